"""Zero rotation: attitude relative to the Earth against matrices, its rows against differences, its state."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from lvnav_trade.quantities.frames import ecef_from_eci, matrices, rotation_i_e
from lvnav_trade.sensors.attitude_reference import measure
from lvnav_trade.sensors.pad.zero_rotation import ZeroRotationCard, fill
from tests.sensors.pad.rows import Q_B_I, THETA, VIEW, assert_rows_are_derivatives, rows

CARD = {"name": "test", "source": "none", "sigma": "0.2 mrad", "attitude": "1 deg"}
STANDING = ZeroRotationCard.model_validate(CARD).truth(VIEW)[0]


def standing(H, z, nav):
    fill(H, z, 0, STANDING, nav, THETA[0])


def test_what_stays_is_the_attitude_relative_to_the_earth_an_hour_later_too():
    later = VIEW._replace(theta=THETA + 0.26, q_rest=_turned_with_the_earth(0.26))
    np.testing.assert_allclose(ZeroRotationCard.model_validate(CARD).truth(later)[0], STANDING, atol=1e-12)
    np.testing.assert_allclose(matrices(STANDING[None])[0], rotation_i_e(THETA)[0] @ matrices(Q_B_I)[0], atol=1e-12)


def _turned_with_the_earth(angle):
    whole = Rotation.from_rotvec([0.0, 0.0, angle]) * Rotation.from_quat(Q_B_I[0], scalar_first=True)
    return whole.as_quat(scalar_first=True)[None]


def test_the_innovation_is_the_attitude_error_in_the_axes_of_the_earth():
    error = np.array([0.002, -0.001, 0.0005] + [0.0] * 6)
    np.testing.assert_allclose(rows(standing, 3, error)[1], ecef_from_eci(error[:3], THETA[0]), atol=1e-9)


def test_the_rows_are_derivatives():
    assert_rows_are_derivatives(standing, 3, ZeroRotationCard.jacobian)


def test_an_error_turns_the_known_attitude_about_the_axes_of_the_earth():
    out = np.zeros(4)
    measure(out, STANDING, 0.01, -0.02, 0.03)
    expected = Rotation.from_rotvec([0.01, -0.02, 0.03]) * Rotation.from_quat(STANDING, scalar_first=True)
    np.testing.assert_allclose(matrices(out[None])[0], expected.as_matrix(), atol=1e-12)


def test_what_is_not_known_of_the_attitude_is_a_state_for_each_axis():
    card = ZeroRotationCard.model_validate(CARD)
    (known,) = card.correlated_errors()
    assert (known.sigma, known.labels) == (pytest.approx(np.radians(1.0)), ("x", "y", "z"))
    np.testing.assert_array_equal(known.partials(VIEW, 3)[0], np.eye(3))
    assert card.model.states["attitude"].name == "standing_attitude"
    assert card.matched_model().attitude == known.sigma
    np.testing.assert_allclose(card.matched_model().variance(VIEW), 4e-8)


def test_an_attitude_that_is_known_exactly_is_another_sensor():
    with pytest.raises(ValidationError, match="greater than 0"):
        ZeroRotationCard.model_validate({**CARD, "attitude": "0 deg"})
