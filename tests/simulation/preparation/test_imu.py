"""The true IMU in numbers: noise of a tick, errors of every run, the disturbance of gravity behind its own terms."""

from __future__ import annotations

import numpy as np
import pytest

from tests.building import MATCHED, case, loaded, prepare_hop, with_fields


def test_the_units_noise_per_tick_follows_from_its_root_density():
    prepared_case = case(MATCHED)
    gyro, accel = prepared_case.scenario.imu.gyro, prepared_case.scenario.imu.accel
    expected = [gyro.random_walk * np.sqrt(0.005), accel.random_walk * np.sqrt(0.005)]
    np.testing.assert_allclose(prepared_case.unit.white[[0, 3]], expected, rtol=1e-14)


def test_a_step_of_a_fault_grows_within_a_fraction_of_a_tick_and_ends_by_its_opposite():
    fault = {"kind": "accel_bias_step", "size": ["1 m/s^2", "0 m/s^2", "-2 m/s^2"], "start": "5 s", "duration": "3 s"}
    unit = prepare_hop(with_fields(loaded(), faults=[fault])).unit
    np.testing.assert_array_equal(unit.profile, [[1.0, 0.0, -2.0], [-1.0, 0.0, 2.0]])
    np.testing.assert_array_equal(unit.profile_start, [5.0, 8.0])
    assert np.all((unit.profile_end > unit.profile_start) & (unit.profile_end - unit.profile_start < 1e-3 * unit.dt))
    assert unit.is_drifting


def test_a_gravity_disturbance_stands_behind_the_terms_of_the_imu():
    """Its sigma holds: what is left after a step, and what the step adds, are its variance again."""
    prepared_case = prepare_hop(with_fields(loaded(MATCHED), gravity={"sigma": "30 mGal", "time": "20 s"}))
    unit = prepared_case.unit
    assert [prepared_case.sources[unit.gravity].name, unit.sensors.size] == ["gravity disturbance", unit.gravity]
    held = unit.decay[unit.gravity] ** 2 * 9e-8 + unit.walk[unit.gravity] ** 2
    np.testing.assert_allclose(held, 9e-8, rtol=1e-12)
    assert unit.decay[unit.gravity] == pytest.approx(np.exp(-unit.process_ticks * unit.dt / 20.0), rel=1e-14)
