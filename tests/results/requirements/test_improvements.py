"""Linear covariance's distribution and verdict, and the source that would turn it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from lvnav_trade.quantities.records import INJECTION
from lvnav_trade.results.evaluation.covariances import why_not_applicable
from lvnav_trade.results.metric import NO_LAW
from lvnav_trade.results.registry import metric_of
from lvnav_trade.results.requirements.improvements import (
    ABOVE_ONLY,
    RequirementCase,
    _improvement,
    evaluate_stored_requirement,
    improvements,
    lincov_verdicts,
)
from lvnav_trade.results.statistics.probability import norm_probability, norm_quantile
from lvnav_trade.results.tables.read import load
from tests import synthetic
from tests.injections import law

AT_END = 1.0 + 0.01 * 99.5  # growth of the sigmas of the fine unit at injection


def test_the_expected_probability_is_that_of_the_gaussian_of_the_case(good):
    row = lincov_verdicts(good).set_index(["requirement", "case"]).loc["tight bound", "imu=fine"]
    sigma, mean = AT_END * synthetic.SIGMA[6:9], AT_END * synthetic.MEAN[6:9]
    assert row.expected_probability == pytest.approx(norm_probability(mean, np.diag(sigma**2), 4.0), abs=1e-9)
    assert row.verdict == "violated"
    assert (row.limit, row.unit) == (pytest.approx(4.0), "m")


def test_a_lever_meets_the_requirement_exactly(tmp_path):
    """The limit is the quantile of the error with the larger source at 0.4 of its sigma: the factor must be 0.4."""
    sigma, mean = AT_END * synthetic.SIGMA[6:9], AT_END * synthetic.MEAN[6:9]
    limit = norm_quantile(mean, np.diag(sigma**2) * (0.25 + 0.75 * 0.4**2), 0.9)
    campaign = synthetic.CAMPAIGN.replace("below: 4.0 m,", f"below: {limit!r} m,")
    tables = load(synthetic.results(tmp_path, n_run=80, campaign=campaign))
    found = improvements(tables).set_index(["requirement", "case"])
    row = found.loc["tight bound", "imu=fine"]
    assert row.source == "gyro bias"
    assert row.factor_ratio == pytest.approx(0.4, abs=2e-4)
    assert row.share_ratio == pytest.approx(0.75 * (sigma @ sigma) / (sigma @ sigma + mean @ mean), rel=1e-9)
    worse = found.loc["tight bound", "imu=coarse"]
    assert (worse.source, worse.remark) != ("gyro bias", "")


def test_where_nothing_need_be_better_it_says_so(good):
    row = improvements(good).set_index(["requirement", "case"]).loc["rare", "imu=fine"]
    assert row.verdict == "undecided"
    assert row.remark == "linear covariance expects it to be met as it is"


def test_a_gate_that_rejects_too_much_takes_the_verdict_away(tmp_path):
    tables = load(synthetic.results(tmp_path, n_run=0, rejects=0.03))
    assert why_not_applicable(tables, "aaaaaaaaaaaa")
    assert why_not_applicable(tables, "aaaaaaaaaaaa") == "the gate rejects 3 % of good rows at 51 s"
    assert set(lincov_verdicts(tables).verdict) == {"not applicable"}
    assert improvements(tables).empty


def test_where_no_realistic_factor_would_do_it_says_so(good):
    row = improvements(good).set_index(["requirement", "case"]).loc["tight bound", "imu=coarse"]
    assert row.source == ""
    assert row.remark == "not even all error sources together, each times 0.05, would do"


FINE = "aaaaaaaaaaaa"
BOUND = {"name": "x", "metric": "position_error_3d", "probability": 0.9, "below": "4 m"}


def stated(tmp_path, *requirements, n_run=80):
    head, _, tail = synthetic.CAMPAIGN.partition("requirements:")
    lines = "".join(f"  - {item}\n" for item in requirements)
    campaign = f"{head}requirements:\n{lines}references:{tail.partition('references:')[2]}"
    return load(synthetic.results(tmp_path, n_run=n_run, campaign=campaign))


def test_at_an_event_it_is_the_gaussian_of_the_event(good):
    found = evaluate_stored_requirement(good, BOUND | {"at": "stage1_cutoff"}, FINE)
    np.testing.assert_allclose(found.distribution.law.covariance, np.diag((1.4 * synthetic.SIGMA[6:9]) ** 2))
    np.testing.assert_allclose(found.distribution.law.mean, 1.4 * synthetic.MEAN[6:9])
    assert (found.bound, found.unit, found.distribution.is_upper_limit) == (4.0, "m", False)


def test_over_a_phase_it_is_that_of_the_worst_event(good):
    found = evaluate_stored_requirement(good, BOUND | {"during": "liftoff to injection"}, FINE)
    assert (found.distribution.event_or_time, found.distribution.is_upper_limit) == ("injection", True)
    np.testing.assert_array_equal(
        found.distribution.law.covariance, evaluate_stored_requirement(good, BOUND, FINE).distribution.law.covariance
    )
    assert (
        evaluate_stored_requirement(good, BOUND | {"during": "start to stage1_cutoff"}, FINE).distribution.event_or_time
        == "stage1 cutoff"
    )


def test_one_axis_is_looked_at_at_every_time(good):
    found = evaluate_stored_requirement(
        good, BOUND | {"metric": "position_error_north", "during": "liftoff to injection"}, FINE
    )
    assert found.distribution.event_or_time == "injection"
    between = evaluate_stored_requirement(
        good, BOUND | {"metric": "position_error_north", "during": "start to end"}, FINE
    )
    assert between.distribution.law.covariance[0, 0] >= found.distribution.law.covariance[0, 0]


def test_the_probability_at_the_worst_moment_bounds_that_of_the_phase(good):
    """2,000 Gaussian histories whose errors are new at every time: none of them may keep a bound more often."""
    cov = synthetic.covariance()
    within = cov.t >= 0.0
    rng = np.random.default_rng(1)
    drawn = cov.mean[within, 6:9] + cov.true_sigma[within, 6:9] * rng.standard_normal((2000, within.sum(), 3))
    worst = np.linalg.norm(drawn, axis=2).max(axis=1)
    for bound in (20.0, 40.0, 60.0):
        found = evaluate_stored_requirement(good, BOUND | {"below": f"{bound} m", "during": "flight"}, FINE)
        kept = norm_probability(found.distribution.law.mean, found.distribution.law.covariance, bound)
        assert np.mean(worst < bound) <= kept + 3.0 * np.sqrt(kept * (1.0 - kept) / 2000) + 1e-12


def test_a_phase_is_violated_or_not_applicable_by_linear_covariance_never_met(tmp_path):
    tables = stated(
        tmp_path,
        "{name: tight, metric: position_error_3d, during: liftoff to injection, probability: 0.9, below: 4 m}",
        "{name: loose, metric: position_error_3d, during: flight, probability: 0.9, below: 200 m}",
    )
    found = lincov_verdicts(tables).set_index(["requirement", "case"])
    assert tuple(found.loc[("tight", "imu=fine"), ["verdict", "reason"]]) == ("violated", "already at injection")
    assert tuple(found.loc[("loose", "imu=fine"), ["verdict", "reason"]]) == ("not applicable", ABOVE_ONLY)
    better = improvements(tables).set_index(["requirement", "case"])
    assert better.loc[("tight", "imu=coarse"), "remark"].endswith(
        "would do; to keep it at injection; the whole phase may take more"
    )
    assert ("loose", "imu=fine") not in better.index or better.loc[("loose", "imu=fine"), "remark"] == ABOVE_ONLY


def test_numbers_of_the_mission_are_asked_of_position_and_velocity_together(good):
    impact = evaluate_stored_requirement(
        good, {"name": "x", "metric": "impact_error", "probability": 0.9, "below": "1 km"}, FINE
    )
    assert (impact.distribution.law.mean.shape, impact.bound, impact.unit) == ((2,), 1000.0, "km")
    perigee = {"name": "x", "metric": "perigee_error", "probability": 0.9, "below": "1 km"}
    assert evaluate_stored_requirement(good, perigee, FINE) == "no closed orbit"


def test_an_error_that_is_not_held_is_said_so(good):
    assert evaluate_stored_requirement(good, BOUND | {"metric": "heading_error_3d"}, FINE) == NO_LAW
    assert evaluate_stored_requirement(good, BOUND | {"at": "kick"}, FINE) == NO_LAW
    assert evaluate_stored_requirement(good, BOUND | {"during": "kick to injection"}, FINE) == NO_LAW


def test_one_component_is_the_normal_law(good):
    found = evaluate_stored_requirement(good, BOUND | {"metric": "position_error_north"}, FINE)
    sigma = 1.995 * synthetic.SIGMA[6]
    expected_kept = stats.norm.cdf(4.0 / sigma) - stats.norm.cdf(-4.0 / sigma)
    assert norm_probability(found.distribution.law.mean, found.distribution.law.covariance, 4.0) == pytest.approx(
        expected_kept, abs=1e-12
    )


CIRCULAR = {"eccentricity_along_node": 0.0, "eccentricity_ahead_of_node": 0.0}


def perigee(below):
    """A requirement on the perigee of a circular orbit, whose error is not Gaussian, and the law it follows."""
    injection = law()
    target = injection.target.copy()
    for name, value in CIRCULAR.items():
        target[INJECTION.index(name)] = value
    injection = injection._replace(target=target)
    distribution = metric_of("injection_perigee_error").injection_distribution(injection)
    assert distribution.redraw is not None
    return RequirementCase(distribution, below, 0.9), injection


def test_the_improvement_of_a_perigee_near_a_circular_orbit_is_that_of_independent_draws():
    wide, injection = perigee(np.inf)
    found = wide._replace(bound=0.8 * wide.quantile(0.9))
    source, factor, share, remark = _improvement(found)
    assert remark == ""
    assert 0.05 < factor < 1.0
    assert found.success_probability((source,), factor) == pytest.approx(0.9, abs=2e-3)

    def kept(factor_of):
        at = [INJECTION.index(name) for name in ("semi_major_axis", *CIRCULAR)]
        covariance = sum(
            factor_of.get(name, 1.0) ** 2 * part[np.ix_(at, at)]
            for name, part in zip(injection.sources, injection.covariance, strict=True)
        )
        rng = np.random.default_rng(4)
        a, h, k = (injection.target[at] + rng.multivariate_normal(injection.mean[at], covariance, 400_000)).T
        error = a * (1.0 - np.hypot(h, k)) - injection.target[at[0]]
        return float(np.mean(np.abs(error) < found.bound)), float(np.mean(error**2))

    assert kept({source: factor})[0] == pytest.approx(0.9, abs=4e-3)
    assert share == pytest.approx(1.0 - kept({source: 0.0})[1] / kept({})[1], abs=0.02)


def test_shares_of_a_gaussian_add_up_to_the_part_of_its_covariance(good):
    found = evaluate_stored_requirement(good, good.campaign["requirements"][0], next(iter(good.labels)))
    if isinstance(found, str):
        pytest.fail(found)
    law_of = found.distribution.law
    total = np.trace(law_of.covariance) + law_of.mean @ law_of.mean
    assert sum(found.shares().values()) == pytest.approx(np.trace(law_of.covariance) / total)
