"""Cards of faults: the failed device or signal, the time, and the size.

Their effects: `faults` (signals and receiver), `interference`, and for IMUs `simulation.preparation.imu` and
`imu_arrays`.
"""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, Field

from lvnav_trade.gnss.link import Pattern
from lvnav_trade.quantities.conditions import Conditions, Instant, SightConditions
from lvnav_trade.quantities.records import FLAGS
from lvnav_trade.quantities.units import (
    Acceleration,
    Angle,
    AngularRate,
    Duration,
    Length,
    LengthSigma,
    Level,
    Pause,
    SignedFraction,
    Speed,
    require_distinct,
)

if TYPE_CHECKING:
    Flag = str
else:
    Flag = Literal[FLAGS]
Names = Annotated[tuple[str, ...], AfterValidator(require_distinct)]


class TimedFault(Conditions):
    """Time of a fault: a start and a duration, or conditions, or both."""

    start: Instant | None = Field(
        None, description="time such as '100 s', or relative to an event: 'stage1_cutoff + 20 s'; with a duration"
    )
    duration: Pause | None = Field(None, description="duration from the start")

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if self.start is None and self.duration is None and not self.condition_keys:
            yield "start: is missing, or a condition such as from or above"
        elif self.start is None and self.duration is not None:
            yield "duration: counts from a start, which is missing: add start, or give until, the time of its end"
        elif self.start is not None and self.duration is None:
            yield "duration: is missing: add it, or give from in place of start, for a fault that lasts to the end"


class TimedSatelliteFault(TimedFault, SightConditions):
    """Time of a fault of satellites, which may depend on their elevation."""


class SatelliteOutage(TimedSatelliteFault):
    """Loss of all satellites, or of all but `keep` (the highest at the start of the outage)."""

    kind: Literal["satellite_outage"] = "satellite_outage"
    keep: int = Field(0, ge=0)


class AntennaFailure(TimedFault):
    """Failure of antennas, given by their numbers from 1 in the receiver's list."""

    kind: Literal["antenna_failure"] = "antenna_failure"
    antennas: Annotated[tuple[Annotated[int, Field(ge=1)], ...], AfterValidator(require_distinct)] = Field(min_length=1)


class DegradedNoise(TimedSatelliteFault):
    """White noise of the measurements multiplied by a factor that the filter does not model."""

    kind: Literal["degraded_noise"] = "degraded_noise"
    factor: float = Field(gt=0.0)
    satellites: Names = Field((), description="satellites such as G05; if empty: all, and the solution")


class RangeBias(TimedSatelliteFault):
    """Step and drift of the pseudoranges of some satellites, as by a failed satellite clock."""

    kind: Literal["range_bias"] = "range_bias"
    satellites: Names = Field((), description="satellites such as G05; if empty: the highest at the start")
    size: Length = 0.0
    drift: Speed = 0.0


class JumpFault(Conditions):
    """A single jump, at a start or when conditions first become true."""

    start: Instant | None = Field(
        None, description="start as a time or relative to an event; without it, the start of the conditions"
    )

    @property
    def duration(self) -> float:
        """Zero: a jump is instantaneous."""
        return 0.0

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if (self.start is None) == (not self.condition_keys):
            yield (
                "start: is missing, or a condition such as from or above"
                if self.start is None
                else (f"start: {self.jump_text} once, at its start or when its conditions begin to hold")
            )

    @property
    def jump_text(self) -> str:
        """What jumps, in words."""
        return "a clock jumps"


class ClockJump(JumpFault):
    """Single jump of the receiver clock, in metres of range."""

    kind: Literal["clock_jump"] = "clock_jump"
    size: Length


class ClockDrift(TimedFault):
    """Frequency error of the receiver clock, in m/s of range rate; it affects the measurements of all satellites."""

    kind: Literal["clock_drift"] = "clock_drift"
    rate: Speed


class CycleSlip(JumpFault):
    """Single jump of the carrier phases of some satellites, in cycles, which the receiver does not detect."""

    kind: Literal["cycle_slip"] = "cycle_slip"
    satellites: Names = Field((), description="satellites such as G05; if empty: the highest at the start")
    size: float = Field(description="size in cycles of the carrier")

    @property
    def jump_text(self) -> str:
        """What jumps, in words."""
        return "a phase slips"


class WildSamples(TimedSatelliteFault):
    """Additional white error of the measurements: of ranges, or of each axis of the solution."""

    kind: Literal["wild_samples"] = "wild_samples"
    sigma: LengthSigma
    satellites: Names = Field((), description="satellites such as G05; if empty: all")


class FrozenOutput(TimedFault):
    """The receiver repeats its output of the time at which the fault began."""

    kind: Literal["frozen_output"] = "frozen_output"


