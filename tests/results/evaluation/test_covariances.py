"""The Gaussian that linear covariance says of an error, and where it says nothing."""

from __future__ import annotations

import copy
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.covariances import (
    agreement,
    by_case,
    contributions,
    is_position_bias,
    nonlinearity,
    observability,
    observability_ranks,
    sensitivity,
    why_not_applicable,
)
from lvnav_trade.results.statistics.gaussian import gaussian
from lvnav_trade.results.tables.read import load
from tests import synthetic
from tests.vehicle_tables import tables

AT_END = 1.0 + 0.01 * 99.5  # growth of the sigmas of the fine unit at injection


def test_a_norm_has_three_components_and_an_axis_one(good):
    case = next(iter(good.labels))
    assert gaussian(good, case, "injection", "velocity", "3d").covariance.shape == (3, 3)
    roll = gaussian(good, case, "injection", "attitude", "roll")
    np.testing.assert_allclose(roll.covariance, [[(AT_END * 1e-3) ** 2]], rtol=1e-12)
    assert gaussian(good, case, "injection", "velocity", "radial") is None


def test_the_sources_sum_to_the_whole(good):
    found = gaussian(good, next(iter(good.labels)), "injection", "position", "3d")
    np.testing.assert_allclose(sum(found.sources.values()), found.covariance, rtol=1e-12)


def test_a_case_without_a_gate_is_described_everywhere(good):
    assert why_not_applicable(good, next(iter(good.labels))) == ""


def test_the_mean_error_belongs_to_the_gaussian(good):
    found = gaussian(good, next(iter(good.labels)), "injection", "position", "3d")
    np.testing.assert_allclose(found.mean, AT_END * synthetic.MEAN[6:9], rtol=1e-12)


def test_agreement_has_the_columns_that_users_rely_on(good):
    assert list(agreement(good).columns) == [
        "case", "event", "state", "unit", "monte_carlo", "lincov", "ratio", "low", "high", "agree",
    ]  # fmt: skip


def test_runs_drawn_from_the_covariance_agree_with_it(good):
    assert len(agreement(good)) == 2 * 3 * 9
    assert set(by_case(good).verdict) == {"agree"}


def test_runs_drawn_too_large_disagree_and_the_worst_state_is_named(wrong):
    found = by_case(wrong)
    assert set(found.verdict) == {"disagree"}
    assert set(found.source) == {"gyro bias"}
    assert found.share_ratio.iloc[0] == pytest.approx(0.75)
    assert (found.outside_count == 27).all()
    assert found.ratio.iloc[0] == pytest.approx(1.6, rel=0.35)
    assert found.event.iloc[0] in synthetic.EVENTS


def test_the_bounds_are_bonferronis(good):
    """27 rows, 200 runs, 199 of them after the failure of one, no mean: sqrt(chi2.ppf(0.005 / 27, 199) / 199)."""
    rows = agreement(good).set_index("event")
    for event, runs in (("liftoff", 200), ("injection", 199)):
        low = np.sqrt(stats.chi2.ppf(0.01 / 27 / 2, runs) / runs)
        assert rows.low[event].iloc[0] == pytest.approx(low, rel=1e-12)


def test_without_runs_nothing_is_claimed(alone):
    assert set(agreement(alone).agree) == {"no runs"}
    assert set(by_case(alone).verdict) == {"no runs"}


def test_where_the_gate_rejects_too_much_neither_agreement_nor_disagreement_is_claimed(tmp_path):
    tables = load(synthetic.results(tmp_path, n_run=40, wrong=1.6, rejects=0.02))
    assert set(agreement(tables).agree) == {"not applicable"}
    found = by_case(tables)
    assert set(found.verdict) == {"not applicable"}
    assert found.reason.iloc[0] == "the gate rejects 2 % of good rows at 51 s"


def test_a_gate_that_rejects_one_row_in_a_hundred_changes_no_verdict(tmp_path):
    tables = load(synthetic.results(tmp_path, n_run=40, rejects=0.01))
    assert set(by_case(tables).verdict) == {"agree"}


def test_contributions_of_all_sources_and_bins_sum_to_one(good):
    total = contributions(good).groupby(["case", "metric"]).share_ratio.sum()
    assert len(total) == 6
    np.testing.assert_allclose(total, 1.0, rtol=1e-12)


def test_a_frozen_sigma_of_ten_times_is_the_closed_form(good):
    rows = sensitivity(good).set_index(["case", "metric", "source", "factor_ratio"])
    one, ten = (rows.loc["imu=fine", "attitude_error", "gyro bias", f] for f in (1.0, 10.0))
    assert ten.frozen == pytest.approx(one.frozen * np.sqrt(0.25 + 0.75 * 100.0), rel=1e-12)
    assert ten.retuned == pytest.approx(synthetic.RETUNED * ten.frozen, rel=1e-12)
    assert ten.unit == "mrad"


def test_the_smallest_singular_values_come_first(good):
    row = observability(good).iloc[0]
    assert (row.rank_count, row.state_count) == (4, 5)
    assert (row.smallest_ratio, row.second_ratio, row.third_ratio) == (1e-5, 0.2, 1.0)


def test_nonlinearity_stands_at_every_event(good):
    assert list(nonlinearity(good).event) == 2 * list(synthetic.EVENTS)


