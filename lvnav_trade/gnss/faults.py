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
from lvnav_trade.quantities.conditions import ROUNDING, FlightProfile, Intervals, intersection, is_inside
from lvnav_trade.quantities.errors import InputError, Mistake
from lvnav_trade.quantities.records import FLAGS, Floats
from lvnav_trade.quantities.units import Card

Mask = NDArray[np.bool_]


class FaultEffects(NamedTuple):
    """Effects of faults on the receiver at the epochs.

    noise : (n_epoch, n_sat). Factor on the white noise of the satellite's measurements.
    solution_noise : (n_epoch,). Factor on the white noise of the receiver's solution.
    bias : (n_epoch, n_sat) m. Error of the range.
    drift : (n_epoch, n_sat) m/s. Error of the range rate.
    slip : (n_epoch, n_sat) cycles. Accumulated slips of the carrier phase.
    jump : (n_epoch, 2) m, m/s. Jump of clock bias and drift at this epoch.
    wild_sigma : (n_epoch, n_sat) m. Sigma of wild ranges.
    solution_wild_sigma : (n_epoch,) m. Sigma of wild solutions.
    is_frozen : (n_epoch,). Whether the receiver repeats its last output.
    raised_flags : (n_epoch, n_flag). Whether the receiver raises the flag, in the order of `records.FLAGS`.
    """

    noise: Floats
    solution_noise: Floats
    bias: Floats
    drift: Floats
    slip: Floats
    jump: Floats
    wild_sigma: Floats
    solution_wild_sigma: Floats
    is_frozen: Mask
    raised_flags: Mask


def _fault_error(number: int, field: str, message: str) -> InputError:
    return InputError(records=[Mistake(message, f"faults.{number}.{field}")])


def periods(number: int, fault: AnyFault, flight_profile: FlightProfile) -> Intervals:
    """Return the intervals (s) in which a fault is active.

    A jump has one interval of zero length, at which it occurs.

    Parameters
    ----------
    number : int
        Index of the fault in the scenario, for messages.
    fault : card
    flight_profile : FlightProfile
        The flight, for its events and conditions.

    Raises
    ------
    InputError
        The flight has no such event. The path names the fault.
    """
    try:
        start = None if fault.start is None else flight_profile.time(fault.start, "start")
        if isinstance(fault, JumpFault):
            if start is not None:
                return ((start, start),)
            intervals = flight_profile.active_intervals(fault)[:1]
            return tuple((flight_profile.begin(first), flight_profile.begin(first)) for first, _ in intervals)
        if start is None or fault.duration is None:
            return flight_profile.active_intervals(fault)
        fault_interval = ((start, start + fault.duration),)
        if not fault.condition_keys:
            return fault_interval
        return intersection(fault_interval, flight_profile.active_intervals(fault))
    except InputError as error:
        raise _fault_error(number, error.records[0].path, error.records[0].message) from None


