"""Attitude reference card: a sensor that measures attitude by itself, at every update of the filter."""

from __future__ import annotations

from pydantic import Field

from lvnav_trade.units import AngleSigma, Card


class AttitudeReferenceCard(Card):
    """A magnetometer, horizon or star sensor, by what it is good for: true attitude plus white noise on each axis."""

    name: str
    source: str
    sigma: AngleSigma = Field(gt=0.0, description="of a measurement, per axis")
