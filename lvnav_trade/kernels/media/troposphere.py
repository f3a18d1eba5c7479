"""Tropospheric delay as published formulas: Canepa and Servidia, Spilker, STANAG 4294, Saastamoinen, Niell."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

SCALE_HEIGHT = 7518.8  # m, of Canepa and Servidia, section 3.1; Spilker prints 0.133e-3 per m
TROPOPAUSE = 11e3  # m
_ISOTHERMAL_SCALE = 6341.6  # m: 287.05287 x 216.65 / 9.80665, so that pressure falls as smoothly as it did below

# --- models of one formula --------------------------------------------------------------------------------------------


def any_elevation(
    elevation: ArrayLike,
    height: ArrayLike,
    earth_radius: ArrayLike,
    gain: float = 2.47,
    scale_height: float = SCALE_HEIGHT,
    offset: float = 0.0121,
    join: float = np.radians(5.0),
    gain_law: bool = True,
) -> Floats:
    """Return the delay (...,) m of Canepa and Servidia's compensation, eq. 3.1 to 3.15, negative elevations included.

    Parameters
    ----------
    elevation, height, earth_radius
        (...,) rad, m, m; the radius is that of the local Earth.
    gain, scale_height, offset, join
        k_alpha (m), h_tau (m), phi_alpha and epsilon_alpha (rad) of eq. 3.1 and 3.3.
    gain_law
        Whether the gain depends on height and elevation (eq. 3.14, 3.15).

    Notes
    -----
    A ray that would pass below sea level is treated as touching it: the formula is undefined below the minimum of
    eq. 3.5.
    """
    el, h, radius = (np.asarray(value, dtype=float) for value in (elevation, height, earth_radius))

    def ascending_delay(angle: Floats, start: Floats) -> Floats:
        """Return the delay of an ascending ray of an elevation from a height."""
        high_mapping = 1.0 / (np.sin(np.maximum(angle, join)) + offset)
        mirror_mapping = 1.0 / (np.sin(2.0 * join - np.minimum(angle, join)) + offset)
        low_mapping = 2.0 / (np.sin(join) + offset) - mirror_mapping
        mapping = np.where(angle >= join, high_mapping, low_mapping)
        factor = np.ones(())
        if gain_law:
            elevation_factor = np.minimum(0.9 + 0.1 * angle / join, 1.0)
            factor = elevation_factor - start / (16.0 * scale_height)
        decay = np.exp(-start / scale_height)
        return np.asarray(gain * np.maximum(factor, 0.0) * decay * mapping)

    ascent_delay = ascending_delay(np.abs(el), h)
    impact = (radius + h) * np.cos(el)
    lowest_height = np.maximum(impact - radius, 0.0)
    grazing_delay = ascending_delay(np.zeros_like(el), lowest_height)
    descent_delay = 2.0 * grazing_delay - ascent_delay
    return np.asarray(np.where(el < 0.0, descent_delay, ascent_delay))


def spilker(
    elevation: ArrayLike,
    height: ArrayLike,
    zenith: float = 2.4405,
    scale_height: float = 1e3 / 0.133,
    offset: float = 0.0121,
) -> Floats:
    """Return the delay (...,) m of Spilker's simple model: Trigo and Theil, eq. 16 to 18.

    Parameters
    ----------
    elevation, height
        (...,) rad and m. Elevation must be positive: at sin(elevation) = -offset the formula is infinite.
    zenith, scale_height, offset
        m, m, 1. Zenith delay at sea level, scale height, and constant of the mapping function.
    """
    mapping = (1.0 + offset) / (np.sin(elevation) + offset)
    decay = np.exp(-np.asarray(height, dtype=float) / scale_height)
    return np.asarray(zenith * decay * mapping)


_LINEAR, _MIDDLE = 1e3, 9e3  # m: ends of the two lower layers of STANAG 4294
_AT_MIDDLE, _UPPER = 105.0, 0.1424e-3  # refractivity at the upper one, and its fall above, 1/m


def stanag(elevation: ArrayLike, height: ArrayLike, surface: float = 324.8) -> Floats:
    """Return the delay (...,) m of NATO STANAG 4294: integral of its refractivity upwards, times its mapping function.

    The mapping function is 1 / (sin E + 0.00143 / (tan E + 0.0455)). Its two constants are from a secondary source; the
    agreement itself was not available.

    Parameters
    ----------
    elevation, height
        (...,) rad and m. Elevation of the ray, zero or above; height of the receiver.
    surface
        Refractivity at sea level, (n - 1) x 1e6.
    """
    el, h = (np.asarray(value, dtype=float) for value in (elevation, height))
    slope = -7.32e-3 * np.exp(0.005577 * surface)
    linear_top_refractivity = surface + _LINEAR * slope  # refractivity at the top of the linear layer
    rate = np.log(linear_top_refractivity / _AT_MIDDLE) / (_MIDDLE - _LINEAR)
    # integral over each layer from the height, or from the bottom of the layer, to its top
    linear_height = np.minimum(h, _LINEAR)
    lower_integral = (surface + 0.5 * slope * (_LINEAR + linear_height)) * (_LINEAR - linear_height)
    middle_height = np.clip(h, _LINEAR, _MIDDLE) - _LINEAR
    decay = np.exp(-rate * middle_height)
    middle_integral = linear_top_refractivity / rate * (decay - _AT_MIDDLE / linear_top_refractivity)
    upper_height = np.maximum(h, _MIDDLE) - _MIDDLE
    upper_integral = _AT_MIDDLE / _UPPER * np.exp(-_UPPER * upper_height)
    zenith = 1e-6 * (lower_integral + middle_integral + upper_integral)
    fraction = 0.00143 / (np.tan(el) + 0.0455)
    return np.asarray(zenith / (np.sin(el) + fraction))


# --- zenith delay from weather ----------------------------------------------------------------------------------------


def weather(
    height: ArrayLike, pressure: float = 101325.0, temperature: float = 288.15, humidity: float = 0.5
) -> tuple[Floats, Floats, Floats]:
    """Return pressure (Pa), temperature (K) and vapour pressure (Pa) at heights (...,) m, from those at sea level.

    Parameters
    ----------
    height
        (...,) m above sea level.
    pressure, temperature, humidity
        Pa, K, and relative humidity (0 to 1) at sea level.

    Notes
    -----
    Up to 11 km the temperature falls by the standard 6.5 K/km with constant relative humidity (0 to 1), as in RTKLIB
    (``tropmodel``), where the delay ends there with a step. Here the air is isothermal above, with constant mixing
    ratio, so that the delay falls smoothly to zero.
    """
    h = np.asarray(height, dtype=float)
    troposphere_height = np.clip(h, 0.0, TROPOPAUSE)
    stratosphere_height = np.maximum(h - TROPOPAUSE, 0.0)
    decay = np.exp(-stratosphere_height / _ISOTHERMAL_SCALE)
    kelvin = temperature - 6.5e-3 * troposphere_height
    exponent = (17.15 * kelvin - 4684.0) / (kelvin - 38.45)
    vapour = 610.8 * humidity * np.exp(exponent)
    total = pressure * (1.0 - 2.2557e-5 * troposphere_height) ** 5.2568 * decay
    return total, np.asarray(kelvin), np.asarray(vapour * decay)


def saastamoinen_zenith(
    pressure: ArrayLike, temperature: ArrayLike, vapour: ArrayLike, latitude: ArrayLike, height: ArrayLike
) -> tuple[Floats, Floats]:
    """Return dry and wet zenith delay (...,) m from the weather at the receiver (Saastamoinen 1972, Davis 1985).

    Parameters
    ----------
    pressure, temperature, vapour
        (...,) Pa, K, Pa. Weather at the receiver.
    latitude, height
        (...,) rad and m, for gravity; heights above 100 km count as 100 km.
    """
    p, kelvin, e, lat = (np.asarray(value, dtype=float) for value in (pressure, temperature, vapour, latitude))
    limited_height = np.clip(height, 0.0, 100e3)
    gravity = 1.0 - 0.00266 * np.cos(2.0 * lat) - 0.00028e-3 * limited_height
    dry = 2.2768e-5 * p / gravity
    wet = 2.277e-5 * (1255.0 / kelvin + 0.05) * e
    return np.asarray(dry), np.asarray(wet)


# --- mapping functions ------------------------------------------------------------------------------------------------

# Niell 1996, tables 3 and 4, at latitudes 15, 30, 45, 60, 75 degrees: a, b, c.
_LATITUDES = np.radians([15.0, 30.0, 45.0, 60.0, 75.0])
_DRY_MEAN = np.array(
    [
        [1.2769934e-3, 1.2683230e-3, 1.2465397e-3, 1.2196049e-3, 1.2045996e-3],
        [2.9153695e-3, 2.9152299e-3, 2.9288445e-3, 2.9022565e-3, 2.9024912e-3],
        [62.610505e-3, 62.837393e-3, 63.721774e-3, 63.824265e-3, 64.258455e-3],
    ]
)
_DRY_AMPLITUDE = np.array(
    [
        [0.0, 1.2709626e-5, 2.6523662e-5, 3.4000452e-5, 4.1202191e-5],
        [0.0, 2.1414979e-5, 3.0160779e-5, 7.2562722e-5, 11.723375e-5],
        [0.0, 9.0128400e-5, 4.3497037e-5, 84.795348e-5, 170.37206e-5],
    ]
)
_WET = np.array(
    [
        [5.8021897e-4, 5.6794847e-4, 5.8118019e-4, 5.9727542e-4, 6.1641693e-4],
        [1.4275268e-3, 1.5138625e-3, 1.4572752e-3, 1.5007428e-3, 1.7599082e-3],
        [4.3472961e-2, 4.6729510e-2, 4.3908931e-2, 4.4626982e-2, 5.4736038e-2],
    ]
)
_HEIGHT = (2.53e-5, 5.49e-3, 1.14e-3)


def niell(
    elevation: ArrayLike, latitude: ArrayLike, height: ArrayLike, day_of_year: ArrayLike
) -> tuple[Floats, Floats]:
    """Return Niell's dry and wet mapping functions (...,), J. Geophys. Res. 101 (B2), 1996, 3227-3246.

    The functions are valid for elevations above 3 degrees and receivers on the Earth's surface.

    Parameters
    ----------
    elevation, latitude, height
        (...,) rad, rad, m.
    day_of_year
        (...,) 1.0 at the start of the year.
    """
    arrays = [np.asarray(value, dtype=float) for value in (elevation, latitude, height, day_of_year)]
    el, lat, h, day = np.broadcast_arrays(*arrays)
    # seasons are half a year apart on the southern hemisphere
    half_year = np.where(lat < 0.0, 0.5, 0.0)
    year = (day - 28.0) / 365.25 + half_year
    season = np.cos(2.0 * np.pi * year)

    def coefficients(table: Floats) -> Floats:
        return np.array([np.interp(np.abs(lat), _LATITUDES, row) for row in table])

    a, b, c = coefficients(_DRY_MEAN) - coefficients(_DRY_AMPLITUDE) * season
    dry = _fraction(el, a, b, c)
    a, b, c = np.asarray(_HEIGHT)
    height_mapping = 1.0 / np.sin(el) - _fraction(el, a, b, c)
    correction = height_mapping * h / 1e3
    a, b, c = coefficients(_WET)
    wet = _fraction(el, a, b, c)
    return np.asarray(dry + correction), wet


def _fraction(elevation: Floats, a: Floats, b: Floats, c: Floats) -> Floats:
    """Return Marini's continued fraction (...,), normalised to 1 at the zenith.

    Parameters
    ----------
    elevation
        (...,) rad.
    a, b, c
        (...,) coefficients of the fraction.
    """
    sine = np.sin(elevation)
    zenith_value = 1.0 + a / (1.0 + b / (1.0 + c))
    elevation_value = sine + a / (sine + b / (sine + c))
    return np.asarray(zenith_value / elevation_value)
