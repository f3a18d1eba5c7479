"""The star tracker: what it measures, the innovation that a filter makes of it, and when it is blind."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.kernels.attitude import from_rotation, multiply
from lvnav_trade.kernels.earth import SEMI_MAJOR
from lvnav_trade.kernels.strapdown import N_NAV, Q
from lvnav_trade.quantities.frames import matrices, unit
from lvnav_trade.sensors.jacobian_row import H_ATT, N_ENTRY
from lvnav_trade.sensors.optics import boresight_quaternion, sun_direction
from lvnav_trade.sensors.sensor import FlightView
from lvnav_trade.sensors.star_tracker import StarTrackerCard, StarTrackerModel, fill, measure

TRUE = np.array([0.8, 0.1, -0.5, 0.3]) / np.linalg.norm([0.8, 0.1, -0.5, 0.3])
BORESIGHT = (1.0, 2.0, -2.0)
DATA = {"name": "a", "source": "b", "kind": "star_tracker", "boresight": BORESIGHT, "across": "5 arcsec",
        "about": "50 arcsec"}  # fmt: skip
EPOCH = "2024-06-20T20:51:00Z"


def card(**fields):
    return StarTrackerCard.model_validate({**DATA, **fields})


def view(q_b_i=TRUE, r_i=(SEMI_MAJOR + 4e5, 0.0, 0.0), rate=(0.0, 0.0, 0.0)):
    """A flight of one epoch, 400 km over the equator."""
    one = np.zeros(1)
    height = np.array([np.linalg.norm(r_i) - SEMI_MAJOR])
    return FlightView(one, np.array([r_i]), np.zeros((1, 3)), np.array([q_b_i]), height, one, np.array([rate]), EPOCH)


def looking(direction, **place):
    """An attitude at which the boresight points in a direction of frame i, 400 km over the equator or elsewhere."""
    return view(multiply(*boresight_quaternion(tuple(direction)), *conjugate(boresight_quaternion(BORESIGHT))), **place)


def conjugate(q):
    return np.asarray(q) * [1.0, -1.0, -1.0, -1.0]


def rows(errors, estimate=TRUE):
    """Jacobian rows (3, n) and innovations (3,) of a measurement with errors about the tracker's axes."""
    observed = np.zeros(4)
    measure(observed, card().truth(view())[0], *errors)
    H, z, nav = np.full((4, N_ENTRY), np.nan), np.full(4, np.nan), np.zeros(N_NAV)
    nav[Q : Q + 4] = estimate
    known = np.pad(card().matched_model().filter_parameters(view())[0], (0, 12))
    fill(H, z, 1, observed, nav, known)
    assert np.isnan(H[0]).all()
    return H[1:], z[1:]


def test_without_error_the_innovation_is_zero_and_noise_is_about_its_own_axes():
    np.testing.assert_allclose(rows((0.0, 0.0, 0.0))[1], 0.0, atol=1e-15)
    errors = np.array([1e-4, -2e-4, 5e-4])
    np.testing.assert_allclose(rows(errors)[1], errors, rtol=1e-6)


def test_the_innovation_is_the_attitude_error_in_axes_of_the_tracker_and_the_row_is_its_derivative():
    C_s_i = matrices(card().truth(view()))[0]
    H, _ = rows((0.0, 0.0, 0.0))
    np.testing.assert_allclose(H[:, H_ATT : H_ATT + 3], C_s_i.T, atol=1e-14)
    assert np.count_nonzero(np.delete(H, range(H_ATT, H_ATT + 3), axis=1)) == 0
    for axis in range(3):
        step = 1e-5 * np.eye(3)[axis]
        high, low = (rows((0.0, 0.0, 0.0), multiply(*from_rotation(*(-s * step)), *TRUE))[1] for s in (1.0, -1.0))
        np.testing.assert_allclose((high - low) / 2e-5, H[:, H_ATT + axis], atol=1e-9)


def test_noise_is_across_and_about_the_boresight_in_truth_and_in_the_matched_model():
    one = card(low_frequency="2 arcsec", low_frequency_time="60 s")
    arcsec = math.pi / 648000.0
    np.testing.assert_allclose(one.noise_sigma(view()), arcsec * np.array([[5.0, 5.0, 50.0]]))
    np.testing.assert_allclose(one.matched_model().variance(view()), (arcsec * np.array([[5.0, 5.0, 50.0]])) ** 2)
    constant, slow = one.correlated_errors()
    assert (constant.sigma, constant.time_constant) == (0.0, math.inf)
    assert (slow.sigma, slow.time_constant) == (pytest.approx(2.0 * arcsec), 60.0)
    np.testing.assert_array_equal(slow.partials(view(), 3)[0], np.eye(3))
    assert one.matched_model().time_constant("low_frequency") == 60.0
    assert one.matched_model().time_constant("misalignment") == math.inf


def test_the_sun_blinds_it_within_its_angle_unless_the_earth_hides_it():
    sun = sun_direction(EPOCH, np.zeros(1), np.zeros(1))[0]
    side = unit(np.cross(sun, [0.3, 0.5, 0.9]))
    for off, expected in ((0.0, False), (29.9, False), (30.1, True), (150.0, True)):
        direction = np.cos(np.radians(off)) * sun + np.sin(np.radians(off)) * side
        at = looking(direction, r_i=(SEMI_MAJOR + 4e5) * side)
        assert card(sun_exclusion="30 deg").is_available(at).tolist() == [expected]
        assert card().is_available(at).all()
    behind = looking(sun, r_i=-(SEMI_MAJOR + 4e5) * sun)
    assert card(sun_exclusion="30 deg").is_available(behind).all()


def test_the_limb_of_the_earth_is_where_its_edge_is_seen():
    limb = math.degrees(math.asin(SEMI_MAJOR / (SEMI_MAJOR + 4e5)))  # 70 deg off the nadir at 400 km
    for off, expected in ((0.0, False), (limb + 19.9, False), (limb + 20.1, True), (180.0, True)):
        at = looking((-math.cos(math.radians(off)), 0.0, math.sin(math.radians(off))))
        assert card(limb_exclusion="20 deg").is_available(at).tolist() == [expected]


def test_it_has_no_solution_while_the_body_turns_too_fast():
    for rate, expected in ((1.9, True), (2.1, False)):
        turning = view(rate=np.radians(rate) * unit(np.array([1.0, 1.0, 1.0])))
        assert card(highest_rate="2 deg/s").is_available(turning).tolist() == [expected]


@pytest.mark.parametrize(
    ("fields", "reported"),
    [
        ({"across": "0 arcsec"}, "across"),
        ({"about": "1 m"}, "about"),
        ({"boresight": (0.0, 0.0, 0.0)}, "no direction"),
        ({"sun_exclusion": "200 deg"}, "sun_exclusion"),
        ({"highest_rate": "0 deg/s"}, "highest_rate"),
        ({"latency": "-1 s"}, "latency"),
    ],
)
def test_what_makes_no_sense_is_refused(fields, reported):
    with pytest.raises(ValueError, match=reported):
        card(**fields)


def test_a_filter_has_its_own_idea_of_the_mounting():
    other = StarTrackerModel.model_validate({"across": "1 arcsec", "about": "1 arcsec", "boresight": (0.0, 0.0, 1.0)})
    np.testing.assert_allclose(other.filter_parameters(view())[0], boresight_quaternion((0.0, 0.0, 1.0)))
    assert np.abs(other.filter_parameters(view())[0] - boresight_quaternion(BORESIGHT)).max() > 0.1
