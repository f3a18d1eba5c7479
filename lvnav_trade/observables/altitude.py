"""Radar altimeter: height over the ellipsoid, less the mean height of the ground, which is known."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from lvnav_trade.kernels.earth import height_and_up
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.strapdown import R
from lvnav_trade.observables.base import H_ATT, H_CLOCK, H_POS, H_VEL
from lvnav_trade.observables.sensor import SensorCard, SensorModel
from lvnav_trade.units import Fraction, Length, LengthSigma, TimeConstant


class AltimeterModel(SensorModel):
    """Radar altimeter as the filter models it: white noise, and white noise in proportion to the height."""

    sigma: LengthSigma = Field(gt=0.0)
    share: Fraction = 0.0


class AltimeterCard(SensorCard):
    """A radar altimeter: height above ground, near the ground. It points down whatever the attitude, and its place is
    the IMU's; the mean height of the ground over the ellipsoid is known and subtracted.
    """

    measurement: ClassVar[str] = "altitude"
    model: ClassVar[type[SensorModel]] = AltimeterModel

    kind: Literal["altimeter"] = "altimeter"
    sigma: LengthSigma = Field(gt=0.0, description="white noise of a measurement")
    share: Fraction = Field(0.0, description="white noise in proportion to the height, added in quadrature")
    bias: LengthSigma = Field(0.0, description="lasting error: of the instrument, of ground or waves below")
    bias_time: TimeConstant | None = Field(None, description="its time constant; none: the same all flight")
    lowest: Length = Field(0.0, ge=0.0, description="height below which it does not measure")
    highest: Annotated[Length, Field(gt=0.0)] = Field(description="height above which it does not measure")

    @model_validator(mode="after")
    def _spans(self) -> Self:
        if self.lowest >= self.highest:
            raise ValueError("lowest should be below highest")
        return self

    def matched(self) -> AltimeterModel:
        """Return the filter model that takes every number from this card."""
        return AltimeterModel.model_construct(sigma=self.sigma, share=self.share)


@jit
def row(h, nav):
    """Set the row and return the predicted height (m); h (10,), nav (10,) navigation state, frame i."""
    height, ux, uy, uz = height_and_up(nav[R], nav[R + 1], nav[R + 2])
    h[H_POS], h[H_POS + 1], h[H_POS + 2] = ux, uy, uz
    for i in range(3):
        h[H_ATT + i], h[H_VEL + i] = 0.0 * ux, 0.0 * ux
    h[H_CLOCK] = 0.0 * ux
    return height


@jit
def observe(true_height, sigma, normal):
    """Return the measured height (m): the true one plus white noise of one-sigma `sigma`."""
    return true_height + sigma * normal
