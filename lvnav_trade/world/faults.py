"""Faults that a campaign names: what fails, when, and what that does to satellites and receiver at the epochs."""

from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from lvnav_trade.errors import InputError, Mistake
from lvnav_trade.records import Floats
from lvnav_trade.units import Acceleration, AngularRate, Card, Duration, Length, LengthSigma, Pause, Speed, distinct
from lvnav_trade.world.events import resolve

Mask = NDArray[np.bool_]

ROUNDING = 1e-6  # s; an epoch that rounding has moved by less still lies on the fault's edge


Names = Annotated[tuple[str, ...], AfterValidator(distinct)]


class Timed(Card):
    """What every fault has: when it starts, and how long it lasts."""

    start: str = Field(description="time such as '100 s', or relative to an event: 'stage1_cutoff + 20 s'")
    duration: Pause


class SatelliteOutage(Timed):
    """All satellites lost, or all but `keep` (the highest at the start of the outage)."""

    kind: Literal["satellite_outage"] = "satellite_outage"
    keep: int = Field(0, ge=0)


class AntennaFailure(Timed):
    """Antennas that receive nothing, by their numbers from 1 in the receiver's list."""

    kind: Literal["antenna_failure"] = "antenna_failure"
    antennas: Annotated[tuple[Annotated[int, Field(ge=1)], ...], AfterValidator(distinct)] = Field(min_length=1)


class DegradedNoise(Timed):
    """White noise of the measurements grown by a factor; the filter does not know it."""

    kind: Literal["degraded_noise"] = "degraded_noise"
    factor: float = Field(gt=0.0)
    satellites: Names = Field((), description="such as G05; all, and the solution, if empty")


class RangeBias(Timed):
    """Pseudoranges of some satellites wrong by a step and a drift (a satellite's clock that runs away)."""

    kind: Literal["range_bias"] = "range_bias"
    satellites: Names = Field((), description="such as G05; the highest at the start if empty")
    size: Length = 0.0
    drift: Speed = 0.0


class ClockJump(Card):
    """The receiver's clock jumps by so much range, once."""

    kind: Literal["clock_jump"] = "clock_jump"
    start: str = Field(description="time, or relative to an event")
    size: Length

    @property
    def duration(self) -> float:
        """A jump takes no time."""
        return 0.0


class WildSamples(Timed):
    """Measurements with a further random error, new at every epoch: ranges, or each axis of the solution."""

    kind: Literal["wild_samples"] = "wild_samples"
    sigma: LengthSigma
    satellites: Names = Field((), description="such as G05; all if empty")


class FrozenOutput(Timed):
    """The receiver goes on putting out what it measured when the fault began."""

    kind: Literal["frozen_output"] = "frozen_output"


class InvalidOutput(Timed):
    """The receiver's own checks (checksum, hardware, time synchronisation) mark its output as invalid; a filter whose
    logic does not ask for them uses it all the same.
    """

    kind: Literal["invalid_output"] = "invalid_output"


class LatencyChange(Timed):
    """Measurements arrive later than the filter knows."""

    kind: Literal["latency_change"] = "latency_change"
    by: Duration


class GyroBiasStep(Timed):
    """A step of the gyros' bias, body axes."""

    kind: Literal["gyro_bias_step"] = "gyro_bias_step"
    size: tuple[AngularRate, AngularRate, AngularRate]


class AccelBiasStep(Timed):
    """A step of the accelerometers' bias, body axes."""

    kind: Literal["accel_bias_step"] = "accel_bias_step"
    size: tuple[Acceleration, Acceleration, Acceleration]


class DroppedSamples(Timed):
    """Increments of the inertial unit that do not arrive; the strapdown sees none, or the last one again."""

    kind: Literal["dropped_samples"] = "dropped_samples"
    instead: Literal["nothing", "last"] = "nothing"


AnyFault = (
    SatelliteOutage
    | AntennaFailure
    | DegradedNoise
    | RangeBias
    | ClockJump
    | WildSamples
    | FrozenOutput
    | InvalidOutput
    | LatencyChange
    | GyroBiasStep
    | AccelBiasStep
    | DroppedSamples
)
Fault = Annotated[AnyFault, Field(discriminator="kind")]


class Failures(NamedTuple):
    """What faults do at the epochs. noise (n_epoch, n_sat) factor on white noise, solution_noise (n_epoch,); bias and
    drift (n_epoch, n_sat) m and m/s in range and its rate; jump (n_epoch,) m of the clock at this epoch; wild (n_epoch,
    n_sat) and solution_wild (n_epoch,) sigma (m); frozen, invalid (n_epoch,).
    """

    noise: Floats
    solution_noise: Floats
    bias: Floats
    drift: Floats
    jump: Floats
    wild: Floats
    solution_wild: Floats
    frozen: Mask
    invalid: Mask


def _about(number: int, field: str, message: str) -> InputError:
    return InputError(records=[Mistake(message, f"faults.{number}.{field}")])


def missing_antenna(number: int, n_antenna: int) -> str:
    """Say that a receiver has no antenna of this number."""
    if n_antenna == 0:
        return "the receiver has no antennas; it sees all satellites above its mask"
    return f"antenna {number}: the receiver has {n_antenna}, counted from 1"


def missing_satellite(name: str, names: Sequence[str]) -> str:
    """Say that a constellation has no satellite of this name, and how its own are called."""
    more = f" and {len(names) - 4} more" if len(names) > 4 else ""
    return f"{name!r} is not in the constellation (it has {', '.join(names[:4])}{more})"


def span(number: int, fault: AnyFault, events: dict[str, float]) -> tuple[float, float]:
    """Return start (included) and end (excluded) of a fault in s; InputError names it where its start is unknown."""
    try:
        start = float(resolve(fault.start, events))
    except InputError as error:
        raise _about(number, "start", str(error)) from None
    return start, start + fault.duration


