"""A tick of the nominal flight whose samples are measurements."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.quantities.frames import matrices
from lvnav_trade.simulation.epoch.joint_ticks import nominal_tick
from tests.both_engines.modelled import modelled


def test_a_nominal_tick_is_the_flights_own_velocity_gain_and_the_trapezoid_of_its_attitude():
    reference, sums, dt = modelled().reference, np.zeros(18), 0.005
    k = 1000
    nominal_tick(sums, reference, k, dt)
    assert np.linalg.norm(sums[9:12]) / dt == pytest.approx(30.0, rel=1e-6)
    np.testing.assert_allclose(
        sums[:9].reshape(3, 3), 0.5 * dt * matrices(reference.q_b_i[k : k + 2]).sum(axis=0), rtol=0, atol=1e-16
    )
