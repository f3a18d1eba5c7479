"""Filter card: measurements, states, noise model and rates of a navigation filter."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from lvnav_trade.filter.assumed import ImuModel, InitialModel, ReceiverModel
from lvnav_trade.filter.measurement_tuning import HInfinityCard, ProcessNoiseTable, RegionNoiseCard, UnderweightingCard
from lvnav_trade.filter.policies.policy_cards import IntegrityCard, LogicCard
from lvnav_trade.filter.policies.stored_gains import GainSchedule
from lvnav_trade.filter.strapdown_algorithm import StrapdownCard
from lvnav_trade.gnss.delay_cards import CorrectionsCard
from lvnav_trade.quantities import units
from lvnav_trade.quantities.shared_cards import EnvelopeCard
from lvnav_trade.quantities.state_layout import BY_SATELLITE, EXTRAS, OF_OBSERVABLES, PARAMETERS, RELATIVE
from lvnav_trade.sensors.family import (
    MEASUREMENTS,
    OBSERVABLES,
    RECEIVER_SOLUTION,
    SENSOR_STATES,
    Measurement,
    SensorModels,
)
from lvnav_trade.sensors.receiver_observables import DIFFERENCES

MatchedLiteral = Literal["matched"]
# Standard states of every filter; its card names the additional states.
BIASES = ("gyro_bias", "accel_bias")
# Measurements of the filter kinds of earlier versions.
_KINDS = {
    "inertial": "[]",
    "loose": "[position, velocity]",
    "tight": "[pseudorange, range_rate]",
    "referenced": "[position, velocity, attitude] and report_imu_samples: true",
    "vehicle_model": "[position, velocity, attitude, imu] and report_imu_samples: true",
}


if TYPE_CHECKING:
    ParameterState = str
    ExtraState = str
    NoiseState = str
else:
    ParameterState = Literal[tuple(n for n in (*PARAMETERS, *EXTRAS, *SENSOR_STATES) if n not in OF_OBSERVABLES)]
    ExtraState = Literal[
        tuple(n for n in (*PARAMETERS, *EXTRAS, *SENSOR_STATES) if n not in (*BIASES, *OF_OBSERVABLES))
    ]
    NoiseState = Literal[tuple(n for n in (*EXTRAS, *SENSOR_STATES) if n not in (*RELATIVE.values(), *OF_OBSERVABLES))]


class DelayCompensation(units.Card):
    """Compensation of measurement latency, for the receiver and for every sensor with a latency.

    buffered: the innovation is formed with the stored state of the time of validity. extrapolated: the receiver's
    solution is extrapolated to the present.
    """

    kind: Literal["buffered", "extrapolated"] = Field(
        description="buffered: innovation at the state of the time of validity, as for sensors in any case; "
        "extrapolated: Euler step of a solution"
    )
    delay: MatchedLiteral | units.Pause = Field(
        "matched",
        description="latency of the receiver that the filter assumes; matched: the true one; latencies of sensors are"
        " in sensor_models",
    )
    delay_sigma: units.Pause = Field(0.0, description="extrapolated: assumed one-sigma of the error of the delay")
    acceleration_sigma: units.AccelerationSigma = Field(
        0.0, description="extrapolated: assumed one-sigma of the filter's acceleration"
    )
    base: units.Pause = Field(0.1, gt=0.0, description="extrapolated: time over which the acceleration is computed")


class FilterCard(units.NamedCard):
    """Card of a navigation filter.

    The error state is resolved in the inertial frame, whichever frame the strapdown is integrated in.

    Closed loop: the error state is fed back to the strapdown at every epoch. Open loop: the strapdown runs uncorrected,
    and the error state is added to its output. With `imu` among the measurements, angular rate and specific force of
    the vehicle are states; the motion envelope gives their process noise, and every IMU sample is a measurement.
    """

    OLD_KEYS: ClassVar[Mapping[str, str]] = {
        "kind": "replaced by measurements, such as [pseudorange, range_rate]",
        "altimeter": "replaced by sensor_models.altitude",
        "reference": "replaced by sensor_models.attitude",
        "strapdown_rate": "replaced by strapdown.ratio, the increments to a step",
    }

    measurements: tuple[Measurement, ...] = Field(
        description="[]: inertial; of the receiver either its solution (position, velocity) or ranges (pseudorange, "
        "range_rate, carrier_phase, tdcp, delta_pseudorange); of sensors; imu: samples of the IMU"
    )
    extra_states: tuple[ExtraState, ...] = ()  # estimated besides navigation errors and biases
    clock: Literal["two_state", "one_state", "differenced"] = Field(
        "two_state",
        description="receiver clock of a filter with ranges: two_state: bias and drift; one_state: bias, with the "
        "drift as white noise; differenced: no memory, ranges relative to a reference satellite",
    )
    reference_satellite: str | None = Field(
        None, description="reference of clock: differenced while it is in use, such as G05; none: the highest satellite"
    )
    strapdown: StrapdownCard = Field(StrapdownCard(), description="integration of the increments")
    mechanisation: Literal["inertial", "earth", "pad", "ned", "enu"] = Field(
        "inertial",
        description="frame of the strapdown's integration; earth: Earth-centred, Earth-fixed; pad: the same axes about "
        "the start of the flight; ned, enu: local geographic axes, with latitude, longitude and height",
    )
    covariance_rate: units.StepRate = 10.0  # of the covariance propagation
    update_rate: units.StepRate = 1.0  # of the epochs
    transition_rate: units.StepRate | None = Field(
        None,
        description="rate at which the transition is linearised again; none: at every covariance step, with the "
        "integrals of the strapdown over that step",
    )
    consider: tuple[ParameterState, ...] = Field(
        (), description="states that are not estimated but whose covariance is included (Schmidt)"
    )
    as_noise: tuple[NoiseState, ...] = Field(
        (),
        description="states treated as correlated measurement noise, independent between epochs: covariance R + s^2 t"
        " t' with the sigma s and the partials t",
    )
    neglect: tuple[Literal["gyro_bias", "accel_bias"], ...] = Field(
        (), description="standard states that the filter omits"
    )
    update: Literal["symmetric", "joseph"] = Field(
        "symmetric", description="covariance update; symmetric: P - K S K'; joseph: Joseph's form"
    )
    transition_order: Literal[1, 2] = Field(2, description="order of the transition in the window length; 1: I + F dt")
    algorithm: Literal["extended", "iterated", "unscented"] = Field(
        "extended", description="extended: Jacobians; unscented: sigma points; iterated: repeated linearisation"
    )
    iterations: int = Field(3, ge=2, le=20, description="passes of an iterated update; each linearises again")
    gate: float | None = Field(
        None, gt=0, le=1000, description="gate on the innovation of each scalar, in sigma; none: no gate"
    )
    gravity: Literal["point", "j2", "j4"] = Field(
        "j4", description="gravitation of the strapdown: point mass, with J2, or with J2 to J4"
    )
    feedback: Literal["closed", "open", "direct"] = Field(
        "closed",
        description="closed: the error state is fed back to the strapdown once an epoch; open: added to the outputs; "
        "direct: total states are corrected by every scalar measurement (to first order the same as closed)",
    )
    init: Literal["from_card", "from_gnss"] = Field(
        "from_card", description="source of position, velocity and their covariance when the filter starts"
    )
    logic: LogicCard | None = Field(
        None, description="mode logic; none: the filter starts at once and uses every measurement that the gate accepts"
    )
    integrity: IntegrityCard | None = Field(None, description="fault tests; none: only the gate")
    imu: MatchedLiteral | ImuModel = "matched"  # filter model of the IMU; matched: that of the truth
    receiver: MatchedLiteral | ReceiverModel = "matched"  # filter model of the receiver; matched: that of the truth
    initial: MatchedLiteral | InitialModel = "matched"  # filter model of the initial errors; matched: that of the truth
    sensor_models: SensorModels = Field(
        default_factory=SensorModels, description="filter models of the sensors, by measurement"
    )
    gains: GainSchedule | None = Field(
        None, description="card with stored gains; none: gains from the covariance at every epoch"
    )
    envelope: EnvelopeCard | None = Field(
        None, description="process noise of the vehicle model; none: the defaults of the card"
    )
    corrections: CorrectionsCard = Field(
        CorrectionsCard(), description="corrections that are subtracted from the measurements"
    )
    delay_compensation: DelayCompensation | None = Field(
        None, description="compensation of latency; none: late measurements are treated as present"
    )
    delayed_state: Literal["augmented", "consider", "back_propagated"] = Field(
        "augmented",
        description="state at the earlier epoch of a difference: augmented: estimated as a clone; consider: "
        "considered; back_propagated: from the present state by the inverse transition",
    )
    previous_noise: Literal["white", "estimated"] = Field(
        "white",
        description="noise of the earlier epoch of a difference: white: independent in every difference; estimated: a"
        " state",
    )
    attitude_noise: units.AngleRandomWalk = Field(
        0.0, description="noise in addition to that of the IMU, root PSD per axis"
    )
    velocity_noise: units.VelocityRandomWalk = 0.0  # the same for the accelerometers
    position_noise: units.PositionRandomWalk = Field(
        0.0, description="noise of the derivative of position, in addition to velocity, root PSD per axis"
    )
    backup: bool = Field(
        False,
        description="run a second strapdown on the same increments that is never corrected, and report its errors",
    )
    underweighting: tuple[UnderweightingCard, ...] = Field(
        (), description="under-weighting of measurements while conditions hold"
    )
    fading_memory: units.TimeConstant | None = Field(
        None,
        description="time constant T of a fading memory: the covariance of estimated states grows by exp(2 t / T); "
        "none: no fading",
    )
    h_infinity: HInfinityCard | None = Field(
        None, description="H-infinity filter, which bounds the errors for the worst disturbance; none: Kalman filter"
    )
    region_noise: tuple[RegionNoiseCard, ...] = Field((), description="variance added at a change of operating region")
    process_noise_by: tuple[ProcessNoiseTable, ...] = Field(
        (), description="noise of attitude, velocity and position over altitude, specific force or jerk"
    )
    report_imu_samples: bool = Field(
        False, description="report errors of the IMU samples, raw and corrected, in addition to those of the states"
    )

    @model_validator(mode="before")
    @classmethod
    def _refuse_old_keys(cls, data: Any) -> Any:
        """Refuse the keys of earlier versions with the key that replaces them."""
        if not isinstance(data, Mapping):
            return data
        for key, replacement in cls.OLD_KEYS.items():
            if key not in data:
                continue
            if key == "kind" and data["kind"] in _KINDS:
                raise ValueError(f"kind: replaced by measurements: {_KINDS[data['kind']]}")
            raise ValueError(f"{key}: {replacement}")
        return data

    @field_validator("measurements")
    @classmethod
    def _check_measurements(cls, measurement_names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the measurements in the order of `MEASUREMENTS`; their order in the card has no effect."""
        for name in measurement_names:
            if measurement_names.count(name) > 1:
                raise ValueError(f"{name!r} is listed twice")
        if set(measurement_names) & set(RECEIVER_SOLUTION) and set(measurement_names) & set(OBSERVABLES):
            raise ValueError(
                "the receiver's solution is computed from the same ranges: information would be counted twice; "
                "take position and velocity, or pseudorange and range_rate"
            )
        for difference, observable in DIFFERENCES.items():
            if {difference, observable} <= set(measurement_names):
                raise ValueError(f"{difference} is the change of {observable}: information would be counted twice")
        return tuple(name for name in MEASUREMENTS if name in measurement_names)

    def _faults(self) -> Iterator[str]:
        yield from _state_faults(self)
        yield from _logic_faults(self)
        if self.clock == "one_state" and "range_rate" in self.measurements:
            yield "clock: one_state models the drift as white noise, but every range_rate measures the drift"
        yield from _propagation_faults(self)
        if self.underweighting and not self.is_aided:
            yield "underweighting: the filter has no measurement that it could act on"
        for number, underweighting_card in enumerate(self.underweighting):
            for name in underweighting_card.measurements:
                if name not in self.measurements:
                    yield f"underweighting.{number}.measurements: {name} is not among the filter's measurements"
        yield from _h_infinity_faults(self)
        if self.delayed_state == "back_propagated" and self.models_vehicle:
            yield "delayed_state: samples of the IMU are updates between epochs, which no transition leads back through"
        if self.delayed_state == "back_propagated" and self.as_noise:
            yield "delayed_state: a state that is reset between epochs cannot be propagated back by a transition"

    @property
    def tight(self) -> bool:
        """Whether the filter processes satellite observables (tight coupling)."""
        return any(name in self.measurements for name in OBSERVABLES)

    @property
    def differences(self) -> tuple[str, ...]:
        """The measurements that are differences of two successive epochs."""
        return tuple(name for name in self.measurements if name in DIFFERENCES)

    @property
    def loose(self) -> bool:
        """Whether the filter processes the receiver's solution (loose coupling)."""
        return any(name in self.measurements for name in RECEIVER_SOLUTION)

    @property
    def is_aided(self) -> bool:
        """Whether the filter processes any measurement."""
        return bool(self.measurements)

    @property
    def models_vehicle(self) -> bool:
        """Whether IMU samples are measurements, and angular rate and specific force of the vehicle are states."""
        return "imu" in self.measurements


