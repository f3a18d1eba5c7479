"""The launch vehicle under attitude control: cards of its body, its controller and the wind, and their values."""

import math
from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.quantities import per_axis, units
from lvnav_trade.quantities.conditions import Instant
from lvnav_trade.quantities.frames import rotation_e_n
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.shared_cards import EnvelopeCard

_NOT_IN_RATE_FILTER = (  # fields of an envelope that the filter of pitch and yaw rate does not read
    "roll",
    "axial_burn",
    "axial_coast",
    "axial_change",
    "lateral",
    "nozzle_gain",
    "nozzle_time",
    "start_rate",
    "start_acceleration",
)
_UNIFORM = 0.28867513459481287  # radius of gyration of a uniform rod, in its lengths: 1 / sqrt(12)


class Nozzle(units.Card):
    """A thrust nozzle on two axes and its actuators: a first-order lag within limits of rate and deflection."""

    time_constant: units.TimeConstant
    rate_limit: units.AngularRateLimit
    deflection_limit: Annotated[units.Angle, Field(gt=0.0, lt=1.0)]
    misalignment: units.AngleSigma = Field(0.0, description="thrust misalignment, constant over a burn, per axis")


class Thrusters(units.Card):
    """Pairs of lateral thrusters that hold the attitude while no motor burns: on or off, with a dead band.

    They open when attitude error plus `lead` times rate error exceeds the dead band, and close within the part
    `release` of it.
    """

    force: units.Force = Field(description="thrust of a pair of thrusters that turns the vehicle about one axis")
    arm: Annotated[units.Length, Field(gt=0.0)] = Field(
        description="lever arm of the thrusters from the centre of mass, in every stack"
    )
    dead_band: units.AngleLimit
    lead: units.TimeConstant
    release: units.Share = Field(0.5, ge=0.0, lt=1.0)


class Stack(units.Card):
    """The vehicle while one stage is the lowest: a body of a length, whose mass is that of the ascent."""

    length: Annotated[units.Length, Field(gt=0.0)]
    gyration: Annotated[units.Fraction, Field(gt=0.0)] = Field(
        _UNIFORM, description="radius of gyration across the axis, in lengths; none: a uniform rod"
    )
    nozzle_arm: Annotated[units.Fraction, Field(gt=0.0, le=1.0)] = Field(
        0.5, description="nozzle's throat behind the centre of mass, in lengths"
    )
    normal_force: float = Field(0.0, ge=0.0, description="slope of the normal-force coefficient, per rad")
    pressure_arm: float = Field(
        0.0, ge=-1.0, le=1.0, description="centre of pressure ahead of the centre of mass, in lengths: unstable above 0"
    )


class RotationCard(units.NamedCard):
    """How a launch vehicle turns in pitch and yaw, about the ascent of its vehicle card.

    Roll is held; the axes do not couple. Bending, sloshing, jet damping and the nozzle's own inertia are not modelled.
    """

    stacks: tuple[Stack, ...] = Field(min_length=1, description="one entry for each stage, from the first")
    nozzle: Nozzle
    thrusters: Thrusters

    def _faults(self) -> Iterator[str]:
        if self.nozzle.misalignment > self.nozzle.deflection_limit:
            yield "the misalignment of the thrust exceeds the limit of deflection"

    def inertia(self, number: int, mass: Floats) -> Floats:
        """Return the moments of inertia across the axis: mass times radius of gyration squared.

        Parameters
        ----------
        number : int
            Number of the lowest stage of the stack, from 1.
        mass : (n,) kg
            Masses of the stack.

        Returns
        -------
        (n,) kg m^2
            Moments of inertia in pitch and yaw.
        """
        stack = self.stacks[number - 1]
        gyration_radius = stack.gyration * stack.length
        return np.asarray(mass * gyration_radius**2)


class ControlGains(units.Card):
    """Nozzle angle commanded per attitude error (rad per rad), per rate error, and per integral of attitude error."""

    attitude: float = Field(ge=0.0)
    rate: units.Pause
    integral: units.GainPerSecond = 0.0


class Turn(units.Card):
    """A turn manoeuvre laid over the ascent's attitude: by an angle, from an event on, along a quintic in time."""

    start: Instant = Field(description="event, also with a duration added, or a time since lift-off")
    axis: Literal["pitch", "yaw"]
    angle: units.Angle
    duration: units.TimeConstant


