"""True states and their Gaussians as they are read from results."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities.frames import state_from_elements, unit
from lvnav_trade.results.mechanics import stored_states
from lvnav_trade.results.tables.read import load
from tests import mission as flights
from tests import synthetic


@pytest.fixture(scope="module")
def orbit(tmp_path_factory):
    return load(flights.results(tmp_path_factory.mktemp("orbit"), failing=(3,)))


def state_of(tables):
    return stored_states.state_at(tables, flights.CASE, "injection")


def test_the_true_state_at_an_event_is_that_of_the_flight(orbit):
    r_i, v_i = state_from_elements(flights.SUN_SYNCHRONOUS)
    state = state_of(orbit)
    np.testing.assert_allclose(state.r_i, r_i, atol=1e-3)
    np.testing.assert_allclose(state.v_i, v_i, atol=1e-6)
    assert state.earth_angle == pytest.approx(OMEGA * 99.5)
    assert stored_states.state_at(orbit, flights.CASE, "no such event") is None


def test_the_joint_covariance_is_that_of_the_history_turned_to_the_inertial_frame(orbit):
    law, state = stored_states.law_at(orbit, flights.CASE, "injection"), state_of(orbit)
    growth = 1.0 + 0.01 * 99.5
    C = np.kron(np.eye(2), state.turn)
    sigma, mean = growth * synthetic.SIGMA[3:9], growth * synthetic.MEAN[3:9]
    np.testing.assert_allclose(law.true, C @ np.diag(sigma**2) @ C.T, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(law.mean, C @ mean, rtol=1e-9, atol=1e-9)
    down = state.turn[:, 2]
    assert down @ unit(state.r_i) == pytest.approx(-1.0, abs=1e-5)  # the ellipsoid's normal is 0.2 deg off at most
