"""The corridor on the ground that the point of impact must keep to."""

from __future__ import annotations

import math

from pydantic import Field, field_validator

from lvnav_trade.units import Angle, Card


class Corridor(Card):
    """A polygon of latitudes and longitudes; the estimated point of impact must stay inside with a probability."""

    polygon: tuple[tuple[Angle, Angle], ...] = Field(
        description="corners in order, each [latitude, longitude] with units; edges are straight in both angles"
    )
    probability: float = Field(default=0.999, gt=0, lt=1, description="fraction of flights that must stay inside")
    confidence: float = Field(default=0.9, gt=0, lt=1, description="at which the runs must show it")

    @field_validator("polygon")
    @classmethod
    def _closed(cls, corners: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        if len(set(corners)) < 3:
            raise ValueError(f"a corridor needs at least 3 corners, not {len(set(corners))}")
        for latitude, _ in corners:
            if abs(latitude) > 0.5 * math.pi:
                raise ValueError(f"a latitude of {math.degrees(latitude):g} deg; each corner is [latitude, longitude]")
        return corners
