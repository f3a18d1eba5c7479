"""IMU error card (the numbers of a datasheet, one sigma per axis), and its sensing elements beyond full scale."""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from pydantic import Field

from lvnav_trade.imu.allan import FLOOR, Process, fit_floor
from lvnav_trade.kernels.transition import ACCEL, CONSTANT, GYRO, OTHER_0, OWN_0, OWN_1, SQUARE
from lvnav_trade.quantities import per_axis, units
from lvnav_trade.quantities.per_axis import PerAxis, each_axis
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.quantities.shared_cards import Resources
from lvnav_trade.quantities.state_layout import ErrorTerm
from lvnav_trade.quantities.units import Card, NamedCard


class Ramp(Card):
    """Interval in which a bias grows linearly; it is constant afterwards."""

    start: units.Duration = 0.0
    end: units.Duration

    def _faults(self) -> Iterator[str]:
        if self.end <= self.start:
            yield "the ramp's end should come after its start"


class GyroRamp(Ramp):
    """Gyro bias that grows linearly between two times (warming during the burn); the same in every run."""

    amplitude: tuple[units.AngularRate, units.AngularRate, units.AngularRate]


class AccelRamp(Ramp):
    """Accelerometer bias that grows linearly between two times; the same in every run."""

    amplitude: tuple[units.Acceleration, units.Acceleration, units.Acceleration]


_FIT = (
    "flicker noise of bias_instability by fitted processes, see convention; none: bias_instability is sigma of one "
    "process of instability_time, whose Allan deviation is at most 0.618 of it"
)


_FULL_SCALE = "input at which the output is clipped; none: no limit, and the nonlinearity refers to {}"
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


class TriadCard(Card):
    """A triad of sensors with bias instability."""

    if TYPE_CHECKING:  # fields of the cards below, in their order
        bias_instability: PerAxis
        instability_time: float
        instability_fit: InstabilityFit | None
        full_scale: float | None

    @property
    def instability_processes(self) -> tuple[Process, ...]:
        """Gauss-Markov processes of the true bias instability, with the sigma of the root mean square of the axes."""
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
        size = per_axis.rms(self.bias_instability)
        fit = self.instability_fit
        is_floor = fit is not None and fit.convention == "floor"
        return size / FLOOR if is_floor else size

    @property
    def instability(self) -> Process:
        """Single process that replaces them in a filter: their total sigma, and the short-term drift of the slowest.

        A Gauss-Markov process drifts with the variance 2 sigma^2 / T per second: T = T_slow total^2 / sigma_slow^2.
        """
        size = per_axis.rms(self.bias_instability)
        if size <= 0.0 or self.instability_fit is None:
            return Process(size, self.instability_time)
        processes = self.instability_processes
        variance = sum(process.sigma**2 for process in processes)
        slowest = processes[-1]
        time_constant = slowest.time_constant * variance / slowest.sigma**2
        return Process(math.sqrt(variance), time_constant)

    def instability_axes(self, sigma: float) -> PerAxis:
        """Return the sigma by axis of a process whose root mean square over the axes is `sigma`."""
        if not isinstance(self.bias_instability, tuple):
            return sigma
        mean = per_axis.rms(self.bias_instability)
        return each_axis(lambda size: sigma * size / mean, self.bias_instability)

    @property
    def nonlinearity_scale(self) -> float:
        """Input (SI) to which the nonlinearity of the card refers."""
        return self.full_scale or _USUAL[GYRO if isinstance(self, GyroCard) else ACCEL]

    @property
    def instability_sigma(self) -> float:
        """One-sigma of the bias instability."""
        return self.instability.sigma


class GyroCard(TriadCard):
    """Errors of the gyro triad, one sigma, the same for all axes or by axis (table 1 of Trigo and Theil)."""

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


class AccelCard(TriadCard):
    """Errors of the accelerometer triad, one sigma, the same for all axes or by axis."""

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
    """An inertial measurement unit (IMU)."""

    rate: units.StepRate = 200.0
    process_rate: units.StepRate = Field(10.0, description="rate at which time-varying errors change")
    gyro: GyroCard
    accel: AccelCard
    resources: Resources | None = Field(None, description="cost, mass, power, volume, reliability")


def error_terms(card: ImuCard) -> list[ErrorTerm]:
    """Return the true error parameters of an IMU, without those whose size is zero."""
    terms = _triad_terms("gyro", GYRO, card.gyro)
    for axis in range(3):
        term = ErrorTerm("gyro g-sensitivity", axis, GYRO, OTHER_0 + axis, card.gyro.g_sensitivity)
        terms.append(term)
    terms += _triad_terms("accelerometer", ACCEL, card.accel)
    return [term for term in terms if term.is_nonzero]


