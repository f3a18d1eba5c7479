"""Cards of a receiver, its oscillator, and its solution: direct, point by point, or filtered."""

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from lvnav_trade.gnss.link import AntennaCard, LinkCard
from lvnav_trade.gnss.loops import LoopsCard
from lvnav_trade.gnss.recorded_errors import ErrorTable
from lvnav_trade.gnss.tracking import CycleSlipCard, TrackingCard
from lvnav_trade.kernels.media.ionosphere import L1, L2, L5, free_combination
from lvnav_trade.quantities import units
from lvnav_trade.quantities.shared_cards import NoiseBy, Resources


class ComputedCovariance(units.Card):
    """The receiver reports with every solution the covariance that its solver computes."""

    kind: Literal["own"] = "own"
    factor: float = Field(1.0, gt=0, description="factor on the covariance")
    correlated: bool = Field(True, description="true: the full covariance; false: its diagonal only")


class ConstantCovariance(units.Card):
    """The receiver reports the same sigma per axis with every solution."""

    kind: Literal["constant"]
    position_sigma: units.LengthSigma
    velocity_sigma: units.SpeedSigma


ReportedCovariance = Annotated[
    ComputedCovariance | ConstantCovariance,
    Field(discriminator="kind", description="covariance that is reported with a solution"),
]
Reported = Annotated[
    bool,
    Field(description="report errors of the solution and of the clock in addition to those of the filter that uses it"),
]
RangeSigma = Annotated[units.LengthSigma, Field(gt=0.0, description="noise of pseudoranges that the receiver assumes")]
RateSigma = Annotated[units.SpeedSigma, Field(gt=0.0, description="noise of range rates that the receiver assumes")]


class SmoothingCard(units.Card):
    """Pseudoranges smoothed by carrier phase before they are solved (Hatch filter), satellite by satellite.

    It restarts when the receiver loses the phase: when the signal is lost, when the antenna changes, and at a slip that
    the receiver detects (`cycle_slips`). An undetected slip (the fault `cycle_slip`) remains in the average. Phase
    noise is `carrier_phase_sigma`.
    """

    time: units.TimeConstant = Field(
        100.0, description="window of the smoothing: a mean for this time, then a gain of epoch interval divided by it"
    )
    velocity: Literal["doppler", "backward", "centred"] = Field(
        "doppler",
        description="range rates: doppler: from the Doppler shift; backward: difference of carrier phase over an "
        "interval that ends at the epoch (late by half of it); centred: over an interval centred on it",
    )
    rate_interval: units.TimeConstant = Field(0.1, description="interval of the differences of carrier phase")


Smoothing = Annotated[
    SmoothingCard | None, Field(description="smoothing of the ranges by carrier phase; none: code only")
]


class _Solver(units.Card):
    """Base of the cards of receivers that compute their solution from ranges."""

    OLD_KEYS: ClassVar[Mapping[str, str]] = {"told": "replaced by reported_covariance"}

    @model_validator(mode="before")
    @classmethod
    def _refuse_old_keys(cls, data: Any) -> Any:
        """Refuse the keys of earlier versions with the key that replaces them."""
        for key, message in cls.OLD_KEYS.items():
            if isinstance(data, Mapping) and key in data:
                raise ValueError(f"{key}: {message}")
        return data


def _values(card: units.Card, excluded_fields: set[str]) -> dict[str, Any]:
    return {name: getattr(card, name) for name in type(card).model_fields if name not in excluded_fields}


class DirectSolution(units.Card):
    """No solver: true position and velocity plus white noise per axis, independent of the satellites in view."""

    kind: Literal["direct"] = "direct"
    position_sigma: units.LengthSigma
    velocity_sigma: units.SpeedSigma
    position_bias: units.LengthSigma = Field(
        0.0, description="Gauss-Markov error per axis, in addition to the white noise"
    )
    velocity_bias: units.SpeedSigma = 0.0
    bias_time: units.TimeConstant = Field(60.0, description="time constant of both errors")
    error_table: ErrorTable | None = Field(None, description="recorded errors, added to all of the above")