def _state_faults(card: FilterCard) -> Iterator[str]:
    """Yield the states that are listed in two ways that exclude each other."""
    conflicting_states = sorted(set(card.neglect) & set(card.consider))
    if conflicting_states:
        yield f"{', '.join(conflicting_states)}: neglected and considered, choose one"
    for name in card.as_noise:
        if name in card.extra_states:
            yield f"as_noise: {name} is in extra_states too, choose one"
        elif name in card.consider:
            yield f"as_noise: {name} is in consider too, choose one"
    states = {*card.extra_states, *card.consider, *card.as_noise}
    for satellite_state, common_state in BY_SATELLITE.items():
        if {satellite_state, common_state} <= states:
            yield f"{satellite_state} and {common_state} model the same delay, choose one"


def _propagation_faults(card: FilterCard) -> Iterator[str]:
    """Yield the settings of strapdown, transition and algorithm that exclude each other."""
    if card.strapdown.ratio > 1 and card.models_vehicle:
        yield "strapdown.ratio: a filter with imu among its measurements uses every sample"
    if card.transition_rate is not None and card.models_vehicle:
        yield "transition_rate: a filter with imu among its measurements propagates by every sample"
    if card.backup and card.models_vehicle:
        yield "backup: a filter with imu among its measurements has no strapdown of increments"
    if card.algorithm == "iterated" and card.feedback == "direct":
        yield "feedback: a direct filter linearises after every scalar, which an iterated update would repeat"
    if card.algorithm == "unscented" and card.models_vehicle:
        yield "algorithm: the strapdown propagates sigma points; a filter with imu among its measurements has none"
    if card.algorithm == "unscented" and (card.transition_rate is not None or card.transition_order != 2):
        yield "algorithm: an unscented filter has no transition, whose rate or order could be chosen"
    if card.transition_rate is not None and card.transition_rate > card.covariance_rate:
        yield "transition_rate: exceeds covariance_rate, at which the covariance is propagated"


