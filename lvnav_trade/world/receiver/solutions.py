"""Cards of what a receiver makes of its measurements: a simulated solution, a point solution, or its own filter's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from lvnav_trade.units import (
    AccelerationSigma,
    Card,
    Fraction,
    JerkGain,
    JerkSigma,
    Length,
    LengthSigma,
    Pause,
    RangeGain,
    Speed,
    SpeedSigma,
    TimeConstant,
)
from lvnav_trade.world.user_file.error_table import ErrorTable


class OwnCovariance(Card):
    """The solver's own covariance of position and velocity goes out with every solution."""

    kind: Literal["own"] = "own"
    factor: float = Field(1.0, gt=0, description="that it is multiplied by")
    correlated: bool = Field(True, description="whole; or its diagonal alone")


class ConstantCovariance(Card):
    """The same sigma per axis goes out with every solution."""

    kind: Literal["constant"]
    position_sigma: LengthSigma
    velocity_sigma: SpeedSigma


ReportedCovariance = Annotated[OwnCovariance | ConstantCovariance, Field(discriminator="kind")]


class _Solver(Card):
    """What the cards of receivers that solve for themselves have in common."""

    OLD_KEYS: ClassVar[Mapping[str, str]] = {"told": "replaced by reported_covariance"}

    @model_validator(mode="before")
    @classmethod
    def _renamed(cls, data: Any) -> Any:
        """Refuse the keys of earlier versions with the key that replaces them."""
        for key, message in cls.OLD_KEYS.items():
            if isinstance(data, Mapping) and key in data:
                raise ValueError(f"{key}: {message}")
        return data


class DirectSolution(Card):
    """No solver: true position and velocity plus white noise per axis, whatever satellites are seen."""

    kind: Literal["direct"] = "direct"
    position_sigma: LengthSigma
    velocity_sigma: SpeedSigma
    position_bias: LengthSigma = Field(0.0, description="Gauss-Markov error per axis beside the white noise")
    velocity_bias: SpeedSigma = 0.0
    bias_time: TimeConstant = Field(60.0, description="time constant of both")
    error_table: ErrorTable | None = Field(None, description="errors of a recording, added to all of the above")


class BancroftSolution(_Solver):
    """A point solution of every epoch with four satellites or more, which knows nothing of the epoch before."""

    kind: Literal["bancroft"]
    range_sigma: LengthSigma = Field(gt=0.0, description="assumed by the receiver for its pseudoranges")
    rate_sigma: SpeedSigma = Field(gt=0.0, description="and of its range rates")
    refinements: int = Field(
        2, ge=0, le=5, description="Newton steps to least squares after the closed form; 0: closed form alone"
    )
    false_alarm: float = Field(
        1e-3, gt=0.0, lt=1.0, description="probability that residuals of good measurements are called inconsistent"
    )
    least_quality: Literal[1, 2, 3] = Field(
        1, description="handed out from: 1 inconsistent residuals, 2 four satellites (no test), 3 consistent residuals"
    )
    reported_covariance: ReportedCovariance = Field(
        OwnCovariance(), description="covariance that goes out with a solution"
    )
    reported: bool = Field(
        False,
        description="errors of the solution and of the clock are reported beside those of the filter that uses it",
    )

    def numbers(self) -> dict[str, Any]:
        """Return the settings of the point solver, SI, by the names of its arguments."""
        return self.model_dump(exclude={"kind", "reported_covariance", "reported"})


class FilteredSolution(_Solver):
    """The receiver's own Kalman filter of position, velocity, clock and, driven by jerk, acceleration.

    State `jerk` for a filter with acceleration, `acceleration_noise` for one without. Noise is adapted to the
    acceleration of the last two point solutions: its variance is the larger of the stated sigma squared and the gain
    times acceleration squared (of range and rate: times its size); gains of zero leave it constant.
    """

    kind: Literal["filtered"]
    range_sigma: LengthSigma = Field(gt=0.0, description="assumed by the receiver for its pseudoranges")
    rate_sigma: SpeedSigma = Field(gt=0.0, description="and of its range rates")
    jerk: JerkSigma | None = Field(None, description="constant over an interval, per axis")
    jerk_gain: JerkGain = 0.0
    acceleration_noise: AccelerationSigma | None = Field(None, description="constant over an interval, per axis")
    acceleration_gain: Fraction = 0.0
    acceleration_time: TimeConstant | None = Field(
        None, description="in which the acceleration decays; none: a random walk"
    )
    range_gain: RangeGain = 0.0
    rate_gain: LengthSigma = 0.0
    clock_noise: AccelerationSigma = Field(description="derivative of the clock's drift, constant over an interval")
    start_acceleration: AccelerationSigma = Field(10.0, description="one-sigma when the filter starts")
    gate: float | None = Field(None, gt=0.0, description="innovations beyond so many sigma are rejected")
    range_limit: Annotated[Length, Field(gt=0.0)] | None = Field(None, description="and beyond so many metres")
    rate_limit: Annotated[Speed, Field(gt=0.0)] | None = None
    restart_after: int | None = Field(
        None, ge=1, description="epochs in a row with most rows rejected; it starts again from a point solution"
    )
    longest_coast: Pause | None = Field(
        None, description="no solution goes out when no measurement has been accepted for longer; none: it always does"
    )
    point: BancroftSolution | None = Field(None, description="that starts it; none: the default with its sigmas")
    reported_covariance: ReportedCovariance = Field(
        OwnCovariance(), description="covariance that goes out with a solution"
    )
    reported: bool = Field(
        False,
        description="errors of the solution and of the clock are reported beside those of the filter that uses it",
    )

    @model_validator(mode="after")
    def _driven(self) -> Self:
        if (self.jerk is None) == (self.acceleration_noise is None):
            raise ValueError("state jerk (a filter with acceleration) or acceleration_noise (one without), not both")
        other = self.acceleration_gain if self.jerk is not None else self.jerk_gain
        if other:
            raise ValueError("jerk_gain goes with jerk, acceleration_gain with acceleration_noise")
        if self.acceleration_noise is not None and self.acceleration_time is not None:
            raise ValueError("acceleration_time: there is no acceleration to decay, state jerk for it")
        return self

    def numbers(self) -> dict[str, Any]:
        """Return the settings of the filter, SI, by the names of its arguments."""
        driven = {"jerk", "jerk_gain", "acceleration_noise", "acceleration_gain"}
        found = self.model_dump(exclude={"kind", "reported_covariance", "point", "reported", *driven})
        with_acceleration = self.jerk is not None
        found["acceleration"] = with_acceleration
        found["drive_sigma"] = self.jerk if with_acceleration else self.acceleration_noise
        found["drive_gain"] = self.jerk_gain if with_acceleration else self.acceleration_gain
        return found

    @property
    def fix(self) -> BancroftSolution:
        """The point solution that the filter starts from and adapts by."""
        return self.point or BancroftSolution.model_construct(
            kind="bancroft", range_sigma=self.range_sigma, rate_sigma=self.rate_sigma
        )


SolutionCard = Annotated[DirectSolution | BancroftSolution | FilteredSolution, Field(discriminator="kind")]
