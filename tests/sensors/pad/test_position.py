"""Known position: its prediction against the frames, its rows against differences, its errors."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.quantities.frames import ecef_from_eci
from lvnav_trade.sensors.jacobian_row import add
from lvnav_trade.sensors.pad.position import PadPositionCard, fill
from tests.sensors.pad.rows import R_E, THETA, VIEW, assert_rows_are_derivatives, rows, state

CARD = {"name": "test", "source": "none", "sigma": "2 cm", "survey": "5 cm"}


def place(H, z, nav):
    fill(H, z, 0, np.array([*R_E, 0.0]), nav, THETA[0])


def test_what_is_known_is_the_place_at_rest_on_the_earth():
    card, out = PadPositionCard.model_validate(CARD), np.zeros(4)
    add(out, card.truth(VIEW._replace(r_i=VIEW.r_i + 0.5))[0], 0.0, 0.0, 0.25)
    np.testing.assert_allclose(out[:3], R_E + np.array([0.0, 0.0, 0.25]), atol=1e-8)


def test_the_innovation_is_the_error_in_the_axes_of_the_earth():
    error = np.array([*np.zeros(6), 30.0, -20.0, 10.0])
    expected = ecef_from_eci(error[6:], THETA[0])
    np.testing.assert_allclose(rows(place, 3, error)[1], expected, atol=1e-8)
    assert not np.allclose(state(error)[7:], state()[7:])


def test_the_rows_are_derivatives():
    assert_rows_are_derivatives(place, 3, PadPositionCard.jacobian)


def test_the_error_of_the_survey_lasts_and_is_one_for_each_axis():
    (survey,) = PadPositionCard.model_validate(CARD).correlated_errors()
    assert (survey.sigma, survey.labels) == (pytest.approx(0.05), ("x", "y", "z"))
    np.testing.assert_array_equal(survey.partials(VIEW, 3)[0], np.eye(3))


def test_a_matched_filter_assumes_the_sway():
    card = PadPositionCard.model_validate({**CARD, "jitter": "1 mm"})
    np.testing.assert_allclose(card.matched_model().variance(VIEW), 4e-4)
    np.testing.assert_array_equal(card.noise_sigma(VIEW), 1e-3)
