"""Parts of a flight that not every case has: what the cards make of them."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.filter.assumed import ReceiverModel
from lvnav_trade.gnss.receiver_cards import BancroftSolution, DirectSolution, FilteredSolution
from lvnav_trade.scenario.filter_models import epoch_interval, filter_models, has_covariance, has_receiver_solution
from lvnav_trade.sensors.receiver_observables import Channels
from lvnav_trade.simulation.preparation.inputs import Schedule
from lvnav_trade.simulation.preparation.options import (
    CompensatedDelay,
    clone_times,
    compensated_delays,
    delay_processing,
    direct_solution,
    epochs_per_update,
    solver_of,
)
from tests.building import loaded, with_fields

POINT = {"kind": "bancroft", "range_sigma": "2 m", "rate_sigma": "0.1 m/s"}
FILTERED = {**POINT, "kind": "filtered", "jerk": "1 m/s^3", "clock_noise": "0.1 m/s^2"}


def solving(solution, *settings):
    scenario = loaded("base.filter=filters/loose", *settings)
    card = {"bancroft": BancroftSolution, "filtered": FilteredSolution}[solution["kind"]].model_validate(solution)
    receiver = scenario.receiver.model_copy(update={"solution": card})
    return scenario.model_copy(update={"receiver": receiver, "faults": ()})


def test_only_a_loose_filter_takes_the_solution_of_a_receiver_that_solves():
    assert has_receiver_solution(solving(POINT))
    assert not has_receiver_solution(loaded("base.filter=filters/loose"))
    tight = solving(POINT, "base.filter=filters/tight")
    assert not has_receiver_solution(tight)
    assert direct_solution(tight).position_sigma == 0.0  # nobody takes it
    assert isinstance(loaded().receiver.solution, DirectSolution)
    assert direct_solution(loaded()) == loaded().receiver.solution
    assert solver_of(tight, filter_models(tight)[1], 12) is None


def test_a_solving_receiver_works_at_its_own_rate_and_the_filter_takes_every_nth():
    scenario = solving(FILTERED)
    fast = scenario.model_copy(update={"receiver": scenario.receiver.model_copy(update={"rate": 5.0})})
    assert (epoch_interval(fast), epochs_per_update(fast)) == (pytest.approx(0.2), 5)
    plain = loaded("base.filter=filters/loose")
    plain = plain.model_copy(update={"receiver": plain.receiver.model_copy(update={"rate": 5.0})})
    assert (epoch_interval(plain), epochs_per_update(plain)) == (1.0, 1)


def test_the_receiver_tells_its_own_covariance_unless_the_filter_has_numbers_of_its_own():
    scenario = solving({**POINT, "reported_covariance": {"kind": "own", "factor": 10.0}})
    reported = solver_of(scenario, filter_models(scenario)[1], 12).point.reported_covariance
    assert (reported.is_computed, reported.has_correlations, reported.factor) == (True, True, 10.0)
    constant = solving(
        {**FILTERED, "reported_covariance": {"kind": "constant", "position_sigma": "3 m", "velocity_sigma": "1 m/s"}}
    )
    reported = solver_of(constant, filter_models(constant)[1], 12).filter.reported_covariance
    assert (reported.is_computed, reported.position_variance, reported.velocity_variance) == (False, 9.0, 1.0)
    numbers = ReceiverModel.model_validate({
        "pseudorange_sigma": "2 m", "range_rate_sigma": "0.1 m/s", "position_sigma": "5 m", "velocity_sigma": "0.5 m/s",
        "clock_h0": 0.0, "clock_h_minus2": 0.0,
    })  # fmt: skip
    stated = scenario.model_copy(update={"filter": scenario.filter.model_copy(update={"receiver": numbers})})
    reported = solver_of(stated, numbers, 12).point.reported_covariance
    assert (reported.is_computed, reported.position_variance) == (False, 25.0)


def test_the_filter_of_the_receiver_steps_by_the_interval_of_its_epochs():
    scenario = solving(FILTERED)
    fast = scenario.model_copy(update={"receiver": scenario.receiver.model_copy(update={"rate": 2.0})})
    solver = solver_of(fast, filter_models(fast)[1], 12)
    assert solver.filter.interval == 0.5
    assert np.isinf(solver.point.limits[4])
    assert solver_of(solving(POINT), filter_models(scenario)[1], 12).filter is None


def compensating(kind="buffered", coupling="tight", **fields):
    scenario = loaded(f"base.filter=filters/{coupling}")
    card = with_fields(scenario.filter, delay_compensation={"kind": kind, **fields})
    return scenario.model_copy(update={"filter": card})


def test_a_delay_is_the_stamped_one_or_the_filters_own_number():
    t = np.array([1.0, 2.0])
    assert compensated_delays(loaded(), t, t - 0.3) == ()
    (stamped,), (stated,) = (
        compensated_delays(compensating(**own), t, t - [0.3, 0.4]) for own in ({}, {"delay": "250 ms"})
    )
    assert stamped.sensor == stated.sensor == -1
    np.testing.assert_allclose(stamped.delay, [0.3, 0.4])
    np.testing.assert_array_equal(stated.delay, [0.25, 0.25])


@pytest.mark.parametrize(("delay", "stored"), [(0.3, 1), (0.95, 2), (1.0, 2), (1.1, 2), (2.5, 3), (3.1, 4)])
def test_a_longer_delay_stores_as_many_states_at_once_as_measurements_are_on_their_way(delay, stored):
    """With 1 s between epochs and 0.1 s of an early velocity: the state of an epoch is stored until it is over."""
    t, t_epoch = np.arange(0.0, 10.001, 0.005), np.arange(1.0, 11.0)
    delays = (CompensatedDelay(-1, np.full(10, delay)),)
    kept = clone_times(compensating(), t_epoch, delays, t, 1)
    ticks = np.arange(0, 2000, 20)
    none = np.full(100, -1)
    schedule = Schedule(ticks, np.full(100, 20), np.zeros(100), none, none, none, np.zeros(100))
    late = delay_processing(compensating(), delays, kept, schedule, Channels(True, ("G01",), ("G",), (True,)))
    assert (late.n_ring.tolist(), late.first.tolist(), late.line.tolist()) == ([stored], [0], [0, 0])
    assert late.is_buffered.tolist() == [True] * stored
    ends = t[ticks + 20]
    first, after = late.state_epochs[0, :, 0], late.state_epochs[0, :, 1]
    for epoch in range(10):
        at = np.flatnonzero((first <= epoch) & (epoch < after))
        if t_epoch[epoch] - delay >= 0.1:
            np.testing.assert_allclose(ends[at], t_epoch[epoch] - delay, atol=1e-9)


def test_states_are_kept_at_the_nearest_step_and_the_rest_is_an_offset():
    t = np.arange(0.0, 10.001, 0.01)
    delay = (CompensatedDelay(-1, np.array([0.3])),)
    (kept,) = clone_times(compensating("extrapolated", "loose"), np.array([5.0]), delay, t, 1)
    assert (kept.state_tick.tolist(), kept.velocity_tick.tolist()) == ([470], [460])
    assert (kept.offset[0], kept.base[0]) == (0.0, pytest.approx(0.1))
    (grouped,) = clone_times(compensating(), np.array([5.0]), (CompensatedDelay(-1, np.array([0.317])),), t, 4)
    assert grouped.state_tick.tolist() == [468]
    assert grouped.offset[0] == pytest.approx(0.003)
    assert clone_times(loaded(), np.array([5.0]), (), t, 1) == ()


def test_windows_know_which_epochs_state_is_kept_at_their_end():
    scenario = compensating()
    nothing = np.full(3, -1)
    schedule = Schedule(
        np.array([0, 70, 70]), np.array([70, 0, 30]), np.zeros(3), nothing, nothing, nothing, np.zeros(3)
    )
    delay, channels = (CompensatedDelay(-1, np.array([0.3])),), Channels(True, ("G01",), ("G",), (True,))
    kept = clone_times(scenario, np.array([1.0]), delay, np.arange(0.0, 2.001, 0.01), 1)
    late = delay_processing(scenario, delay, kept, schedule, channels)
    # a window of no ticks stores nothing a second time: first epoch and the one after the last
    assert late.state_epochs.tolist() == [[[0, 1], [0, 0], [1, 1]]]
    assert late.n_ring.tolist() == [1]
    assert not late.is_extrapolated
    assert delay_processing(loaded(), (), (), schedule, channels) is None
    assert has_covariance(compensating("extrapolated", "loose"))
    assert not has_covariance(scenario)
