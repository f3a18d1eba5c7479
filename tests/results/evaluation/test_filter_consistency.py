"""Normalised errors squared inside and outside their bounds, and innovations that are white or not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.covariances import why_not_applicable
from lvnav_trade.results.evaluation.filter_consistency import accepted_moments, filter_verdicts, nees, nis
from lvnav_trade.results.tables.read import Tables, load
from tests import synthetic

RUNS = 40


def test_a_matched_filter_is_inside_its_bounds(good):
    """99 epochs of ANIS in 95 % bounds: fewer than 87 inside has probability 0.1 %."""
    found = METRICS["consistency"](good).set_index(["case", "test"])
    assert found.loc[("imu=fine", "ANIS"), "inside_ratio"] >= 87 / 99
    assert found.loc[("imu=fine", "ANEES"), "mean_ratio"] == pytest.approx(
        found.loc[("imu=fine", "ANEES"), "expected_ratio"], rel=0.01
    )


def test_an_optimistic_filter_is_outside_its_bounds(wrong):
    found = METRICS["consistency"](wrong).set_index(["case", "test"])
    assert found.loc[("imu=fine", "ANEES"), "inside_ratio"] == 0.0
    assert found.loc[("imu=fine", "ANEES"), "mean_ratio"] == pytest.approx(1.6**2 + 0.0285, rel=0.03)


def test_bounds_of_anees_are_chi_square_with_all_runs(good):
    rows = nees(good)
    for row, freedom in ((rows.iloc[0], 2000), (rows[rows.t_s >= 50.0].iloc[0], 1990)):  # a run fails at 50 s
        assert row.low_ratio == pytest.approx(stats.chi2.ppf(0.025, freedom) / freedom, rel=1e-12)


def test_anis_is_bounded_by_the_rows_that_there_were(good):
    rows = nis(good)
    for row, runs in ((rows.iloc[0], 200), (rows[rows.t_s >= 50.0].iloc[0], 199)):  # a run fails at 50 s
        assert row.measurement_count == runs * 16
        assert row.high_ratio == pytest.approx(stats.chi2.ppf(0.975, runs * 16) / (runs * 16), rel=1e-12)


@pytest.mark.parametrize("gate", [1.0, 2.0, 3.0])
def test_the_moments_are_those_of_a_truncated_normal(gate):
    """Variance and fourth moment of a standard normal within +- gate, by scipy's truncated normal."""
    law = stats.truncnorm(-gate, gate)
    mean, variance = accepted_moments(np.array([gate]))
    assert mean[0] == pytest.approx(law.moment(2), rel=1e-9)
    assert variance[0] == pytest.approx(law.moment(4) - law.moment(2) ** 2, rel=1e-8)


def test_without_a_gate_it_is_the_chi_square():
    mean, variance = accepted_moments(np.array([np.nan]))
    assert (mean[0], variance[0]) == (1.0, 2.0)


def test_white_innovations_pass_and_channels_have_names(good):
    found = METRICS["whiteness"](good)
    assert found.white.all()
    assert found.channel.iloc[0] == "G01 range"
    assert found.channel.nunique() == 16


def test_coloured_innovations_fail_in_their_channel_and_the_lag_is_named(good):
    """A product sum of 0.1 per pair at lag 3 among 17 900 pairs is thirteen sigma."""
    rows = good.whiteness.copy()
    hit = (rows.channel == "G02 range") & (rows.lag_number == 3)
    rows.loc[hit, "product_sum_ratio"] = 0.1 * rows.pair_count[hit]
    coloured = Tables(good.folder)
    coloured._read["whiteness"] = rows
    found = METRICS["whiteness"](coloured).set_index(["case", "channel"])
    assert not found.loc[("imu=fine", "G02 range"), "white"]
    assert found.loc[("imu=fine", "G02 range"), "largest_lag_number"] == 3
    assert found.white.sum() == 30


@pytest.fixture(scope="module")
def watched(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("watched"), n_run=RUNS, size=16, logic=True))


