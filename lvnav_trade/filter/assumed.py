"""What a filter assumes of the IMU, the receiver and its own initial errors."""

from pydantic import Field

from lvnav_trade.quantities import per_axis, units
from lvnav_trade.quantities.shared_cards import NoiseBy


class ImuModel(units.Card):
    """Filter model of the IMU; each parameter is common to the axes or given by axis.

    `imu: matched` in the filter card takes every parameter from the true IMU.
    """

    gyro_random_walk: per_axis.AngleRandomWalk  # root PSD of white noise
    accel_random_walk: per_axis.VelocityRandomWalk  # root PSD of white noise
    gyro_bias: per_axis.AngularRate  # initial one-sigma
    gyro_bias_walk: per_axis.RateRandomWalk = 0.0  # root PSD of the random walk
    gyro_bias_time: units.TimeConstant | None = None  # correlation time; none: constant apart from its walk
    accel_bias: per_axis.Acceleration  # initial one-sigma
    accel_bias_walk: per_axis.AccelerationRandomWalk = 0.0  # root PSD of the random walk
    accel_bias_time: units.TimeConstant | None = None  # correlation time; none: constant apart from its walk
    gyro_scale_factor: per_axis.Fraction = 0.0  # initial one-sigma
    gyro_scale_factor_walk: per_axis.ScaleDrift = Field(
        0.0, description="random walk of the state; a larger value also covers a nonlinearity without a state"
    )
    accel_scale_factor: per_axis.Fraction = 0.0  # initial one-sigma
    accel_scale_factor_walk: per_axis.ScaleDrift = 0.0  # root PSD of the random walk
    gyro_nonlinearity: per_axis.Fraction = Field(0.0, description="scale-factor error at full scale")
    gyro_full_scale: units.AngularRateLimit = 8.7266462599716477  # 500 deg/s
    accel_nonlinearity: per_axis.Fraction = 0.0  # scale-factor error at full scale
    accel_full_scale: units.AccelerationLimit = 294.1995  # 30 g
    gyro_misalignment: per_axis.Angle = 0.0  # initial one-sigma
    accel_misalignment: per_axis.Angle = 0.0  # initial one-sigma
    gyro_g_sensitivity: per_axis.GSensitivity = 0.0  # initial one-sigma
    gyro_relative_bias: per_axis.AngularRate = Field(
        0.0, description="for two units whose difference is measured: bias of the first minus bias of the second"
    )
    gyro_relative_bias_walk: per_axis.RateRandomWalk = 0.0  # root PSD of the random walk
    gyro_relative_bias_correlation: per_axis.Correlation = Field(0.0, description="initial correlation with gyro_bias")
    accel_relative_bias: per_axis.Acceleration = 0.0  # the same of the accelerometers
    accel_relative_bias_walk: per_axis.AccelerationRandomWalk = 0.0  # root PSD of the random walk
    accel_relative_bias_correlation: per_axis.Correlation = Field(
        0.0, description="initial correlation with accel_bias"
    )

    def sigma(self, name: str) -> per_axis.PerAxis:
        """Return the one-sigma of a parameter (SI), or of a nonlinearity its coefficient.

        The coefficient is the scale-factor error at full scale divided by the full scale.
        """
        return per_axis.each_axis(lambda sigma: float(sigma) / self.full_scale(name), getattr(self, name))

    def full_scale(self, name: str) -> float:
        """Return the input (SI) at which a nonlinearity is specified; 1 for any other parameter."""
        return float(getattr(self, name.replace("nonlinearity", "full_scale"))) if "nonlinearity" in name else 1.0


class ReceiverModel(units.Card):
    """Filter model of the receiver: measurement noise, measurement errors that are states, and the clock."""

    pseudorange_sigma: units.LengthSigma  # white noise
    range_rate_sigma: units.SpeedSigma  # white noise
    position_sigma: units.LengthSigma  # white noise of the solution, per axis
    velocity_sigma: units.SpeedSigma  # white noise of the solution, per axis
    clock_h0: float = Field(ge=0)  # power-law coefficient h0 of the clock: white frequency noise
    clock_h_minus2: float = Field(ge=0)  # power-law coefficient h-2: random walk of the frequency
    noise_by: NoiseBy = ()  # factors on the sigmas over altitude, specific force or jerk
    range_bias: units.LengthSigma = Field(0.0, description="initial one-sigma of the state, one for each satellite")
    range_bias_time: units.TimeConstant | None = None  # correlation time; none: constant
    time_offset: units.LengthSigma = Field(0.0, description="time offset of each further satellite system, in range")
    time_offset_time: units.TimeConstant | None = None  # correlation time; none: constant
    range_rate_offset: units.SpeedSigma = Field(
        0.0, description="initial one-sigma of the offset that all range rates share, in addition to the clock drift"
    )
    range_rate_offset_time: units.TimeConstant | None = None  # correlation time; none: constant
    timing: units.Pause = Field(0.0, description="error of the time tags")
    timing_time: units.TimeConstant | None = None  # correlation time; none: constant
    troposphere_scale: units.Fraction = 0.0  # initial one-sigma of the relative error of the delay
    troposphere_scale_time: units.TimeConstant | None = None  # correlation time; none: constant
    ionosphere_scale: units.Fraction = 0.0  # initial one-sigma of the relative error of the delay
    ionosphere_scale_time: units.TimeConstant | None = None  # correlation time; none: constant
    position_bias: units.LengthSigma = Field(0.0, description="bias of the receiver's solution, per axis")
    position_bias_time: units.TimeConstant | None = None  # correlation time; none: constant
    velocity_bias: units.SpeedSigma = 0.0  # of the receiver's solution, per axis
    velocity_bias_time: units.TimeConstant | None = None  # correlation time; none: constant
    carrier_phase_sigma: units.LengthSigma = 0.002  # white noise
    ambiguity: units.LengthSigma = Field(10.0, description="one-sigma of the state at every start of a carrier phase")


class InitialModel(units.Card):
    """The filter's one-sigma at the start: tilt (north, east axes) and heading, position and velocity per axis."""

    tilt: units.AttitudeSigma
    heading: units.AttitudeSigma
    position: units.LengthSigma
    velocity: units.SpeedSigma
    clock_bias: units.LengthSigma
    clock_drift: units.SpeedSigma
