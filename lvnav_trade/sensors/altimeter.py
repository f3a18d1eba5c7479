"""Radar altimeter: height above ground; the mean height of the ground over the ellipsoid is known."""

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from lvnav_trade.kernels.earth import height_and_normal
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.strapdown import R
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.quantities.units import Fraction, Length, LengthSigma, TimeConstant
from lvnav_trade.sensors.jacobian_row import H_POS, clear
from lvnav_trade.sensors.sensor import (
    Check,
    CorrelatedError,
    Evidence,
    FlightView,
    Registration,
    SensorCard,
    SensorModel,
    StateUnit,
)


class AltimeterModel(SensorModel):
    """Radar altimeter as the filter models it: white noise, constant and proportional to height; bias as a state."""

    states: ClassVar[Mapping[str, StateUnit]] = {"bias": StateUnit("altitude_bias", "m", "m", 1.0)}

    sigma: LengthSigma = Field(gt=0.0)
    share: Fraction = 0.0
    bias: LengthSigma = Field(0.0, description="of the extra state altitude_bias: its initial one-sigma")
    bias_time: TimeConstant | None = None

    def variance(self, flight: FlightView) -> Floats:
        """Return the variance (n_epoch, 1) in m^2."""
        return np.asarray(self.sigma**2 + (self.share * flight.height[:, None]) ** 2)


class AltimeterCard(SensorCard):
    """A radar altimeter: height above ground, near the ground.

    It points down independently of attitude, from the position of the IMU. The mean height of the ground over the
    ellipsoid is known and subtracted.
    """

    measurement: ClassVar[str] = "altitude"
    model: ClassVar[type[SensorModel]] = AltimeterModel
    unit: ClassVar[str] = "m"
    jacobian: ClassVar[tuple[str, ...]] = ("position",)
    noise: ClassVar[str] = "altimeter noise"
    noise_fields: ClassVar[tuple[str, ...]] = ("sigma", "share")
    availability_phrase: ClassVar[str] = "the height is within its range"

    kind: Literal["altimeter"] = "altimeter"
    sigma: LengthSigma = Field(gt=0.0, description="white noise of a measurement")
    share: Fraction = Field(0.0, description="white noise in proportion to the height, added in quadrature")
    bias: LengthSigma = Field(0.0, description="lasting error of the instrument, terrain and waves")
    bias_time: TimeConstant | None = Field(None, description="time constant of this error; none: constant during a run")
    lowest: Length = Field(0.0, ge=0.0, description="height below which it does not measure")
    highest: Annotated[Length, Field(gt=0.0)] = Field(description="height above which it does not measure")

    @model_validator(mode="after")
    def _check_range(self) -> Self:
        if self.lowest >= self.highest:
            raise ValueError("lowest should be below highest")
        return self

    def truth(self, flight: FlightView) -> Floats:
        """Return the height (n_epoch, 1) in m."""
        return flight.height[:, None]

    def noise_sigma(self, flight: FlightView) -> Floats:
        """Return the one-sigma (n_epoch, 1) in m."""
        return np.hypot(self.sigma, self.share * flight.height)[:, None]

    def is_available(self, flight: FlightView) -> Bools:
        """Return whether the height is within its range, (n_epoch,)."""
        return np.asarray((flight.height >= self.lowest) & (flight.height <= self.highest))

    @property
    def limiting_field(self) -> str:
        """Field with its greatest height."""
        return "highest"

    def correlated_errors(self) -> tuple[CorrelatedError, ...]:
        """Return its bias."""
        return (CorrelatedError("altimeter bias", "height_bias", self.bias, "bias", self.bias_time or math.inf),)


@jit
def fill(H, z, first_row, measurement, nav):
    """Set the Jacobian row of a height and its innovation.

    Parameters
    ----------
    H : (n, n_entry)
        Jacobian rows of the epoch; that at `first_row` is set.
    z : (n,)
        Innovations; that at `first_row` is set (m).
    first_row : int
        Index of the scalar measurement.
    measurement : (4,)
        Measured height over the ellipsoid (m) in the first entry.
    nav : (10,)
        Navigation state, frame i.
    """
    height, ux, uy, uz = height_and_normal(nav[R], nav[R + 1], nav[R + 2])
    h = H[first_row]
    clear(h)
    h[H_POS] = ux
    h[H_POS + 1] = uy
    h[H_POS + 2] = uz
    z[first_row] = measurement[0] - height


SENSORS = (
    Registration(
        AltimeterCard,
        Evidence(
            "Radar altimeter",
            checks=(
                Check(
                    "closed form",
                    "geodetic height to 1e-6 m",
                    "tests/sensors/test_altimeter.py::test_the_prediction_is_the_ellipsoidal_height",
                ),
                Check(
                    "both engines",
                    "bias and noise in 400 runs, loose and tight",
                    "tests/simulation/preparation/test_sensors.py"
                    "::test_both_engines_agree_on_what_an_altimeter_does_bias_and_all",
                ),
            ),
            omits="Terrain and sea state: the ground is the ellipsoid. The beam points down for any attitude.",
        ),
        fill=fill,
        order=0,
    ),
)
