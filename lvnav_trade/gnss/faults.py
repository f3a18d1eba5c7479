"""Faults of a case: when they are active, and their effects on satellites and receiver at the epochs."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.gnss.fault_cards import (
    AntennaFailure,
    AnyFault,
    ClockDrift,
    ClockJump,
    CycleSlip,
    DegradedNoise,
    FrozenOutput,
    InvalidOutput,
    JumpFault,
    LatencyChange,
    RangeBias,
    SatelliteOutage,
    TimedSatelliteFault,
    WildSamples,
)
from lvnav_trade.quantities.conditions import ROUNDING, FlightProfile, Intervals, both, inside
from lvnav_trade.quantities.errors import InputError, Mistake
from lvnav_trade.quantities.records import FLAGS, Floats
from lvnav_trade.quantities.units import Card

Mask = NDArray[np.bool_]


class Failures(NamedTuple):
    """Effects of faults on the receiver at the epochs.

    noise : (n_epoch, n_sat). Factor on the white noise of the satellite's measurements.
    solution_noise : (n_epoch,). Factor on the white noise of the receiver's solution.
    bias : (n_epoch, n_sat) m. Error of the range.
    drift : (n_epoch, n_sat) m/s. Error of the range rate.
    slip : (n_epoch, n_sat) cycles. Accumulated slips of the carrier phase.
    jump : (n_epoch, 2) m, m/s. Jump of clock bias and drift at this epoch.
    wild : (n_epoch, n_sat) m. Sigma of wild ranges.
    solution_wild : (n_epoch,) m. Sigma of wild solutions.
    frozen : (n_epoch,). Whether the receiver repeats its last output.
    invalid : (n_epoch, n_flag). Whether the receiver raises the flag, in the order of `records.FLAGS`.
    """

    noise: Floats
    solution_noise: Floats
    bias: Floats
    drift: Floats
    slip: Floats
    jump: Floats
    wild: Floats
    solution_wild: Floats
    frozen: Mask
    invalid: Mask


def _about(number: int, field: str, message: str) -> InputError:
    return InputError(records=[Mistake(message, f"faults.{number}.{field}")])


def missing_antenna(number: int, n_antenna: int) -> str:
    """Return the message that a receiver has no antenna of this number."""
    if n_antenna == 0:
        return "the receiver has no antennas; it sees all satellites above its mask"
    return f"antenna {number}: the receiver has {n_antenna}, counted from 1"


def missing_axis(number: int, n_axis: int) -> str:
    """Return the message that an IMU has no sensing axis of this number."""
    return f"axis {number}: the unit has {n_axis}, counted from 1"


def missing_satellite(name: str, names: Sequence[str]) -> str:
    """Return the message that a constellation has no satellite of this name, with some of its names."""
    more = f" and {len(names) - 4} more" if len(names) > 4 else ""
    return f"{name!r} is not in the constellation (it has {', '.join(names[:4])}{more})"


def periods(number: int, fault: AnyFault, course: FlightProfile) -> Intervals:
    """Return the intervals (s) in which a fault is active.

    A jump has one interval of zero length, at which it occurs.

    Parameters
    ----------
    number : int
        Index of the fault in the scenario, for messages.
    fault : card
    course : FlightProfile
        The flight, for its events and conditions.

    Raises
    ------
    InputError
        The flight has no such event. The path names the fault.
    """
    try:
        start = None if fault.start is None else course.time(fault.start, "start")
        if isinstance(fault, JumpFault):
            if start is not None:
                return ((start, start),)
            return tuple((course.begin(first), course.begin(first)) for first, _ in course.holding(fault)[:1])
        if start is None or fault.duration is None:
            return course.holding(fault)
        timed = (start, start + fault.duration)
        return both((timed,), course.holding(fault)) if fault.stated else (timed,)
    except InputError as error:
        raise _about(number, error.records[0].path, error.records[0].message) from None


def active(faults: Sequence[AnyFault], kind: type[Card], course: FlightProfile, t: Floats) -> Iterable[Any]:
    """Yield every active interval of the faults of a class.

    Parameters
    ----------
    faults : sequence of fault cards
        All faults of the scenario.
    kind : type
        Class of the cards to yield.
    course : FlightProfile
    t : (n_epoch,) s
        Epochs, rising.

    Yields
    ------
    number : int
        Index of the fault, from 0.
    fault : card
    mask : (n_epoch,) bool
        Epochs at which the fault is active.
    start, end : float
        Interval (s).

    Raises
    ------
    InputError
        A start cannot be resolved, or a fault of any class lies outside the flight.
    """
    for number, fault in enumerate(faults):
        intervals = periods(number, fault, course)
        if t.size and not any(end >= t[0] - ROUNDING and t[-1] + ROUNDING >= start for start, end in intervals):
            raise _about(number, "start" if fault.start else fault.stated[0], _outside(fault, intervals, t))
        if isinstance(fault, kind):
            for start, end in intervals:
                yield number, fault, inside(((start, end),), t), course.begin(start), end


def _outside(fault: AnyFault, intervals: Intervals, t: Floats) -> str:
    what = "outage" if isinstance(fault, SatelliteOutage) else fault.kind.replace("_", " ")
    when = f" from {intervals[0][0]:g} s to {intervals[0][1]:g} s" if intervals else ""
    return f"the {what}{when} lies outside the flight ({t[0]:g} s to {t[-1]:g} s)"


def lost(faults: Sequence[AnyFault], course: FlightProfile, t: Floats, elevation: Floats, visible: Mask) -> Mask:
    """Return which satellites are lost to outages, (n_epoch, n_sat) bool.

    Outages that overlap add up: a satellite is lost if any of them removes it.

    Parameters
    ----------
    faults, course : as in `active`
    t : (n_epoch,) s
        Epochs, rising.
    elevation : (n_epoch, n_sat) rad
    visible : (n_epoch, n_sat) bool
        Whether the satellite could be tracked without faults.

    Raises
    ------
    InputError
        As in `active`.
    """
    gone = np.zeros_like(visible)
    for number, fault, within, *_ in active(faults, SatelliteOutage, course, t):
        if np.any(within):
            first = int(np.argmax(within))
            affected = _affected(number, fault, within, elevation, visible)
            gone |= affected & ~highest(elevation[first], visible[first], fault.keep)
    return gone


def antennas_alive(faults: Sequence[AnyFault], course: FlightProfile, t: Floats, n_antenna: int) -> Mask:
    """Return which antennas work, (n_epoch, n_antenna) bool; InputError if a fault names an antenna that is missing."""
    alive = np.ones((t.size, n_antenna), dtype=bool)
    for number, fault, _, start, end in active(faults, AntennaFailure, course, t):
        # an epoch describes the interval before it, so that the epoch at which the failure starts is not affected
        within = (t > start + ROUNDING) & (t <= end + ROUNDING)
        for antenna in fault.antennas:
            if antenna > n_antenna:
                raise _about(number, "antennas", missing_antenna(antenna, n_antenna))
            alive[within, antenna - 1] = False
    return alive


def delay(faults: Sequence[AnyFault], course: FlightProfile, t: Floats) -> Floats:
    """Return the latency of the measurements beyond the latency assumed by the filter, (n_epoch,) s."""
    late = np.zeros(t.size)
    for _, fault, within, *_ in active(faults, LatencyChange, course, t):
        late[within] += fault.by
    return late


def _named(number: int, wanted: tuple[str, ...], names: tuple[str, ...]) -> Mask:
    unknown = [name for name in wanted if name not in names]
    if unknown:
        raise _about(number, "satellites", missing_satellite(unknown[0], names))
    return np.array([not wanted or name in wanted for name in names])


def _affected(number: int, fault: TimedSatelliteFault, within: Mask, elevation: Floats, candidates: Mask) -> Mask:
    """Return which satellites an active fault affects by their elevation, (n_epoch, n_sat) bool.

    InputError if it would affect none of the candidates (n_epoch, n_sat) at any time of the flight.
    """
    sighted = fault.sights(elevation)
    if fault.by_elevation and within.size and not np.any(sighted & candidates):
        raise _about(number, fault.by_elevation[0], "holds for no satellite that is received on the flight")
    return within[:, None] & sighted


def singled_out(
    faults: Sequence[AnyFault],
    course: FlightProfile,
    t: Floats,
    names: tuple[str, ...],
    elevation: Floats,
    tracked: Mask,
) -> list[tuple[str, ...]]:
    """Return the names of the satellites that each fault affects individually.

    They are those that the card names, or the highest at the start of the fault. A fault of all satellites or of the
    receiver has none. Parameters are those of `failures`.
    """
    satellites = []
    for number, fault in enumerate(faults):
        affected = tuple(getattr(fault, "satellites", ()))
        if not affected and isinstance(fault, RangeBias | CycleSlip) and t.size:
            start = min((begin for begin, _ in periods(number, fault, course)), default=t[0])
            first = min(int(np.searchsorted(t, start - ROUNDING)), t.size - 1)
            affected = tuple(np.array(names)[np.asarray(highest(elevation[first], tracked[first], 1))].tolist())
        satellites.append(affected)
    return satellites


def failures(
    faults: Sequence[AnyFault],
    course: FlightProfile,
    t: Floats,
    names: tuple[str, ...],
    elevation: Floats,
    tracked: Mask,
) -> Failures:
    """Return the effects of faults on the measurements at the epochs.

    Parameters
    ----------
    faults, course, t : as in `active`
    names : (n_sat,)
        Names of the satellites.
    elevation : (n_epoch, n_sat) rad
    tracked : (n_epoch, n_sat) bool

    Raises
    ------
    InputError
        As in `active`, or a fault names a satellite that the constellation does not have.
    """
    n, shape = t.size, (t.size, len(names))
    bias, drift, slip, jump, wild, solution_wild = (np.zeros(size) for size in (shape, shape, shape, (n, 2), shape, n))
    frozen, invalid = np.zeros(n, dtype=bool), np.zeros((n, len(FLAGS)), dtype=bool)
    out = Failures(np.ones(shape), np.ones(n), bias, drift, slip, jump, wild, solution_wild, frozen, invalid)
    for number, fault, within, *_ in active(faults, DegradedNoise, course, t):
        affected = _affected(number, fault, within, elevation, tracked) & _named(number, fault.satellites, names)
        out.noise[affected] *= fault.factor
        out.solution_noise[within] *= 1.0 if fault.satellites or fault.by_elevation else fault.factor
    for number, fault, within, start, _ in active(faults, RangeBias, course, t):
        hit = _named(number, fault.satellites, names)
        if not fault.satellites and np.any(within):
            first = int(np.argmax(within))
            hit = np.asarray(highest(elevation[first], tracked[first], 1))
        affected = _affected(number, fault, within, elevation, tracked) & hit
        bias += np.where(affected, (fault.size + fault.drift * (t - start))[:, None], 0.0)
        drift[affected] += fault.drift
    for number, fault, _, start, _ in active(faults, CycleSlip, course, t):
        first = min(int(np.searchsorted(t, start - ROUNDING)), n - 1)
        hit = _named(number, fault.satellites, names)
        slip[first:] += fault.size * (hit if fault.satellites else highest(elevation[first], tracked[first], 1))
    for _, fault, _, start, _ in active(faults, ClockJump, course, t):
        jump[min(int(np.searchsorted(t, start - ROUNDING)), n - 1), 0] += fault.size
    for _, fault, _, start, end in active(faults, ClockDrift, course, t):
        _add_drift(jump, t, start, fault.rate)
        _add_drift(jump, t, end, -fault.rate)
    for number, fault, within, *_ in active(faults, WildSamples, course, t):
        affected = _affected(number, fault, within, elevation, tracked) & _named(number, fault.satellites, names)
        wild[affected] = np.hypot(wild[affected], fault.sigma)
        if not fault.by_elevation:
            solution_wild[within] = np.hypot(solution_wild[within], fault.sigma)
    for _, _, within, *_ in active(faults, FrozenOutput, course, t):
        frozen |= within
    frozen[:1] = False  # the first epoch has no earlier output to repeat
    for _, fault, within, *_ in active(faults, InvalidOutput, course, t):
        invalid[within, FLAGS.index(fault.flag)] = True
    return out


def _add_drift(jump: Floats, t: Floats, since: float, rate: float) -> None:
    """Add a clock drift from a time on: at the next epoch the drift changes, and the bias by the drift accumulated."""
    if since <= t[-1] + ROUNDING:
        first = int(np.searchsorted(t, since - ROUNDING))
        jump[first] += rate * max(0.0, t[first] - since), rate


def highest(elevation: Floats, candidates: Mask, count: int) -> Any:
    """Return which candidates have the `count` highest elevations along the last axis, (..., n_sat) bool.

    Equal elevations are taken in order. With no more than `count` candidates the result is all of them.

    elevation : (..., n_sat) rad
    candidates : (..., n_sat) bool
    """
    order = np.argsort(np.where(candidates, -elevation, np.inf), axis=-1, kind="stable")
    rank = np.argsort(order, axis=-1, kind="stable")
    return candidates & (rank < count)
