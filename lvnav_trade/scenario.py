"""Scenario: one resolved design point (trajectory, IMU, GNSS, filter, faults), frozen."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from lvnav_trade.delays import AtmosphereCard
from lvnav_trade.filters.base import REFERENCED, FilterCard, ImuBelief, InitialBelief, ReceiverBelief
from lvnav_trade.units import AngleSigma, Card, Length, LengthSigma, SpeedSigma
from lvnav_trade.world.control.controlled import ControlledCard
from lvnav_trade.world.faults import Fault
from lvnav_trade.world.flight.trajectory import TrajectoryCard
from lvnav_trade.world.gravity import GravityCard
from lvnav_trade.world.receiver.receiver import ReceiverCard
from lvnav_trade.world.receiver.solutions import DirectSolution
from lvnav_trade.world.sensors.altimeter import AltimeterCard
from lvnav_trade.world.sensors.attitude_reference import AttitudeReferenceCard
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


_BEYOND_BIAS = ("misalignment", "g_sensitivity", "scale_factor", "scale_factor_drift", "nonlinearity", "quantisation")


class Scenario(Card):
    """Everything that one case needs; cards are already resolved into it."""

    trajectory: Annotated[TrajectoryCard, Field(discriminator="kind")]
    imu: ImuCard
    constellation: Annotated[Constellation, Field(discriminator="kind")]
    receiver: ReceiverCard
    filter: FilterCard
    initial: InitialErrors
    attitude_reference: AttitudeReferenceCard | None = Field(None, description="of filters that have one")
    altimeter: AltimeterCard | None = Field(None, description="measures height near the ground, for any aided filter")
    control: ControlledCard | None = Field(None, description="the ascent's vehicle steered, beside the navigation")
    faults: tuple[Fault, ...] = ()
    atmosphere: AtmosphereCard = Field(AtmosphereCard(), description="what is true of the signals' delays")
    gravity: GravityCard | None = Field(None, description="what true gravity has beyond the model of the truth")
    frame: Literal["ned", "ecef", "inertial", "orbital"] = "ned"
    diverged: Length = Field(100e3, gt=0.0, description="a run whose position error exceeds this counts as failed")

    @model_validator(mode="after")
    def _steered(self) -> Self:
        card = self.control
        if card is None:
            return self
        if self.trajectory.kind != "vehicle":
            other = self.trajectory.kind
            raise ValueError(f"control: the ascent of a vehicle is steered, not a trajectory of kind {other}")
        if self.attitude_reference is None:
            raise ValueError("control: a vehicle under control needs an attitude_reference")
        stages = len(self.trajectory.vehicle.stages)
        for name, held in (("rotation.stacks", card.rotation.stacks), ("controller.gains", card.controller.gains)):
            if len(held) != stages:
                raise ValueError(f"control.{name}: {len(held)} of them, the vehicle has {stages} stages")
        return self

    @model_validator(mode="after")
    def _referred(self) -> Self:
        kind = self.filter.kind
        if kind not in REFERENCED:
            return self
        if self.attitude_reference is None:
            raise ValueError(f"attitude_reference: a {kind} filter needs one")
        if self.gravity is not None:
            raise ValueError(f"gravity: its disturbance is not modelled with a {kind} filter")
        for sensor, card in (("gyro", self.imu.gyro), ("accel", self.imu.accel)):
            found = [name for name in _BEYOND_BIAS if getattr(card, name, 0.0) > 0.0]
            if found:
                raise ValueError(f"imu.{sensor}.{found[0]}: only noise and bias are modelled with a {kind} filter")
        if self.receiver.solution.kind != "direct":
            raise ValueError(
                f"receiver.solution: a {kind} filter takes a direct one, not {self.receiver.solution.kind}"
            )
        return self

    @model_validator(mode="after")
    def _late(self) -> Self:
        card, late = self.filter, self.filter.delay_compensation
        if late is None:
            return self
        if late.kind == "extrapolated" and card.kind != "loose":
            raise ValueError(
                "filter.delay_compensation.kind: only a solution can be extrapolated; a tight filter buffers"
            )
        if card.feedback == "open" or card.logic is not None or card.init != "from_card":
            raise ValueError("filter.delay_compensation: not with feedback: open, a logic, or init: from_gnss")
        before = late.base if late.kind == "extrapolated" else 0.0
        stated = before + (self.receiver.latency if isinstance(late.delay, str) else late.delay)
        if stated >= epoch_interval(self):
            raise ValueError(
                f"filter.delay_compensation: delay{' and base' if before else ''} of {stated * 1e3:.0f} ms, not less "
                f"than the {epoch_interval(self) * 1e3:.0f} ms between epochs"
            )
        return self

    @model_validator(mode="after")
    def _alone(self) -> Self:
        apart = judged(self) or self.filter.delay_compensation is not None
        if self.altimeter is not None and (apart or self.filter.kind in REFERENCED):
            raise ValueError(
                "altimeter: not with filter.delay_compensation, a receiver that solves itself, or an attitude reference"
            )
        if self.filter.gains is not None and (apart or self.altimeter is not None):
            raise ValueError(
                "filter.gains: not with filter.delay_compensation, a receiver that solves itself, or an altimeter"
            )
        return self

    @model_validator(mode="after")
    def _judged(self) -> Self:
        if not judged(self):
            return self
        shared = [name for name in (*self.filter.extra_states, *self.filter.consider)
                  if not name.startswith(("gyro_", "accel_"))]  # fmt: skip
        if shared:
            raise ValueError(
                f"filter.extra_states: {', '.join(shared)}: a filter that takes solutions with a covariance of their "
                "own (receiver.solution.kind bancroft or filtered, filter.delay_compensation.kind extrapolated) has no "
                "such state"
            )
        if solves(self) and any(fault.kind == "frozen_output" for fault in self.faults):
            raise ValueError("faults: frozen_output needs receiver.solution.kind: direct, or a tight filter")
        return self


def solves(scenario: Scenario) -> bool:
    """Return whether a loose filter takes the solution of a receiver that solves for it itself."""
    return scenario.filter.kind == "loose" and not isinstance(scenario.receiver.solution, DirectSolution)


def reported(scenario: Scenario) -> bool:
    """Return whether errors of the receiver's own solution are reported beside those of the filter that takes it."""
    card = scenario.receiver.solution
    return solves(scenario) and not isinstance(card, DirectSolution) and card.reported


def judged(scenario: Scenario) -> bool:
    """Return whether every solution comes with a covariance of its own, so that its rows are taken together."""
    late = scenario.filter.delay_compensation
    extrapolated = late is not None and late.kind == "extrapolated" and scenario.filter.kind == "loose"
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


def altimeter_belief(scenario: Scenario) -> tuple[float, float]:
    """Return sigma (m) and share that the filter believes of its altimeter; there is one."""
    card, sensor = scenario.filter, scenario.altimeter
    if not isinstance(card.altimeter, str):
        return card.altimeter.sigma, card.altimeter.share
    assert sensor is not None  # only asked where there is one
    return sensor.sigma, sensor.share


def reference_belief(scenario: Scenario) -> float:
    """Return the sigma (rad) that the filter believes of its attitude reference; it has one."""
    card, sensor = scenario.filter, scenario.attitude_reference
    if not isinstance(card.reference, str):
        return float(card.reference.sigma)
    assert sensor is not None  # the scenario is checked for it
    return float(sensor.sigma)