class InvalidOutput(TimedFault):
    """The receiver flags its output as invalid. A filter whose mode logic ignores that flag still uses the output."""

    kind: Literal["invalid_output"] = "invalid_output"
    flag: Flag = Field(
        "checksum", description="flag that is raised: integrity or checksum, hardware, time synchronisation"
    )


class Spoofing(TimedFault):
    """Ranges, range rates and phases of all satellites are those of a point that moves away from the antenna.

    The power is that of the true signals. The solution drifts while its ranges stay consistent.
    """

    kind: Literal["spoofing"] = "spoofing"
    velocity: tuple[Speed, Speed, Speed] = Field(
        description="velocity of the false position relative to the true one: north, east, down"
    )

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if not any(self.velocity):
            yield "velocity: is zero, so the false position is the true one; give a velocity, or omit the fault"


class Jamming(TimedFault):
    """A transmitter on the ground in the receiver's band, which lowers C/N0 according to the link budget."""

    kind: Literal["jamming"] = "jamming"
    latitude: Annotated[Angle, Field(ge=-0.5 * math.pi, le=0.5 * math.pi)]  # geodetic, of the transmitter
    longitude: Angle  # of the transmitter
    height: Length = 0.0  # over the ellipsoid
    power: Level = Field(description="power into the transmitter's antenna")
    pattern: Pattern | None = Field(
        None, description="gain pattern of the transmitter's antenna; none: 0 dBi in all directions"
    )
    azimuth: Angle = Field(0.0, description="azimuth of the boresight, from north towards east")
    elevation: Angle = Field(0.5 * math.pi, description="elevation of the boresight")
    quality: float = Field(
        1.0,
        gt=0.0,
        description="Q of the effective C/N0: 1 a narrow band, 1.5 the spectrum of the signal, 2.22 white noise over "
        "its main lobe",
    )

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        # compare with the defaults: the levels of an axis set every field, so that "given by the user" says nothing
        fields = type(self).model_fields
        boresight_fields = [name for name in ("azimuth", "elevation") if getattr(self, name) != fields[name].default]
        if self.pattern is None and boresight_fields:
            yield f"{boresight_fields[0]}: without a pattern the antenna radiates alike in all directions"


class LatencyChange(TimedFault):
    """Latency of the measurements beyond the latency assumed by the filter."""

    kind: Literal["latency_change"] = "latency_change"
    by: Duration


class ImuFault(TimedFault):
    """A fault of one IMU."""

    unit: int = Field(1, ge=1, description="number of the unit in the list of units")


class GyroBiasStep(ImuFault):
    """Step of the gyro bias along the (first three) axes of the IMU."""

    kind: Literal["gyro_bias_step"] = "gyro_bias_step"
    size: tuple[AngularRate, AngularRate, AngularRate]


class AccelBiasStep(ImuFault):
    """Step of the accelerometer bias along the (first three) axes of the IMU."""

    kind: Literal["accel_bias_step"] = "accel_bias_step"
    size: tuple[Acceleration, Acceleration, Acceleration]


class GyroScaleFactorStep(ImuFault):
    """Step of the gyro scale factor along the (first three) axes of the IMU."""

    kind: Literal["gyro_scale_factor_step"] = "gyro_scale_factor_step"
    size: tuple[SignedFraction, SignedFraction, SignedFraction]


class AccelScaleFactorStep(ImuFault):
    """Step of the accelerometer scale factor along the (first three) axes of the IMU."""

    kind: Literal["accel_scale_factor_step"] = "accel_scale_factor_step"
    size: tuple[SignedFraction, SignedFraction, SignedFraction]


class DeadAxis(ImuFault):
    """A sensing element that no longer responds to its input; bias and noise of its electronics remain."""

    kind: Literal["dead_axis"] = "dead_axis"
    sensor: Literal["gyro", "accelerometer"]
    axis: int = Field(ge=1, description="number of the sensing axis in the unit: 1 is x")
    output: Literal["zero", "last"] = Field(
        "zero", description="output of the element: zero, or its value at the start"
    )


class DroppedSamples(ImuFault):
    """Lost increments of an IMU, which the strapdown replaces by zero or by the last increment."""

    kind: Literal["dropped_samples"] = "dropped_samples"
    instead: Literal["nothing", "last"] = "nothing"


AnyFault = (
    SatelliteOutage
    | AntennaFailure
    | DegradedNoise
    | RangeBias
    | ClockJump
    | ClockDrift
    | CycleSlip
    | WildSamples
    | FrozenOutput
    | InvalidOutput
    | Spoofing
    | Jamming
    | LatencyChange
    | GyroBiasStep
    | AccelBiasStep
    | GyroScaleFactorStep
    | AccelScaleFactorStep
    | DeadAxis
    | DroppedSamples
)
Fault = Annotated[AnyFault, Field(discriminator="kind")]


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
    remainder_text = f" and {len(names) - 4} more" if len(names) > 4 else ""
    return f"{name!r} is not in the constellation (it has {', '.join(names[:4])}{remainder_text})"
