"""Windows of a flight: cut at everything that is looked at, each length once."""

from __future__ import annotations

import numpy as np

from lvnav_trade.engines.setup.times import epochs_of
from tests.building import case, loaded, prepare_hop, with_fields


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


def test_epochs_are_on_ticks_of_the_strapdown():
    prepared = case()
    card = with_fields(prepared.scenario.filter, strapdown={"ratio": 4})
    epochs = epochs_of(prepared.scenario.model_copy(update={"filter": card}), prepared.reference)
    assert epochs.group == 4
    assert not np.any(epochs.tick % 4)
    np.testing.assert_array_equal(epochs.t, prepared.reference.t[epochs.tick])
