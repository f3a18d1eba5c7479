"""Rays through a spherically layered atmosphere: bending and excess path for any height and elevation.

With X = n r, refractive index times radius, a = X cos(elevation) is constant along a ray (Bouguer). In the variable
l = sqrt(X^2 - a^2), negative before the lowest point of the ray, both integrals are smooth, also at a turning point:

    optical path  = l_far - l_0 + integral of f dl
    central angle = acos(a / r_far) - elevation_0 + integral of f a / X^2 dl,    f = -r n' / (n + r n')

Only the contribution of the air is integrated. Rays that descend below the receiver need no special case.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lvnav_trade.kernels.earth import ECCENTRICITY_2, SEMI_MAJOR, SEMI_MINOR
from lvnav_trade.kernels.media.atmosphere import atmosphere

Floats = NDArray[np.float64]

EARTH_RADIUS = 6371e3  # m, of the layered sphere
BOTTOM, TOP = -1e3, 130e3  # m, of a sampled profile; beyond the top there is vacuum
_SPACING = 5.0  # m, of the samples
_ROUNDING = 1000.0  # m, see `sample_atmosphere`
_PANELS = 1e3 * np.array([-1, 0.5, 2, 4, 6, 8, 10, 12, 14, 17, 20, 24, 29, 35, 42, 50, 60, 70, 80, 90, 110, 130])  # m
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_ROUNDS = 30  # of Newton's iteration at most; three to eight are needed
_TOP_OF_STANDARD = 86e3  # m
_TAIL_SCALE = 5630.0  # m, isothermal scale height there: 287.05 x 186.87 / 9.53


class SampledAtmosphere(NamedTuple):
    """Atmosphere sampled from BOTTOM to TOP.

    height : (n,) m. Heights, ascending.
    radius : (n,) m. X = n r.
    log_f : (n,). Logarithm of f, the integrand.
    log_n : (n,). Logarithm of n - 1.
    panels : (m,) m. Bounds of X of the quadrature panels, bottom and top included.
    """

    height: Floats
    radius: Floats
    log_f: Floats
    log_n: Floats
    panels: Floats


class Ray(NamedTuple):
    """Result of ray tracing.

    delay : m. Excess of the optical path over the straight distance.
    apparent_elevation : rad. Apparent elevation at the receiver.
    """

    delay: Floats
    apparent_elevation: Floats


# --- refractivity against height, (n - 1) x 1e6 ----------------------------------------------------------------------


def standard_refractivity(height: ArrayLike, wet: float = 44.8, wet_scale: float = 2000.0) -> Floats:
    """Return the refractivity (...,) of the US Standard Atmosphere 1976 with vapour that falls off exponentially.

    Parameters
    ----------
    height
        (...,) m above sea level, from -5 km; exponential above 86 km.
    wet, wet_scale
        Wet refractivity at sea level, and its scale height (m). The default is the reference atmosphere of ITU-R P.835:
        7.5 g/m^3 at 288.15 K, which is 9.97 hPa, over 2 km.

    Notes
    -----
    Dry 77.6 p/T and wet 3.73e5 e/T^2, p and e in hPa (Smith and Weintraub 1953; ITU-R P.453).
    """
    height = np.asarray(height, dtype=float)
    limited_height = np.minimum(height, _TOP_OF_STANDARD)
    _, pressure, temperature, _ = np.vectorize(atmosphere, otypes=[float] * 4)(limited_height)
    dry = 0.776 * pressure / temperature
    tail = np.exp((limited_height - height) / _TAIL_SCALE)
    vapour = wet * np.exp(-height / wet_scale)
    return np.asarray(dry * tail + vapour)


def bean_thayer_refractivity(height: ArrayLike, surface: float = 324.8) -> Floats:
    """Return the refractivity (...,) of the exponential reference atmosphere from its value at sea level.

    Linear to 1 km, with slope -7.32 exp(0.005577 surface) per km; exponential to 105 at 9 km; with 0.1424 per km above
    (Bean and Thayer 1959). With 324.8 it is the model of NATO STANAG 4294, which signal simulators use.
    """
    height = np.asarray(height, dtype=float)
    slope = -7.32e-3 * np.exp(0.005577 * surface)
    lower = surface + slope * height
    refractivity_1_km = surface + 1e3 * slope
    rate = np.log(refractivity_1_km / 105.0) / 8e3
    middle = refractivity_1_km * np.exp(-rate * (height - 1e3))
    upper = 105.0 * np.exp(-0.1424e-3 * (height - 9e3))
    upper_profile = np.where(height < 9e3, middle, upper)
    return np.asarray(np.where(height < 1e3, lower, upper_profile))


def exponential_refractivity(height: ArrayLike, surface: float = 315.0, scale: float = 7350.0) -> Floats:
    """Return the refractivity (n - 1) x 1e6, (...,), that falls exponentially.

    The defaults are the world mean of ITU-R P.453.

    Parameters
    ----------
    height
        (...,) m. Height above sea level.
    surface
        Refractivity at height zero.
    scale
        m. Scale height.
    """
    decay = np.exp(-np.asarray(height, dtype=float) / scale)
    return np.asarray(surface * decay)


def sample_atmosphere(refractivity: Callable[[Floats], Floats]) -> SampledAtmosphere:
    """Return the profile of a refractivity (n - 1) x 1e6 that is a function of height (n,) in m.

    Its logarithm is smoothed by a Gaussian with a sigma of one kilometre. At a sharp corner, such as the tropopause of
    the standard atmosphere, a grazing ray seen from orbit would otherwise have three solutions.

    Raises
    ------
    ValueError
        If refractivity increases with height, or decreases so fast (157 per km) that rays are trapped.
    """
    wings = np.arange(-3.0 * _ROUNDING, 3.0 * _ROUNDING + 1.0, _SPACING)
    weight = np.exp(-0.5 * (wings / _ROUNDING) ** 2)
    height = np.arange(BOTTOM, TOP + 1.0, _SPACING)
    wide_height = np.arange(BOTTOM + wings[0], TOP + wings[-1] + 1.0, _SPACING)
    log_samples = np.log(1e-6 * refractivity(wide_height))
    gaussian = weight / np.sum(weight)
    log_n = np.convolve(log_samples, gaussian, "valid")
    excess = np.exp(log_n)  # n - 1
    slope = excess * np.gradient(log_n, _SPACING, edge_order=2)  # n'
    r = EARTH_RADIUS + height
    stretch = 1.0 + excess + r * slope  # dX/dr = n + r n'
    if np.any(stretch <= 0.0) or np.any(slope >= 0.0):
        raise ValueError("refractivity should fall with height, and by less than 157 per km: rays would be trapped")
    radius = r * (1.0 + excess)
    return SampledAtmosphere(
        height=height,
        radius=radius,
        log_f=np.log(-r * slope / stretch),
        log_n=log_n,
        panels=np.interp(_PANELS, height, radius),
    )


# --- rays -------------------------------------------------------------------------------------------------------------


def ray(profile: SampledAtmosphere, height: ArrayLike, elevation: ArrayLike, satellite_radius: float) -> Ray:
    """Trace rays from receivers to satellites: delay and apparent elevation from the elevation of the straight line.

    Parameters
    ----------
    profile
        The layered atmosphere on a sphere of EARTH_RADIUS.
    height, elevation
        (...,) m and rad. Height of the receiver; elevation of the straight line to the satellite, may be negative.
    satellite_radius
        m. Distance r_far of the satellite from the Earth's centre; outside receiver and profile.

    Returns
    -------
    Ray
        (...,) each. Below BOTTOM a ray is continued with the air of the bottom: the result is finite but meaningless.
    """
    height, elevation = np.broadcast_arrays(np.asarray(height, dtype=float), np.asarray(elevation, dtype=float))
    start = EARTH_RADIUS + height
    is_in_air = height <= TOP
    excess_index = np.exp(np.interp(height, profile.height, profile.log_n))
    start_radius = start * (1.0 + is_in_air * excess_index)
    straight_impact = start * np.cos(elevation)
    target = np.arccos(straight_impact / satellite_radius) - elevation  # central angle between receiver and satellite

    def trace(apparent: Floats) -> tuple[Floats, Floats]:
        """Return the error of the central angle (rad) and the excess path (m) of rays of an apparent elevation."""
        excess, bending = _air_contribution(profile, start_radius, apparent)
        impact = start_radius * np.cos(apparent)
        angle = np.arccos(impact / satellite_radius) - apparent + bending
        return angle - target, excess

    apparent = np.array(elevation)
    for _ in range(_ROUNDS):  # Newton's method from below, where the error is convex, so no step overshoots
        error, excess = trace(apparent)
        step = 1e-5
        stepped_error, _ = trace(apparent + step)
        change = np.minimum(stepped_error - error, -1e-3 * step)
        correction = -error * step / change
        apparent = apparent + correction
        if np.all(np.abs(correction) < 1e-9):  # convergence is quadratic: the next correction is negligible
            break
    error, excess = trace(apparent)
    impact = start_radius * np.cos(apparent)  # the optical path grows by it for each radian of central angle
    satellite_distance = np.sqrt(satellite_radius**2 - impact**2)
    receiver_distance = start_radius * np.sin(apparent)
    path = satellite_distance - receiver_distance + excess - impact * error
    distance = np.sqrt(satellite_radius**2 - straight_impact**2) - start * np.sin(elevation)
    return Ray(np.asarray(path - distance), np.asarray(apparent))


def _air_contribution(profile: SampledAtmosphere, start_radius: Floats, apparent: Floats) -> tuple[Floats, Floats]:
    """Return the contribution of the air to optical path (m) and central angle (rad) of rays to space, (...,) each.

    Parameters
    ----------
    profile
        Layered atmosphere.
    start_radius
        (...,) m. X = n r at the receiver.
    apparent
        (...,) rad. Apparent elevation at the receiver.
    """
    impact = start_radius * np.cos(apparent)
    start = start_radius * np.sin(apparent)  # l at the receiver
    square = profile.panels**2 - impact[..., None] ** 2
    bounds = np.sqrt(np.maximum(square, 0.0))
    bounds[..., 0] = 0.0  # below the bottom the air is that of the bottom
    ascent_start = np.maximum(start, 0.0)
    ascent_bounds = np.maximum(bounds, ascent_start[..., None])
    path, angle = _integrals(profile, impact, ascent_bounds)
    if np.any(start < 0.0):  # a descending ray passes the layers below the receiver twice
        descent_start = np.maximum(-start, 0.0)
        descent_bounds = np.minimum(bounds, descent_start[..., None])
        descent, descent_angle = _integrals(profile, impact, descent_bounds)
        return path + descent, angle + descent_angle
    return path, angle


def _integrals(profile: SampledAtmosphere, impact: Floats, bounds: Floats) -> tuple[Floats, Floats]:
    """Return the integrals of f dl (m) and of f a / X^2 dl (rad), (...,) each, by Gauss-Legendre quadrature.

    Parameters
    ----------
    profile
        Layered atmosphere.
    impact
        (...,) m. The constant a of the ray.
    bounds
        (..., k) m. Bounds of the panels in the variable l.
    """
    half = 0.5 * np.diff(bounds, axis=-1)[..., None]
    path_variable = bounds[..., :-1, None] + half * (1.0 + _NODES)
    square = impact[..., None, None] ** 2 + path_variable**2
    radius = np.sqrt(square)
    f = np.exp(np.interp(radius, profile.radius, profile.log_f))
    weighted_f = half * _WEIGHTS * f
    path = np.sum(weighted_f, axis=(-2, -1))
    angle = impact * np.sum(weighted_f / square, axis=(-2, -1))
    return np.asarray(path), np.asarray(angle)


def lowest_height(latitude: ArrayLike, height: ArrayLike, azimuth: ArrayLike, elevation: ArrayLike) -> Floats:
    """Return the height (...,) m above the ellipsoid of the lowest point of a straight line from a receiver.

    A line with positive elevation is lowest at the receiver. Stretching z makes the ellipsoid a sphere; the error is
    0.4 % of the descent of the line, plus some decimetres.

    Parameters
    ----------
    latitude, height
        (...,) rad and m. Geodetic position of the receiver.
    azimuth, elevation
        (...,) rad. Direction of the line at the receiver.
    """
    lat, h, az, el = (np.asarray(value, dtype=float) for value in (latitude, height, azimuth, elevation))
    normal = SEMI_MAJOR / np.sqrt(1.0 - ECCENTRICITY_2 * np.sin(lat) ** 2)
    stretch = SEMI_MAJOR / SEMI_MINOR
    # receiver: distance from the polar axis, and stretched z
    cos_lat = np.cos(lat)
    sin_lat = np.sin(lat)
    level = (normal + h) * cos_lat
    polar = ((1.0 - ECCENTRICITY_2) * normal + h) * sin_lat * stretch
    # direction of the line: away from the polar axis, to the east, and along stretched z
    north = np.cos(el) * np.cos(az)
    east = np.cos(el) * np.sin(az)
    up = np.sin(el)
    outward_component = up * cos_lat - north * sin_lat
    polar_component = (up * sin_lat + north * cos_lat) * stretch
    # the line is closest to the centre at the distance sqrt(r^2 - (r . d)^2 / d^2)
    product = level * outward_component + polar * polar_component
    start = np.hypot(level, polar)
    square = outward_component**2 + east**2 + polar_component**2
    approach = np.minimum(product, 0.0) ** 2 / square
    lowest = np.sqrt(np.maximum(start**2 - approach, 0.0))
    descent = start - lowest
    return np.asarray(np.where(el < 0.0, h - descent, h))
