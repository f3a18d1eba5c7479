"""The family of sensors: one line adds a member to the scenario's `sensors` and to the filter's measurements."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

from pydantic import Field, create_model

from lvnav_trade.observables.altitude import AltimeterCard
from lvnav_trade.observables.attitude import AttitudeReferenceCard
from lvnav_trade.observables.sensor import SensorCard
from lvnav_trade.units import Card

SENSORS: tuple[type[SensorCard], ...] = (
    AltimeterCard,
    AttitudeReferenceCard,
)

RECEIVER_SOLUTION = ("position", "velocity")
RANGES = ("pseudorange", "range_rate")
SENSOR_MEASUREMENTS = tuple(dict.fromkeys(card.measurement for card in SENSORS))
MEASUREMENTS = (*RECEIVER_SOLUTION, *RANGES, *SENSOR_MEASUREMENTS, "imu")
"""Names of measurements, in the order in which a filter card holds them."""

if TYPE_CHECKING:
    Sensor = SensorCard
    Measurement = str
    SensorModels = Card
else:
    Sensor = Annotated[Union[SENSORS], Field(discriminator="kind")]  # noqa: UP007
    Measurement = Literal[MEASUREMENTS]
    SensorModels = create_model(
        "SensorModels",
        __base__=Card,
        __doc__="Filter models of the sensors, by measurement; `matched` takes each number from the sensor's card.",
        **{
            name: (
                Literal["matched"] | Union[tuple(card.model for card in SENSORS if card.measurement == name)],  # noqa: UP007
                "matched",
            )
            for name in SENSOR_MEASUREMENTS
        },
    )


def model_of(models: SensorModels, sensor: SensorCard) -> Any:
    """Return the filter model of a sensor: that of the filter card, or the one that takes the sensor's own numbers."""
    stated = getattr(models, sensor.measurement)
    return sensor.matched() if isinstance(stated, str) else stated
