"""Attitude control of a launcher: gains by stage, turns, corrections by guidance, and what feeds it; the cards."""

from __future__ import annotations

import math
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from lvnav_trade.units import (
    Angle,
    AngleSigma,
    Card,
    Duration,
    Frequency,
    GainPerSecond,
    Pause,
    SpeedSigma,
    TimeConstant,
)
from lvnav_trade.world.sensors.imu import ImuCard


class Gains(Card):
    """Nozzle angle commanded per attitude error (rad per rad), per rate error, and per integral of attitude error."""

    attitude: float = Field(ge=0.0)
    rate: Pause
    integral: GainPerSecond = 0.0


class Turn(Card):
    """A turn manoeuvre laid over the ascent's attitude: by an angle, from an event on, along a quintic in time."""

    start: str = Field(description="event of the flight, with a duration added or not, or a time since lift-off")
    axis: Literal["pitch", "yaw"]
    angle: Angle
    duration: Annotated[Duration, Field(gt=0.0)]


class Guidance(Card):
    """Corrections of the commanded attitude while a motor burns: steps, one every period, against lateral speed.

    The step asks for the angle at which the thrust takes the estimated lateral speed away within `time`.
    """

    from_stage: int = Field(2, ge=1, description="number of the first stage that is corrected; below: open loop")
    period: TimeConstant = 1.0
    time: TimeConstant = 20.0
    limit: Annotated[Angle, Field(gt=0.0)] = 0.03490658503988659  # 2 deg
    velocity_sigma: SpeedSigma = Field(0.0, description="noise of the navigation's lateral speed, new at every step")


class ControllerCard(Card):
    """An attitude controller: proportional, rate and integral gains by stage, and how its commands come about.

    Nozzle command = attitude gain x attitude error + rate gain x rate error + integral gain x integral. Errors are of
    the navigation's attitude and of the rate that is fed, against the commanded attitude and rate. When a motor lights,
    the command begins where the vehicle points and goes over to the ascent's attitude by the lag of `command_time`.
    """

    name: str
    source: str
    gains: tuple[Gains, ...] = Field(min_length=1, description="one for each stage, from the first")
    command_time: TimeConstant = Field(2.0, description="critically damped lag that smooths steps of the command")
    turns: tuple[Turn, ...] = ()
    guidance: Guidance | None = Field(None, description="none: the ascent's attitude is not corrected")


class FeedbackCard(Card):
    """What feeds the controller: which rate, which attitude, and how large the gyro's noise per sample is taken.

    `filtered` is the gyro through a filter that models the rate as a random walk. `navigation` attitude integrates the
    gyro and is corrected by an attitude reference with the gain of its steady filter. `datasheet` noise per sample is
    density x sqrt(rate), `published` density x rate.
    """

    rate: Literal["true", "raw", "filtered"] = "filtered"
    attitude: Literal["true", "navigation"] = "navigation"
    noise: Literal["datasheet", "published", "none"] = "datasheet"
    reference_sigma: AngleSigma = 0.017453292519943295  # 1 deg
    reference_rate: Frequency = 1.0


class Design(NamedTuple):
    """Gains that give a rigid vehicle in vacuum or air, with an ideal nozzle, a natural frequency and a damping."""

    attitude: float
    rate: float


def design(frequency: float, damping: float, effectiveness: float, instability: float = 0.0) -> Design:
    """Return attitude gain and rate gain (s) for a natural frequency (rad/s) and a damping ratio.

    The body obeys angle'' = instability x angle - effectiveness x nozzle (both 1/s^2).
    """
    return Design((frequency**2 + instability) / effectiveness, 2.0 * damping * frequency / effectiveness)


def rate_noise(imu: ImuCard, reading: str) -> float:
    """Return the gyro's noise per sample, rad/s one sigma, by the reading of `FeedbackCard`."""
    if reading == "none":
        return 0.0
    return float(imu.gyro.random_walk * (imu.rate if reading == "published" else math.sqrt(imu.rate)))
