"""What a receiver's noise may depend on, on flights whose motion is known to the formula."""

from __future__ import annotations

import numpy as np

from lvnav_trade.gnss.reception import dynamics_at, factors
from lvnav_trade.quantities.shared_cards import NoiseFactor
from tests.building import SITE_V, flight, turning

ALONG = SITE_V / np.linalg.norm(SITE_V)


def ramp():
    """Thrust that grows by 2 m/s^3 from 10 m/s^2, on a body that turns."""
    return flight([(20.0, lambda t: (10.0 + 2.0 * t) * ALONG)], turning)


def test_force_and_jerk_are_those_of_the_thrust_whatever_the_body_does():
    t = np.array([2.0, 9.0, 15.0])
    at = dynamics_at(ramp(), t)
    np.testing.assert_allclose(at.specific_force, 10.0 + 2.0 * t, rtol=1e-4)
    np.testing.assert_allclose(at.jerk, 2.0, rtol=2e-3)


def test_altitude_is_above_the_ellipsoid():
    # the site's geocentric distance is 6.5519e6 m, and an ellipsoid's radius there 6.369e6 m
    assert 175e3 < dynamics_at(ramp(), np.array([0.0])).altitude[0] < 190e3


def test_without_tables_nothing_is_evaluated():
    assert factors((), ("position",), None, np.zeros(3)) == [1.0]


def test_a_proportion_is_a_table_of_two_entries():
    table = NoiseFactor.model_validate({"specific_force": ["0 m/s^2", "100 m/s^2"], "factor": [1.0, 11.0]})
    (found,) = factors((table,), ("velocity",), ramp(), np.array([5.0]))
    np.testing.assert_allclose(found, [[3.0]], rtol=1e-4)
