"""The Earth's potential in closed form, an oracle for gravitation and for the energy of trajectories."""

from __future__ import annotations

import math

from lvnav_trade.kernels.earth import GM, J2, J3, J4, SEMI_MAJOR


def potential_j4(x: float, y: float, z: float) -> float:
    """Return the potential in m^2/s^2 (positive near the Earth) whose gradient is `gravity_j4`."""
    r2 = x * x + y * y + z * z
    r = math.sqrt(r2)
    s2 = z * z / r2
    q2 = SEMI_MAJOR * SEMI_MAJOR / r2
    p2 = 1.5 * s2 - 0.5
    p3 = (2.5 * s2 - 1.5) * (z / r)
    p4 = (4.375 * s2 - 3.75) * s2 + 0.375
    return GM / r * (1.0 - J2 * q2 * p2 - J3 * (q2 * (SEMI_MAJOR / r)) * p3 - J4 * (q2 * q2) * p4)