class Guidance(units.Card):
    """Corrections of the commanded attitude while a motor burns: steps, one every period, against lateral speed.

    The step asks for the angle at which the thrust takes the estimated lateral speed away within `time`.
    """

    from_stage: int = Field(2, ge=1, description="number of the first stage that is corrected; below: open loop")
    period: units.TimeConstant = 1.0
    time: units.TimeConstant = 20.0
    limit: units.AngleLimit = 0.03490658503988659  # 2 deg
    velocity_sigma: units.SpeedSigma = Field(
        0.0, description="white noise of the navigated lateral speed, at every step"
    )
    command_sigma: units.AngleSigma = Field(
        0.0,
        description="white noise of the attitude command in addition to that from the lateral speed, per axis, at "
        "every step",
    )


class ControllerCard(units.NamedCard):
    """An attitude controller: proportional, rate and integral gains by stage, and how its commands come about.

    Nozzle command = attitude gain x attitude error + rate gain x rate error + integral gain x integral. Errors are of
    the navigation's attitude and of the rate that is fed, against the commanded attitude and rate. When a motor lights,
    the command begins where the vehicle points and goes over to the ascent's attitude by the lag of `command_time`.
    """

    gains: tuple[ControlGains, ...] = Field(min_length=1, description="one entry for each stage, from the first")
    command_time: units.TimeConstant = Field(
        2.0, description="time constant of the critically damped lag that smooths steps of the command"
    )
    turns: tuple[Turn, ...] = ()
    guidance: Guidance | None = Field(None, description="guidance; none: the attitude of the ascent is not corrected")


class FeedbackCard(units.Card):
    """What feeds the controller: which rate, which attitude, and how large the gyro's noise per sample is taken.

    `filtered` is the gyro through a filter that models the rate as a random walk. `navigation` attitude integrates the
    gyro and is corrected by an attitude reference with the gain of its steady filter. `datasheet` noise per sample is
    density x sqrt(rate), `published` density x rate.
    """

    rate: Literal["true", "raw", "filtered"] = "filtered"
    attitude: Literal["true", "navigation"] = "navigation"
    noise: Literal["datasheet", "published", "none"] = "datasheet"
    reference_sigma: units.AngleSigma = 0.017453292519943295  # 1 deg
    reference_rate: units.Frequency = 1.0


def rate_noise(imu: ImuCard, reading: str) -> float:
    """Return the gyro noise per sample for an interpretation of `FeedbackCard`.

    Parameters
    ----------
    imu : ImuCard
        IMU. Its angle random walk is taken as the RMS of the three axes.
    reading : {"datasheet", "published", "none"}
        Interpretation of the noise: density times the square root of the rate, density times the rate, or no noise.

    Returns
    -------
    float
        Standard deviation (rad/s).
    """
    if reading == "none":
        return 0.0
    factor = imu.rate if reading == "published" else math.sqrt(imu.rate)
    return float(per_axis.rms(imu.gyro.random_walk) * factor)


class WindCard(units.NamedCard):
    """Horizontal wind and gusts across the path over geodetic height; straight between the heights, and none above.

    A run's steady wind is the profile times 1 + spread n along its direction, and spread n' of it across, n and n'
    standard normals of the run. Gusts have the Dryden spectrum across the path, alike in all directions, of sigma and
    length that vary with height.
    """

    height: tuple[units.Length, ...] = Field(min_length=2, description="heights of all tables, increasing")
    speed: tuple[units.SpeedSigma, ...] = Field(description="speed of the steady wind")
    direction: units.Angle = Field(description="direction from which the wind blows, clockwise from north")
    spread: units.Fraction = 0.0
    gust: tuple[units.SpeedSigma, ...] = Field(description="sigma of each gust component across the path")
    gust_length: tuple[Annotated[units.Length, Field(gt=0.0)], ...] = Field(
        description="scale length of gusts across the path"
    )

    def _faults(self) -> Iterator[str]:
        for name in ("speed", "gust", "gust_length"):
            entries = getattr(self, name)
            if len(entries) != len(self.height):
                yield f"{len(self.height)} heights but {len(entries)} entries of {name}"
        units.require_rising("height", self.height)


