"""The table of the orbit says what the flight is, its errors what was drawn, and what a correction costs."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.earth import SEMI_MAJOR
from lvnav_trade.quantities.frames import state_from_elements
from lvnav_trade.results.evaluate import errors_at
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.mechanics import orbits
from lvnav_trade.results.metrics.mission import magnitude_sample_at, mean_and_covariance_at
from lvnav_trade.results.mission.orbit import QUANTITIES, mardia, orbital_states
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.statistics.probability import norm_quantile
from lvnav_trade.results.tables.read import load
from tests import mission as flights
from tests import synthetic
from tests.mission import CASE


@pytest.fixture(scope="module")
def reached(tmp_path_factory):
    return load(flights.results(tmp_path_factory.mktemp("orbit"), failing=(3,)))


def at_injection(tables):
    frame = METRICS["orbit"](tables)
    return frame[frame.event == "injection"].set_index("quantity")


def test_the_orbit_is_reported_osculating_and_averaged_in_units_of_people(reached):
    found = at_injection(reached)
    assert found.loc["semi-major axis", "osculating"] == pytest.approx(6900.0, abs=1e-3)
    assert found.loc["perigee height", "osculating"] == pytest.approx((6.9e6 * 0.988 - SEMI_MAJOR) / 1e3, abs=1e-2)
    assert found.loc["inclination", "osculating"] == pytest.approx(97.5, abs=1e-5)
    mean = orbits.mean(*state_from_elements(flights.SUN_SYNCHRONOUS))
    assert found.loc["apogee height", "averaged"] == pytest.approx(float(mean.apogee) / 1e3, abs=1e-2)
    vector = found.loc[["eccentricity along the node", "eccentricity ahead of the node"], "averaged"]
    assert np.hypot(*vector) == pytest.approx(found.loc["eccentricity", "averaged"], rel=1e-9)


def test_what_was_drawn_has_the_sigma_that_linear_covariance_says(reached):
    found = at_injection(reached).loc[list(QUANTITIES)]
    assert set(found.runs) == {199}
    np.testing.assert_allclose(found.mc_sigma / found.lincov_sigma, 1.0, atol=4.0 / np.sqrt(2.0 * 199))
    np.testing.assert_allclose((found.mc_bias - found.lincov_bias) / found.lincov_sigma, 0.0, atol=4.0 / np.sqrt(199))
    np.testing.assert_allclose(found.filter_sigma, found.lincov_sigma, rtol=1e-9)
    assert (found.remark == "").all()


def test_lowest_and_highest_height_enclose_the_averaged_perigee_and_apogee_within_the_swing(reached):
    found = at_injection(reached).averaged
    assert abs(found["lowest height"] - found["perigee height"]) < 10.0
    assert abs(found["highest height"] - found["apogee height"]) < 10.0


def test_a_circular_orbit_has_quantiles_but_no_sigma_of_perigee(tmp_path):
    found = at_injection(load(flights.results(tmp_path, flights.CIRCULAR, n_run=0, factor=40.0)))
    row = found.loc["perigee height"]
    assert np.isnan(row.lincov_sigma)
    assert row.lincov_q99 > 1.0
    assert row.remark.startswith("the orbit is circular to within 3 sigma")
    assert found.loc["eccentricity along the node", "lincov_sigma"] > 0.0


def test_a_flight_that_falls_back_has_no_row(good):
    assert METRICS["orbit"](good).empty
    assert orbital_states(good, "aaaaaaaaaaaa") == []


@pytest.fixture(scope="module")
def reported(tmp_path_factory):
    tables = load(flights.results(tmp_path_factory.mktemp("cost"), failing=(3,)))
    return tables, METRICS["orbit_correction"](tables).set_index("by")


def test_runs_and_linear_covariance_agree_on_the_quantiles(reported):
    _, found = reported
    runs, lincov = found.loc["Monte Carlo"], found.loc["linear covariance"]
    assert runs.draw_count == 199
    assert runs.q50 == pytest.approx(lincov.q50, rel=0.15)
    assert runs.q95 == pytest.approx(lincov.q95, rel=0.15)
    assert lincov.q50 < lincov.q95 < lincov.q99


def test_the_quantiles_are_those_of_the_runs_errors(reported):
    tables, found = reported
    size = errors_at(tables, flights.CASE, "injection", "correction_delta_v").magnitude
    assert found.loc["Monte Carlo", "q99"] == pytest.approx(np.quantile(size[np.isfinite(size)], 0.99), rel=1e-12)


def test_the_parts_stand_beside_the_whole(reported):
    """A norm is at most the sum of its parts', draw by draw; here velocity makes nearly all of it."""
    _, found = reported
    assert (found.velocity_q99 > 0.9 * found.q99).all()
    assert (found.position_q99 < 0.2 * found.q99).all()


