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
    missing_antenna,
    missing_satellite,
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
            intervals = course.holding(fault)[:1]
            return tuple((course.begin(first), course.begin(first)) for first, _ in intervals)
        if start is None or fault.duration is None:
            return course.holding(fault)
        timed = ((start, start + fault.duration),)
        if not fault.stated:
            return timed
        return both(timed, course.holding(fault))
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
        if t.size and all(end < t[0] - ROUNDING or t[-1] + ROUNDING < start for start, end in intervals):
            field = "start" if fault.start else fault.stated[0]
            raise _about(number, field, _outside(fault, intervals, t))
        if isinstance(fault, kind):
            for start, end in intervals:
                mask = inside(((start, end),), t)
                yield number, fault, mask, course.begin(start), end


def _outside(fault: AnyFault, intervals: Intervals, t: Floats) -> str:
    """Return the message that a fault lies outside the flight."""
    name = "outage" if isinstance(fault, SatelliteOutage) else fault.kind.replace("_", " ")
    period = f" from {intervals[0][0]:g} s to {intervals[0][1]:g} s" if intervals else ""
    return f"the {name}{period} lies outside the flight ({t[0]:g} s to {t[-1]:g} s)"


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
    lost_satellites = np.zeros_like(visible)
    for number, fault, mask, *_ in active(faults, SatelliteOutage, course, t):
        if np.any(mask):
            first = int(np.argmax(mask))
            remaining = highest(elevation[first], visible[first], fault.keep)
            lost_satellites |= _affected(number, fault, mask, elevation, visible) & ~remaining
    return lost_satellites


def antennas_alive(faults: Sequence[AnyFault], course: FlightProfile, t: Floats, n_antenna: int) -> Mask:
    """Return which antennas work, (n_epoch, n_antenna) bool; InputError if a fault names an antenna that is missing."""
    alive = np.ones((t.size, n_antenna), dtype=bool)
    for number, fault, _, start, end in active(faults, AntennaFailure, course, t):
        # an epoch describes the interval before it, so that the epoch at which the failure starts is not affected
        affected = (t > start + ROUNDING) & (t <= end + ROUNDING)
        for antenna in fault.antennas:
            if antenna > n_antenna:
                raise _about(number, "antennas", missing_antenna(antenna, n_antenna))
            alive[affected, antenna - 1] = False
    return alive


def delay(faults: Sequence[AnyFault], course: FlightProfile, t: Floats) -> Floats:
    """Return the latency of the measurements beyond the latency assumed by the filter, (n_epoch,) s."""
    latency = np.zeros(t.size)
    for _, fault, mask, *_ in active(faults, LatencyChange, course, t):
        latency[mask] += fault.by
    return latency


def _named(number: int, satellites: tuple[str, ...], names: tuple[str, ...]) -> Mask:
    """Return which satellites (n_sat,) a fault names, all if it names none; InputError if one is unknown."""
    unknown = [name for name in satellites if name not in names]
    if unknown:
        raise _about(number, "satellites", missing_satellite(unknown[0], names))
    return np.array([not satellites or name in satellites for name in names])


def _affected(number: int, fault: TimedSatelliteFault, mask: Mask, elevation: Floats, candidates: Mask) -> Mask:
    """Return which satellites an active fault affects by their elevation, (n_epoch, n_sat) bool.

    InputError if it would affect none of the candidates (n_epoch, n_sat) at any time of the flight.
    """
    in_elevation = fault.sights(elevation)
    if fault.by_elevation and mask.size and not np.any(in_elevation & candidates):
        raise _about(number, fault.by_elevation[0], "holds for no satellite that is received on the flight")
    return mask[:, None] & in_elevation


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
            first = _first_epoch(t, start)
            is_highest = np.asarray(highest(elevation[first], tracked[first], 1))
            affected = tuple(np.array(names)[is_highest].tolist())
        satellites.append(affected)
    return satellites


def _first_epoch(t: Floats, start: float) -> int:
    """Return the index of the first epoch at or after a time, the last epoch if there is none."""
    return min(int(np.searchsorted(t, start - ROUNDING)), t.size - 1)


class _FaultCase(NamedTuple):
    """Faults of a case, the flight and the satellites; fields as the parameters of `failures`."""

    faults: Sequence[AnyFault]
    course: FlightProfile
    t: Floats
    names: tuple[str, ...]
    elevation: Floats
    tracked: Mask

    def active(self, kind: type[Card]) -> Iterable[Any]:
        """Return the active intervals of the faults of a class, see `active`."""
        return active(self.faults, kind, self.course, self.t)

    def affected(self, number: int, fault: TimedSatelliteFault, mask: Mask) -> Mask:
        """Return which satellites an active fault affects by their elevation, (n_epoch, n_sat) bool."""
        return _affected(number, fault, mask, self.elevation, self.tracked)

    def named(self, number: int, fault: Any) -> Mask:
        """Return which satellites (n_sat,) a fault names, all if it names none."""
        return _named(number, fault.satellites, self.names)

    def highest(self, epoch: int) -> Mask:
        """Return the highest tracked satellite of an epoch, (n_sat,) bool."""
        return np.asarray(highest(self.elevation[epoch], self.tracked[epoch], 1))


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
    case = _FaultCase(faults, course, t, names, elevation, tracked)
    effects = _no_failures(t.size, len(names))
    _scale_noise(case, effects)
    _add_range_biases(case, effects)
    _add_slips(case, effects)
    _add_clock_faults(case, effects)
    _add_wild_samples(case, effects)
    _set_output_faults(case, effects)
    return effects


