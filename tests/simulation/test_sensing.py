"""What is true in one run: profiles of bias, dropped samples."""

from __future__ import annotations

import numpy as np

from lvnav_trade.kernels.processes import profile_value
from tests.building import loaded, prepare_hop, with_fields


def unit_with(faults=(), **imu):
    scenario = loaded()
    scenario = scenario.model_copy(update={"imu": with_fields(scenario.imu, **imu)})
    return prepare_hop(with_fields(scenario, faults=list(faults))).unit


def test_a_profile_grows_between_its_times_and_then_stays():
    ramp = {"start": "5 s", "end": "15 s", "amplitude": ["1e-4 rad/s", "0 rad/s", "-2e-4 rad/s"]}
    unit = unit_with(**{"gyro.temperature": ramp})
    found = [[profile_value(unit, 0, axis, t) for axis in (0, 2)] for t in (0.0, 5.0, 10.0, 15.0, 25.0)]
    np.testing.assert_allclose(found, np.outer([0.0, 0.0, 0.5, 1.0, 1.0], [1e-4, -2e-4]), atol=1e-18)


def test_a_step_of_a_fault_comes_and_goes():
    step = {"kind": "gyro_bias_step", "start": "8 s", "duration": "4 s", "size": ["1e-4 rad/s", "0 rad/s", "0 rad/s"]}
    unit = unit_with([step])
    total = [sum(profile_value(unit, p, 0, t) for p in range(2)) for t in (7.9, 8.1, 11.9, 12.1)]
    np.testing.assert_allclose(total, [0.0, 1e-4, 1e-4, 0.0], atol=1e-18)


def test_dropped_samples_are_gone_or_repeat_the_last():
    drop = {"kind": "dropped_samples", "start": "8 s", "duration": "20 ms"}
    plain, nothing, last = unit_with(), unit_with([drop]), unit_with([{**drop, "instead": "last"}])
    hit = np.flatnonzero(np.any(plain.dvel != nothing.dvel, axis=1))
    np.testing.assert_array_equal(hit, 1600 + np.arange(4))  # ticks that end after 8 s, at 200 Hz
    np.testing.assert_array_equal(nothing.dvel[hit], 0.0)
    np.testing.assert_array_equal(last.dvel[hit], np.tile(plain.dvel[1599], (4, 1)))
    np.testing.assert_array_equal(last.dtheta[hit], np.tile(plain.dtheta[1599], (4, 1)))