def active(faults: Sequence[AnyFault], kind: type[Card], events: dict[str, float], t: Floats) -> Iterable[Any]:
    """Yield number (from 0), card, mask (n_epoch,) of the epochs at which it holds, and start (s) of faults of a kind.

    InputError where a start cannot be resolved, or a fault lies wholly before or after the epochs.
    """
    for number, fault in enumerate(faults):
        start, end = span(number, fault, events)
        if t.size and (end < t[0] - ROUNDING or t[-1] + ROUNDING < start):
            what = "outage" if isinstance(fault, SatelliteOutage) else fault.kind.replace("_", " ")
            where = f"lies outside the flight ({t[0]:g} s to {t[-1]:g} s)"
            raise _about(number, "start", f"the {what} from {start:g} s to {end:g} s {where}")
        if isinstance(fault, kind):
            yield number, fault, (t >= start - ROUNDING) & (t < end - ROUNDING), start


def lost(faults: Sequence[AnyFault], events: dict[str, float], t: Floats, elevation: Floats, visible: Mask) -> Mask:
    """Return which satellites outages take away, (n_epoch, n_sat) bool.

    A fault holds from its start (included) to its end (excluded); where several hold, each takes its share. events:
    times (s) that a start may refer to; t (n_epoch,) s, rising; elevation (n_epoch, n_sat) rad; visible: whether the
    satellite could be tracked without any fault. InputError as of `active`.
    """
    gone = np.zeros_like(visible)
    for _, fault, within, _ in active(faults, SatelliteOutage, events, t):
        if np.any(within):
            first = int(np.argmax(within))
            gone |= within[:, None] & ~highest(elevation[first], visible[first], fault.keep)
    return gone


def antennas_alive(faults: Sequence[AnyFault], events: dict[str, float], t: Floats, n_antenna: int) -> Mask:
    """Return which antennas receive, (n_epoch, n_antenna) bool; InputError where a fault names one that is none."""
    alive = np.ones((t.size, n_antenna), dtype=bool)
    for number, fault, _, start in active(faults, AntennaFailure, events, t):
        # what is said of an epoch holds since the epoch before, so the one that the failure begins with still has all
        within = (t > start + ROUNDING) & (t <= start + fault.duration + ROUNDING)
        for antenna in fault.antennas:
            if antenna > n_antenna:
                raise _about(number, "antennas", missing_antenna(antenna, n_antenna))
            alive[within, antenna - 1] = False
    return alive


def delay(faults: Sequence[AnyFault], events: dict[str, float], t: Floats) -> Floats:
    """Return by how much later than the filter knows measurements arrive, (n_epoch,) s."""
    late = np.zeros(t.size)
    for _, fault, within, _ in active(faults, LatencyChange, events, t):
        late[within] += fault.by
    return late


def _named(number: int, wanted: tuple[str, ...], names: tuple[str, ...]) -> Mask:
    unknown = [name for name in wanted if name not in names]
    if unknown:
        raise _about(number, "satellites", missing_satellite(unknown[0], names))
    return np.array([not wanted or name in wanted for name in names])


def failures(
    faults: Sequence[AnyFault],
    events: dict[str, float],
    t: Floats,
    names: tuple[str, ...],
    elevation: Floats,
    tracked: Mask,
) -> Failures:
    """Return what faults do to the measurements at the epochs t (n_epoch,) s, rising; names (n_sat,); elevation (rad)
    and tracked (n_epoch, n_sat).
    """
    n, shape = t.size, (t.size, len(names))
    bias, drift, jump, wild, solution_wild = (np.zeros(size) for size in (shape, shape, n, shape, n))
    frozen, invalid = np.zeros((2, n), dtype=bool)
    out = Failures(np.ones(shape), np.ones(n), bias, drift, jump, wild, solution_wild, frozen, invalid)
    for number, fault, within, _ in active(faults, DegradedNoise, events, t):
        out.noise[np.ix_(within, _named(number, fault.satellites, names))] *= fault.factor
        out.solution_noise[within] *= 1.0 if fault.satellites else fault.factor
    for number, fault, within, start in active(faults, RangeBias, events, t):
        hit = _named(number, fault.satellites, names)
        if not fault.satellites and np.any(within):
            first = int(np.argmax(within))
            hit = np.asarray(highest(elevation[first], tracked[first], 1))
        bias[np.ix_(within, hit)] += (fault.size + fault.drift * (t[within] - start))[:, None]
        drift[np.ix_(within, hit)] += fault.drift
    for _, fault, _, start in active(faults, ClockJump, events, t):
        jump[min(int(np.searchsorted(t, start - ROUNDING)), n - 1)] += fault.size
    for number, fault, within, _ in active(faults, WildSamples, events, t):
        struck = np.ix_(within, _named(number, fault.satellites, names))
        wild[struck] = np.hypot(wild[struck], fault.sigma)
        solution_wild[within] = np.hypot(solution_wild[within], fault.sigma)
    for _, _, within, _ in active(faults, FrozenOutput, events, t):
        frozen |= within
    frozen[:1] = False  # there is nothing yet to be held
    for _, _, within, _ in active(faults, InvalidOutput, events, t):
        invalid |= within
    return out


def highest(elevation: Floats, candidates: Mask, count: int) -> Any:
    """Return which of the candidates are the `count` highest, along the last axis; equal heights keep their order.

    elevation (..., n_sat) rad; candidates (..., n_sat) bool; all candidates where they are no more than `count`.
    """
    order = np.argsort(np.where(candidates, -elevation, np.inf), axis=-1, kind="stable")
    rank = np.argsort(order, axis=-1, kind="stable")
    return candidates & (rank < count)