def _logic_faults(card: FilterCard) -> Iterator[str]:
    """Yield the settings of the mode logic that the feedback or the algorithm excludes."""
    if card.logic is None:
        return
    if card.logic.correct_after > 0.0 and card.feedback != "open":
        yield "logic.correct_after delays the outputs of an open loop: it needs feedback: open"
    if card.logic.after_stop == "inertial":
        return
    if card.feedback != "open":
        yield "logic.after_stop: a closed loop has its corrections in the strapdown; it needs feedback: open"
    if card.logic.stop_after is None:
        yield "logic.after_stop: without stop_after the filter never stops; state stop_after"
    if card.logic.after_stop == "predicted" and (card.algorithm == "unscented" or card.models_vehicle):
        yield (
            "logic.after_stop: a filter with points, or with imu among its measurements, has no transition of a "
            "window to predict the correction by; choose held"
        )


def _h_infinity_faults(card: FilterCard) -> Iterator[str]:
    """Yield the settings that an H-infinity filter excludes."""
    if card.h_infinity is None:
        return
    if not card.is_aided:
        yield "h_infinity: bounds errors by measurements, and the filter has none"
    if card.models_vehicle:
        yield "h_infinity: a filter with imu among its measurements has another covariance between epochs"
    if card.gains is not None:
        yield "h_infinity: stored gains are used whatever the covariance is"
    if card.consider:
        yield f"h_infinity: would change the covariance of {', '.join(card.consider)}, which is only considered"
    if card.backup:
        yield "h_infinity: the backup is measured by nothing, and its covariance would grow beyond all bounds"
    if card.delayed_state == "back_propagated" and card.differences:
        yield "h_infinity: its covariance cannot be propagated back by a transition; use delayed_state: augmented"