def lag(increments: Floats, bandwidth: float | None, dt: float) -> Floats:
    """Return the increments of a sensor with first-order bandwidth, which starts in steady state.

    The input is assumed constant over each tick; for such an input the response is exact.

    Parameters
    ----------
    increments : (n, 3) rad or m/s
        Increments of the ideal sensor.
    bandwidth : float or None
        Bandwidth (Hz); None: unlimited.
    dt : float
        Length of a tick (s).
    """
    if bandwidth is None:
        return increments
    from scipy.signal import lfilter  # imports scipy.stats: 30 MiB and 0.5 s for every worker, needed by few IMUs

    time_constant = 1.0 / (2.0 * math.pi * bandwidth)
    decay = math.exp(-dt / time_constant)
    level = increments / dt
    # the sensor's output at the start of each tick trails the level of the tick before
    numerator = [0.0, 1.0 - decay]
    denominator = [1.0, -decay]
    trail, _ = lfilter(numerator, denominator, level, axis=0, zi=level[:1])
    lag_time = time_constant * (1.0 - decay)
    return increments + (trail - level) * lag_time


class DeadElement(NamedTuple):
    """A dead sensing element.

    axis : Index of its axis.
    is_dead : (n_tick,). Whether it is dead at the tick.
    repeats_last : Whether it repeats its last output; otherwise its output is zero.
    """

    axis: int
    is_dead: Bools
    repeats_last: bool


def _triad_terms(name: str, sensor: int, triad: GyroCard | AccelCard) -> list[ErrorTerm]:
    """Return the error parameters that gyro and accelerometer triads have in common, also those of size zero."""

    def term(
        label: str,
        process_index: int,
        driver: int,
        sigma: PerAxis,
        walk: PerAxis = 0.0,
        time_constant: float = math.inf,
    ) -> ErrorTerm:
        return ErrorTerm(f"{name} {label}", process_index, sensor, driver, sigma, walk, time_constant)

    terms = [term("bias repeatability", 0, CONSTANT, triad.bias_repeatability)]
    for process_number, process in enumerate(triad.instability_processes):
        sigma = triad.instability_axes(process.sigma)
        terms.append(term("bias instability", process_number, CONSTANT, sigma, time_constant=process.time_constant))
    full_scale = triad.nonlinearity_scale
    nonlinearity = each_axis(lambda size: size / full_scale, triad.nonlinearity)
    terms += [
        term("rate random walk", 0, CONSTANT, 0.0, triad.rate_random_walk),
        term("scale factor", 0, OWN_0, triad.scale_factor),
        term("scale-factor drift", 0, OWN_0, 0.0, triad.scale_factor_drift),
        # misalignment of each axis towards the next axis, and towards the third axis
        term("misalignment", 0, OWN_1, triad.misalignment),
        term("misalignment", 1, OWN_1 + 1, triad.misalignment),
        term("nonlinearity", 0, SQUARE, nonlinearity),
    ]
    return terms


def sensor_output(increments: Floats, axes: Floats, limit: float, dead: Sequence[DeadElement] = ()) -> Floats:
    """Return the increments after clipping at full scale and dead elements.

    Bias, noise and scale factor are errors of the electronics and are added after this step.

    Parameters
    ----------
    increments : (n_tick, 3) rad or m/s
        Increments of angle or velocity, body axes.
    axes : (k, 3)
        Linearly independent unit vectors of 1 to 3 sensing axes. Components across all of them do not change.
    limit : float
        Largest increment (rad or m/s) of a tick, of either sign; inf: none.
    dead : sequence of DeadElement

    Returns
    -------
    (n_tick, 3) rad or m/s
        The array `increments` itself if nothing is clipped or dead.
    """
    squares = np.einsum("ij,ij->i", increments, increments)
    largest_square = float(np.max(squares, initial=0.0))
    if not dead and largest_square < 0.99 * limit**2:
        return increments  # the component along an axis is at most the length of the vector
    components = increments @ axes.T
    output = np.clip(components, -limit, limit)
    for element in dead:
        ticks = np.flatnonzero(element.is_dead)
        if not ticks.size:
            continue
        first = ticks[0]
        has_last = element.repeats_last and first > 0
        output[ticks, element.axis] = output[first - 1, element.axis] if has_last else 0.0
    if np.array_equal(output, components):
        return increments
    change = output - components
    to_body = np.linalg.pinv(axes).T
    return np.asarray(increments + change @ to_body)