def active_intervals(
    faults: Sequence[AnyFault], fault_class: type[Card], flight_profile: FlightProfile, t: Floats
) -> Iterable[Any]:
    """Yield every active interval of the faults of a class.

    Parameters
    ----------
    faults : sequence of fault cards
        All faults of the scenario.
    fault_class : type
        Class of the cards to yield.
    flight_profile : FlightProfile
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
        intervals = periods(number, fault, flight_profile)
        if t.size and all(end < t[0] - ROUNDING or t[-1] + ROUNDING < start for start, end in intervals):
            field = "start" if fault.start else fault.condition_keys[0]
            raise _fault_error(number, field, _outside_message(fault, intervals, t))
        if isinstance(fault, fault_class):
            for start, end in intervals:
                mask = is_inside(((start, end),), t)
                yield number, fault, mask, flight_profile.begin(start), end


def _outside_message(fault: AnyFault, intervals: Intervals, t: Floats) -> str:
    """Return the message that a fault lies outside the flight."""
    name = "outage" if isinstance(fault, SatelliteOutage) else fault.kind.replace("_", " ")
    period = f" from {intervals[0][0]:g} s to {intervals[0][1]:g} s" if intervals else ""
    return f"the {name}{period} lies outside the flight ({t[0]:g} s to {t[-1]:g} s)"


def satellite_outages(
    faults: Sequence[AnyFault], flight_profile: FlightProfile, t: Floats, elevation: Floats, is_visible: Mask
) -> Mask:
    """Return which satellites are lost to outages, (n_epoch, n_sat) bool.

    Outages that overlap add up: a satellite is lost if any of them removes it.

    Parameters
    ----------
    faults, flight_profile : as in `active_intervals`
    t : (n_epoch,) s
        Epochs, rising.
    elevation : (n_epoch, n_sat) rad
    is_visible : (n_epoch, n_sat) bool
        Whether the satellite could be tracked without faults.

    Raises
    ------
    InputError
        As in `active_intervals`.
    """
    lost_satellites = np.zeros_like(is_visible)
    for number, fault, mask, *_ in active_intervals(faults, SatelliteOutage, flight_profile, t):
        if np.any(mask):
            first = int(np.argmax(mask))
            remaining = highest(elevation[first], is_visible[first], fault.keep)
            lost_satellites |= _affected_satellites(number, fault, mask, elevation, is_visible) & ~remaining
    return lost_satellites


def antennas_alive(faults: Sequence[AnyFault], flight_profile: FlightProfile, t: Floats, n_antenna: int) -> Mask:
    """Return which antennas work, (n_epoch, n_antenna) bool; InputError if a fault names an antenna that is missing."""
    alive = np.ones((t.size, n_antenna), dtype=bool)
    for number, fault, _, start, end in active_intervals(faults, AntennaFailure, flight_profile, t):
        # an epoch describes the interval before it, so that the epoch at which the failure starts is not affected
        is_affected = (t > start + ROUNDING) & (t <= end + ROUNDING)
        for antenna in fault.antennas:
            if antenna > n_antenna:
                raise _fault_error(number, "antennas", missing_antenna(antenna, n_antenna))
            alive[is_affected, antenna - 1] = False
    return alive


def delay(faults: Sequence[AnyFault], flight_profile: FlightProfile, t: Floats) -> Floats:
    """Return the latency of the measurements beyond the latency assumed by the filter, (n_epoch,) s."""
    latency = np.zeros(t.size)
    for _, fault, mask, *_ in active_intervals(faults, LatencyChange, flight_profile, t):
        latency[mask] += fault.by
    return latency


def _named_satellites(number: int, satellites: tuple[str, ...], names: tuple[str, ...]) -> Mask:
    """Return which satellites (n_sat,) a fault names, all if it names none; InputError if one is unknown."""
    unknown_names = [name for name in satellites if name not in names]
    if unknown_names:
        raise _fault_error(number, "satellites", missing_satellite(unknown_names[0], names))
    return np.array([not satellites or name in satellites for name in names])


def _affected_satellites(
    number: int, fault: TimedSatelliteFault, mask: Mask, elevation: Floats, candidates: Mask
) -> Mask:
    """Return which satellites an active fault affects by their elevation, (n_epoch, n_sat) bool.

    InputError if it would affect none of the candidates (n_epoch, n_sat) at any time of the flight.
    """
    meets_elevation = fault.meets_elevation(elevation)
    if fault.elevation_keys and mask.size and not np.any(meets_elevation & candidates):
        raise _fault_error(number, fault.elevation_keys[0], "holds for no satellite that is received on the flight")
    return mask[:, None] & meets_elevation


def individual_satellites(
    faults: Sequence[AnyFault],
    flight_profile: FlightProfile,
    t: Floats,
    names: tuple[str, ...],
    elevation: Floats,
    is_tracked: Mask,
) -> list[tuple[str, ...]]:
    """Return the names of the satellites that each fault affects individually.

    They are those that the card names, or the highest at the start of the fault. A fault of all satellites or of the
    receiver has none. Parameters are those of `failures`.
    """
    satellites = []
    for number, fault in enumerate(faults):
        fault_satellites = tuple(getattr(fault, "satellites", ()))
        if not fault_satellites and isinstance(fault, RangeBias | CycleSlip) and t.size:
            start = min((begin for begin, _ in periods(number, fault, flight_profile)), default=t[0])
            first = _first_epoch(t, start)
            is_highest = np.asarray(highest(elevation[first], is_tracked[first], 1))
            fault_satellites = tuple(np.array(names)[is_highest].tolist())
        satellites.append(fault_satellites)
    return satellites


def _first_epoch(t: Floats, start: float) -> int:
    """Return the index of the first epoch at or after a time, the last epoch if there is none."""
    return min(int(np.searchsorted(t, start - ROUNDING)), t.size - 1)


class _FaultCase(NamedTuple):
    """Faults of a case, the flight and the satellites; fields as the parameters of `failures`."""

    faults: Sequence[AnyFault]
    flight_profile: FlightProfile
    t: Floats
    names: tuple[str, ...]
    elevation: Floats
    is_tracked: Mask

    def active_intervals(self, fault_class: type[Card]) -> Iterable[Any]:
        """Return the active intervals of the faults of a class, see `active_intervals`."""
        return active_intervals(self.faults, fault_class, self.flight_profile, self.t)

    def affected_satellites(self, number: int, fault: TimedSatelliteFault, mask: Mask) -> Mask:
        """Return which satellites an active fault affects by their elevation, (n_epoch, n_sat) bool."""
        return _affected_satellites(number, fault, mask, self.elevation, self.is_tracked)

    def named_satellites(self, number: int, fault: Any) -> Mask:
        """Return which satellites (n_sat,) a fault names, all if it names none."""
        return _named_satellites(number, fault.satellites, self.names)

    def highest(self, epoch: int) -> Mask:
        """Return the highest tracked satellite of an epoch, (n_sat,) bool."""
        return np.asarray(highest(self.elevation[epoch], self.is_tracked[epoch], 1))


def failures(
    faults: Sequence[AnyFault],
    flight_profile: FlightProfile,
    t: Floats,
    names: tuple[str, ...],
    elevation: Floats,
    is_tracked: Mask,
) -> FaultEffects:
    """Return the effects of faults on the measurements at the epochs.

    Parameters
    ----------
    faults, flight_profile, t : as in `active_intervals`
    names : (n_sat,)
        Names of the satellites.
    elevation : (n_epoch, n_sat) rad
    is_tracked : (n_epoch, n_sat) bool

    Raises
    ------
    InputError
        As in `active_intervals`, or a fault names a satellite that the constellation does not have.
    """
    case = _FaultCase(faults, flight_profile, t, names, elevation, is_tracked)
    effects = _no_failures(t.size, len(names))
    _scale_noise(case, effects)
    _add_range_biases(case, effects)
    _add_slips(case, effects)
    _add_clock_faults(case, effects)
    _add_wild_samples(case, effects)
    _set_output_faults(case, effects)
    return effects


def _no_failures(n_epoch: int, n_sat: int) -> FaultEffects:
    """Return the effects of no fault, to which those of faults are added."""
    shape = (n_epoch, n_sat)
    return FaultEffects(
        noise=np.ones(shape),
        solution_noise=np.ones(n_epoch),
        bias=np.zeros(shape),
        drift=np.zeros(shape),
        slip=np.zeros(shape),
        jump=np.zeros((n_epoch, 2)),
        wild_sigma=np.zeros(shape),
        solution_wild_sigma=np.zeros(n_epoch),
        is_frozen=np.zeros(n_epoch, dtype=bool),
        raised_flags=np.zeros((n_epoch, len(FLAGS)), dtype=bool),
    )


def _scale_noise(case: _FaultCase, effects: FaultEffects) -> None:
    """Multiply the noise of measurements and solution by the factors of degraded noise."""
    for number, fault, mask, *_ in case.active_intervals(DegradedNoise):
        is_affected = case.affected_satellites(number, fault, mask) & case.named_satellites(number, fault)
        effects.noise[is_affected] *= fault.factor
        affects_all = not fault.satellites and not fault.elevation_keys
        if affects_all:
            effects.solution_noise[mask] *= fault.factor


def _add_range_biases(case: _FaultCase, effects: FaultEffects) -> None:
    """Add the errors of range and range rate of biased satellites: those named, or the highest at the start."""
    for number, fault, mask, start, _ in case.active_intervals(RangeBias):
        is_biased = case.named_satellites(number, fault)
        if not fault.satellites and np.any(mask):
            is_biased = case.highest(int(np.argmax(mask)))
        is_affected = case.affected_satellites(number, fault, mask) & is_biased
        size = fault.size + fault.drift * (case.t - start)
        effects.bias[...] += np.where(is_affected, size[:, None], 0.0)
        effects.drift[is_affected] += fault.drift


def _add_slips(case: _FaultCase, effects: FaultEffects) -> None:
    """Add cycle slips of the satellites named, or of the highest at the time of the slip, from that epoch on."""
    for number, fault, _, start, _ in case.active_intervals(CycleSlip):
        first = _first_epoch(case.t, start)
        is_named = case.named_satellites(number, fault)
        has_slip = is_named if fault.satellites else case.highest(first)
        effects.slip[first:] += fault.size * has_slip


def _add_clock_faults(case: _FaultCase, effects: FaultEffects) -> None:
    """Add jumps of the receiver's clock, and changes of its drift at start and end of a fault."""
    for _, fault, _, start, _ in case.active_intervals(ClockJump):
        effects.jump[_first_epoch(case.t, start), 0] += fault.size
    for _, fault, _, start, end in case.active_intervals(ClockDrift):
        _add_drift(effects.jump, case.t, start, fault.rate)
        _add_drift(effects.jump, case.t, end, -fault.rate)