class BancroftSolution(_Solver):
    """A point solution at every epoch with four satellites or more, independent of earlier epochs."""

    kind: Literal["bancroft"]
    range_sigma: RangeSigma  # modelled noise of a pseudorange
    rate_sigma: RateSigma  # modelled noise of a range rate
    refinements: int = Field(
        2, ge=0, le=5, description="Newton steps of least squares after the closed form; 0: closed form only"
    )
    false_alarm: units.Share = Field(
        1e-3, gt=0.0, lt=1.0, description="probability that residuals of good measurements are rejected as inconsistent"
    )
    least_quality: Literal[1, 2, 3] = Field(
        1,
        description="smallest status with output: 1 inconsistent residuals, 2 four satellites (no test), 3 consistent"
        " residuals",
    )
    smoothing: Smoothing = None  # of the ranges by carrier phase; none: code alone
    reported_covariance: ReportedCovariance = ComputedCovariance()  # covariance reported with the solution
    reported: Reported = False  # whether errors of the solution are reported too

    def numbers(self) -> dict[str, Any]:
        """Return the settings of the point solver, SI, by the names of its arguments."""
        return _values(self, {"kind", "reported_covariance", "reported", "smoothing"})


class FilteredSolution(_Solver):
    """The Kalman filter of the receiver, with the states position, velocity, clock and optionally acceleration.

    `jerk` gives a filter with acceleration states, `acceleration_noise` a filter without them. Process noise adapts to
    the acceleration between the last two point solutions: its variance is the larger of sigma squared and gain times
    acceleration squared. The variances of range and range rate adapt likewise, with gain times acceleration. Gains of
    zero make them constant.
    """

    kind: Literal["filtered"]
    range_sigma: RangeSigma  # modelled noise of a pseudorange
    rate_sigma: RateSigma  # modelled noise of a range rate
    jerk: units.JerkSigma | None = Field(
        None, description="white noise of the acceleration, constant over an interval, per axis"
    )
    jerk_gain: units.JerkGain = 0.0  # of the jerk's variance, per squared acceleration
    acceleration_noise: units.AccelerationSigma | None = Field(
        None, description="white noise of the acceleration, constant over an interval, per axis"
    )
    acceleration_gain: units.Fraction = 0.0  # of the acceleration noise's variance, per squared acceleration
    acceleration_time: units.TimeConstant | None = Field(
        None, description="time constant of the acceleration; none: a random walk"
    )
    range_gain: units.RangeGain = 0.0  # of the range variance, per acceleration
    rate_gain: units.LengthSigma = 0.0  # of the range-rate variance, per acceleration
    clock_noise: units.AccelerationSigma = Field(
        description="white noise of the derivative of the clock drift, constant over an interval"
    )
    start_acceleration: units.AccelerationSigma = Field(10.0, description="initial one-sigma of the acceleration")
    gate: float | None = Field(None, gt=0.0, description="innovations beyond this number of sigmas are rejected")
    range_limit: Annotated[units.Length, Field(gt=0.0)] | None = Field(
        None, description="innovations beyond this length are rejected too"
    )
    rate_limit: Annotated[units.Speed, Field(gt=0.0)] | None = None  # the same for range rates
    restart_after: int | None = Field(
        None,
        ge=1,
        description="consecutive epochs with most scalars rejected, after which the filter restarts from a point "
        "solution",
    )
    longest_coast: units.Pause | None = Field(
        None, description="time without an accepted measurement after which there is no output; none: there always is"
    )
    point: BancroftSolution | None = Field(
        None, description="point solution that starts the filter; none: the default with its sigmas"
    )
    smoothing: Smoothing = None  # of the ranges by carrier phase; none: code alone
    reported_covariance: ReportedCovariance = ComputedCovariance()  # covariance reported with the solution
    reported: Reported = False  # whether errors of the solution are reported too

    def _faults(self) -> Iterator[str]:
        if (self.jerk is None) == (self.acceleration_noise is None):
            yield "state jerk (a filter with acceleration) or acceleration_noise (one without), not both"
        if self.acceleration_gain if self.jerk is not None else self.jerk_gain:
            yield "jerk_gain goes with jerk, acceleration_gain with acceleration_noise"
        if self.acceleration_noise is not None and self.acceleration_time is not None:
            yield "acceleration_time: there is no acceleration to decay, state jerk for it"

    def numbers(self) -> dict[str, Any]:
        """Return the settings of the filter, SI, by the names of `FilterSettings`."""
        drive_fields = {"jerk", "jerk_gain", "acceleration_noise", "acceleration_gain"}
        values = _values(self, {"kind", "reported_covariance", "point", "reported", "smoothing", *drive_fields})
        drive = (self.acceleration_noise, self.acceleration_gain) if self.jerk is None else (self.jerk, self.jerk_gain)
        return values | {"acceleration": self.jerk is not None, "drive_sigma": drive[0], "drive_gain": drive[1]}

    @property
    def fix(self) -> BancroftSolution:
        """Card of the point solution that initialises the filter and adapts its noise."""
        return self.point or BancroftSolution.model_construct(
            kind="bancroft", range_sigma=self.range_sigma, rate_sigma=self.rate_sigma
        )


