"""Tables of a filter's tuning: weights by epoch and channel, changes of region and renewed transitions by window."""

from __future__ import annotations

import numpy as np

from lvnav_trade.kernels.transition import EVERY_WINDOW, FIRST, KEPT, RENEWED
from lvnav_trade.quantities.frames import matrices
from tests.building import flight, turning
from tests.filter.test_tuning import prepare_case


def test_underweighting_acts_while_its_conditions_hold_on_the_measurements_it_names():
    entries = [
        {"beta": 0.5, "until": "10 s", "measurements": ["pseudorange"]},
        {"beta": 0.25, "noise_factor": 2.0, "above": "0 m"},
        {"noise_factor": 3.0, "from": "10 s", "until": "20 s", "measurements": ["range_rate"]},
    ]
    prepared_case = prepare_case(underweighting=entries)
    signals, plain = prepared_case.signals, prepare_case().signals
    early, middle = prepared_case.t_epoch < 10.0, (prepared_case.t_epoch >= 10.0) & (prepared_case.t_epoch < 20.0)
    ranges, rates = slice(0, None, 2), slice(1, None, 2)
    assert np.all(signals.beta[early, ranges] == 0.75)
    assert np.all(signals.beta[early, rates] == 0.25)
    assert np.all(signals.beta[~early] == 0.25)
    factor = signals.variance / plain.variance
    np.testing.assert_allclose(factor[middle, rates], 6.0, rtol=1e-14)
    np.testing.assert_allclose(factor[~middle, rates], 2.0, rtol=1e-14)
    np.testing.assert_allclose(factor[:, ranges], 2.0, rtol=1e-14)


def test_conditions_add_variance_where_they_begin_and_where_they_end():
    prepared_case = prepare_case(
        region_noise=[{"from": "5 s", "until": "12 s", "accel_scale_factor": "0 ppm", "accel_bias": "1 mg"}]
    )
    ends = prepared_case.schedule.first_tick + prepared_case.schedule.n_tick
    at = prepared_case.reference.t[ends[prepared_case.schedule.injection >= 0]]
    np.testing.assert_allclose(at, [5.0, 12.0], atol=1e-9)
    bias = next(b.offset for b in prepared_case.layout.parameters if b.name == "accel_bias")
    np.testing.assert_allclose(prepared_case.model.injected_variance[:, bias : bias + 3], (9.80665e-3) ** 2, rtol=1e-12)
    assert np.count_nonzero(prepared_case.model.injected_variance) == 6


def test_a_threshold_finds_every_step_of_the_force_and_no_turn_of_the_vehicle():
    """0, 10, 40 and 0 m/s^2: with 15 m/s^2 two steps, with 8 m/s^2 three; a pitch of 1 deg/s is none of rate."""
    nose = turning(np.zeros(1))
    along = matrices(nose)[0][:, 0]
    forces = [(5.0, lambda t, f=f: f * along) for f in (0.0, 10.0, 40.0, 0.0)]
    steps = flight(forces, lambda t: np.tile(nose, (t.size, 1)))

    def times(**entry):
        prepared_case = prepare_case(flight=steps, region_noise=[entry | {"velocity": "1 m/s"}])
        ends = prepared_case.schedule.first_tick + prepared_case.schedule.n_tick
        return prepared_case.reference.t[ends[prepared_case.schedule.injection >= 0]]

    np.testing.assert_allclose(times(force_change="15 m/s^2"), [10.1, 15.1], atol=0.11)
    np.testing.assert_allclose(times(force_change="8 m/s^2"), [5.1, 10.1, 15.1], atol=0.11)
    np.testing.assert_allclose(times(force_change="8 m/s^2", until="7 s"), [5.1], atol=0.11)
    assert times(rate_change="1 deg/s").size == 0


def test_a_transition_is_renewed_where_its_interval_is_over_and_in_the_second_window():
    """Windows of 0.1 s, intervals of 2 s: nothing is known before the first window."""
    schedule = prepare_case(transition_rate="0.5 Hz").schedule
    moved = np.flatnonzero(schedule.n_tick > 0)
    codes = schedule.linearisation[moved]
    assert codes[:4].tolist() == [FIRST, RENEWED, KEPT, KEPT]
    assert np.flatnonzero(codes == RENEWED)[1:4].tolist() == [20, 40, 60]
    assert np.all(np.delete(schedule.linearisation, moved) == EVERY_WINDOW)
    assert np.all(prepare_case().schedule.linearisation == EVERY_WINDOW)


def test_a_change_of_region_reaches_nonlinearities_and_only_the_states_that_a_clock_has():
    entry = {"from": "5 s", "accel_nonlinearity": "1 percent", "clock_bias": "3 m"}
    prepared_case = prepare_case(region_noise=[entry], extra_states=["accel_nonlinearity"])
    at = next(b.offset for b in prepared_case.layout.parameters if b.name == "accel_nonlinearity")
    full_scale = prepared_case.scenario.imu.accel.nonlinearity_scale
    np.testing.assert_allclose(
        prepared_case.model.injected_variance[0, at : at + 3], (0.01 / full_scale) ** 2, rtol=1e-12
    )
    drifting = entry | {"clock_drift": "1 m/s"}
    clock = prepared_case.layout.clock
    np.testing.assert_allclose(
        prepare_case(region_noise=[drifting]).model.injected_variance[0, clock - 3 : clock - 1], [9.0, 1.0]
    )
    ranges = ["pseudorange"]
    # the drift is taken for zero
    reduced = prepare_case(region_noise=[drifting], clock="one_state", measurements=ranges)
    at = reduced.layout.clock
    np.testing.assert_allclose(reduced.model.injected_variance[0, at : at + 2], [9.0, 0.0])
