"""The magnetometer: the Earth's field in body axes, the map that a filter predicts it with, and its iron."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.kernels.attitude import from_rotation, multiply
from lvnav_trade.kernels.strapdown import N_NAV, Q, R
from lvnav_trade.quantities.frames import ecef_from_eci, eci_from_ecef, matrices
from lvnav_trade.sensors.geomagnetism import decimal_year, field
from lvnav_trade.sensors.jacobian_row import H_ATT, H_POS, N_ENTRY, add
from lvnav_trade.sensors.magnetometer import SOFT, MagnetometerCard, fill
from lvnav_trade.sensors.sensor import FlightView

TRUE = np.array([0.8, 0.1, -0.5, 0.3]) / np.linalg.norm([0.8, 0.1, -0.5, 0.3])
PLACE = np.array([4.05e6, -3.10e6, -4.12e6])
THETA, EPOCH = 0.7, "2024-03-20T12:00:00Z"
DATA = {"name": "a", "source": "b", "kind": "magnetometer", "sigma": "50 nT"}


def card(**fields):
    return MagnetometerCard.model_validate({**DATA, **fields})


def view(epoch=EPOCH):
    zero, theta = np.zeros(1), np.array([THETA])
    return FlightView(zero, PLACE[None], np.zeros((1, 3)), TRUE[None], zero, theta, np.zeros((1, 3)), epoch)


def field_at(r_i):
    """The full field (3,) T in frame i."""
    return eci_from_ecef(field(ecef_from_eci(r_i, THETA), decimal_year(EPOCH)), THETA)


def rows(estimate=TRUE, position=PLACE):
    H, z, nav, observed = np.full((4, N_ENTRY), np.nan), np.full(4, np.nan), np.zeros(N_NAV), np.zeros(4)
    nav[Q : Q + 4], nav[R : R + 3] = estimate, position
    add(observed, np.pad(card().truth(view())[0], (0, 1)), 0.0, 0.0, 0.0)
    fill(H, z, 1, observed, nav, np.pad(card().matched_model().filter_parameters(view())[0], (0, 1)))
    assert np.isnan(H[0]).all()
    return H[1:], z[1:]


def test_it_measures_the_field_in_body_axes_and_errors_are_added():
    body = matrices(TRUE[None])[0].T @ field_at(PLACE)
    np.testing.assert_allclose(card().truth(view())[0], body, rtol=1e-12)
    assert 2e-5 < np.linalg.norm(body) < 6e-5  # T
    out = np.zeros(4)
    add(out, np.array([1e-5, 2e-5, 3e-5, 0.0]), 1e-7, -2e-7, 3e-7)
    np.testing.assert_allclose(out, [1.01e-5, 1.98e-5, 3.03e-5, 0.0])


def test_at_the_truth_the_innovation_is_zero_and_the_row_is_its_derivative():
    H, z = rows()
    np.testing.assert_allclose(z, 0.0, atol=1e-18)
    for axis in range(3):
        step = 1e-5 * np.eye(3)[axis]
        high, low = (rows(multiply(*from_rotation(*(-s * step)), *TRUE))[1] for s in (1.0, -1.0))
        np.testing.assert_allclose((high - low) / 2e-5, H[:, H_ATT + axis], atol=1e-13)
        step = 1e4 * np.eye(3)[axis]
        high, low = (matrices(TRUE[None])[0].T @ field_at(PLACE + s * step) for s in (1.0, -1.0))
        np.testing.assert_allclose((high - low) / 2e4, H[:, H_POS + axis], atol=1e-15)
    assert np.abs(H[:, H_ATT : H_ATT + 3]).max() > 1e-5


def test_ten_kilometres_off_the_map_is_right_to_a_nanotesla():
    off = PLACE + 1e4 * np.array([0.6, -0.64, 0.48])
    predicted = card().truth(view())[0] - rows(position=off)[1]
    np.testing.assert_allclose(predicted, matrices(TRUE[None])[0].T @ field_at(off), atol=1e-9)


def test_a_field_of_a_lower_degree_leaves_the_difference_in_the_innovation():
    dipole = card().matched_model().model_copy(update={"degree": 1}).filter_parameters(view())[0, :3]
    assert 1e-6 < np.linalg.norm(dipole - field_at(PLACE)) < 2e-5  # T


def test_soft_iron_acts_in_proportion_to_the_field_of_an_axis():
    hard, soft = card(hard_iron="100 nT", soft_iron="1 percent").correlated_errors()
    body = card().truth(view())[0]
    distorted = soft.partials(view(), 3)[0] @ np.eye(9)[:, SOFT.index("yz")]
    np.testing.assert_allclose(distorted, [0.0, body[2], 0.0])
    assert (hard.sigma, soft.sigma) == (pytest.approx(1e-7), 0.01)
    np.testing.assert_array_equal(hard.partials(view(), 3)[0], np.eye(3))
    assert math.isinf(hard.time_constant)


def test_a_flight_before_or_after_the_model_is_refused_with_its_years():
    assert card().refusal(EPOCH) == ""
    assert "covers 1900 to 2030" in card().refusal("2031-01-01T00:00:00Z")


@pytest.mark.parametrize(
    "fields", [{"sigma": "0 nT"}, {"sigma": "1 m"}, {"hard_iron": "-1 nT"}, {"soft_iron": "-1 percent"}]
)
def test_what_makes_no_sense_is_refused(fields):
    with pytest.raises(ValueError, match=next(iter(fields))):
        card(**fields)


@pytest.mark.parametrize("degree", [0, 14])
def test_a_degree_that_the_model_has_not_is_refused(degree):
    with pytest.raises(ValueError, match="degree"):
        card().model.model_validate({"sigma": "1 nT", "degree": degree})
