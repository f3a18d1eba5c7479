"""Windows of a flight: cut at everything that is looked at, each length once."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.covariance.diagnostics.case_diagnostics import flight_events
from tests.building import ascent, case, hop, loaded, prepare_hop, with_fields


def test_windows_follow_each_other_and_end_at_every_covariance_step_epoch_and_history_time():
    prepared_case = case()
    schedule, t = prepared_case.schedule, prepared_case.reference.t
    ends = schedule.first_tick + schedule.n_tick
    assert schedule.first_tick[0] == 0
    np.testing.assert_array_equal(schedule.first_tick[1:], ends[:-1])
    np.testing.assert_allclose(t[ends[schedule.epoch >= 0]], prepared_case.t_epoch)
    assert sorted(schedule.hist[schedule.hist >= 0]) == list(range(prepared_case.t_hist.size))
    step = round(prepared_case.scenario.imu.rate / prepared_case.scenario.filter.covariance_rate)
    assert schedule.n_tick.max() == step
    np.testing.assert_allclose(
        prepared_case.lengths[schedule.length_index] * prepared_case.scenario.imu.rate, schedule.n_tick
    )


def test_a_state_that_is_kept_cuts_its_window_in_two():
    card = with_fields(loaded().filter, delay_compensation={"kind": "buffered", "delay": "333 ms"})
    prepared_case = prepare_hop(loaded().model_copy(update={"filter": card}))
    delays, schedule = prepared_case.options.delay_processing, prepared_case.schedule
    at = np.flatnonzero(delays.state_epochs[0, :, 1] > delays.state_epochs[0, :, 0])
    ends = prepared_case.reference.t[(schedule.first_tick + schedule.n_tick)[at]]
    np.testing.assert_allclose(ends + delays.offset[0], prepared_case.t_epoch - 0.333, atol=1e-9)
    assert np.abs(delays.offset).max() <= 0.5 / prepared_case.scenario.imu.rate


@pytest.mark.parametrize(("rate", "ratio"), [("50 Hz", 1), ("100 Hz", 1), ("100 Hz", 4), ("200 Hz", 1)])
def test_errors_of_an_event_are_those_of_the_first_strapdown_step_at_or_after_it(rate, ratio):
    prepared_case = ascent(
        "base.filter=filters/inertial", f"base.imu.rate={rate}", f"base.filter.strapdown.ratio={ratio}"
    )
    cut_off = prepared_case.trajectory.events["injection"]
    tick = int(prepared_case.hist_tick[prepared_case.t_hist.tolist().index(cut_off)])
    after, step = prepared_case.reference.t[tick], ratio / prepared_case.scenario.imu.rate
    assert cut_off <= after < cut_off + step
    assert tick % ratio == 0
    at = int(np.searchsorted(prepared_case.t_hist, cut_off))
    np.testing.assert_array_equal(prepared_case.record.r[at], prepared_case.reference.r_i[tick])
    assert np.all(np.diff(prepared_case.hist_tick) >= 0)


def test_an_event_within_the_last_piece_of_a_tick_is_an_event_of_the_history():
    prepared_case = prepare_hop(loaded("base.filter=filters/inertial"), hop(coast=9.997))
    burnt_out, end = flight_events(prepared_case)["end0"], flight_events(prepared_case)["end1"]
    assert burnt_out < prepared_case.reference.t[-1] < end == prepared_case.trajectory.end == prepared_case.t_hist[-1]
    assert prepared_case.hist_tick[-1] == prepared_case.reference.t.size - 1