def test_every_kind_of_change_is_counted_with_its_reason(watched):
    found = METRICS["mode_transitions"](watched)
    mine = found[found.case == "imu=fine"].set_index(["from_mode", "to_mode", "reason"])
    start, lost = (
        mine.loc["waiting", "converging", "good samples in a row"],
        mine.loc["aiding", "predicting", "data lost"],
    )
    assert (start.change_count, start.run_count, start.run_ratio, start.first_s) == (RUNS, RUNS, 1.0, 5.0)
    assert (lost.change_count, lost.run_ratio, lost.median_s) == (RUNS // 4, 0.25, 60.0)
    assert mine.loc["predicting", "stopped", "data loss persists"].change_count == RUNS // 4
    assert len(mine) == 5


def test_the_modes_of_all_runs_add_up_at_every_time(watched):
    modes = METRICS["modes"](watched)
    mine = modes[modes.case == "imu=coarse"].pivot(index="t_s", columns="filter_mode", values="run_ratio")
    np.testing.assert_allclose(mine.sum(axis=1), 1.0)
    at = mine.loc[mine.index[np.searchsorted(mine.index, [0.0, 15.0, 40.0, 65.0, 75.0, 90.0])]]
    assert at.waiting.tolist() == [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert at.aiding.tolist() == [0.0, 0.0, 1.0, 0.75, 0.75, 0.75]
    assert at.predicting.tolist() == [0.0, 0.0, 0.0, 0.25, 0.0, 0.0]
    assert at.stopped.tolist() == [0.0, 0.0, 0.0, 0.0, 0.25, 0.0]


def test_stops_and_restarts_are_counted_and_who_corrects_at_the_end(watched):
    row = METRICS["stops"](watched).set_index("case").loc["imu=fine"]
    assert (row.started_ratio, row.corrected_ratio, row.ended_ratio) == (1.0, 1.0, 0.75)
    assert (row.stop_count, row.restart_count) == (RUNS // 4, RUNS // 4)


def test_filters_without_a_logic_have_none_of_it(good):
    assert METRICS["mode_transitions"](good).empty
    assert METRICS["modes"](good).empty
    assert METRICS["stops"](good).empty


def test_linear_covariance_is_not_held_against_a_filter_with_a_logic(watched, good):
    case = watched.cases.case[0]
    assert why_not_applicable(watched, case)
    assert "logic of its own" in why_not_applicable(watched, case)
    assert not why_not_applicable(good, good.cases.case[0])
    assert set(METRICS["agreement"](watched).agree) == {"not applicable"}


def _with_expected(tables: Tables, factor: float) -> Tables:
    frame = tables.consistency.assign(expected_nees_ratio=tables.consistency.expected_nees_ratio * factor)
    return tables.with_frames(consistency=frame)


def test_a_filter_is_overconfident_by_the_factor_that_its_errors_are_larger_than_its_sigma(wrong, good):
    """Errors are drawn 1.6 times as large as the filter's sigma, with a mean of 0.0285 of the variance."""
    found = filter_verdicts(wrong)
    assert list(found.verdict) == ["overconfident"] * 2
    assert found.sigma_ratio.to_numpy() == pytest.approx(np.sqrt(1.6**2 + 0.0285), rel=0.02)
    assert (set(found.by), set(found.moment)) == ({"runs"}, {"run"})
    assert list(filter_verdicts(good).verdict) == ["consistent"] * 2


@pytest.mark.parametrize(("factor", "verdict", "sigma"), [(1.0, "consistent", 1.0), (16.0, "overconfident", 4.0),
                                                          (1.0 / 9.0, "conservative", 1.0 / 3.0)])  # fmt: skip
def test_without_runs_the_verdict_is_that_of_true_and_formal_covariance(alone, factor, verdict, sigma):
    found = filter_verdicts(_with_expected(alone, factor))
    assert set(found.verdict) == {verdict}
    assert set(found.by) == {"LinCov"}
    assert found.sigma_ratio.to_numpy() == pytest.approx(sigma * np.sqrt(1.0285), rel=0.01)


def test_where_the_covariance_has_no_inverse_navigation_errors_decide(alone):
    """True sigma of the nine errors is doubled; the mean is 0.05 of 0.12 m/s and 2 of 6 m, in two of nine axes."""
    history = alone.history.assign(lincov_true_si=2.0 * alone.history.lincov_true_si)
    found = filter_verdicts(_with_expected(alone, np.nan).with_frames(history=history))
    extra = ((0.05 / 0.12) ** 2 + (2.0 / 6.0) ** 2) / 9.0
    assert set(found.verdict) == {"overconfident"}
    assert found.sigma_ratio.to_numpy() == pytest.approx(np.sqrt(4.0 + extra), rel=1e-6)


def test_a_filter_that_is_inconsistent_at_the_event_of_a_requirement_alone_is_so(alone):
    rows = alone.consistency
    at = np.abs(rows.t_s - synthetic.EVENTS["injection"]) < 1e-6
    found = filter_verdicts(alone.with_frames(
        consistency=rows.assign(expected_nees_ratio=rows.expected_nees_ratio.where(~at, 9.0 * rows.nees_dof_count))
    ))  # fmt: skip
    assert set(found.verdict) == {"overconfident"}
    assert set(found.moment) == {"injection"}
    assert found.sigma_ratio.to_numpy() == pytest.approx(3.0)
    assert found.largest_s.to_numpy() == pytest.approx(99.5)
