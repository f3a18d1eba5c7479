"""Filter card: what the filter believes, estimates and how often it works."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from lvnav_trade.delays import CorrectionsCard
from lvnav_trade.filters.envelope import EnvelopeCard
from lvnav_trade.filters.scheduled import GainSchedule
from lvnav_trade.units import (
    AccelerationRandomWalk,
    AccelerationSigma,
    AngleRandomWalk,
    AngleSigma,
    AngularRateSigma,
    Card,
    Fraction,
    Frequency,
    GSensitivity,
    Length,
    LengthSigma,
    Pause,
    RateRandomWalk,
    Speed,
    SpeedSigma,
    TimeConstant,
    VelocityRandomWalk,
)

Matched = Literal["matched"]
REFERENCED = ("referenced", "vehicle_model")
"""Kinds of filter that have an attitude reference."""


class ImuBelief(Card):
    """What the filter believes of its inertial unit; `matched` in the filter card takes each number from the truth."""

    gyro_random_walk: AngleRandomWalk
    accel_random_walk: VelocityRandomWalk
    gyro_bias: AngularRateSigma
    gyro_bias_walk: RateRandomWalk = 0.0
    gyro_bias_time: TimeConstant | None = None
    accel_bias: AccelerationSigma
    accel_bias_walk: AccelerationRandomWalk = 0.0
    accel_bias_time: TimeConstant | None = None
    gyro_scale_factor: Fraction = 0.0
    accel_scale_factor: Fraction = 0.0
    gyro_misalignment: AngleSigma = 0.0
    accel_misalignment: AngleSigma = 0.0
    gyro_g_sensitivity: GSensitivity = 0.0


class ReceiverBelief(Card):
    """What the filter believes of the receiver's measurement noise and clock."""

    pseudorange_sigma: LengthSigma
    range_rate_sigma: SpeedSigma
    position_sigma: LengthSigma
    velocity_sigma: SpeedSigma
    clock_h0: float = Field(ge=0)
    clock_h_minus2: float = Field(ge=0)
    range_bias: LengthSigma = Field(0.0, description="of each satellite, as a state; its initial one-sigma")
    range_bias_time: TimeConstant | None = None
    time_offset: LengthSigma = Field(0.0, description="of each further system's time, in range")
    time_offset_time: TimeConstant | None = None
    timing: Pause = Field(0.0, description="error of the time tags")
    timing_time: TimeConstant | None = None
    troposphere_scale: Fraction = 0.0
    troposphere_scale_time: TimeConstant | None = None
    ionosphere_scale: Fraction = 0.0
    ionosphere_scale_time: TimeConstant | None = None
    position_bias: LengthSigma = Field(0.0, description="of the receiver's solution, per axis")
    position_bias_time: TimeConstant | None = None
    velocity_bias: SpeedSigma = 0.0
    velocity_bias_time: TimeConstant | None = None


class AltimeterBelief(Card):
    """What the filter believes of its radar altimeter: white noise, and a part in proportion to the height."""

    sigma: LengthSigma = Field(gt=0.0)
    share: Fraction = 0.0


class InitialBelief(Card):
    """The filter's one-sigma at the start: tilt (north, east axes) and heading, position and velocity per axis."""

    tilt: AngleSigma
    heading: AngleSigma
    position: LengthSigma
    velocity: SpeedSigma
    clock_bias: LengthSigma
    clock_drift: SpeedSigma


class ReferenceBelief(Card):
    """What the filter believes of its attitude reference: white noise per axis."""

    sigma: AngleSigma = Field(gt=0.0)


ExtraState = Literal[
    "gyro_scale_factor",
    "accel_scale_factor",
    "gyro_misalignment",
    "accel_misalignment",
    "gyro_g_sensitivity",
    "range_bias",
    "time_offset",
    "timing",
    "troposphere_scale",
    "ionosphere_scale",
    "position_bias",
    "velocity_bias",
]

ParameterState = Literal[
    "gyro_bias",
    "accel_bias",
    "gyro_scale_factor",
    "accel_scale_factor",
    "gyro_misalignment",
    "accel_misalignment",
    "gyro_g_sensitivity",
    "range_bias",
    "time_offset",
    "timing",
    "troposphere_scale",
    "ionosphere_scale",
    "position_bias",
    "velocity_bias",
]


class DelayCompensation(Card):
    """How a filter meets measurements that are late: at the state that its unit had then, or carried on to the present.

    The delay must end after the epoch before, whose corrections the kept state would lack.
    """

    kind: Literal["buffered", "extrapolated"] = Field(
        description="buffered: innovation at the state of the time of validity; extrapolated: Euler step of a solution"
    )
    delay: Matched | Pause = Field("matched", description="as the filter takes it; matched: as the receiver stamps it")
    delay_sigma: Pause = Field(0.0, description="extrapolated: one-sigma that the filter believes of its error")
    acceleration_sigma: AccelerationSigma = Field(
        0.0, description="extrapolated: one-sigma that it believes of its own acceleration"
    )
    base: Pause = Field(0.1, gt=0.0, description="extrapolated: time over which the acceleration is taken")


Persisting = Literal["data_loss", "residual", "covariance"]


