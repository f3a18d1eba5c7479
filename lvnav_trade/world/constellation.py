"""Nominal slots or an almanac to satellite states."""

from __future__ import annotations

from typing import Literal

from lvnav_trade.units import Angle, Card, Length


class Slot(Card):
    """One satellite of a nominal constellation: right ascension of the node and argument of latitude at the epoch."""

    name: str
    node: Angle
    latitude_argument: Angle


class NominalConstellation(Card):
    """Circular orbits from published slots."""

    kind: Literal["nominal"] = "nominal"
    name: str
    source: str
    epoch: str  # ISO 8601, UTC
    semi_major_axis: Length
    inclination: Angle
    slots: tuple[Slot, ...]


class AlmanacConstellation(Card):
    """A YUMA almanac file of the user's."""

    kind: Literal["almanac"] = "almanac"
    almanac: str  # path
