"""Radar altimeter card: height above ground, near the ground, at every update of the filter."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from lvnav_trade.units import Card, Fraction, Length, LengthSigma, TimeConstant


class AltimeterCard(Card):
    """A radar altimeter by what it is good for. It points down whatever the attitude, and its place is the inertial
    unit's; the mean height of the ground over the ellipsoid is known and taken off.
    """

    name: str
    source: str
    sigma: LengthSigma = Field(gt=0.0, description="white noise of a measurement")
    share: Fraction = Field(0.0, description="white noise in proportion to the height, added in quadrature")
    bias: LengthSigma = Field(0.0, description="what lasts: of the instrument, of ground or waves below")
    bias_time: TimeConstant | None = Field(None, description="its time constant; none: the same all flight")
    lowest: Length = Field(0.0, ge=0.0, description="height below which it is silent")
    highest: Annotated[Length, Field(gt=0.0)] = Field(description="height above which it is silent")

    @model_validator(mode="after")
    def _spans(self) -> Self:
        if self.lowest >= self.highest:
            raise ValueError("lowest should be below highest")
        return self