class LogicCard(Card):
    """When a filter starts, what it believes, when it gives up and starts again; a rule that is left out is off."""

    check_flags: bool = Field(True, description="leave out what the receiver says is invalid, or put out before")
    pdop_below: float | None = Field(None, gt=0, description="leave out solutions of a greater dilution of precision")
    wild_position: Annotated[Length, Field(gt=0.0)] | None = Field(
        None,
        description="leave out a sample of which an axis is further from the prediction; before a start, further "
        "from the sample before",
    )
    wild_velocity: Annotated[Speed, Field(gt=0.0)] | None = None
    start_after: int = Field(1, ge=1, description="good samples in a row")
    correct_after: Pause = Field(0.0, description="since its start the outputs are the inertial system's own")
    stop_after: TimeConstant | None = Field(None, description="of any error: data loss, residual, covariance")
    covariance_position: Annotated[Length, Field(gt=0.0)] | None = Field(
        None, description="a one-sigma beyond is an error of the covariance; so is one that is no number"
    )
    covariance_velocity: Annotated[Speed, Field(gt=0.0)] | None = None
    restart_after: tuple[Persisting, ...] = Field(
        ("data_loss", "residual", "covariance"), description="errors after which it starts again with good samples"
    )


class FilterCard(Card):
    """A navigation filter: error-state, mechanised in the inertial frame.

    Closed loop: what it estimates is fed back to the strapdown at every epoch. Open loop: the strapdown is left alone,
    the estimate is added to its output. `referenced` is loose with an attitude reference; `vehicle_model` is that with
    rate and acceleration of the vehicle as states that wander within an envelope: samples of the inertial unit are its
    measurements, one by one.
    """

    name: str
    source: str
    kind: Literal["inertial", "loose", "tight", "referenced", "vehicle_model"]
    extra_states: tuple[ExtraState, ...] = ()
    strapdown_rate: Frequency | None = Field(
        None, description="increments are added up to this rate before the strapdown; none: the unit's own rate"
    )
    covariance_rate: Frequency = 10.0
    update_rate: Frequency = 1.0
    consider: tuple[ParameterState, ...] = Field((), description="states carried but not estimated (Schmidt)")
    neglect: tuple[Literal["gyro_bias", "accel_bias"], ...] = Field((), description="standard states left out")
    update: Literal["symmetric", "joseph"] = "symmetric"
    transition_order: Literal[1, 2] = 2
    gate: float | None = Field(None, gt=0, description="innovation gate in sigma per row; none: no gate")
    gravity: Literal["point", "j2", "j4"] = "j4"
    feedback: Literal["closed", "open"] = "closed"
    init: Literal["from_card", "from_gnss"] = Field(
        "from_card", description="position and velocity, and their covariance, when the filter starts"
    )
    logic: LogicCard | None = Field(None, description="none: it starts at once and believes what the gate passes")
    imu: Matched | ImuBelief = "matched"
    receiver: Matched | ReceiverBelief = "matched"
    initial: Matched | InitialBelief = "matched"
    reference: Matched | ReferenceBelief = Field("matched", description="of a filter with an attitude reference")
    altimeter: Matched | AltimeterBelief = Field("matched", description="of a scenario with an altimeter")
    gains: GainSchedule | None = Field(
        None, description="gains of a loose filter in place of those of its covariance; none: its own, epoch by epoch"
    )
    envelope: EnvelopeCard | None = Field(None, description="of a vehicle model; none: that of the card's defaults")
    corrections: CorrectionsCard = Field(CorrectionsCard(), description="taken off the measurements beforehand")
    delay_compensation: DelayCompensation | None = Field(
        None, description="none: a late measurement is taken as present"
    )
    attitude_noise: AngleRandomWalk = Field(0.0, description="process noise beyond the unit's own, root PSD per axis")
    velocity_noise: VelocityRandomWalk = 0.0

    @property
    def measurements(self) -> tuple[str, ...]:
        """What the filter measures."""
        return {
            "inertial": (), "loose": ("position", "velocity", "altitude"),
            "tight": ("pseudorange", "range_rate", "altitude"), "referenced": ("position", "velocity", "attitude"),
            "vehicle_model": ("position", "velocity", "attitude", "imu"),
        }[self.kind]  # fmt: skip

    @property
    def report_imu_samples(self) -> bool:
        """Whether errors of samples are reported."""
        return self.kind in REFERENCED

    @model_validator(mode="after")
    def _decided(self) -> Self:
        both = sorted(set(self.neglect) & set(self.consider))
        if both:
            raise ValueError(f"{', '.join(both)}: neglected and considered, choose one")
        watched = "logic" if self.logic is not None else "init: from_gnss" if self.init == "from_gnss" else ""
        if watched and self.kind != "loose":
            raise ValueError(f"{watched} judges the receiver's solution: it needs kind: loose, not {self.kind}")
        if self.gains is not None and self.kind != "loose":
            raise ValueError(f"gains are those of position and velocity rows: they need kind: loose, not {self.kind}")
        if self.logic is not None and self.logic.correct_after > 0.0 and self.feedback == "closed":
            raise ValueError("logic.correct_after delays the outputs of an open loop: it needs feedback: open")
        return self

    @model_validator(mode="after")
    def _modelled(self) -> Self:
        modelled = self.kind == "vehicle_model"
        if self.envelope is not None and not modelled:
            raise ValueError(f"envelope: a {self.kind} filter has no model of the vehicle")
        if self.kind not in REFERENCED:
            return self
        inertial = [name for name in self.extra_states if modelled and name.startswith(("gyro_", "accel_"))]
        for name, value in (("neglect", self.neglect), ("consider", self.consider), ("extra_states", inertial)):
            if value:
                more = " and nothing else of it" if modelled else ""
                raise ValueError(f"{name}: a {self.kind} filter estimates the biases of its unit{more}")
        if self.feedback == "open":
            raise ValueError(f"feedback: a {self.kind} filter is closed-loop")
        if self.strapdown_rate is not None and modelled:
            raise ValueError("strapdown_rate: a vehicle_model filter takes every sample of the unit")
        return self
