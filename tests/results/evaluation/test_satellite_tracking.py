"""Satellites in view, errors around an outage, losses and recovery."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.satellite_tracking import _recovery_values, reacquisition_times, signal_values


def test_satellites_vanish_during_the_outage(good):
    found = METRICS["in_view"](good)
    assert set(found.tracked_count[found.t_s.between(60, 74.5)]) == {0}
    assert set(found.above_count) == {8}


def test_growth_over_an_outage_is_end_over_before(alone):
    found = METRICS["outages"](alone).iloc[0]
    assert found.growth_ratio == pytest.approx(1.75 / 1.60)
    assert (found.t_start_s, found.t_end_s) == (60.0, 75.0)


def test_the_worst_error_lies_between_the_start_and_ten_seconds_after_the_end(alone):
    found = METRICS["outages"](alone)
    row = found[(found.case == "imu=fine") & (found.metric == "velocity_error")].iloc[0]
    assert row.worst == pytest.approx(row.before * 1.85 / 1.60)  # the error grows by 1 % a second


def after_the_outage(results, shape, faults=()):
    """Return results in which each 3-D error is one SI unit times a shape over time; the outage is from 60 to 75 s and
    the last satellite is back at 82 s. faults: starts (s) of more of them, each a second long.
    """
    history = results.history.copy()
    history["lincov_mean_si"] = 0.0
    history["lincov_true_si"] = np.interp(history.t_s, *np.transpose(shape))
    events, outage = results.events, results.events[results.events.kind == "fault"]
    more = [outage.assign(t_s=start, t_end_s=start + 1.0, event="jump") for start in faults]
    frame = METRICS["outages"](results.with_frames(history=history, events=pd.concat([events, *more])))
    return frame[(frame.case == "imu=fine") & (frame.metric == "velocity_error")].iloc[0]


def test_the_worst_error_is_searched_until_the_error_has_recovered(alone):
    """The error peaks twenty seconds after the fault."""
    row = after_the_outage(alone, [(0, 1), (60, 1), (75, 2), (95, 9), (97, 1), (98, 1)])
    assert (row.before, row.at_end, row.worst, row.t_worst_s, row.t_recovered_s) == (1.0, 2.0, 9.0, 95.0, 97.0)


def test_an_error_has_not_recovered_before_its_satellites_are_back(alone):
    """A falling error is small at the end of the fault while a satellite is still missing, and grows again."""
    rows = alone.satellites.copy()
    rows.loc[rows.t_s.between(60.0, 91.0) & (rows.satellite == "G08"), "tracked"] = False
    row = after_the_outage(alone.with_frames(satellites=rows), [(0, 1), (86, 1), (90, 4), (94, 1), (99, 1)])
    assert (row.worst, row.t_worst_s, row.t_recovered_s) == (4.0, 90.0, 94.0)


def test_the_search_ends_with_the_run_or_the_next_fault_where_the_error_does_not_recover(alone):
    rising = [(0, 1), (60, 1), (100, 5)]
    row = after_the_outage(alone, rising)
    assert (row.worst, row.t_worst_s) == (pytest.approx(4.95), 99.5)
    assert np.isnan(row.t_recovered_s)
    row = after_the_outage(alone, rising, faults=[90.0])
    assert (row.worst, row.t_worst_s) == (pytest.approx(3.9), 89.0)


def test_before_a_fault_of_a_moment_is_the_time_before_it(alone):
    jump = type(alone)(alone.folder)
    events = alone.events.copy()
    events.loc[events.kind == "fault", ["t_s", "t_end_s"]] = 60.0
    jump._read["events"] = events
    assert METRICS["outages"](jump).iloc[0].growth_ratio == pytest.approx(1.60 / 1.59)


def test_losses_are_counted_by_reason(good):
    found = METRICS["losses"](good)
    assert list(found.case) == ["imu=fine", "imu=coarse"]
    assert set(zip(found.reason, found.loss_count, found.satellite_count, found.first_s, strict=True)) == {
        ("fault", 8, 8, 60.0)
    }


def test_a_receiver_without_channels_has_no_transition(good):
    changes = METRICS["transitions"](good)
    assert set(changes.columns) == {"case", "t_s", "satellite", "from_state", "to_state", "reason"}
    assert len(changes) == 2 * (8 + 8 + 3 * 8)


def test_a_gap_lasts_from_the_loss_to_the_fourth_satellite(good):
    """The outage takes all eight at 60 s; they are back at 75, 76, ... 82 s, the fourth at 78 s."""
    row = METRICS["tracking"](good).iloc[0]
    assert (row.first_fix_s, row.to_fix_s) == (1.0, 0.0)
    assert (row.least_count, row.gap_count, row.longest_gap_s, row.loss_count) == (0, 1, 18.0, 8)


def test_recovery_counts_from_the_end_of_the_fault(good):
    row = METRICS["recovery"](good).iloc[0]
    assert (row.t_start_s, row.t_end_s, row.before_count, row.lost_count) == (60.0, 75.0, 8, 8)
    assert (row.least_count, row.to_fix_s, row.to_all_s, row.gone_count) == (0, 3.0, 7.0, 0)


@pytest.fixture
def sky():
    """Five satellites: one is never touched, two come back, one sets, one rises during the fault."""
    t = np.arange(10.0)
    wide = pd.DataFrame(index=t, data={name: np.ones(10, dtype=bool) for name in "abcde"})
    wide.loc[3:5, ["b", "c", "d"]] = False
    wide.loc[6:7, "c"] = False
    wide.loc[6:, "d"] = False
    wide.loc[:3, "e"] = False
    return wide


def test_who_sets_meanwhile_is_distinguished_from_who_comes_back(sky):
    assert _recovery_values(sky, 3.0, 6.0) == {
        "before_count": 4, "least_count": 1, "lost_count": 3, "to_fix_s": 2.0, "to_all_s": 2.0, "gone_count": 1,
    }  # fmt: skip


def test_a_fault_without_duration_takes_nothing(sky):
    found = _recovery_values(sky, 1.0, 1.0)
    assert (found["before_count"], found["lost_count"], found["to_all_s"], found["to_fix_s"]) == (4, 0, 0.0, 0.0)


def test_a_fault_up_to_the_end_of_the_flight_has_no_recovery(sky):
    found = _recovery_values(sky, 3.0, 20.0)
    assert found["gone_count"] == found["lost_count"] == 3
    assert np.isnan(found["to_fix_s"])
    assert np.isnan(found["to_all_s"])


def test_the_change_of_a_delay_is_that_of_one_satellite_within_the_bounds_of_elevation_and_altitude(good):
    case = next(iter(good.labels))
    rows = signal_values(good, case, "troposphere_change", ("20 deg", "30 deg"), ("1 km", "5 km"))
    sky = good.satellites[(good.satellites.case == case) & good.satellites.tracked]
    truth = good.reference[good.reference.case == case]
    chosen = []
    for _, one in sky.sort_values("t_s").groupby("satellite"):
        height = np.interp(one.t_s, truth.t_s, truth.altitude_m)
        inside = one.elevation_rad.between(*np.radians([20.0, 30.0])) & (height >= 1e3) & (height <= 5e3)
        chosen += list(np.abs(np.diff(one.troposphere_m, prepend=np.nan))[inside])
    assert len(chosen) > 5
    np.testing.assert_allclose(np.sort(rows.value), np.sort(chosen), rtol=1e-12)


def test_satellites_come_back_one_after_the_other_after_the_outage(good):
    case = next(iter(good.labels))
    times = reacquisition_times(good, case, "stage1_cutoff + 34 s")  # a second before the first is back
    np.testing.assert_allclose(np.sort(times), np.arange(1.0, 9.0))
    assert len(reacquisition_times(good, case, "liftoff + 20 s")) == 0
