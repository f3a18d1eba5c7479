"""Wind over height: a steady profile that differs from run to run, and Dryden gusts; the card and its values."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from lvnav_trade.frames import rotation_e_n
from lvnav_trade.units import Angle, Card, Fraction, Length, SpeedSigma

Floats = NDArray[np.float64]


class WindCard(Card):
    """Horizontal wind and gusts across the path over geodetic height; straight between the heights, and none above.

    A run's steady wind is the profile times 1 + spread n along its direction, and spread n' of it across, n and n'
    standard normals of the run. Gusts have the Dryden spectrum across the path, alike in all directions, of sigma and
    length that vary with height.
    """

    name: str
    source: str
    height: tuple[Length, ...] = Field(min_length=2, description="rising, of all tables")
    speed: tuple[SpeedSigma, ...] = Field(description="of the steady wind")
    direction: Angle = Field(description="from which it blows, clockwise from north")
    spread: Fraction = 0.0
    gust: tuple[SpeedSigma, ...] = Field(description="sigma of each component of a gust across the path")
    gust_length: tuple[Annotated[Length, Field(gt=0.0)], ...] = Field(description="scale across the path")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for name in ("speed", "gust", "gust_length"):
            if len(getattr(self, name)) != len(self.height):
                raise ValueError(f"{len(self.height)} heights but {len(getattr(self, name))} entries of {name}")
        if any(above <= below for below, above in pairwise(self.height)):
            raise ValueError("height must rise from entry to entry")
        return self


class Air(NamedTuple):
    """Wind along a path: steady (n, 2, 3) m/s, frame e, the profile along its direction and the same across it; sigma
    (n,) m/s and length (n,) m of the gusts.
    """

    steady_e: Floats
    gust: Floats
    length: Floats


def air(card: WindCard, latitude: Floats, longitude: Floats, height: Floats) -> Air:
    """Return the wind at geodetic places (n,)."""
    along = np.array([-np.cos(card.direction), -np.sin(card.direction), 0.0])
    across = np.array([np.sin(card.direction), -np.cos(card.direction), 0.0])
    speed = np.interp(height, card.height, card.speed, right=0.0)
    C_e_n = rotation_e_n(latitude, longitude)
    steady = np.einsum("kji,aj->kai", C_e_n, np.stack([along, across])) * speed[:, None, None]
    gust = np.interp(height, card.height, card.gust, right=0.0)
    return Air(steady, gust, np.interp(height, card.height, card.gust_length))
