"""Deterministic errors of a window; those of profiles are tested in test_history."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from scipy.spatial.transform import Rotation

from lvnav_trade.covariance.deterministic_errors import set_deviation
from lvnav_trade.imu.error_model import lag
from lvnav_trade.kernels.attitude import multiply, small_rotation
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.kernels.strapdown import J4, N_SUM, POINT, full_rate

DT, TICKS, FAR = 1.0 / 400.0, 40, 1e15  # increments, those of a window, and where gravitation is nothing


def integrated(q, dtheta, dvel):
    """The strapdown over increments from rest."""
    nav, sums, previous = np.array([*q, 0.0, 0.0, 0.0, FAR, 0.0, 0.0]), np.zeros(N_SUM), np.zeros(6)
    increments = np.hstack([dtheta, dvel])
    mechanise(nav, sums, previous, increments, len(increments), DT, full_rate(POINT), 0.0)
    return nav


def test_what_a_bandwidth_does_to_a_body_that_spins_and_shakes_is_what_the_strapdown_makes_of_it():
    """Two seconds at 1.7 turns a second with vibration of 60 Hz across: the difference of two integrations of the same
    motion, sensed and true. With the mean attitude of a window of 0.1 s (61 deg) the velocity was 15 mm/s off.
    """
    n = 20 * TICKS
    t = DT * (np.arange(n) + 0.5)
    rate = np.stack([np.full(n, 2 * np.pi * 1.7), 0.5 * np.sin(8.0 * t), 0.5 * np.cos(8.0 * t)], axis=1)
    force = np.stack([np.full(n, 60.0), 15.0 * np.sin(377.0 * t), 15.0 * np.cos(300.0 * t)], axis=1)
    dtheta, dvel = rate * DT, force * DT
    seen = lag(dtheta, 500.0, DT), lag(dvel, 200.0, DT)
    turns = Rotation.from_rotvec(dtheta)
    q, quaternions = np.array([1.0, 0.0, 0.0, 0.0]), []
    for step in turns.as_quat(scalar_first=True):
        quaternions.append(q)
        q = np.array(multiply(*q, *step))
    reference = SimpleNamespace(dtheta=dtheta, dvel=dvel, q_b_i=np.array([*quaternions, q]))
    unit = SimpleNamespace(dtheta=seen[0], dvel=seen[1], dt=DT)
    strapdown = SimpleNamespace(gravity=J4, is_error_included=False)
    deviation, mean = np.zeros(12), np.zeros(6)
    plain, nav = getattr(set_deviation, "py_func", set_deviation), [0.0] * 7 + [FAR, 0.0, 0.0]
    for first in range(0, n, TICKS):
        plain(deviation, unit, nav, SimpleNamespace(strapdown=strapdown), first, TICKS, reference)
        within = slice(first, first + TICKS)
        gained = integrated(reference.q_b_i[first], dtheta[within], dvel[within])[4:7]
        mean[3:] += deviation[3:6] + np.cross(mean[:3], gained)
        mean[:3] += deviation[:3]
    true, sensed = (integrated(reference.q_b_i[0], *both) for both in ((dtheta, dvel), seen))
    expected = np.array([*small_rotation(*sensed[:4], *true[:4]), *(sensed - true)[4:7]])
    assert np.abs(expected[3:]).max() > 5e-3
    np.testing.assert_allclose(mean[3:], expected[3:], rtol=0, atol=2e-4)
    np.testing.assert_allclose(mean[:3], expected[:3], rtol=0, atol=2e-6)
