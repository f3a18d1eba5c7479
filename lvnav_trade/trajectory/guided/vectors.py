"""Vectors of three components as tuples, for kernels that create no array."""

import math

from lvnav_trade.kernels.jit import jit

Vector = tuple[float, float, float]


@jit
def unit_vector(x: float, y: float, z: float) -> Vector:
    """Return the unit vector along (x, y, z)."""
    norm = math.sqrt(x * x + y * y + z * z)
    return (
        x / norm,
        y / norm,
        z / norm,
    )


@jit
def blend(weight: float, a: Vector, b: Vector) -> Vector:
    """Return the unit vector along a + weight (b - a)."""
    x = a[0] + weight * (b[0] - a[0])
    y = a[1] + weight * (b[1] - a[1])
    z = a[2] + weight * (b[2] - a[2])
    return unit_vector(x, y, z)


@jit
def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product a x b."""
    x = a[1] * b[2] - a[2] * b[1]
    y = a[2] * b[0] - a[0] * b[2]
    z = a[0] * b[1] - a[1] * b[0]
    return x, y, z