def test_the_budget_names_the_largest_source_first(good):
    found = METRICS["budget"](good)
    assert found.source.iloc[0] == "gyro bias"
    assert found.share_ratio.iloc[0] == pytest.approx(0.75)


def test_a_source_of_a_billionth_is_zero_and_the_rest_is_unchanged(good):
    table = good.budget.copy()
    chosen = (table.source == "gyro bias") & (table.axis == "3d")
    assert chosen.any()
    table.loc[chosen, ["sigma_si", "share_ratio"]] = [1e-12, 1e-10]
    changed, before = copy.copy(good), METRICS["budget"](good)
    changed.budget, changed.cache = table, {}
    found = METRICS["budget"](changed)
    small = found.source == "gyro bias"
    assert (found[small][["sigma", "share_ratio"]] == 0.0).all(axis=None)
    others = before[before.source != "gyro bias"].reset_index(drop=True)
    assert found[~small].reset_index(drop=True).equals(others)


def test_ranks_are_counted_over_all_stretches():
    row = observability_ranks(tables()).iloc[0]
    assert (row.stretches, row.states, row.least_rank, row.least_rank_with_information) == (2, 3, 3, 2)
    assert row.smallest_ratio == 2e-3
    assert row.position_against_bias_ratio == 0.5
    assert row.weakest_direction == "+1.00 gyro bias x"


def test_directions_in_which_a_position_trades_with_its_bias_are_known_by_their_words():
    assert is_position_bias("+1.00 position bias x, -0.80 position north")
    assert not is_position_bias("+1.00 position north")
    assert not is_position_bias("+1.00 position bias x, +0.60 gyro bias x")


def enlarged(tables, factor, until=1e9):
    """The tables with the linear covariance of attitude so much larger, up to a time."""
    history = tables.history.copy()
    chosen = (history.quantity == "attitude") & (history.t_s <= until)
    history.loc[chosen, "lincov_true_si"] *= factor
    return SimpleNamespace(cases=tables.cases, history=history, innovations=tables.innovations, campaign={}, cache={})


@pytest.mark.parametrize(("factor", "applies"), [(43.0, True), (44.0, False)])  # the largest sigma is 2 mrad
def test_beyond_five_degrees_at_lift_off_linear_covariance_does_not_apply(good, factor, applies):
    case = next(iter(good.labels))
    found = why_not_applicable(enlarged(good, factor), case)
    assert (not found) == applies
    if not applies:
        assert found == "an attitude error of 5 deg (one sigma) at -5 s is beyond the linear form (5 deg)"


def test_where_a_spot_check_is_flown_it_tells_how_far_linear_covariance_reaches(good):
    found = enlarged(good, 1e3)
    found.campaign = {"covariance": {"spot_check": 32}}
    assert not why_not_applicable(found, next(iter(good.labels)))


def test_what_attitude_becomes_in_flight_is_no_matter_of_alignment(good):
    case = next(iter(good.labels))
    history = good.history.copy()
    history.loc[(history.quantity == "attitude") & (history.t_s > 0.0), "lincov_true_si"] *= 1e3
    found = SimpleNamespace(cases=good.cases, history=history, innovations=good.innovations, campaign={}, cache={})
    assert not why_not_applicable(found, case)


def changed_history(tables, **columns):
    """The tables with columns of the history of velocity set to (factor, added)."""
    found = copy.copy(tables)
    history = tables.history.copy()
    chosen = (history.quantity == "velocity") & (history.axis != "3d")
    for name, (factor, added) in columns.items():
        history.loc[chosen, name] = history.loc[chosen, name] * factor + added
    found.history, found.cache = history, {}
    return found


def test_however_little_runs_spread_a_hundredth_of_the_mean_is_agreement(good):
    """The mean is a million sigma, so that chi-square's bounds are 1e-7 wide: 0.9 % is agreement, 1.1 % is not."""
    for off, inside in ((1.009, True), (1.011, False)):
        small = {"lincov_true_si": (0.0, 1e-6), "lincov_mean_si": (0.0, 1.0), "dof_ratio": (0.0, 1e9)}
        found = changed_history(good, **small, rms_si=(0.0, off))
        rows = agreement(found)
        rows = rows[rows.state.str.startswith("velocity")]
        assert (((rows.ratio >= rows.low) & (rows.ratio <= rows.high)) == inside).all()


@pytest.mark.parametrize(("sigmas", "verdict"), [(4.0, "disagree"), (6.0, "not applicable")])
def test_engines_that_differ_over_a_mean_of_many_sigma_are_told_why(good, sigmas, verdict):
    mean = sigmas * 0.01
    found = changed_history(good, lincov_true_si=(0.0, 0.01), lincov_mean_si=(0.0, mean), rms_si=(0.0, 2.0 * mean))
    rows = by_case(found)
    assert set(rows.verdict) == {verdict}
    assert rows.reason.str.contains(r"the mean error is 6 sigma \(velocity").all() == (verdict == "not applicable")


def test_engines_that_agree_need_no_reason(good):
    """Mean and runs as large as each other, twenty sigma."""
    found = changed_history(good, lincov_true_si=(0.0, 0.01), lincov_mean_si=(0.0, 0.2), rms_si=(0.0, 0.2003))
    assert set(by_case(found).verdict) == {"agree"}
