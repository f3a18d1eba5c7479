"""Zero velocity: its prediction against the frames, its rows against differences, its card."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.quantities.frames import earth_velocity, ecef_from_eci
from lvnav_trade.sensors.jacobian_row import add
from lvnav_trade.sensors.pad.zero_velocity import ZeroVelocityCard, fill
from tests.sensors.pad.rows import THETA, VIEW, assert_rows_are_derivatives, rows, state

CARD = {"name": "test", "source": "none", "sigma": "1 cm/s"}


def zero(H, z, nav):
    fill(H, z, 0, np.zeros(4), nav, THETA[0])


def test_at_rest_on_the_turning_earth_nothing_is_left():
    np.testing.assert_allclose(rows(zero, 3)[1], 0.0, atol=1e-12)


def test_the_prediction_is_the_velocity_over_the_earth_in_its_axes():
    error = np.array([0.0, 0.0, 0.0, 1.0, -2.0, 0.5, 300.0, 200.0, -100.0])
    nav = state(error)
    expected = ecef_from_eci(earth_velocity(nav[7:10], nav[4:7]), THETA[0])
    np.testing.assert_allclose(rows(zero, 3, error)[1], -expected, atol=1e-12)
    assert np.linalg.norm(expected) > 1.0


def test_the_rows_are_derivatives():
    assert_rows_are_derivatives(zero, 3, ZeroVelocityCard.jacobian)


def test_what_is_measured_is_zero_with_its_errors_whatever_the_sway():
    card, out = ZeroVelocityCard.model_validate({**CARD, "jitter": "1 mm/s"}), np.zeros(4)
    moving = VIEW._replace(v_i=VIEW.v_i + 0.3)
    add(out, card.truth(moving)[0], 0.1, -0.2, 0.3)
    assert out.tolist() == [0.1, -0.2, 0.3, 0.0]
    np.testing.assert_array_equal(card.noise_sigma(VIEW), 1e-3)


def test_a_matched_filter_assumes_the_sway_and_the_truth_has_none_of_its_own():
    card = ZeroVelocityCard.model_validate(CARD)
    np.testing.assert_allclose(card.matched_model().variance(VIEW), 1e-4)
    assert not card.noise_sigma(VIEW).any()


def test_a_filter_cannot_take_it_for_exact():
    with pytest.raises(ValidationError, match="greater than 0"):
        ZeroVelocityCard.model_validate({**CARD, "sigma": "0 m/s"})
