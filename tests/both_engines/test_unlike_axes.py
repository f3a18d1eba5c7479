"""White noise of axes that differ: it is in axes of the body, which turn, in truth and in what the filter assumes."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from lvnav_trade.covariance.history import adjoint, covariance
from lvnav_trade.simulation.montecarlo import run_block
from tests.both_engines.test_closed_forms import FORCE, SECONDS, at_end
from tests.building import LOOSE, MATCHED, flight, loaded, prepare_hop, with_fields

RUNS = 400
WALK, NO_WALK = "5 deg/sqrt(h)", "0 deg/sqrt(h)"
SPEED_WALK, NO_SPEED = "50 mg/sqrt(Hz)", "0 mg/sqrt(Hz)"
ALONE = {
    "gyro z": {"gyro.random_walk": [NO_WALK, NO_WALK, WALK], "accel.random_walk": NO_SPEED},
    "accelerometer x": {"gyro.random_walk": NO_WALK, "accel.random_walk": [SPEED_WALK, NO_SPEED, NO_SPEED]},
}


def sideways(t):
    """Attitude of a body turned by 90 deg about z: its x axis is y of frame i, its y axis is -x."""
    return np.tile([math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)], (len(t), 1))


@cache
def across():
    """Constant force along z, the body turned by 90 deg, far from the Earth, for 100 s."""
    there = {"r": np.array([0.0, 1e10, 1e9]), "v": np.array([10.0, 0.0, 0.0])}
    return flight([(SECONDS, lambda t: np.array([0.0, 0.0, FORCE]))], sideways, **there)


@cache
def case(alone, *settings):
    scenario = loaded(LOOSE, MATCHED, *settings)
    return prepare_hop(scenario.model_copy(update={"imu": with_fields(scenario.imu, **ALONE[alone])}))


@pytest.mark.parametrize(
    ("sensor", "unit", "at", "expected"),
    [("gyro", "rad/s**0.5", 0, (1e-5, 0.0, 2e-5)), ("accel", "m/s**1.5", 3, (0.0, 1e-5, 2e-5))],
    ids=["attitude, in axes of the body", "velocity, in axes of the frame"],
)
def test_of_a_body_turned_by_90_degrees_noise_along_x_is_along_y_of_the_frame(sensor, unit, at, expected):
    walk = {"random_walk": [f"{size} {unit}" for size in (1e-5, 0.0, 2e-5)]}
    found = at_end(**{sensor: walk}, trajectory=across())
    for sigma in (found.true_sigma[-1], found.formal_sigma[-1]):
        np.testing.assert_allclose(sigma[at : at + 3], np.multiply(expected, math.sqrt(SECONDS)), rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("settings", [(), ("base.filter.algorithm=unscented",)], ids=["by the transition", "by points"])
@pytest.mark.parametrize("alone", ALONE)
def test_runs_linear_covariance_and_the_filter_agree_on_a_vehicle_that_turns(alone, settings):
    prepared_case = case(alone, *settings)
    history, runs = covariance(prepared_case), run_block(prepared_case, 4, 0, RUNS)
    spread, formal = np.std(runs.err, axis=0)[-1, :9], history.formal_sigma[-1, :9]
    # the standard deviation of 400 is known to 1 / sqrt(800), 3.5 %
    np.testing.assert_allclose(history.true_sigma[-1, :9], spread, rtol=4.0 / math.sqrt(2.0 * RUNS))
    np.testing.assert_allclose(formal, history.true_sigma[-1, :9], rtol=0.02)


def test_the_budget_found_backwards_has_the_noise_of_unlike_axes_too():
    prepared_case = case("gyro z")
    history, back = covariance(prepared_case), adjoint(prepared_case, float(prepared_case.t_hist[-1]))
    total = back.contribution[:9].sum(axis=(1, 2))
    np.testing.assert_allclose(total, history.true_sigma[-1, :9] ** 2, rtol=1e-6)
    assert back.contribution[:3, back.sources.index("gyro random walk")].sum() > 0.5 * total[:3].sum()


def test_axes_that_are_alike_have_no_part_of_their_own():
    assert case("gyro z").model.excess_density is not None
    same = with_fields(loaded(LOOSE).imu, **{"gyro.random_walk": [WALK] * 3})
    assert prepare_hop(loaded(LOOSE).model_copy(update={"imu": same})).model.excess_density is None
