"""Velocity error of a tick and change of the covariance against matrices written out."""

from __future__ import annotations

import numpy as np

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.vehicle_tick import N_NAV, add_changes, velocity_error

N, MOTION, DT = 18, 12, 0.01


@jit
def change(P, moved, sums):
    add_changes(P, moved, sums, DT, MOTION, N)


def test_a_velocity_error_is_that_of_attitude_and_specific_force():
    rng = np.random.default_rng(5)
    sums, a, f = rng.standard_normal(18), rng.standard_normal(3), rng.standard_normal(3)
    expected = sums[:9].reshape(3, 3) @ f - np.cross(sums[9:12], a)
    np.testing.assert_allclose(velocity_error(sums, *a, *f), expected, rtol=1e-12)


def test_the_changes_of_a_covariance_are_those_of_the_dense_product():
    rng = np.random.default_rng(6)
    sums, A = rng.standard_normal(18), rng.standard_normal((N, N))
    P = A @ A.T
    C = sums[:9].reshape(3, 3)
    vx, vy, vz = sums[9:12]
    skew = np.array([[0.0, -vz, vy], [vz, 0.0, -vx], [-vy, vx, 0.0]])
    step = np.zeros((N, N))  # Phi - I
    step[0:3, MOTION : MOTION + 3] = C
    step[3:6, 0:3] = -skew
    step[3:6, MOTION + 3 : MOTION + 6] = C
    step[6:9] = 0.5 * DT * step[3:6]
    step[6:9, 3:6] = DT * np.eye(3)
    phi = np.eye(N) + step
    expected = phi @ P @ phi.T
    moved = (step @ P)[:N_NAV].copy()
    change(P, moved, sums)
    upper = np.triu_indices(N)
    np.testing.assert_allclose(P[upper], expected[upper], rtol=1e-11, atol=1e-11)