def test_a_flight_that_falls_back_has_no_correction(good):
    assert METRICS["orbit_correction"](good).empty


ROUND = """\
requirements:
  - {{name: perigee, metric: perigee_error, at: injection, probability: {p}, below: {below} km, confidence: 0.9}}
"""


def test_the_perigee_of_a_circular_orbit_gets_a_verdict_by_draws_and_runs_agree(tmp_path):
    """The quantile is that of the runs' own Gaussian through the map: both engines say the same of |perigee error|."""
    head = synthetic.CAMPAIGN.partition("requirements:")[0]
    campaign = head + ROUND.format(p=0.9, below=1.0)
    tables = load(flights.results(tmp_path, flights.CIRCULAR, n_run=400, factor=40.0, campaign=campaign))
    assert at_injection(tables).loc["perigee height", "remark"] != ""
    row = METRICS["expected_verdicts"](tables).iloc[0]
    assert row.verdict in ("met", "violated")
    runs = METRICS["requirements"](tables).iloc[0]
    assert row.estimate == pytest.approx(runs.estimate, rel=0.1)
    part = 1.0 - runs.failures / runs.runs
    assert row.expected_probability == pytest.approx(part, abs=3.0 * np.sqrt(part * (1.0 - part) / 400) + 1e-3)


def test_far_from_circular_draws_give_the_quantile_of_the_first_order(reached):
    """Where the perigee is linear in the error, the draws reproduce the Gaussian quantile."""
    drawn = magnitude_sample_at(CaseTables(reached, CASE), "injection", "perigee_error")
    mean, covariance = mean_and_covariance_at(CaseTables(reached, CASE), "injection", "perigee_error")
    for probability in (0.9, 0.9973):
        assert np.quantile(drawn, probability) == pytest.approx(norm_quantile(mean, covariance, probability), rel=0.02)
    assert magnitude_sample_at(CaseTables(reached, CASE), "injection", "correction_delta_v") is None


def test_elements_of_an_ellipse_are_gaussian_and_the_perigee_of_a_circle_is_not(reached, tmp_path):
    """The perigee of a circular orbit is below it whatever the error: its distribution is skewed."""
    found = METRICS["normality"](reached)
    assert set(found.event) == {"injection"}
    assert found.gaussian.all()
    assert found.skewness.abs().max() < 0.6
    circle = METRICS["normality"](load(flights.results(tmp_path, flights.CIRCULAR, factor=40.0))).set_index("quantity")
    assert not circle.gaussian["perigee height"]
    assert abs(circle.skewness["perigee height"]) > 0.4
    assert circle.gaussian["inclination"]
    assert METRICS["normality"](load(flights.results(tmp_path / "few", n_run=19))).empty


def test_a_pair_of_elements_that_depend_on_each_other_is_no_gaussian_vector():
    """Chance of a Gaussian pair is uniform, that of a banana negligible although each marginal may look Gaussian."""
    draw = np.random.default_rng(3)
    chances = [mardia(draw.standard_normal((200, 2)) @ np.array([[1.0, 0.5], [0.0, 2.0]]))[2] for _ in range(400)]
    assert np.mean(np.array(chances) < 0.05) == pytest.approx(0.05, abs=0.03)
    x, y = draw.standard_normal((2, 200))
    assert mardia(np.stack([x, y + 0.5 * x**2], axis=1))[2] < 1e-6
