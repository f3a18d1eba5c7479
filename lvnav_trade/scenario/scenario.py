"""Scenario: one resolved design point (trajectory, IMU, GNSS, filter, faults), frozen."""

import re
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from lvnav_trade.filter.card import FilterCard
from lvnav_trade.gnss.constellation import Constellation
from lvnav_trade.gnss.delay_cards import AtmosphereCard
from lvnav_trade.gnss.fault_cards import Fault
from lvnav_trade.gnss.receiver_cards import ReceiverCard
from lvnav_trade.imu.array import Imu
from lvnav_trade.quantities.input_limits import FAULTS
from lvnav_trade.quantities.units import AttitudeSigma, Card, Length, LengthSigma, SpeedSigma
from lvnav_trade.scenario.rules import breaches
from lvnav_trade.sensors.family import Sensor
from lvnav_trade.sensors.sensor import SensorCard
from lvnav_trade.trajectory.control_cards import ControlledCard
from lvnav_trade.trajectory.disturbances import GravityCard
from lvnav_trade.trajectory.flight import TrajectoryCard


class InitialErrors(Card):
    """True initial errors of the navigation state, one sigma: tilt (north, east axes), heading, position, velocity."""

    tilt: AttitudeSigma
    heading: AttitudeSigma
    position: Annotated[LengthSigma, Field(le=1e6)]
    velocity: Annotated[SpeedSigma, Field(le=1e5)]


class Scenario(Card):
    """All settings of a case, with its cards resolved."""

    OLD_KEYS: ClassVar[Mapping[str, str]] = {
        "altimeter": "replaced by sensors, such as sensors: {altimeter: CARD}; "
        "the filter lists altitude among its measurements",
        "attitude_reference": "replaced by sensors, such as sensors: {attitude_reference: CARD}; "
        "the filter lists attitude among its measurements",
    }

    trajectory: Annotated[TrajectoryCard, Field(discriminator="kind")]  # true flight
    imu: Imu  # IMU or IMU array
    constellation: Annotated[Constellation, Field(discriminator="kind")]  # satellites
    receiver: ReceiverCard  # GNSS receiver
    filter: FilterCard  # navigation filter
    initial: InitialErrors  # true initial errors
    sensors: dict[str, Sensor | None] = Field(
        {}, description="sensors other than IMU and receiver, by names of your choice; null removes one"
    )
    control: ControlledCard | None = Field(
        None, description="attitude control of the vehicle, simulated in addition to the navigation"
    )
    faults: tuple[Fault, ...] = Field((), max_length=FAULTS)  # of satellites, receiver, IMU and sensors
    atmosphere: AtmosphereCard = Field(AtmosphereCard(), description="true delays of the signals in the atmosphere")
    gravity: GravityCard | None = Field(None, description="random disturbance of true gravity")
    frame: Literal["ned", "ecef", "inertial", "orbital", "pad"] = Field(
        "ned",
        description="axes in which errors are reported; orbital: radial, along-track, cross-track; pad: azimuth, "
        "slant range and elevation from the start of the flight",
    )
    diverged: Length = Field(100e3, gt=0.0, description="a run whose position error exceeds this counts as failed")

    @model_validator(mode="before")
    @classmethod
    def _refuse_old_keys(cls, data: Any) -> Any:
        """Refuse the keys of earlier versions with the key that replaces them."""
        if isinstance(data, Mapping):
            for key, replacement in cls.OLD_KEYS.items():
                if key in data:
                    raise ValueError(f"{key}: {replacement}")
        return data

    @field_validator("sensors")
    @classmethod
    def _check_sensor_names(cls, sensors: dict[str, SensorCard | None]) -> dict[str, SensorCard | None]:
        for name in sensors:
            if not re.fullmatch(r"[A-Za-z_]\w*", name):
                raise ValueError(f"{name!r} cannot name a sensor; use letters, digits and '_'")
        return sensors

    def _faults(self) -> Iterator[str]:
        for path, reason in breaches(self):
            yield f"{path}: {reason}"
