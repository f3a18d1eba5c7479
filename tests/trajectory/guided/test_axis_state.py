"""Initial state of the attitude loop, and the ignition of a motor: keyed draws and their variances."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.trajectory.control_cards import FeedbackCard
from lvnav_trade.trajectory.guided import autopilot, axis_state
from lvnav_trade.trajectory.guided.missions import controlled_attitude
from tests.trajectory.guided.launches import steady_launch

RUNS = 400


def control(run: int = 0, **given):
    launch = steady_launch(1.0, nozzle={"misalignment": "0.5 deg"}, **given)
    draws = autopilot.DrawKeys(np.uint64(1), np.uint64(2), np.uint64(run))
    return controlled_attitude(launch, FeedbackCard(), draws)


def test_a_run_begins_on_the_nominal_attitude_with_the_commanded_rate():
    begun = control(rate=(0.01, -0.02), turn_rate=(0.005, 0.0))
    state = begun.memory
    assert not state[:, [axis_state.ANGLE_NOW, axis_state.RATE_NOW, axis_state.NOZZLE_NOW]].any()
    np.testing.assert_allclose(state[:, axis_state.COMMANDED_RATE], [0.015, -0.02])
    np.testing.assert_allclose(state[:, axis_state.RATE_ESTIMATE], [0.01, -0.02])
    assert begun.counts.tolist() == [0, -1, 0, 1]


def test_initial_draws_depend_on_the_run_alone_and_have_the_stationary_covariance_of_the_gusts():
    np.testing.assert_array_equal(control(3).memory, control(3).memory)
    gusts = np.array([control(run).memory[:, [axis_state.GUST_1, axis_state.GUST_2]] for run in range(RUNS)])
    first, second = gusts.reshape(-1, 2).T
    assert np.mean(first**2) == pytest.approx(1.0, abs=0.2)
    assert np.mean(second**2) == pytest.approx(1.0, abs=0.2)
    assert np.mean(first * second) == pytest.approx(np.sqrt(0.5), abs=0.15)


def test_an_ignition_centres_the_nozzle_and_draws_the_misalignment_of_the_stage():
    lit = control(5)
    lit.memory[:, [axis_state.NOZZLE_NOW, axis_state.INTEGRAL, axis_state.COMMAND_NOW]] = 0.1
    axis_state.ignite(lit, 2, 0.01, -0.02)
    drawn = lit.memory[:, axis_state.MISALIGNMENT_NOW] - [0.01, -0.02]
    assert not lit.memory[:, [axis_state.NOZZLE_NOW, axis_state.INTEGRAL, axis_state.COMMAND_NOW]].any()
    assert 0.0 < np.abs(drawn).min() < 5.0 * np.radians(0.5)
    assert (lit.counts[autopilot.MOTOR], lit.counts[autopilot.JUST_IGNITED]) == (2, 1)
    axis_state.ignite(lit, 0, 0.01, -0.02)
    assert not lit.memory[:, axis_state.MISALIGNMENT_NOW].any()  # no motor burns
