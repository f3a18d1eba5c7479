"""Numbers of an orbit, their differences, and what perigee and apogee follow from."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.earth import SEMI_MAJOR
from lvnav_trade.quantities.records import ORBIT
from lvnav_trade.trajectory.guided.orbit_numbers import append_apsides, orbit_difference, osculating_orbit
from tests.trajectory.guided.cases import state_of


def test_numbers_of_an_orbit():
    found = dict(zip(ORBIT, osculating_orbit(state_of()[None])[0], strict=True))
    assert found["semi_major_axis"] == pytest.approx(6.8e6)
    assert found["perigee"] == pytest.approx(6.8e6 * 0.99 - SEMI_MAJOR)
    assert found["apogee"] == pytest.approx(6.8e6 * 1.01 - SEMI_MAJOR)
    assert found["eccentricity_along_node"] == pytest.approx(0.01 * np.cos(0.3))
    assert found["eccentricity_ahead_of_node"] == pytest.approx(0.01 * np.sin(0.3))
    assert found["inclination"] == pytest.approx(0.9)


def test_the_node_differs_the_short_way_round():
    one, other = (osculating_orbit(state_of(node=node)[None]) for node in (0.01, 6.28))
    assert orbit_difference(one, other)[0, ORBIT.index("node")] == pytest.approx(0.01 - 6.28 + 2.0 * np.pi)


def test_perigee_and_apogee_follow_from_axis_and_eccentricity_vector():
    target = osculating_orbit(state_of()[None])
    change = orbit_difference(
        osculating_orbit(state_of(semi_major_axis=6.8001e6, eccentricity=0.0100003)[None]), target
    )
    np.testing.assert_allclose(append_apsides(change, target[0]), change, rtol=1e-3, atol=1e-9)
    circle = append_apsides(change, osculating_orbit(state_of(eccentricity=1e-6)[None])[0])
    assert np.isnan(circle[0, [ORBIT.index("perigee"), ORBIT.index("apogee")]]).all()
