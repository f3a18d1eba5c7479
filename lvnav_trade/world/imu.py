"""IMU error card: what an inertial unit's datasheet says, one sigma per axis."""

from __future__ import annotations

from pydantic import Field

from lvnav_trade.units import (
    Acceleration,
    AccelerationRandomWalk,
    Angle,
    AngleRandomWalk,
    AngularRate,
    Card,
    Duration,
    Fraction,
    Frequency,
    GSensitivity,
    RateRandomWalk,
    ScaleDrift,
    Speed,
    VelocityRandomWalk,
)


class GyroRamp(Card):
    """A bias that grows linearly between two times and then stays (warming during the burn); same in every run."""

    start: Duration = 0.0
    end: Duration
    amplitude: tuple[AngularRate, AngularRate, AngularRate]


class AccelRamp(Card):
    """The accelerometers' bias ramp; same in every run."""

    start: Duration = 0.0
    end: Duration
    amplitude: tuple[Acceleration, Acceleration, Acceleration]


class GyroCard(Card):
    """Errors of the gyro triad, one sigma per axis (rows of table 1 of Trigo and Theil)."""

    bandwidth: Frequency | None = Field(None, description="first-order bandwidth; none: ideal")
    misalignment: Angle = 0.0
    random_walk: AngleRandomWalk = 0.0
    rate_random_walk: RateRandomWalk = 0.0
    bias_repeatability: AngularRate = 0.0
    bias_instability: AngularRate = 0.0
    instability_time: Duration = 100.0
    g_sensitivity: GSensitivity = 0.0
    scale_factor: Fraction = Field(0.0, description="repeatability")
    scale_factor_drift: ScaleDrift = 0.0
    nonlinearity: Fraction = Field(0.0, description="scale-factor error at full scale, growing with the rate")
    full_scale: AngularRate = 8.7266462599716477  # 500 deg/s
    quantisation: Angle = 0.0
    temperature: GyroRamp | None = None


class AccelCard(Card):
    """Errors of the accelerometer triad, one sigma per axis."""

    bandwidth: Frequency | None = Field(None, description="first-order bandwidth; none: ideal")
    misalignment: Angle = 0.0
    random_walk: VelocityRandomWalk = 0.0
    rate_random_walk: AccelerationRandomWalk = 0.0
    bias_repeatability: Acceleration = 0.0
    bias_instability: Acceleration = 0.0
    instability_time: Duration = 100.0
    scale_factor: Fraction = Field(0.0, description="repeatability")
    scale_factor_drift: ScaleDrift = 0.0
    nonlinearity: Fraction = Field(0.0, description="scale-factor error at full scale, growing with specific force")
    full_scale: Acceleration = 294.1995  # 30 g
    quantisation: Speed = 0.0
    temperature: AccelRamp | None = None


class ImuCard(Card):
    """An inertial unit."""

    name: str
    source: str = Field(description="where each number is from")
    rate: Frequency = 200.0
    gyro: GyroCard
    accel: AccelCard