def _no_failures(n_epoch: int, n_sat: int) -> Failures:
    """Return the effects of no fault, to which those of faults are added."""
    shape = (n_epoch, n_sat)
    return Failures(
        noise=np.ones(shape),
        solution_noise=np.ones(n_epoch),
        bias=np.zeros(shape),
        drift=np.zeros(shape),
        slip=np.zeros(shape),
        jump=np.zeros((n_epoch, 2)),
        wild=np.zeros(shape),
        solution_wild=np.zeros(n_epoch),
        frozen=np.zeros(n_epoch, dtype=bool),
        invalid=np.zeros((n_epoch, len(FLAGS)), dtype=bool),
    )


def _scale_noise(case: _FaultCase, effects: Failures) -> None:
    """Multiply the noise of measurements and solution by the factors of degraded noise."""
    for number, fault, mask, *_ in case.active(DegradedNoise):
        affected = case.affected(number, fault, mask) & case.named(number, fault)
        effects.noise[affected] *= fault.factor
        of_all_satellites = not fault.satellites and not fault.by_elevation
        if of_all_satellites:
            effects.solution_noise[mask] *= fault.factor


def _add_range_biases(case: _FaultCase, effects: Failures) -> None:
    """Add the errors of range and range rate of biased satellites: those named, or the highest at the start."""
    for number, fault, mask, start, _ in case.active(RangeBias):
        biased = case.named(number, fault)
        if not fault.satellites and np.any(mask):
            biased = case.highest(int(np.argmax(mask)))
        affected = case.affected(number, fault, mask) & biased
        size = fault.size + fault.drift * (case.t - start)
        effects.bias[...] += np.where(affected, size[:, None], 0.0)
        effects.drift[affected] += fault.drift


def _add_slips(case: _FaultCase, effects: Failures) -> None:
    """Add cycle slips of the satellites named, or of the highest at the time of the slip, from that epoch on."""
    for number, fault, _, start, _ in case.active(CycleSlip):
        first = _first_epoch(case.t, start)
        named = case.named(number, fault)
        slipping = named if fault.satellites else case.highest(first)
        effects.slip[first:] += fault.size * slipping


def _add_clock_faults(case: _FaultCase, effects: Failures) -> None:
    """Add jumps of the receiver's clock, and changes of its drift at start and end of a fault."""
    for _, fault, _, start, _ in case.active(ClockJump):
        effects.jump[_first_epoch(case.t, start), 0] += fault.size
    for _, fault, _, start, end in case.active(ClockDrift):
        _add_drift(effects.jump, case.t, start, fault.rate)
        _add_drift(effects.jump, case.t, end, -fault.rate)


def _add_wild_samples(case: _FaultCase, effects: Failures) -> None:
    """Add the sigmas of wild ranges and solutions; sigmas of several faults add in quadrature."""
    for number, fault, mask, *_ in case.active(WildSamples):
        affected = case.affected(number, fault, mask) & case.named(number, fault)
        effects.wild[affected] = np.hypot(effects.wild[affected], fault.sigma)
        if not fault.by_elevation:
            effects.solution_wild[mask] = np.hypot(effects.solution_wild[mask], fault.sigma)


def _set_output_faults(case: _FaultCase, effects: Failures) -> None:
    """Set the epochs with repeated output and with flags of the receiver."""
    for _, _, mask, *_ in case.active(FrozenOutput):
        effects.frozen[mask] = True
    effects.frozen[:1] = False  # the first epoch has no earlier output to repeat
    for _, fault, mask, *_ in case.active(InvalidOutput):
        effects.invalid[mask, FLAGS.index(fault.flag)] = True


def _add_drift(jump: Floats, t: Floats, since: float, rate: float) -> None:
    """Add a clock drift from a time on: at the next epoch the drift changes, and the bias by the drift accumulated."""
    if since <= t[-1] + ROUNDING:
        first = int(np.searchsorted(t, since - ROUNDING))
        seconds = max(0.0, t[first] - since)
        jump[first, 0] += rate * seconds
        jump[first, 1] += rate


def highest(elevation: Floats, candidates: Mask, count: int) -> Any:
    """Return which candidates have the `count` highest elevations along the last axis, (..., n_sat) bool.

    Equal elevations are taken in order. With no more than `count` candidates the result is all of them.

    elevation : (..., n_sat) rad
    candidates : (..., n_sat) bool
    """
    order = np.argsort(np.where(candidates, -elevation, np.inf), axis=-1, kind="stable")
    rank = np.argsort(order, axis=-1, kind="stable")
    return candidates & (rank < count)
