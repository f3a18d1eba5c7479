"""What `matched` takes from the truth."""

from __future__ import annotations

import math

import pytest

from lvnav_trade.scenario.filter_models import filter_models
from tests.building import loaded, with_fields


def changed(**cards):
    scenario = loaded()
    return scenario.model_copy(
        update={name: with_fields(getattr(scenario, name), **fields) for name, fields in cards.items()}
    )


def test_matched_takes_every_number_from_the_truth():
    scenario = loaded()
    imu, receiver, initial = filter_models(scenario)
    assert imu.gyro_random_walk == scenario.imu.gyro.random_walk
    assert imu.accel_scale_factor == scenario.imu.accel.scale_factor
    assert imu.gyro_g_sensitivity == scenario.imu.gyro.g_sensitivity
    assert receiver.pseudorange_sigma == scenario.receiver.pseudorange_sigma
    assert receiver.velocity_sigma == scenario.receiver.solution.velocity_sigma
    assert receiver.clock_h0 == scenario.receiver.clock.h0
    assert (initial.tilt, initial.heading) == (scenario.initial.tilt, scenario.initial.heading)
    assert initial.clock_bias == scenario.receiver.clock.initial_bias


def test_a_matched_bias_holds_repeatability_and_instability_and_drifts_as_both_walks():
    scenario = changed(imu={
        "gyro.bias_repeatability": "3 deg/h", "gyro.bias_instability": "4 deg/h", "gyro.instability_time": "200 s",
        "gyro.rate_random_walk": "0 rad/s**1.5",
    })  # fmt: skip
    imu, _, _ = filter_models(scenario)
    unit = math.radians(1.0) / 3600.0
    assert imu.gyro_bias == pytest.approx(5.0 * unit, rel=1e-12)
    # a Gauss-Markov process of sigma and time constant begins to drift as a walk of density 2 sigma^2 / tau
    assert imu.gyro_bias_walk == pytest.approx(4.0 * unit * math.sqrt(2.0 / 200.0), rel=1e-12)
    assert imu.gyro_bias_time is None


def test_a_filter_model_of_the_filters_own_stands_instead_of_the_truth():
    own = {
        "tilt": "9 mrad", "heading": "8 mrad", "position": "7 m", "velocity": "6 m/s", "clock_bias": "5 m",
        "clock_drift": "4 m/s",
    }  # fmt: skip
    _, receiver, initial = filter_models(changed(filter={"initial": own}))
    assert (initial.tilt, initial.position, initial.clock_drift) == pytest.approx((9e-3, 7.0, 4.0), rel=1e-12)
    assert receiver.pseudorange_sigma == loaded().receiver.pseudorange_sigma
