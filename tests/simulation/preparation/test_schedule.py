"""Windows of a flight: cut at everything that is looked at, each length once."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.covariance.diagnostics.case_diagnostics import flown_events
from tests.building import ascent, case, hop, loaded, prepare_hop, with_fields


def test_windows_follow_each_other_and_end_at_every_covariance_step_epoch_and_history_time():
    prepared = case()
    schedule, t = prepared.schedule, prepared.reference.t
    ends = schedule.first_tick + schedule.n_tick
    assert schedule.first_tick[0] == 0
    np.testing.assert_array_equal(schedule.first_tick[1:], ends[:-1])
    np.testing.assert_allclose(t[ends[schedule.epoch >= 0]], prepared.t_epoch)
    assert sorted(schedule.hist[schedule.hist >= 0]) == list(range(prepared.t_hist.size))
    step = round(prepared.scenario.imu.rate / prepared.scenario.filter.covariance_rate)
    assert schedule.n_tick.max() == step
    np.testing.assert_allclose(prepared.lengths[schedule.length] * prepared.scenario.imu.rate, schedule.n_tick)


def test_a_state_that_is_kept_cuts_its_window_in_two():
    card = with_fields(loaded().filter, delay_compensation={"kind": "buffered", "delay": "333 ms"})
    prepared = prepare_hop(loaded().model_copy(update={"filter": card}))
    late, schedule = prepared.options.late, prepared.schedule
    at = np.flatnonzero(late.valid[0, :, 1] > late.valid[0, :, 0])
    ends = prepared.reference.t[(schedule.first_tick + schedule.n_tick)[at]]
    np.testing.assert_allclose(ends + late.offset[0], prepared.t_epoch - 0.333, atol=1e-9)
    assert np.abs(late.offset).max() <= 0.5 / prepared.scenario.imu.rate


@pytest.mark.parametrize(("rate", "ratio"), [("50 Hz", 1), ("100 Hz", 1), ("100 Hz", 4), ("200 Hz", 1)])
def test_errors_of_an_event_are_those_of_the_first_strapdown_step_at_or_after_it(rate, ratio):
    prepared = ascent("base.filter=filters/inertial", f"base.imu.rate={rate}", f"base.filter.strapdown.ratio={ratio}")
    cut_off = prepared.trajectory.events["injection"]
    tick = int(prepared.hist_tick[prepared.t_hist.tolist().index(cut_off)])
    after, step = prepared.reference.t[tick], ratio / prepared.scenario.imu.rate
    assert cut_off <= after < cut_off + step
    assert tick % ratio == 0
    at = int(np.searchsorted(prepared.t_hist, cut_off))
    np.testing.assert_array_equal(prepared.record.r[at], prepared.reference.r_i[tick])
    assert np.all(np.diff(prepared.hist_tick) >= 0)


def test_an_event_within_the_last_piece_of_a_tick_is_an_event_of_the_history():
    prepared = prepare_hop(loaded("base.filter=filters/inertial"), hop(coast=9.997))
    burnt_out, end = flown_events(prepared)["end0"], flown_events(prepared)["end1"]
    assert burnt_out < prepared.reference.t[-1] < end == prepared.trajectory.end == prepared.t_hist[-1]
    assert prepared.hist_tick[-1] == prepared.reference.t.size - 1
