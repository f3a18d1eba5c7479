"""Scenario: one resolved design point (trajectory, IMU, GNSS, filter, faults), frozen."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from lvnav_trade.filters.base import FilterCard
from lvnav_trade.units import Angle, Card, Length, Speed
from lvnav_trade.world.constellation import AlmanacConstellation, NominalConstellation
from lvnav_trade.world.faults import SatelliteOutage
from lvnav_trade.world.imu import ImuCard
from lvnav_trade.world.profile import RecordedAscent
from lvnav_trade.world.receiver import ReceiverCard
from lvnav_trade.world.vehicle import VehicleAscent


class InitialErrors(Card):
    """True one-sigma error of the navigation state at the start: tilt (north, east axes), heading, position, velocity."""

    tilt: Angle
    heading: Angle
    position: Length
    velocity: Speed


class Scenario(Card):
    """Everything that one case needs; cards are already resolved into it."""

    trajectory: Annotated[VehicleAscent | RecordedAscent, Field(discriminator="kind")]
    imu: ImuCard
    constellation: Annotated[NominalConstellation | AlmanacConstellation, Field(discriminator="kind")]
    receiver: ReceiverCard
    filter: FilterCard
    initial: InitialErrors
    faults: tuple[SatelliteOutage, ...] = ()
    frame: Literal["ned", "ecef", "inertial", "orbital"] = "ned"
    diverged: Length = Field(100e3, description="a run whose position error exceeds this counts as failed")
