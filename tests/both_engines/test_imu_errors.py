"""Nonlinearity of the accelerometers: neglected, as a state, covered by a larger walk of the scale factor."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from lvnav_trade.covariance.history import covariance
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import MATCHED, ascent

CURVED = (MATCHED, "base.imu.accel.nonlinearity=3 percent", "base.imu.accel.scale_factor=300 ppm")
ASSUMED = {
    "gyro_random_walk": "0.03 deg/sqrt(h)", "accel_random_walk": "0.05 mg/sqrt(Hz)", "gyro_bias": "1 deg/h",
    "gyro_bias_walk": "0.1 deg/h/sqrt(h)", "accel_bias": "2 mg", "accel_bias_walk": "0.5 mg/sqrt(h)",
    "accel_scale_factor": "300 ppm", "accel_scale_factor_walk": "4 percent/sqrt(h)",
}  # fmt: skip
WAYS = {
    "neglected": ("base.filter.extra_states=[accel_scale_factor]",),
    "state": ("base.filter.extra_states=[accel_scale_factor, accel_nonlinearity]",),
    "covered": (
        "base.filter.extra_states=[accel_scale_factor]",
        "base.filter.imu={" + ", ".join(f"{key}: {value}" for key, value in ASSUMED.items()) + "}",
    ),
}
RUNS = 40


@cache
def of(way):
    case = ascent(*CURVED, *WAYS[way])
    return case, covariance(case), run_block(case, 9, 0, RUNS)


def speed(way, event="stage1_cutoff"):
    """Formal, true and flown one-sigma of the velocity error (m/s), 3-D, at an event: at cutoff the force falls."""
    case, history, runs = of(way)
    at = int(np.argmin(np.abs(case.t_hist - case.trajectory.events[event])))
    flown = np.sqrt(np.mean(np.sum(runs.err[:, at, 3:6] ** 2, axis=1)))
    return *(float(np.linalg.norm(one[at, 3:6])) for one in (history.formal_sigma, history.true_sigma)), float(flown)


@pytest.mark.parametrize("event", ["stage1_cutoff", "injection"])
@pytest.mark.parametrize("way", WAYS)
def test_runs_and_linear_covariance_agree_whatever_the_filter_does_about_it(way, event):
    _, true, flown = speed(way, event)
    assert flown == pytest.approx(true, rel=0.2)  # 120 components, correlated: 0.07 is one sigma


def test_a_neglected_nonlinearity_makes_the_filter_optimistic_and_a_state_consistent():
    formal, true, _ = speed("neglected")
    assert true > 10.0 * formal
    case, history, _ = of("state")
    assert speed("state")[0] == pytest.approx(speed("state")[1], rel=1e-6)
    np.testing.assert_allclose(history.expected_nees, case.layout.n_state, rtol=1e-3)


def test_a_larger_walk_of_the_scale_factor_covers_it():
    formal, true, _ = speed("covered")
    assert formal > true
    assert true < 0.1 * speed("neglected")[1]
    assert true > speed("state")[1]


def test_the_slope_along_the_thrust_is_estimated():
    case, history, runs = of("state")
    along, *across = (k for k, one in enumerate(case.outputs) if one.quantity == "accel_nonlinearity")
    assert history.true_sigma[-1, along] < 0.02 * history.true_sigma[0, along]
    assert all(history.true_sigma[-1, k] > 0.99 * history.true_sigma[0, k] for k in across)
    flown = np.sqrt(np.mean(runs.err[:, -1, along] ** 2))
    assert flown == pytest.approx(history.true_sigma[-1, along], rel=0.4)
