"""Polygons of a corridor against closed forms and draws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtr

from lvnav_trade.quantities.frames import ecef_from_geodetic
from lvnav_trade.results.mission.corridor import contains, corridor_of, metres, probability, unwrapped_longitude
from lvnav_trade.results.tables.read import load
from tests import synthetic

SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
HOOK = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [3.0, 3.0], [3.0, 1.0], [0.0, 1.0]])  # not convex


@pytest.mark.parametrize("turned", [1, -1], ids=["counter-clockwise", "clockwise"])
def test_a_rectangle_holds_the_product_of_two_intervals(turned):
    mean, sigma = np.array([0.3, -0.2]), np.array([0.5, 0.8])
    sides = [ndtr((1.0 - m) / s) - ndtr((-1.0 - m) / s) for m, s in zip(mean, sigma, strict=True)]
    found, margin = probability(SQUARE[::turned], mean, np.diag(sigma**2))
    assert found == pytest.approx(sides[0] * sides[1], abs=1e-14)
    assert margin == pytest.approx(0.8 / 0.8)  # the lower edge of the second axis, or 0.7 / 0.5 = 1.4 of the first


def test_a_far_tail_is_resolved():
    found, margin = probability(100.0 * SQUARE, [0.0, 0.0], np.diag([20.0**2, 1.0]))
    assert 1.0 - found == pytest.approx(2.0 * ndtr(-5.0), rel=1e-6)
    assert margin == pytest.approx(5.0)


def test_a_polygon_that_is_not_convex_agrees_with_draws():
    mean, covariance = np.array([2.5, 0.8]), np.array([[0.9, 0.4], [0.4, 0.6]])
    drawn = np.random.default_rng(2).multivariate_normal(mean, covariance, 400_000)
    found, margin = probability(HOOK, mean, covariance)
    assert found == pytest.approx(contains(HOOK, drawn).mean(), abs=4e-3)
    assert margin > 0.0


def test_outside_the_margin_is_negative_and_the_probability_small():
    found, margin = probability(SQUARE, [0.0, 4.0], np.eye(2))
    assert margin == pytest.approx(-3.0)
    inside = (ndtr(1.0) - ndtr(-1.0)) * (ndtr(-3.0) - ndtr(-5.0))
    assert found == pytest.approx(inside, rel=1e-9)


@pytest.mark.parametrize(("point", "part"), [((1.0, 0.0), 0.5), ((1.0, 1.0), 0.25), ((0.0, 0.0), 1.0)])
def test_on_an_edge_half_is_inside_and_on_a_corner_a_quarter(point, part):
    assert probability(SQUARE, point, 1e-6 * np.eye(2))[0] == pytest.approx(part, abs=1e-12)


def test_points_are_inside_or_not():
    assert contains(HOOK, [[3.5, 2.0], [1.0, 2.0], [1.0, 0.5], [5.0, 0.5]]).tolist() == [True, False, True, False]


def test_metres_per_radian_are_those_of_the_ellipsoid():
    latitude, step = np.radians(50.0), 1e-6
    here = ecef_from_geodetic(latitude, 0.2, 0.0)
    north = np.linalg.norm(ecef_from_geodetic(latitude + step, 0.2, 0.0) - here) / step
    east = np.linalg.norm(ecef_from_geodetic(latitude, 0.2 + step, 0.0) - here) / step
    np.testing.assert_allclose(metres(latitude), [north, east], rtol=1e-6)


def test_a_corridor_across_the_date_line_is_one_piece(tmp_path):
    card = "corridor: {polygon: [['10 deg', '170 deg'], ['20 deg', '-175 deg'], ['10 deg', '-170 deg']]}\n"
    tables = load(synthetic.results(tmp_path, n_run=0, campaign=synthetic.CAMPAIGN + card))
    corridor = corridor_of(tables)
    np.testing.assert_allclose(np.degrees(corridor.corners[:, 1]), [170.0, 185.0, 190.0])
    assert np.degrees(unwrapped_longitude(np.radians(-178.0), corridor.corners)) == pytest.approx(182.0)
    assert (corridor.probability, corridor.confidence) == (0.999, 0.9)


def test_a_campaign_need_not_have_a_corridor(alone):
    assert corridor_of(alone) is None
