"""Scenario: one resolved design point (trajectory, IMU, GNSS, filter, faults), frozen."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, field_validator, model_validator

from lvnav_trade.delays import AtmosphereCard
from lvnav_trade.filters.base import FilterCard, ImuBelief, InitialBelief, ReceiverBelief
from lvnav_trade.limits import FAULTS
from lvnav_trade.observables.sensor import SensorCard, SensorModel
from lvnav_trade.observables.sensors import RANGES, RECEIVER_SOLUTION, SENSOR_MEASUREMENTS, Sensor, model_of
from lvnav_trade.units import AngleSigma, Card, Length, LengthSigma, SpeedSigma
from lvnav_trade.world.control.controlled import ControlledCard
from lvnav_trade.world.faults import Fault
from lvnav_trade.world.flight.trajectory import TrajectoryCard
from lvnav_trade.world.gravity import GravityCard
from lvnav_trade.world.receiver.receiver import ReceiverCard
from lvnav_trade.world.receiver.solutions import DirectSolution
from lvnav_trade.world.sensors.imu import ImuCard
from lvnav_trade.world.sky.constellation import AlmanacConstellation, Constellation, parts_of


class InitialErrors(Card):
    """True one-sigma error of the navigation state at the start: tilt (north, east axes), heading, position,
    velocity.
    """

    tilt: AngleSigma
    heading: AngleSigma
    position: LengthSigma
    velocity: SpeedSigma


class Scenario(Card):
    """Everything that one case needs; cards are already resolved into it."""

    OLD_KEYS: ClassVar[Mapping[str, str]] = {
        "altimeter": "replaced by sensors, such as sensors: {altimeter: altimeters/radar_004}; "
        "the filter lists altitude among its measurements",
        "attitude_reference": "replaced by sensors, such as sensors: {attitude_reference: "
        "attitude_references/magnetometer_003}; the filter lists attitude among its measurements",
    }

    trajectory: Annotated[TrajectoryCard, Field(discriminator="kind")]
    imu: ImuCard
    constellation: Annotated[Constellation, Field(discriminator="kind")]
    receiver: ReceiverCard
    filter: FilterCard
    initial: InitialErrors
    sensors: dict[str, Sensor | None] = Field(
        {}, description="beside the IMU and the receiver, by names of your own; null removes one"
    )
    control: ControlledCard | None = Field(None, description="the ascent's vehicle steered, beside the navigation")
    faults: tuple[Fault, ...] = Field((), max_length=FAULTS)
    atmosphere: AtmosphereCard = Field(AtmosphereCard(), description="what is true of the signals' delays")
    gravity: GravityCard | None = Field(None, description="what true gravity has beyond the model of the truth")
    frame: Literal["ned", "ecef", "inertial", "orbital"] = "ned"
    diverged: Length = Field(100e3, gt=0.0, description="a run whose position error exceeds this counts as failed")

    @model_validator(mode="before")
    @classmethod
    def _renamed(cls, data: Any) -> Any:
        """Refuse the keys of earlier versions with the key that replaces them."""
        found = next((key for key in cls.OLD_KEYS if isinstance(data, Mapping) and key in data), None)
        if found is not None:
            raise ValueError(f"{found}: {cls.OLD_KEYS[found]}")
        return data

    @field_validator("sensors")
    @classmethod
    def _named(cls, sensors: dict[str, SensorCard | None]) -> dict[str, SensorCard | None]:
        wrong = next((name for name in sensors if not re.fullmatch(r"[A-Za-z_]\w*", name)), None)
        if wrong is not None:
            raise ValueError(f"{wrong!r} cannot name a sensor; use letters, digits and '_'")
        return sensors

    @model_validator(mode="after")
    def _steered(self) -> Self:
        card = self.control
        if card is None:
            return self
        if self.trajectory.kind != "vehicle":
            other = self.trajectory.kind
            raise ValueError(f"control: the ascent of a vehicle is steered, not a trajectory of kind {other}")
        if not sensors_measuring(self, "attitude"):
            raise ValueError("control: a vehicle under control needs a sensor that measures attitude")
        stages = len(self.trajectory.vehicle.stages)
        for name, held in (("rotation.stacks", card.rotation.stacks), ("controller.gains", card.controller.gains)):
            if len(held) != stages:
                raise ValueError(f"control.{name}: {len(held)} of them, the vehicle has {stages} stages")
        return self

    @model_validator(mode="after")
    def _provided(self) -> Self:
        """Refuse a measurement without a sensor; where a sensor is null the filter does without it."""
        if None in self.sensors.values():
            return self
        for name in self.filter.measurements:
            if name in SENSOR_MEASUREMENTS and not sensors_measuring(self, name):
                raise ValueError(f"filter.measurements: no sensor of the scenario measures {name}")
        return self

    @model_validator(mode="after")
    def _late(self) -> Self:
        late = self.filter.delay_compensation
        if late is None:
            return self
        if not self.filter.tight and not self.filter.loose:
            raise ValueError("filter.delay_compensation: the filter takes nothing of the receiver that could be late")
        if late.kind == "extrapolated" and self.filter.tight:
            raise ValueError(
                "filter.delay_compensation.kind: only a solution can be extrapolated; a tight filter buffers"
            )
        return self

    @model_validator(mode="after")
    def _possible(self) -> Self:
        refused = next(engine_limits(self), None)
        if refused is not None:
            raise ValueError(f"{refused[0]}: {refused[1]}")
        return self


_BEYOND_BIAS = ("misalignment", "g_sensitivity", "scale_factor", "scale_factor_drift", "nonlinearity", "quantisation")
_LISTS: tuple[tuple[str, ...], ...] = (
    *((), RECEIVER_SOLUTION, RANGES, (*RECEIVER_SOLUTION, "altitude"), (*RANGES, "altitude")),
    *((*RECEIVER_SOLUTION, "attitude"), (*RECEIVER_SOLUTION, "attitude", "imu")),
)
"""Lists of measurements that the engines can run."""


# ENGINE LIMITS: what physics permits and the engines cannot run yet. What an engine has learnt goes from here.
def engine_limits(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield path and reason of everything in a scenario that the engines cannot run yet."""
    card, listed = scenario.filter, measured(scenario)
    if set(listed) not in map(set, _LISTS):
        known = "; ".join(f"[{', '.join(one)}]" for one in _LISTS)
        yield "filter.measurements", f"[{', '.join(listed)}] cannot be simulated yet; possible are {known}"
    yield from _sensor_limits(scenario)
    if not card.loose or "attitude" in listed:
        about = "needs measurements: [position, velocity], and of the sensors at most altitude"
        for name, given in (
            ("logic", card.logic), ("init", card.init == "from_gnss" or None), ("gains", card.gains),
        ):  # fmt: skip
            if given is not None:
                yield f"filter.{name}", f"{'from_gnss ' if name == 'init' else ''}{about}"
    if "attitude" in listed:
        yield from _attitude_limits(scenario)
    yield from _late_limits(scenario)
    yield from _solution_limits(scenario)


