"""IMU error card: the numbers of a datasheet, one sigma per axis."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from lvnav_trade import per_axis, units
from lvnav_trade.kernels.transition import ACCEL, CONSTANT, GYRO, OTHER_0, OWN_0, OWN_1, SQUARE
from lvnav_trade.layout import ErrorTerm
from lvnav_trade.per_axis import PerAxis, each_axis
from lvnav_trade.records import Floats
from lvnav_trade.resources import Resources
from lvnav_trade.units import Card, NamedCard
from lvnav_trade.world.sensors.allan import FLOOR, Process, fit_floor


class Ramp(Card):
    """When a bias grows linearly before it stays as it is."""

    start: units.Duration = 0.0
    end: units.Duration

    def _faults(self) -> Iterator[str]:
        if self.end <= self.start:
            yield "the ramp's end should come after its start"


class GyroRamp(Ramp):
    """A bias that grows linearly between two times and then stays (warming during the burn); same in every run."""

    amplitude: tuple[units.AngularRate, units.AngularRate, units.AngularRate]


class AccelRamp(Ramp):
    """The accelerometers' bias ramp; same in every run."""

    amplitude: tuple[units.Acceleration, units.Acceleration, units.Acceleration]


_FIT = (
    "flicker noise of bias_instability by fitted processes, see convention; none: bias_instability is sigma of one "
    "process of instability_time, whose Allan deviation is at most 0.618 of it"
)


_FULL_SCALE = "input beyond which an element puts out no more; none: no limit, and a nonlinearity is that at {}"
# rad/s and m/s^2: 500 deg/s and 30 g
_USUAL = {GYRO: 8.7266462599716477, ACCEL: 294.1995}


class InstabilityFit(Card):
    """Flicker noise by several Gauss-Markov processes, fitted to the flat part of the Allan deviation."""

    processes: int = Field(ge=1, le=6)
    shortest: units.TimeConstant = Field(1.0, description="averaging times between which the Allan deviation is flat")
    longest: units.TimeConstant = 1000.0
    convention: Literal["coefficient", "floor"] = Field(
        "coefficient",
        description="bias_instability is the coefficient B of IEEE 952, whose Allan deviation has the floor 0.664 B; "
        "or it is that floor, the minimum of the curve, which most datasheets print",
    )

    def _faults(self) -> Iterator[str]:
        if self.longest < 10.0 * self.shortest:
            yield "the longest averaging time should be ten times the shortest or more"


class SensorCard(Card):
    """A triad with a bias that varies."""

    if TYPE_CHECKING:  # fields of the cards below, in their order
        bias_instability: PerAxis
        instability_time: float
        instability_fit: InstabilityFit | None
        full_scale: float | None

    @property
    def instability_processes(self) -> tuple[Process, ...]:
        """The Gauss-Markov processes of the true bias instability, of the root mean square of the axes; none without
        one.
        """
        size = per_axis.rms(self.bias_instability)
        if size <= 0.0:
            return ()
        fit = self.instability_fit
        if fit is None:
            return (Process(size, self.instability_time),)
        return fit_floor(self.flicker, fit.processes, fit.shortest, fit.longest)

    @property
    def flicker(self) -> float:
        """Coefficient B (SI, IEEE 952) of the bias instability by fitted processes, root mean square of the axes."""
        size, fit = per_axis.rms(self.bias_instability), self.instability_fit
        return size / FLOOR if fit is not None and fit.convention == "floor" else size

    @property
    def instability(self) -> Process:
        """What one process has of them: their sigma together, and the drift over a short time of the slowest."""
        size = per_axis.rms(self.bias_instability)
        if size <= 0.0 or self.instability_fit is None:
            return Process(size, self.instability_time)
        found = self.instability_processes
        variance, slowest = sum(one.sigma**2 for one in found), found[-1]
        return Process(math.sqrt(variance), slowest.time_constant * variance / slowest.sigma**2)

    def instability_axes(self, sigma: float) -> PerAxis:
        """Return by axis the one-sigma of a process that is `sigma` for the root mean square of the axes."""
        if not isinstance(self.bias_instability, tuple):
            return sigma
        return each_axis(lambda one: sigma * one / per_axis.rms(self.bias_instability), self.bias_instability)

    @property
    def nonlinearity_scale(self) -> float:
        """Input (SI) at which the nonlinearity is what the card says."""
        return self.full_scale or _USUAL[GYRO if isinstance(self, GyroCard) else ACCEL]

    @property
    def instability_sigma(self) -> float:
        """One-sigma of the bias instability."""
        return self.instability.sigma


