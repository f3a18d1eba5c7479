"""What both engines share: windows of the flight, signals on their ticks, the start and the record."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.filtering import filtering_of, layout_of
from lvnav_trade.simulation.preparation.measurements import measurements_of
from lvnav_trade.simulation.preparation.schedule import times_of
from lvnav_trade.simulation.preparation.true_flight import flight_of
from tests.building import MATCHED, case, hop, loaded, prepare_hop, with_fields


def prepared_with(history=1.0, **filter_fields):
    scenario = loaded()
    card = with_fields(scenario.filter, **filter_fields)
    return prepare_hop(scenario.model_copy(update={"filter": card}), history=history)


CUTS = [(10.0, 1.0, 1.0), (3.0, 1.0, 1.0), (10.0, 3.0, 1.0), (7.0, 2.0, 0.35), (200.0, 1.0, 0.1), (0.5, 4.0, 1.0)]


@pytest.mark.parametrize(("covariance_rate", "update_rate", "history"), CUTS)
def test_windows_tile_the_flight_and_end_at_every_epoch_and_history_time(covariance_rate, update_rate, history):
    prepared_case = prepared_with(history, covariance_rate=f"{covariance_rate} Hz", update_rate=f"{update_rate} Hz")
    schedule, n_tick = prepared_case.schedule, prepared_case.reference.dtheta.shape[0]
    ends = schedule.first_tick + schedule.n_tick
    assert ends[-1] == n_tick
    np.testing.assert_array_equal(schedule.first_tick[1:], ends[:-1])
    assert schedule.n_tick.max() <= round(200.0 / covariance_rate)
    for column, times in ((schedule.epoch, prepared_case.t_epoch), (schedule.hist, prepared_case.t_hist)):
        at = column >= 0
        np.testing.assert_array_equal(column[at], np.arange(times.size))
        # an event may lie between ticks: the nearest stands for it
        assert np.abs(prepared_case.reference.t[ends[at]] - times).max() <= 0.5 / 200.0 + 1e-9
    np.testing.assert_allclose(prepared_case.lengths[schedule.length_index] * 200.0, schedule.n_tick, atol=1e-9)


@pytest.mark.parametrize("update_rate", [1.0, 3.0, 7.0])
def test_measurements_are_taken_on_ticks_where_the_increments_end(update_rate):
    prepared_case = prepared_with(update_rate=f"{update_rate} Hz")
    schedule, signals = prepared_case.schedule, prepared_case.signals
    ticks = (schedule.first_tick + schedule.n_tick)[schedule.epoch >= 0]
    # no lever arm: the antenna is at the unit; a float64 at 7e6 m counts in 1e-9 m
    np.testing.assert_allclose(signals.position, prepared_case.reference.r_i[ticks], rtol=0, atol=1e-7)
    np.testing.assert_allclose(signals.velocity, prepared_case.reference.v_i[ticks], rtol=0, atol=1e-9)
    assert prepared_case.t_epoch.size == pytest.approx(30 * update_rate, abs=1)


def test_history_holds_the_grid_and_every_event_once():
    prepared_case = prepared_with(history=0.7)
    expected = np.union1d(np.arange(43) * 0.7, list(hop().events.values()))
    np.testing.assert_allclose(prepared_case.t_hist, expected, atol=1e-12)


def test_a_strapdown_at_a_quarter_of_the_units_rate_steps_over_four_ticks_and_stays_near_the_truth():
    slow, full = (case(f"base.filter.strapdown.ratio={ratio}") for ratio in (4, 1))
    assert (slow.model.strapdown.subsamples, full.model.strapdown.subsamples) == (4, 1)
    assert np.all(slow.schedule.n_tick % 4 == 0)
    runs = [run_block(one, 3, 0, 8) for one in (slow, full)]
    # The draws are the same, so what differs is the algorithm: two-sample coning and sculling over 20 ms of a flight
    # that turns at some 0.1 rad/s leave far less than the noise of the fixes.
    at_end = [one.err[:, -1, 6:9] for one in runs]
    np.testing.assert_allclose(at_end[0], at_end[1], rtol=0, atol=0.2 * float(runs[1].sigma[0, -1, 6]))
    assert not np.array_equal(at_end[0], at_end[1])


def _writable(record):
    """Yield the arrays of a record, and of records in it, that can be written to."""
    for value in record if isinstance(record, tuple) else ():
        if isinstance(value, np.ndarray) and value.flags.writeable:
            yield value
        yield from _writable(value)


def test_no_stage_changes_what_an_earlier_one_has_made():
    """With the records of the earlier stages locked, the later ones give the same numbers."""
    scenario = with_fields(
        loaded(MATCHED, "base.receiver.solution={kind: bancroft, range_sigma: 2 m, rate_sigma: 0.1 m/s}"),
        faults=[
            {"kind": "frozen_output", "start": "9 s", "duration": "3 s"},
            {"kind": "range_bias", "size": "60 m", "start": "5 s", "duration": "3 s"},
        ],
        **{
            "filter.measurements": ["position", "velocity"],
            "filter.logic": {"start_after": 1},
            "filter.underweighting": [{"noise_factor": 2.0, "from": "10 s"}],
            "filter.region_noise": [{"from": "5 s", "accel_bias": "1 mg"}],
        },
    )
    free = prepare_hop(scenario)
    locked = []
    try:
        flight = flight_of(scenario, (hop(), free.reference))
        layout, records = layout_of(scenario, flight), [flight]
        for stage in (times_of, filtering_of, measurements_of):
            locked += [array for array in _writable(tuple(records)) if not array.setflags(write=False)]
            made = {times_of: (layout, 1.0), filtering_of: (layout, records[-1]), measurements_of: (records[-1],)}
            records.append(stage(scenario, flight, *made[stage]))
    finally:
        for array in locked:
            array.setflags(write=True)
    assert len(locked) > 40
    _, times, filtering, measured = records
    np.testing.assert_array_equal(filtering.P, free.initial_state.P)
    for name, found, wanted in (
        ("schedule", times.schedule, free.schedule), ("signals", measured.signals, free.signals),
        ("chain", measured.chain, free.chain),
    ):  # fmt: skip
        for field in found._fields:
            if isinstance(getattr(found, field), np.ndarray):
                np.testing.assert_array_equal(getattr(found, field), getattr(wanted, field), err_msg=f"{name}.{field}")
