"""Baro-altimeter: height from static pressure in the standard atmosphere.

z = h + b + s h + k v^2 / (2 g) + v, with the bias b of reference pressure and instrument; the scale error s (air that
is dT warmer than the standard temperature T expands by dT / T); the port error k, the fraction of the dynamic pressure
rho v^2 / 2 added at the port; and the noise v = dp / (rho g) of a white pressure noise dp. Jacobian and innovation are
those of an altimeter.
"""

import math
from collections.abc import Iterator, Mapping
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from lvnav_trade.kernels.media.atmosphere import TOP_OF_LAYERS, atmosphere
from lvnav_trade.quantities.frames import earth_velocity
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.quantities.units import Fraction, Length, LengthSigma, Pressure, TimeConstant
from lvnav_trade.sensors.altimeter import fill
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

_GRAVITY = 9.80665


def _height_per_pressure(height: Floats) -> Floats:
    """Return the height per pressure, 1 / (rho g), (n_epoch, 1) m/Pa; constant above the layers of the standard."""
    density = [atmosphere(min(h, TOP_OF_LAYERS))[0] for h in height.tolist()]
    return 1.0 / (np.array(density)[:, None] * _GRAVITY)


class BarometerModel(SensorModel):
    """Baro-altimeter as the filter models it: white noise of the pressure; bias and scale as states."""

    states: ClassVar[Mapping[str, StateUnit]] = {
        "bias": StateUnit("pressure_altitude_bias", "m", "m", 1.0),
        "scale": StateUnit("pressure_altitude_scale", "1", "%", 1e2),
    }

    sigma: Pressure = Field(description="white noise of the static pressure")
    bias: LengthSigma = Field(0.0, description="of the extra state pressure_altitude_bias: its initial one-sigma")
    bias_time: TimeConstant | None = None
    scale: Fraction = Field(0.0, description="of the extra state pressure_altitude_scale: its initial one-sigma")

    def variance(self, flight: FlightView) -> Floats:
        """Return the variance (n_epoch, 1) in m^2."""
        return np.asarray((self.sigma * _height_per_pressure(flight.height)) ** 2)


class BarometerCard(SensorCard):
    """A baro-altimeter: pressure altitude, available in the air.

    It is converted to height over the ellipsoid: geoid and reference pressure are known, except for the bias.
    """

    measurement: ClassVar[str] = "pressure_altitude"
    model: ClassVar[type[SensorModel]] = BarometerModel
    unit: ClassVar[str] = "m"
    jacobian: ClassVar[tuple[str, ...]] = ("position",)
    noise: ClassVar[str] = "barometer noise"
    availability_phrase: ClassVar[str] = "the height is within its range"

    kind: Literal["barometer"] = "barometer"
    sigma: Pressure = Field(description="white noise of the static pressure; dp / (rho g) of height")
    bias: LengthSigma = Field(0.0, description="lasting error of reference pressure (8.3 m per hPa) and instrument")
    bias_time: TimeConstant | None = Field(None, description="time constant of this error; none: constant during a run")
    scale: Fraction = Field(
        0.0, description="lasting error in proportion to the height, from the temperature of the air"
    )
    flow: Fraction = Field(
        0.0, description="lasting error of the port: fraction of the dynamic pressure that it senses"
    )
    highest: Length = Field(description="height above which it does not measure; at most 86 km")

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if not 0.0 < self.highest <= TOP_OF_LAYERS:
            yield f"highest: there is air to measure from the ground up to {TOP_OF_LAYERS / 1e3:g} km"

    def truth(self, flight: FlightView) -> Floats:
        """Return the height (n_epoch, 1) in m."""
        return flight.height[:, None]

    def noise_sigma(self, flight: FlightView) -> Floats:
        """Return the one-sigma (n_epoch, 1) in m."""
        return self.sigma * _height_per_pressure(flight.height)

    def is_available(self, flight: FlightView) -> Bools:
        """Return whether it is low enough, (n_epoch,)."""
        return np.asarray(flight.height <= self.highest)

    @property
    def limiting_field(self) -> str:
        """Its greatest height."""
        return "highest"

    def correlated_errors(self) -> tuple[CorrelatedError, ...]:
        """Return its bias, its scale error and the error of its port."""
        return (
            CorrelatedError("barometer bias", "bias", self.bias, "bias", self.bias_time or math.inf),
            CorrelatedError("barometer scale", "scale", self.scale, "scale", math.inf, ("",), _height_partials),
            CorrelatedError("barometer port", "flow", self.flow, "flow", math.inf, ("",), _flow_partials),
        )


def _height_partials(flight: FlightView) -> Floats:
    return flight.height[:, None, None]


def _flow_partials(flight: FlightView) -> Floats:
    """Return the height (n_epoch, 1, 1) m equivalent to the dynamic pressure: (rho v^2 / 2) / (rho g)."""
    speed = np.linalg.norm(earth_velocity(flight.r_i, flight.v_i), axis=1)
    return np.asarray(speed**2 / (2.0 * _GRAVITY))[:, None, None]


SENSORS = (
    Registration(
        BarometerCard,
        Evidence(
            "Baro-altimeter",
            checks=(
                Check(
                    "closed form",
                    "noise is the slope of the standard pressure to 0.1 %",
                    "tests/sensors/test_barometer.py"
                    "::test_noise_of_the_pressure_is_that_height_by_which_the_standard_pressure_changes_so_much",
                ),
                Check(
                    "both engines",
                    "bias, scale and port error beside two stations",
                    "tests/both_engines/test_ground.py"
                    "::test_both_engines_agree_on_two_stations_of_different_scalars_and_a_barometer",
                ),
            ),
            omits="Lag of the pressure line, shocks, angle of attack; the real atmosphere differs by a bias "
            "and a scale only.",
        ),
        fill=fill,
        order=9,
    ),
)