SolutionCard = Annotated[DirectSolution | BancroftSolution | FilteredSolution, Field(discriminator="kind")]


class ClockCard(units.Card):
    """A receiver oscillator: one-sided power-law coefficients h0 (s) and h_minus2 (1/s), and initial errors."""

    h0: float = Field(ge=0)
    h_minus2: float = Field(ge=0)
    initial_bias: units.LengthSigma = 0.0
    initial_drift: units.SpeedSigma = 0.0


_SECOND = {"L1_L2": L2, "L1_L5": L5}
_LEAST_WINDOW = 1.5  # epochs; a shorter window rounds to one epoch
_HALF = 0.5  # of the interval between epochs, so that successive differences share no phase measurement


class ReceiverCard(units.NamedCard):
    """A GNSS receiver and its antennas: true properties of its measurements.

    Without antennas, link, loops and tracking it measures every satellite above the mask, immediately and with constant
    noise. Antennas limit the directions of reception. With a link, C/N0 follows from their gain. With loops, noise and
    loss of lock follow from C/N0 and the motion. With tracking, search and pull-in take time.
    """

    rate: units.StepRate = Field(1.0, description="rate of the measurements; a filter uses all or every n-th of them")
    resources: Resources | None = Field(None, description="cost, mass, power, volume, reliability")
    latency: units.Pause = Field(0.0, description="age of a measurement when the filter uses it")
    latency_per_satellite: units.Pause = Field(0.0, description="added to the latency for every satellite tracked")
    latency_error: units.Pause = Field(0.0, description="one-sigma of the latency error that is constant in a run")
    latency_sigma: units.Pause = Field(0.0, description="one-sigma of the random latency error of each epoch")
    multipath: units.LengthSigma = Field(0.0, description="Gauss-Markov error, independent for every pseudorange")
    multipath_time: units.TimeConstant = 60.0  # correlation time of multipath
    range_rate_offset: units.SpeedSigma = Field(
        0.0,
        description="offset that all range rates share, constant in a run, in addition to the clock drift of the "
        "ranges",
    )
    range_rate_instability: units.SpeedSigma = Field(
        0.0, description="Gauss-Markov part of the offset that all range rates share"
    )
    range_rate_instability_time: units.TimeConstant = 60.0  # its correlation time
    doppler_interval: units.Pause = Field(
        0.0, description="a Doppler range rate is the mean over this time up to its epoch; 0: instantaneous"
    )
    frequencies: Literal["L1", "L1_L2", "L1_L5"] = Field(
        "L1", description="two frequencies: combined to remove the first-order ionosphere, with amplified noise"
    )
    lever_error: units.LengthSigma = Field(
        0.0, description="one-sigma of the position of the antenna on the vehicle, per body axis"
    )
    mask: units.Angle = Field(0.0, description="elevation mask above the local horizontal")
    mask_height: Annotated[units.Length, Field(gt=0.0)] | None = Field(
        None,
        description="height at which the mask reaches the horizontal; above it, the mask follows the horizon of a "
        "shell of this height; none: a constant mask",
    )
    lever_b: tuple[units.Length, units.Length, units.Length] = Field(
        (0.0, 0.0, 0.0), description="vector from the IMU to the point to which the solution refers"
    )
    channels: int = Field(16, ge=1, le=64, description="largest number of satellites tracked; the highest are selected")
    pseudorange_sigma: Annotated[units.LengthSigma, Field(le=1e6)] = Field(
        description="white noise; with loops, the noise in addition to their thermal noise"
    )
    range_rate_sigma: Annotated[units.SpeedSigma, Field(le=1e5)] = Field(
        description="white noise; with loops, the noise in addition to their thermal noise"
    )
    noise_by: NoiseBy = ()  # factors on the sigmas over altitude, specific force or jerk
    carrier_phase_sigma: units.LengthSigma = Field(
        0.002, description="white noise of a carrier phase; with loops, the noise in addition to their thermal noise"
    )
    carrier_ambiguity: units.LengthSigma = Field(
        10.0, description="one-sigma of the ambiguity of a carrier phase after every acquisition or slip"
    )
    cycle_slips: CycleSlipCard | None = Field(
        None, description="cycle slips; none: a phase is continuous while its signal is tracked"
    )
    solution: SolutionCard  # how position and velocity are computed
    clock: ClockCard  # oscillator
    antennas: tuple[AntennaCard, ...] = Field((), description="antennas; none: one omnidirectional antenna at lever_b")
    link: LinkCard | None = Field(None, description="link budget; none: no C/N0")
    loops: LoopsCard | None = Field(
        None, description="tracking loops, which require a link budget; none: constant noise, no loss of lock"
    )
    tracking: TrackingCard | None = Field(None, description="acquisition; none: a visible satellite is tracked at once")

    def _faults(self) -> Iterator[str]:
        if self.loops is not None and self.link is None:
            yield "loops need a link: their noise follows from its C/N0"
        smoothing = getattr(self.solution, "smoothing", None)
        if smoothing is not None and smoothing.time * self.rate < _LEAST_WINDOW:
            yield "solution.smoothing.time: a window of one epoch has no smoothing effect"
        if smoothing is not None and smoothing.velocity != "doppler" and smoothing.rate_interval * self.rate > _HALF:
            yield "solution.smoothing.rate_interval: at most half of the interval between epochs"
        if self.doppler_interval * self.rate > 1.0:
            yield "doppler_interval: at most the interval between epochs"
        if self.cycle_slips is not None and self.cycle_slips.below is not None and self.link is None:
            yield "cycle_slips.below needs a link: it is a C/N0"

    @property
    def is_dual(self) -> bool:
        """Whether ranges of two frequencies are combined, which removes the first-order ionospheric delay."""
        return self.frequencies != "L1"

    @property
    def amplification(self) -> float:
        """Factor on noise and multipath due to the combination of two frequencies with equal, independent sigmas."""
        return math.hypot(*free_combination(L1, _SECOND[self.frequencies])) if self.is_dual else 1.0

    @property
    def lever_arms(self) -> tuple[tuple[float, float, float], ...]:
        """Phase centres of the antennas relative to the IMU, m, body axes; `lever_b` without antennas."""
        return tuple(antenna.lever_b for antenna in self.antennas) or (self.lever_b,)