def air(card: WindCard, latitude: Floats, longitude: Floats, height: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the steady wind and the gust parameters at geodetic positions.

    Parameters
    ----------
    card : WindCard
        Wind profile. It is linear between its heights; above them there is neither steady wind nor gust.
    latitude, longitude : (n,) rad
        Geodetic latitude and longitude.
    height : (n,) m
        Height above the ellipsoid.

    Returns
    -------
    steady : (n, 2, 3) m/s
        Wind vectors in frame e: the profile along its direction, and a vector of equal size across it.
    gust_sigma : (n,) m/s
        Standard deviation of each gust component.
    gust_length : (n,) m
        Scale length of the gusts.
    """
    north = np.cos(card.direction)
    east = np.sin(card.direction)
    along = np.array([-north, -east, 0.0])  # frame n; the wind blows from its direction
    across = np.array([east, -north, 0.0])
    speed = np.interp(height, card.height, card.speed, right=0.0)
    C_e_n = rotation_e_n(latitude, longitude)
    directions_n = np.stack([along, across])
    directions_e = np.einsum("kji,aj->kai", C_e_n, directions_n)
    steady = directions_e * speed[:, None, None]
    gust_sigma = np.interp(height, card.height, card.gust, right=0.0)
    gust_length = np.interp(height, card.height, card.gust_length)
    return steady, gust_sigma, gust_length


class SteeredCard(units.Card):
    """An ascent under wind and attitude control. The rotation of the vehicle is simulated, and the forces of nozzle and
    air change its path. Every realisation is a different launch, with its own wind, thrust misalignment and controller
    noise.
    """

    rotation: RotationCard
    controller: ControllerCard
    wind: WindCard | None = Field(None, description="none: still air")
    imu: ImuCard = Field(description="IMU whose gyro feeds the controller; the controller commands at its ticks")
    feedback: FeedbackCard = FeedbackCard()
    envelope: EnvelopeCard | None = Field(
        None, description="envelope of the filter for the rate; none: the defaults of the card"
    )
    realisation: int = Field(0, ge=0, lt=2**32, description="number of the launch; the same for all runs")

    def _faults(self) -> Iterator[str]:
        if self.envelope is None:
            return
        if self.feedback.rate != "filtered":
            yield f"envelope has no effect: the controller takes the {self.feedback.rate} rate; leave it out"
        default_envelope = EnvelopeCard()
        idle_fields = [
            name for name in _NOT_IN_RATE_FILTER if getattr(self.envelope, name) != getattr(default_envelope, name)
        ]
        if idle_fields:
            yield f"envelope.{idle_fields[0]} has no effect: only the rates of pitch and yaw are filtered; leave it out"

    def misfits(self, stages: int) -> Iterator[str]:
        """Yield the faults of the card for a vehicle with this number of stages."""
        yield from _misfits(self.rotation, self.controller, stages)

    def guidance_faults(self, guidance: str) -> Iterator[str]:
        """Yield the settings without effect, and the contradictions, under a guidance that steers by navigation."""
        if self.realisation != 0:
            yield f"control.realisation has no effect with guidance: {guidance}, every run is a launch; leave it out"
        if self.controller.guidance is not None:
            yield (
                f"control.controller.guidance and guidance: {guidance} both correct the commanded attitude; give "
                "controller.guidance: null"
            )
        default_feedback = FeedbackCard()
        for name in ("reference_sigma", "reference_rate"):
            if getattr(self.feedback, name) != getattr(default_feedback, name):
                yield (
                    f"control.feedback.{name} has no effect with guidance: {guidance}, the controller has the "
                    "navigation of the run; leave it out"
                )


class ControlledCard(units.Card):
    """The vehicle of the ascent as a body that is controlled in pitch and yaw, with the navigated attitude as feedback.

    It is simulated with the raw, the filtered and the true rate on the same draws. The IMU, the attitude reference and
    the envelope of the filter are those of the scenario.
    """

    rotation: RotationCard
    controller: ControllerCard
    wind: WindCard
    rate_gain: float = Field(1.0, gt=0.0, description="factor on the rate gain of every stage")

    def misfits(self, stages: int) -> Iterator[str]:
        """Yield the faults of the card for a vehicle with this number of stages."""
        yield from _misfits(self.rotation, self.controller, stages)


def _misfits(rotation: RotationCard, controller: ControllerCard, stages: int) -> Iterator[str]:
    """Yield a message for each list whose length differs from the number of stages of the vehicle."""
    lists = {
        "rotation.stacks": rotation.stacks,
        "controller.gains": controller.gains,
    }
    for name, cards in lists.items():
        if len(cards) != stages:
            yield f"control.{name}: {len(cards)} of them, the vehicle has {stages} stages"
