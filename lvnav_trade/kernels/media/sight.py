"""Refraction along a line of sight in the atmosphere, to first order: excess path and bending at the observer.

Along the straight line of length R, with refractivity n(h) - 1 and distance s from the observer,

    excess  = integral of (n - 1) ds
    bending = - integral of (1 - s / R) n'(h) cos(e(s)) ds

with e(s) the elevation of the line at s. The second integral is the slope, at the observer, of the ray between the two
points (y'' = n' cos e, y = 0 at both). In a flat exponential atmosphere N exp(-h / H), from the ground to height h,

    excess = N H (1 - exp(-h / H)) / sin e,  bending = N cot e (1 - H / h (1 - exp(-h / H)))
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lvnav_trade.kernels.media.refractivity import EARTH_RADIUS

Floats = NDArray[np.float64]
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
_AIR = 120e3  # m; no refraction above
_SLOPE = 1.0  # m, step of the derivative of the refractivity


class SightRefraction(NamedTuple):
    """Refraction along a line of sight.

    excess : m. Excess of the optical path over the distance.
    bending : rad. Apparent minus geometric elevation at the observer.
    """

    excess: Floats
    bending: Floats


def along_line(
    refractivity: Callable[[Floats], Floats], height: ArrayLike, elevation: ArrayLike, distance: ArrayLike
) -> SightRefraction:
    """Return excess path and bending for lines of sight, (...,) each.

    Parameters
    ----------
    refractivity
        (n - 1) x 1e6 as a function of height (m).
    height
        (...,) m. Height of the observer above the sphere of EARTH_RADIUS.
    elevation
        (...,) rad. Elevation of the straight line at the observer.
    distance
        (...,) m. Distance of the point.
    """
    arrays = (np.asarray(value, dtype=float) for value in (height, elevation, distance))
    height, elevation, distance = np.broadcast_arrays(*arrays)
    start = EARTH_RADIUS + height
    rise = start * np.sin(elevation)
    top = EARTH_RADIUS + _AIR
    top_square = np.maximum(top**2 - start**2 + rise**2, 0.0)
    top_distance = np.sqrt(top_square) - rise
    half = 0.5 * np.minimum(distance, top_distance)[..., None]
    # s = 2 half share^3: nodes are dense near the observer, where refractivity is large
    share = 0.5 * (1.0 + _NODES)
    s = 2.0 * half * share**3
    weight = 3.0 * half * share**2 * _WEIGHTS
    square = start[..., None] ** 2 + s**2 + 2.0 * s * rise[..., None]
    radius = np.sqrt(square)
    cos_elevation = start[..., None] * np.cos(elevation)[..., None] / radius
    h = radius - EARTH_RADIUS
    excess_index = 1e-6 * refractivity(h)
    excess = np.sum(weight * excess_index, axis=-1)
    difference = refractivity(h + _SLOPE) - refractivity(h - _SLOPE)
    slope = 1e-6 * difference / (2.0 * _SLOPE)
    remaining_share = 1.0 - s / distance[..., None]
    bending = -np.sum(weight * remaining_share * slope * cos_elevation, axis=-1)
    return SightRefraction(np.asarray(excess), np.asarray(bending))
