"""Our number for a published one, against the runs themselves."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.campaign.definition.metric_names import RANKS
from lvnav_trade.metrics.numbers import cases_of, columns, is_ratio, name_of, ours
from tests import synthetic, vehicle_tables

CASE, FAILED = "aaaaaaaaaaaa", 3
PHASE = "liftoff to injection"


@pytest.fixture(scope="module")
def drawn():
    """Errors (n_run, n_hist, n_out) of the good runs of the first case, and the times."""
    block = synthetic.block(synthetic.covariance(1.0), 0, 200)
    return np.delete(block.err, FAILED, axis=0), block.t


def test_a_phase_is_the_mean_over_runs_and_time(good, drawn):
    err, t = drawn
    within = (t >= 0.0) & (t <= 99.5)
    square = (err[:, within, 3] ** 2).mean(axis=0)
    begun = t[within] < 50.0  # until then the run that fails counts too
    sound = synthetic.block(synthetic.covariance(1.0), FAILED, 1).err[0, within, 3] ** 2
    square[begun] = ((199 * square + sound) / 200)[begun]
    area = (0.5 * (square[1:] + square[:-1]) * np.diff(t[within])).sum() / 99.5
    found = ours(good, CASE, {"metric": "velocity_error_north", "during": PHASE}, "cm/s")
    assert found.value == pytest.approx(100 * np.sqrt(area), rel=1e-9)
    assert len(found.runs) == 200  # each by itself, a failed one infinite
    assert np.isinf(found.runs[-1])
    own = np.sqrt(np.trapezoid(err[:, within, 3] ** 2, t[within], axis=1) / 99.5)
    np.testing.assert_allclose(np.sort(found.runs)[:-1], np.sort(100 * own), rtol=1e-9)


def test_the_worst_is_the_median_over_runs_of_each_runs_largest(good, drawn):
    err, t = drawn
    within = (t >= 0.0) & (t <= 99.5)
    largest = np.append(np.sqrt((err[:, within, 6:9] ** 2).sum(axis=2)).max(axis=1), np.inf)
    found = ours(good, CASE, {"metric": "position_error_3d", "during": PHASE, "statistic": "worst"}, "m")
    assert found.value == pytest.approx(np.median(largest), rel=1e-12)


def test_a_mean_has_its_sign_and_is_over_runs_and_time(good, drawn):
    err, t = drawn
    within = (t >= 50.0) & (t <= 60.0)  # after the run that fails
    stated = {"metric": "velocity_error_north", "statistic": "mean"}
    during = stated | {"during": "stage1_cutoff + 10 s to stage1_cutoff + 20 s"}
    expected = np.trapezoid(err[:, within, 3].mean(axis=0), t[within]) / 10.0
    found = columns(good, CASE, during, "cm/s")
    assert found.monte_carlo == pytest.approx(100 * expected, rel=1e-9)
    assert found.true == pytest.approx(0.0, abs=1e-12)  # linear covariance of what is drawn without a mean
    assert np.isnan(found.formal)
    assert not len(found.runs)
    assert ours(good, CASE, during, "cm/s").value == pytest.approx(100 * expected, rel=1e-9)
    at_end = columns(good, CASE, stated | {"at": "injection"}, "m/s")
    assert at_end.monte_carlo == pytest.approx(err[:, np.searchsorted(t, 99.5), 3].mean(), rel=1e-9)
    assert at_end.runs[np.isfinite(at_end.runs)].mean() == pytest.approx(at_end.monte_carlo, rel=1e-9)
    assert np.isinf(at_end.runs).sum() == 1


def test_a_window_that_begins_after_an_event_is_read_off_the_history(good, drawn):
    err, t = drawn
    within = (t >= 50.0) & (t <= 60.0)
    square = (err[:, within, 8] ** 2).mean(axis=0)
    stated = {"metric": "position_error_down", "during": "stage1_cutoff + 10 s to stage1_cutoff + 20 s"}
    found = ours(good, CASE, stated, "m")
    assert found.value == pytest.approx(np.sqrt(np.trapezoid(square, t[within]) / 10.0), rel=1e-9)
    assert not len(found.runs)
    assert np.isnan(ours(good, CASE, stated | {"statistic": "worst"}, "m").value)


def test_sigmas_of_the_filter_and_of_linear_covariance_are_those_of_the_gaussians(good, alone):
    stated = {"metric": "velocity_error_down", "at": "injection"}
    sigma = 0.2 * 1.995
    for results in (good, alone):
        for statistic in ("formal", "lincov"):
            found = ours(results, CASE, stated | {"statistic": statistic}, "m/s")
            assert found.value == pytest.approx(sigma, rel=1e-9)
    assert ours(alone, CASE, stated, "m/s").remark == "linear covariance"


def test_an_attitude_beyond_five_degrees_has_no_linear_covariance_beside_it(good):
    stated = {"metric": "attitude_error_roll", "at": "injection", "statistic": "lincov", "value": 48.8}
    found = ours(good, CASE, stated, "deg")
    assert np.isnan(found.value)
    assert found.remark == "not applicable: an attitude error of 49 deg (one sigma) is beyond the linear form (5 deg)"
    assert ours(good, CASE, stated | {"value": 4.9}, "deg").value > 0.0
    assert ours(good, CASE, stated | {"statistic": "formal"}, "deg").value > 0.0


def test_satellites_are_counted_and_what_is_left_of_delays_is_the_worst(good):
    during = {"metric": "satellites_tracked", "during": "flight"}
    assert ours(good, CASE, during | {"statistic": "least"}, "-").value == 0.0  # in the outage
    assert ours(good, CASE, during | {"statistic": "worst"}, "-").value == synthetic.N_SAT
    left = ours(good, CASE, {"metric": "ionosphere_left", "during": "flight", "statistic": "worst"}, "m")
    assert left.value == pytest.approx(2.5)


@pytest.mark.parametrize(
    ("stated", "unit", "why"),
    [
        ({"metric": "gyro_bias_error_x"}, "deg/h", "not among our results"),
        ({"metric": "velocity_error_3d"}, "m", "unit m does not fit"),
        ({"metric": "velocity_error_3d", "at": "touchdown"}, "m/s", "not in our flight"),
    ],
)
def test_what_these_results_lack_is_said(good, stated, unit, why):
    found = ours(good, CASE, stated, unit)
    assert np.isnan(found.value)
    assert found.remark == why


def test_only_the_rates_of_decisions_are_ratios_and_not_the_error_of_a_clock_rate():
    assert is_ratio("detection_rate")
    assert is_ratio("attitude_nees")
    assert is_ratio("position_coverage")
    assert not is_ratio("receiver_clock_drift_error_rate")


def test_cases_are_found_by_the_levels_of_their_axes(good):
    assert cases_of(good, {"imu": "coarse"}) == ["bbbbbbbbbbbb"]
    assert len(cases_of(good, {})) == 2
    assert cases_of(good, {"imu": "none"}) == []


def test_a_statement_is_named_by_statistic_metric_and_place():
    assert name_of({"metric": "observable_states"}) == "observable_states, least of all stretches"
    assert name_of({"metric": "velocity_error_3d"}) == "velocity_error_3d at injection"
    assert (
        name_of({"metric": "position_error_x", "during": PHASE, "statistic": "worst"})
        == "worst position_error_x, liftoff to injection"
    )


def test_states_with_information_are_fewer_than_those_beyond_rounding():
    tables = vehicle_tables.tables()
    rank, informed = (ours(tables, "aaaaaaaaaaaa", {"metric": name}, "-") for name in RANKS)
    assert (rank.value, informed.value) == (3.0, 2.0)
    assert informed.remark == "2 stretches, singular values above 0.01; least informed: +1.00 gyro bias x"


def test_the_part_of_ticks_in_an_envelope_is_that_of_the_worse_rate():
    tables = vehicle_tables.tables()
    rows = tables.turning.copy()
    rows.loc[(rows.feed == "raw") & (rows.axis == "pitch"), "inside_turning_ratio"] = 0.9
    rows.loc[(rows.feed == "true"), "inside_turning_ratio"] = 0.1  # is not flown
    coast = rows.assign(phase="coast", tick_count=3000, inside_turning_ratio=1.0)
    tables.__dict__["turning"] = pd.concat([rows, coast], ignore_index=True)
    whole, burn, yaw, jerk = (
        ours(tables, "aaaaaaaaaaaa", {"metric": name}, "%").value
        for name in ("turning_inside_pitch", "turning_inside_pitch_burn", "turning_inside_yaw_burn", "jerk_inside_yaw")
    )
    assert whole == pytest.approx(97.5)
    assert (burn, yaw, jerk) == pytest.approx((90.0, 99.0, 100.0))
    assert np.isnan(ours(tables, "aaaaaaaaaaaa", {"metric": "turning_inside_yaw_change"}, "%").value)


def test_a_nozzle_moves_less_in_a_burn_and_over_the_flight():
    tables = vehicle_tables.tables()
    found = [
        ours(tables, "aaaaaaaaaaaa", {"metric": f"nozzle_movement_pitch{part}"}, "%").value for part in ("", "_burn_1")
    ]
    assert found == pytest.approx([70.0, 70.0])
    each = ours(tables, "aaaaaaaaaaaa", {"metric": "nozzle_movement_yaw"}, "%").runs
    assert each == pytest.approx([35.0] * vehicle_tables.RUNS)  # one reduction of each pair of runs
    assert np.isnan(ours(tables, "aaaaaaaaaaaa", {"metric": "nozzle_movement_pitch_burn_2"}, "%").value)
