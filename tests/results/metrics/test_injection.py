"""Metrics of the injection of guided runs: by tables and by arrays, with known numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

from lvnav_trade.campaign.reading.load import load as load_campaign
from lvnav_trade.campaign.running.case_arrays import CaseArrays
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import INJECTION, ORBIT
from lvnav_trade.results.mission.injection_accuracy import _expected_end
from lvnav_trade.results.registry import metric_of
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.tables.read import load
from lvnav_trade.simulation.statistics import summarise
from tests import synthetic
from tests.injections import SIZES, SOURCES, law, rows, with_injections

CASE = synthetic.CASES[0][0].id
ROOT = Path(__file__).parents[3]


class PreparedCase:
    """What `CaseArrays` reads of a prepared case."""

    outputs = synthetic.OUTPUTS


@pytest.fixture(scope="module")
def guided(tmp_path_factory):
    return with_injections(load(synthetic.results(tmp_path_factory.mktemp("guided"), n_run=8, size=8)))


@pytest.mark.parametrize(("metric", "unit", "factor"), [
    ("injection_perigee_error", "km", 1e-3),
    ("injection_inclination_error", "rad", 1.0),
])  # fmt: skip
def test_a_run_that_is_not_injected_has_an_infinite_error(guided, metric, unit, factor):
    found = metric_of(metric).errors(CaseTables(guided, CASE), {"metric": metric, "at": "injection"})
    quantity = metric.removeprefix("injection_").removesuffix("_error")
    wanted = CaseTables(guided, CASE).injections(quantity)
    np.testing.assert_allclose(found.magnitude[:6], np.abs(wanted.error[:6]))
    assert np.all(np.isinf(found.magnitude[6:]))
    assert metric_of(metric).value(guided, CASE, {"metric": metric}, unit).monte_carlo == np.inf


def test_the_eccentricity_vector_is_the_length_of_both_parts(guided):
    metric = metric_of("injection_eccentricity_vector_error")
    case = CaseTables(guided, CASE)
    parts = [case.injections(name).error for name in ("eccentricity_along_node", "eccentricity_ahead_of_node")]
    np.testing.assert_allclose(metric.errors(case, {}).magnitude[:6], np.hypot(*parts)[:6])
    assert metric.bound_type == "norm"


def test_depletion_cutoff_and_propellant(guided):
    share = metric_of("depletion").value(guided, CASE, {}, "-")
    assert share.monte_carlo == pytest.approx(1.0 / 8.0)
    np.testing.assert_array_equal(
        metric_of("depletion").errors(CaseTables(guided, CASE), {}).magnitude, [0.0] * 6 + [1.0, np.inf]
    )
    assert metric_of("cutoff_time").value(guided, CASE, {}, "s").monte_carlo == pytest.approx(
        np.mean(500.0 + np.arange(6))
    )
    left = metric_of("propellant_left").value(guided, CASE, {}, "kg")
    assert left.monte_carlo == pytest.approx(np.mean(10.0 * np.arange(6)))


def test_the_law_of_a_number_is_its_gaussian_with_every_source(guided):
    found = metric_of("injection_inclination_error").distribution(CaseTables(guided, CASE), {})
    k = ORBIT.index("inclination")
    assert found.law.mean == pytest.approx([0.1 * SIZES[k]])
    assert found.law.covariance[0, 0] == pytest.approx(sum(share**2 for share in SOURCES.values()) * SIZES[k] ** 2)
    assert found.law.sources["thrust"][0, 0] == pytest.approx(SIZES[k] ** 2)
    vector = metric_of("injection_eccentricity_vector_error").distribution(CaseTables(guided, CASE), {})
    assert vector.law.covariance.shape == (2, 2)


@pytest.mark.parametrize(("changes", "reason"), [
    ({"reason": "no reference flight"}, "no reference flight"),
    ({"mean": np.append(np.zeros(7), [503.0, 8.0])}, "empty stage"),
    ({"second_order": np.full(9, 1e4)}, "second order"),
])  # fmt: skip
def test_linear_covariance_says_why_it_does_not_hold(changes, reason):
    case = CaseArrays(PreparedCase(), synthetic.covariance()._replace(injection=law(**changes)))
    for name in ("injection_inclination_error", "injection_perigee_error", "depletion", "extra_propellant"):
        assert reason in metric_of(name).distribution(case, {})


def test_depletion_and_propellant_by_linear_covariance(guided):
    case, share = CaseTables(guided, CASE), np.linalg.norm(list(SOURCES.values()))
    wanted = norm.sf(60.0 / (5.0 * share))
    assert metric_of("depletion").value(guided, CASE, {}, "-").true == pytest.approx(wanted)
    assert metric_of("depletion").distribution(case, {}).sample.mean() == pytest.approx(wanted, abs=1.0 / 2**15)
    extra = metric_of("extra_propellant").distribution(case, {}).sample
    assert np.quantile(extra, 0.9987) == pytest.approx(norm.ppf(0.9987) * 5.0 * share, rel=0.01)
    assert np.mean(extra == 0.0) == pytest.approx(0.5, abs=1e-3)
    flown = metric_of("extra_propellant").errors(case, {}).magnitude
    np.testing.assert_allclose(flown[:6], 60.0 - 10.0 * np.arange(6))
    assert np.all(np.isinf(flown[6:]))
    assert metric_of("cutoff_time").value(guided, CASE, {}, "s").true == pytest.approx(503.0)


def test_without_guidance_there_is_no_number(tmp_path):
    plain = load(synthetic.results(tmp_path / "plain", n_run=4, size=4))
    assert metric_of("injection_apogee_error").errors(CaseTables(plain, CASE), {}) is None
    assert "guidance" in metric_of("cutoff_time").value(plain, CASE, {}, "s").remark


def test_arrays_and_tables_have_the_same_runs(guided):
    cov = synthetic.covariance()
    block = synthetic.block(cov, 0, 8)._replace(injections=rows())
    summary = summarise(block, synthetic.EVENTS, cov.true_sigma, synthetic.OUTPUTS)

    mine = CaseArrays(PreparedCase(), cov, summary).injections("apogee")
    stored = CaseTables(guided, CASE).injections("apogee")
    for one, other in zip(mine, stored, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_requirement_on_the_injection_asks_for_a_guided_ascent(tmp_path):
    campaign = tmp_path / "campaign.yaml"
    stated = "metric: injection_perigee_error, at: injection, probability: 0.9, below: 15 km"
    text = (ROOT / "campaigns/smoke.yaml").read_text().partition("requirements:")[0]
    text += f"requirements: [{{name: a, {stated}}}]\n"
    campaign.write_text(text)
    with pytest.raises(InputError, match=r"no ascent is guided: give trajectory\.guidance"):
        load_campaign(campaign)
    load_campaign(campaign, sets=("axes=[{path: trajectory.guidance, values: [nominal, explicit]}]",))
    load_campaign(campaign, sets=("base.trajectory.guidance=explicit", "monte_carlo=null"))


def test_no_window_is_sought_around_a_number_of_the_cut_off():
    assert metric_of("injection_perigee_error").has_single_value
    assert metric_of("depletion").has_single_value
    assert not metric_of("perigee_error").has_single_value


def test_the_end_of_a_flight_is_not_told_where_linear_covariance_does_not_hold():
    order = np.zeros(9)
    order[INJECTION.index("propellant_left")] = 1e4
    end = _expected_end(law(second_order=order))
    assert set(end) == {"lincov_depleted_ratio", "lincov_cutoff_s", "lincov_cutoff_sigma_s"}
    assert end["lincov_cutoff_s"] == 503.0
    assert np.isfinite(list(end.values())).all()
