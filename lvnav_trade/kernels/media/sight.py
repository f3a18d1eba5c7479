"""What air does to a line between two points within it, to first order: excess of the path, bending at one end.

Along the straight line of length R, with refractivity n(h) - 1 and distance s from the observer,

    excess  = integral of (n - 1) ds
    bending = - integral of (1 - s / R) n'(h) cos(e(s)) ds

e(s) the elevation of the line there: the second is the slope at the observer of the ray that begins and ends at the two
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
_AIR = 120e3  # m; above it there is none
_SLOPE = 1.0  # m, step of the derivative of the refractivity


class Sight(NamedTuple):
    """excess (m) of the path over the distance; bending (rad) by which the observer sees the point too high."""

    excess: Floats
    bending: Floats


def along_line(
    refractivity: Callable[[Floats], Floats], height: ArrayLike, elevation: ArrayLike, distance: ArrayLike
) -> Sight:
    """Return what the air does to lines that an observer looks along, (...,).

    refractivity: (n - 1) x 1e6 at heights (m); height (...,) m of the observer above the sphere; elevation (...,) rad
    of the straight line; distance (...,) m of the point.
    """
    found = (np.asarray(value, dtype=float) for value in (height, elevation, distance))
    height, elevation, distance = np.broadcast_arrays(*found)
    start = EARTH_RADIUS + height
    rise = start * np.sin(elevation)
    top = np.sqrt(np.maximum((EARTH_RADIUS + _AIR) ** 2 - start**2 + rise**2, 0.0)) - rise
    half = 0.5 * np.minimum(distance, top)[..., None]
    # nodes are dense near the observer, where the air is
    share = 0.5 * (1.0 + _NODES)
    s, weight = 2.0 * half * share**3, 3.0 * half * share**2 * _WEIGHTS
    radius = np.sqrt(start[..., None] ** 2 + s**2 + 2.0 * s * rise[..., None])
    level = start[..., None] * np.cos(elevation)[..., None] / radius
    h = radius - EARTH_RADIUS
    n = 1e-6 * refractivity(h)
    slope = 1e-6 * (refractivity(h + _SLOPE) - refractivity(h - _SLOPE)) / (2.0 * _SLOPE)
    bending = -np.sum(weight * (1.0 - s / distance[..., None]) * slope * level, axis=-1)
    return Sight(np.asarray(np.sum(weight * n, axis=-1)), np.asarray(bending))