class GyroCard(SensorCard):
    """Errors of the gyro triad, one sigma per axis (rows of table 1 of Trigo and Theil), alike or a list of three."""

    bandwidth: units.Frequency | None = Field(None, description="first-order bandwidth; none: ideal")
    misalignment: per_axis.Angle = 0.0  # of each axis towards the two others
    random_walk: per_axis.AngleRandomWalk = 0.0  # angle random walk, white noise of the rate
    rate_random_walk: per_axis.RateRandomWalk = 0.0  # random walk of the bias
    bias_repeatability: per_axis.AngularRate = 0.0  # turn-on bias
    bias_instability: per_axis.AngularRate = 0.0  # Gauss-Markov part of the bias
    instability_time: units.TimeConstant = 100.0  # its correlation time
    instability_fit: InstabilityFit | None = Field(None, description=_FIT)
    g_sensitivity: per_axis.GSensitivity = 0.0  # rate error per specific force
    scale_factor: per_axis.Fraction = Field(0.0, description="repeatability")
    scale_factor_drift: per_axis.ScaleDrift = 0.0  # random walk of the scale factor
    nonlinearity: per_axis.Fraction = Field(0.0, description="scale-factor error at full scale, growing with the rate")
    full_scale: units.AngularRateLimit | None = Field(None, description=_FULL_SCALE.format("500 deg/s"))
    quantisation: units.AngleSigma = 0.0  # step of an angle increment
    temperature: GyroRamp | None = None  # bias that grows as the IMU warms; none: no such error


class AccelCard(SensorCard):
    """Errors of the accelerometer triad, one sigma per axis, alike or a list of three."""

    bandwidth: units.Frequency | None = Field(None, description="first-order bandwidth; none: ideal")
    misalignment: per_axis.Angle = 0.0  # of each axis towards the two others
    random_walk: per_axis.VelocityRandomWalk = 0.0  # velocity random walk, white noise of the specific force
    rate_random_walk: per_axis.AccelerationRandomWalk = 0.0  # random walk of the bias
    bias_repeatability: per_axis.Acceleration = 0.0  # turn-on bias
    bias_instability: per_axis.Acceleration = 0.0  # Gauss-Markov part of the bias
    instability_time: units.TimeConstant = 100.0  # its correlation time
    instability_fit: InstabilityFit | None = Field(None, description=_FIT)
    scale_factor: per_axis.Fraction = Field(0.0, description="repeatability")
    scale_factor_drift: per_axis.ScaleDrift = 0.0  # random walk of the scale factor
    nonlinearity: per_axis.Fraction = Field(
        0.0, description="scale-factor error at full scale, growing with specific force"
    )
    full_scale: units.AccelerationLimit | None = Field(None, description=_FULL_SCALE.format("30 g"))
    quantisation: units.SpeedSigma = 0.0  # step of a velocity increment
    temperature: AccelRamp | None = None  # bias that grows as the IMU warms; none: no such error


class ImuCard(NamedCard):
    """An inertial unit."""

    rate: units.StepRate = 200.0
    process_rate: units.StepRate = Field(10.0, description="how often time-varying errors take a step")
    gyro: GyroCard
    accel: AccelCard
    resources: Resources | None = Field(None, description="cost, mass, power, volume, reliability")


def error_terms(card: ImuCard) -> list[ErrorTerm]:
    """Return the true error parameters that a card names, those that are zero left out."""
    terms: list[ErrorTerm] = []
    for name, sensor, of in (("gyro", GYRO, card.gyro), ("accelerometer", ACCEL, card.accel)):
        terms += [
            ErrorTerm(f"{name} bias repeatability", 0, sensor, CONSTANT, of.bias_repeatability),
            *(
                ErrorTerm(
                    f"{name} bias instability",
                    part,
                    sensor,
                    CONSTANT,
                    of.instability_axes(one.sigma),
                    0.0,
                    one.time_constant,
                )
                for part, one in enumerate(of.instability_processes)
            ),
            ErrorTerm(f"{name} rate random walk", 0, sensor, CONSTANT, 0.0, of.rate_random_walk),
            ErrorTerm(f"{name} scale factor", 0, sensor, OWN_0, of.scale_factor),
            ErrorTerm(f"{name} scale-factor drift", 0, sensor, OWN_0, 0.0, of.scale_factor_drift),
            ErrorTerm(f"{name} misalignment", 0, sensor, OWN_1, of.misalignment),
            ErrorTerm(f"{name} misalignment", 1, sensor, OWN_1 + 1, of.misalignment),
            ErrorTerm(
                f"{name} nonlinearity",
                0,
                sensor,
                SQUARE,
                each_axis(lambda one, at=of.nonlinearity_scale: one / at, of.nonlinearity),
            ),
        ]
        if isinstance(of, GyroCard):
            terms += [ErrorTerm("gyro g-sensitivity", j, GYRO, OTHER_0 + j, of.g_sensitivity) for j in range(3)]
    return [term for term in terms if term.varies]


def lag(increments: Floats, bandwidth: float | None, dt: float) -> Floats:
    """Return the increments (n, 3) that a sensor with a first-order bandwidth (Hz) puts out; it starts in steady state.

    The input is taken as constant over each tick, for which the response of the first-order lag is exact.
    """
    if bandwidth is None:
        return increments
    from scipy.signal import lfilter  # with it comes scipy.stats: 30 MiB and 0.5 s of every worker, for few units

    time_constant = 1.0 / (2.0 * math.pi * bandwidth)
    decay = math.exp(-dt / time_constant)
    level = increments / dt
    # the sensor's output at the start of each tick trails the level of the tick before
    trail, _ = lfilter([0.0, 1.0 - decay], [1.0, -decay], level, axis=0, zi=level[:1])
    return increments + (trail - level) * (time_constant * (1.0 - decay))
