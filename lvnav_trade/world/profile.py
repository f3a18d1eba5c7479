"""A reference from a speed and altitude record: the card, and the three-dimensional ascent rebuilt from it."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from lvnav_trade.units import Angle, Card, Duration, Length, Speed
from lvnav_trade.world.vehicle import Roll, Site


class RecordedAscent(Card):
    """A trajectory rebuilt from a record of Earth-relative speed and altitude against time.

    The file is CSV with the header ``time_s,speed_m_s,altitude_m``; lines that begin with # are comments.
    """

    kind: Literal["profile"] = "profile"
    name: str
    source: str
    epoch: str = Field(description="lift-off, ISO 8601 UTC")
    site: Site
    azimuth: Angle | None = Field(None, description="of the ground track at the site, from north over east")
    inclination: Angle | None = Field(None, description="of the final orbit; gives the azimuth where that is not set")
    direction: Literal["ascending", "descending"] = "ascending"
    file: str = Field(description="the record", json_schema_extra={"path": True})
    events: dict[str, Duration] = Field(description="times of the named events, from lift-off")
    speed_noise: Annotated[Speed, Field(gt=0.0)] = Field(description="one-sigma error of a recorded speed")
    altitude_noise: Annotated[Length, Field(gt=0.0)] = Field(description="one-sigma error of a recorded altitude")
    pad_hold: Annotated[Duration, Field(ge=0.0)] = 60.0
    roll: Roll = Roll()
    coast_after_injection: Annotated[Duration, Field(gt=0.0)] = 20.0

    @model_validator(mode="after")
    def _aimed(self) -> Self:
        if (self.azimuth is None) == (self.inclination is None):
            raise ValueError("give the azimuth or the inclination, one of the two")
        if "injection" not in self.events:
            raise ValueError("events must name injection")
        return self
