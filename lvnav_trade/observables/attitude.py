"""Attitude as a reference measures it: the rotation from the estimated to the measured attitude, axis by axis, frame i.

z - z_hat = att + v.
"""

from __future__ import annotations

from lvnav_trade.kernels.attitude import from_rotation, multiply, small_rotation
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.strapdown import Q
from lvnav_trade.observables.base import H_ATT, clear


@jit
def measure(out, truth, e0, e1, e2):
    """Set out (4,) to the measured attitude, a quaternion from body to inertial: the true one turned by errors (rad,
    frame i).
    """
    q0, q1, q2, q3 = from_rotation(e0, e1, e2)
    out[0], out[1], out[2], out[3] = multiply(q0, q1, q2, q3, truth[0], truth[1], truth[2], truth[3])


@jit
def fill(H, z, at, observed, nav):
    """Set three Jacobian rows from `at` on, and the small rotation (rad, frame i) from estimated to measured attitude."""
    z[at], z[at + 1], z[at + 2] = small_rotation(
        observed[0], observed[1], observed[2], observed[3], nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3]
    )
    for axis in range(3):
        clear(H[at + axis])
        H[at + axis, H_ATT + axis] = 0.0 * z[at] + 1.0