def _sensor_limits(scenario: Scenario) -> Iterator[tuple[str, str]]:
    for measurement in SENSOR_MEASUREMENTS:
        found = sensors_measuring(scenario, measurement)
        if len(found) > 1:
            names = ", ".join(name for name, card in scenario.sensors.items() if card in found)
            yield "sensors", f"{names}: at most one sensor that measures {measurement}"
    if scenario.filter.report_imu_samples != bool(sensor_of(scenario, "attitude")):
        yield "filter.report_imu_samples", "should be true for a filter that measures attitude, and for no other"
    for sensor in sensors_measuring(scenario, "attitude") if scenario.control is not None else ():
        if sensor.from_ is not None or sensor.until is not None:
            yield "control", "the attitude sensor of a vehicle under control measures throughout: no from, no until"


def _attitude_limits(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield what the loop of a filter that measures attitude cannot do."""
    card, by = scenario.filter, "with attitude among the measurements"
    for name in ("neglect", "consider"):
        if getattr(card, name):
            yield f"filter.{name}", f"the IMU's biases are estimated {by}"
    inertial = [name for name in card.extra_states if name.startswith(("gyro_", "accel_"))]
    if inertial and card.models_vehicle:
        yield "filter.extra_states", f"{inertial[0]}: of the IMU only biases are states with imu among the measurements"
    if card.feedback == "open":
        yield "filter.feedback", f"only closed {by}"
    if card.delay_compensation is not None:
        yield "filter.delay_compensation", f"not {by}"
    if scenario.gravity is not None:
        yield "gravity", f"its disturbance is not modelled {by}"
    for sensor, part in (("gyro", scenario.imu.gyro), ("accel", scenario.imu.accel)):
        found = [name for name in _BEYOND_BIAS if getattr(part, name, 0.0) > 0.0]
        if found:
            yield f"imu.{sensor}.{found[0]}", f"only noise and bias are modelled {by}"
    if scenario.receiver.solution.kind != "direct":
        yield "receiver.solution", f"only a direct one {by}, not {scenario.receiver.solution.kind}"


def _late_limits(scenario: Scenario) -> Iterator[tuple[str, str]]:
    card, late = scenario.filter, scenario.filter.delay_compensation
    if late is None:
        return
    if card.feedback == "open" or card.logic is not None or card.init != "from_card":
        yield "filter.delay_compensation", "not with feedback: open, a logic, or init: from_gnss"
    before = late.base if late.kind == "extrapolated" else 0.0
    stated = before + (scenario.receiver.latency if isinstance(late.delay, str) else late.delay)
    interval = epoch_interval(scenario)
    if stated >= interval:
        yield (
            "filter.delay_compensation",
            f"delay{' and base' if before else ''} of {stated * 1e3:.0f} ms, not less than the "
            f"{interval * 1e3:.0f} ms between epochs",
        )


def _solution_limits(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield what solutions with a covariance of their own, stored gains and an altimeter do not go with."""
    card, altitude = scenario.filter, "altitude" in measured(scenario)
    apart = judged(scenario) or card.delay_compensation is not None
    about = "filter.delay_compensation, or a receiver that computes solutions itself"
    if altitude and apart:
        yield "filter.measurements", f"altitude: not with {about}"
    if card.gains is not None and (apart or altitude):
        yield "filter.gains", f"not with {about}, or altitude among the measurements"
    if not judged(scenario):
        return
    shared = [name for name in (*card.extra_states, *card.consider) if not name.startswith(("gyro_", "accel_"))]
    if shared:
        yield (
            "filter.extra_states",
            f"{', '.join(shared)}: a filter that takes solutions with a covariance of their own "
            "(receiver.solution.kind bancroft or filtered, filter.delay_compensation.kind extrapolated) has no "
            "such state",
        )
    if solves(scenario) and any(fault.kind == "frozen_output" for fault in scenario.faults):
        yield "faults", "frozen_output needs receiver.solution.kind: direct, or a tight filter"


def sensors_measuring(scenario: Scenario, measurement: str) -> tuple[SensorCard, ...]:
    """Return the sensors of a scenario that give a measurement."""
    return tuple(card for card in scenario.sensors.values() if card is not None and card.measurement == measurement)


def measured(scenario: Scenario) -> tuple[str, ...]:
    """Return the measurements of the filter, without those whose sensor is null."""
    return tuple(
        name
        for name in scenario.filter.measurements
        if name not in SENSOR_MEASUREMENTS or sensors_measuring(scenario, name)
    )


def sensor_of(scenario: Scenario, measurement: str) -> SensorCard | None:
    """Return the sensor that gives the filter a measurement, None where it does not use it or there is none."""
    found = sensors_measuring(scenario, measurement) if measurement in scenario.filter.measurements else ()
    return found[0] if found else None


def sensor_model(scenario: Scenario, sensor: SensorCard) -> Any:
    """Return the filter's model of a sensor; `matched` takes the sensor's own numbers."""
    model: SensorModel = model_of(scenario.filter.sensor_models, sensor)
    return model


def solves(scenario: Scenario) -> bool:
    """Return whether a loose filter takes the solution of a receiver that solves for it itself."""
    return scenario.filter.loose and not isinstance(scenario.receiver.solution, DirectSolution)


def reported(scenario: Scenario) -> bool:
    """Return whether errors of the receiver's own solution are reported beside those of the filter that takes it."""
    card = scenario.receiver.solution
    return solves(scenario) and not isinstance(card, DirectSolution) and card.reported


def judged(scenario: Scenario) -> bool:
    """Return whether every solution comes with a covariance of its own, so that its rows are taken together."""
    late = scenario.filter.delay_compensation
    extrapolated = late is not None and late.kind == "extrapolated" and scenario.filter.loose
    return solves(scenario) or extrapolated


def epoch_interval(scenario: Scenario) -> float:
    """Return the time (s) between two epochs: a solving receiver works at its own rate, whatever the filter takes."""
    return 1.0 / (scenario.receiver.rate if solves(scenario) else scenario.filter.update_rate)


def _matched_imu(imu: ImuCard) -> ImuBelief:
    """Take every number from the truth; wandering that the bias states do not model apart is added to their walk."""
    gyro, accel = imu.gyro, imu.accel
    # SI numbers are not quantities with a unit, so they bypass the reading of cards
    return ImuBelief.model_construct(
        gyro_random_walk=gyro.random_walk,
        accel_random_walk=accel.random_walk,
        gyro_bias=math.hypot(gyro.bias_repeatability, gyro.bias_instability),
        gyro_bias_walk=math.hypot(
            gyro.rate_random_walk, gyro.bias_instability * math.sqrt(2.0 / gyro.instability_time)
        ),
        gyro_bias_time=None,
        accel_bias=math.hypot(accel.bias_repeatability, accel.bias_instability),
        accel_bias_walk=math.hypot(
            accel.rate_random_walk, accel.bias_instability * math.sqrt(2.0 / accel.instability_time)
        ),
        accel_bias_time=None,
        gyro_scale_factor=gyro.scale_factor,
        accel_scale_factor=accel.scale_factor,
        gyro_misalignment=gyro.misalignment,
        accel_misalignment=accel.misalignment,
        gyro_g_sensitivity=gyro.g_sensitivity,
    )


def _matched_receiver(scenario: Scenario) -> ReceiverBelief:
    """Take every number from the truth; what several causes put into a range of its own is one bias, as slow as the
    largest of them.
    """
    receiver, air = scenario.receiver, scenario.atmosphere
    solution = receiver.solution if isinstance(receiver.solution, DirectSolution) else None
    parts = parts_of(scenario.constellation)
    biases = [(p.range_error, p.range_error_time) for p in parts] + [(receiver.multipath, receiver.multipath_time)]
    offsets = [(p.time_offset, p.time_offset_time) for p in parts if not isinstance(p, AlmanacConstellation)]
    largest = max(offsets, default=(0.0, None), key=lambda pair: pair[0])
    return ReceiverBelief.model_construct(
        pseudorange_sigma=receiver.pseudorange_sigma,
        range_rate_sigma=receiver.range_rate_sigma,
        # a receiver that solves tells the covariance of each of its solutions
        position_sigma=solution.position_sigma if solution else 0.0,
        velocity_sigma=solution.velocity_sigma if solution else 0.0,
        clock_h0=receiver.clock.h0,
        clock_h_minus2=receiver.clock.h_minus2,
        range_bias=math.hypot(max(sigma for sigma, _ in biases[:-1]), receiver.multipath),
        range_bias_time=max(biases, key=lambda pair: pair[0])[1],
        time_offset=largest[0],
        time_offset_time=largest[1],
        troposphere_scale=air.troposphere_scale,
        troposphere_scale_time=air.troposphere_scale_time,
        ionosphere_scale=air.ionosphere_scale,
        ionosphere_scale_time=air.ionosphere_scale_time,
        timing=receiver.latency_error,
        timing_time=None,
        position_bias=solution.position_bias if solution else 0.0,
        position_bias_time=solution.bias_time if solution else None,
        velocity_bias=solution.velocity_bias if solution else 0.0,
        velocity_bias_time=solution.bias_time if solution else None,
    )


def beliefs(scenario: Scenario) -> tuple[ImuBelief, ReceiverBelief, InitialBelief]:
    """Return what the filter believes of its sensors and its start; `matched` takes the truth's own numbers."""
    card, initial, clock = scenario.filter, scenario.initial, scenario.receiver.clock
    imu = _matched_imu(scenario.imu) if isinstance(card.imu, str) else card.imu
    receiver = _matched_receiver(scenario) if isinstance(card.receiver, str) else card.receiver
    if isinstance(card.initial, str):
        start = InitialBelief.model_construct(
            tilt=initial.tilt,
            heading=initial.heading,
            position=initial.position,
            velocity=initial.velocity,
            clock_bias=clock.initial_bias,
            clock_drift=clock.initial_drift,
        )
    else:
        start = card.initial
    return imu, receiver, start
