"""A vehicle that stands at 40 N, and its rows by differences."""

from __future__ import annotations

import numpy as np

from lvnav_trade.kernels.attitude import from_rotation, multiply
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.kernels.strapdown import N_NAV, Q, R, V
from lvnav_trade.quantities.frames import ecef_from_geodetic, eci_from_ecef, quaternions, rotation_i_n
from lvnav_trade.sensors.jacobian_row import H_ATT, H_POS, H_VEL, N_ENTRY
from lvnav_trade.sensors.sensor import FlightView

THETA = np.array([0.3])
R_E = ecef_from_geodetic(np.radians(40.0), np.radians(-75.0), 30.0)
R_I = eci_from_ecef(R_E[None], THETA)
V_I = np.cross([0.0, 0.0, OMEGA], R_I)
# upright, the y axis to the azimuth of 100 deg and, by a tilt of 2 deg, a little below the horizon
_NORTH, _EAST, _DOWN = rotation_i_n(R_I, THETA)[0]
_SIDE = np.cos(np.radians(100.0)) * _NORTH + np.sin(np.radians(100.0)) * _EAST
_TILT = np.radians(2.0)
_X, _Y = -np.cos(_TILT) * _DOWN + np.sin(_TILT) * _SIDE, np.cos(_TILT) * _SIDE + np.sin(_TILT) * _DOWN
Q_B_I = quaternions(np.stack([_X, _Y, np.cross(_X, _Y)], axis=-1)[None])
VIEW = FlightView(
    t=np.zeros(1), r_i=R_I, v_i=V_I, q_b_i=Q_B_I, height=np.array([30.0]), theta=THETA,
    w_ib_b=np.zeros((1, 3)), epoch="2024-03-20T12:00:00Z", r_rest=R_I, q_rest=Q_B_I, is_at_rest=np.array([True]),
)  # fmt: skip
PARTS = {"attitude": (H_ATT, 0, 1e-4), "velocity": (H_VEL, 3, 1.0), "position": (H_POS, 6, 10.0)}


def state(error=None):
    """Navigation state (10,) of the vehicle at rest; its truth is off by an error (9,) of attitude, velocity, position,
    frame i: the state is the truth less that.
    """
    x = np.zeros(9) if error is None else np.asarray(error)
    nav = np.zeros(N_NAV)
    nav[Q : Q + 4] = multiply(*from_rotation(*-x[:3]), *Q_B_I[0])
    nav[V : V + 3], nav[R : R + 3] = V_I[0] - x[3:6], R_I[0] - x[6:]
    return nav


def rows(fill, n_row, error=None):
    """Jacobian rows (n_row, n_entry) and innovations (n_row,) at a state with an error; fill(H, z, nav)."""
    H, z = np.full((n_row, N_ENTRY), np.nan), np.full(n_row, np.nan)
    fill(H, z, state(error))
    return H, z


def assert_rows_are_derivatives(fill, n_row, jacobian):
    """Every entry that the card names is a central difference of the innovation; those of other quantities are zero."""
    H, _ = rows(fill, n_row)
    for name, (entry, at, step) in PARTS.items():
        found = np.empty((n_row, 3))
        for axis in range(3):
            x = step * np.eye(9)[at + axis]
            found[:, axis] = (rows(fill, n_row, x)[1] - rows(fill, n_row, -x)[1]) / (2.0 * step)
        expected = found if name in jacobian else np.zeros((n_row, 3))
        # a difference over 1e-4 rad has the cube of that, one over metres the rounding of 6e6 m
        np.testing.assert_allclose(H[:, entry : entry + 3], expected, rtol=0, atol=1e-8)
    others = [k for k in range(N_ENTRY) if not any(entry <= k < entry + 3 for entry, _, _ in PARTS.values())]
    assert not H[:, others].any()