def _add_wild_samples(case: _FaultCase, effects: FaultEffects) -> None:
    """Add the sigmas of wild ranges and solutions; sigmas of several faults add in quadrature."""
    for number, fault, mask, *_ in case.active_intervals(WildSamples):
        is_affected = case.affected_satellites(number, fault, mask) & case.named_satellites(number, fault)
        effects.wild_sigma[is_affected] = np.hypot(effects.wild_sigma[is_affected], fault.sigma)
        if not fault.elevation_keys:
            effects.solution_wild_sigma[mask] = np.hypot(effects.solution_wild_sigma[mask], fault.sigma)


def _set_output_faults(case: _FaultCase, effects: FaultEffects) -> None:
    """Set the epochs with repeated output and with flags of the receiver."""
    for _, _, mask, *_ in case.active_intervals(FrozenOutput):
        effects.is_frozen[mask] = True
    effects.is_frozen[:1] = False  # the first epoch has no earlier output to repeat
    for _, fault, mask, *_ in case.active_intervals(InvalidOutput):
        effects.raised_flags[mask, FLAGS.index(fault.flag)] = True


def _add_drift(jump: Floats, t: Floats, start: float, rate: float) -> None:
    """Add a clock drift from a time on: at the next epoch the drift changes, and the bias by the drift accumulated."""
    if start <= t[-1] + ROUNDING:
        first = int(np.searchsorted(t, start - ROUNDING))
        seconds = max(0.0, t[first] - start)
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
