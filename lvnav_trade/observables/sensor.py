"""Base classes of the sensors: what every sensor card and every filter model of a sensor has."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from pydantic import ConfigDict, Field

from lvnav_trade.units import Card, Frequency


class SensorModel(Card):
    """A sensor as the filter models it: one-sigma noise of a measurement and whatever its variance depends on."""


class SensorCard(Card):
    """A sensor beside the IMU and the receiver: true errors, and when it measures.

    A member of the family states `kind` (a literal of one word), `measurement` (the name that a filter lists) and
    `model` (the class of its filter model); it is added to `SENSORS`.
    """

    model_config = ConfigDict(serialize_by_alias=True)

    measurement: ClassVar[str]
    model: ClassVar[type[SensorModel]]

    name: str
    source: str
    rate: Frequency | None = Field(None, description="of its measurements; none: at every update of the filter")
    from_: str | None = Field(
        None, alias="from", description="first measurement: time such as '100 s', or event; none: start of the flight"
    )
    until: str | None = Field(None, description="end of its measurements, as `from`; none: end of the flight")

    @abstractmethod
    def matched(self) -> SensorModel:
        """Return the filter model that takes every number from this card."""
