"""Bounds of the noise that a filter assumes: by closed form where there is one, by rank where a state has none."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.covariance.diagnostics.error_bound import error_bound
from lvnav_trade.covariance.history import forward_tape
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.scenario.filter_models import filter_models
from tests.building import LOOSE, case, loaded, prepare_hop, with_fields

WALKS = {
    "gyro_random_walk": "0.05 deg/sqrt(h)", "accel_random_walk": "0.1 mg/sqrt(Hz)", "gyro_bias": "2 deg/h",
    "gyro_bias_walk": "1 deg/h/sqrt(h)", "accel_bias": "3 mg", "accel_bias_walk": "1 mg/sqrt(h)",
}  # fmt: skip


def bound(prepared_case):
    return error_bound(prepared_case, forward_tape(prepared_case))


def with_walks(*settings, **changed):
    scenario = loaded(*settings)
    return prepare_hop(with_fields(scenario, **{"filter.imu": {**WALKS, **changed}}))


@pytest.mark.parametrize("settings", [(), (LOOSE,)], ids=["tight", "loose"])
def test_where_everything_walks_the_condition_holds(settings):
    found = bound(with_walks(*settings))
    assert found.is_satisfied
    assert found.rank == found.state_count
    assert 0.0 < found.smallest_eigenvalue < found.largest_eigenvalue


@pytest.mark.parametrize(("which", "missing"), [("gyro", 3), ("accel", 3)])
def test_a_bias_without_a_walk_breaks_it_and_is_the_weakest_direction(which, missing):
    prepared_case = with_walks(
        LOOSE, **{f"{which}_bias_walk": "0 deg/h/sqrt(h)" if which == "gyro" else "0 mg/sqrt(h)"}
    )
    found = bound(prepared_case)
    assert found.rank == found.state_count - missing
    assert not found.is_satisfied
    assert found.smallest_eigenvalue == pytest.approx(0.0, abs=1e-18)
    bias = next(block for block in prepared_case.layout.parameters if block.name == f"{which}_bias").offset
    assert int(np.argmax(np.abs(found.weakest_direction))) in range(bias, bias + 3)


def test_the_largest_is_that_of_a_walk_that_outgrows_all_others_by_its_closed_form():
    # 1 s between updates; a bias that walks by far the most in initial sigmas: q' = density x 1 s / sigma^2
    prepared_case = with_walks(LOOSE, accel_bias_walk="60 mg/sqrt(h)", accel_bias="0.1 mg")
    imu, _, _ = filter_models(prepared_case.scenario)
    assert bound(prepared_case).largest_eigenvalue == pytest.approx(
        imu.accel_bias_walk**2 / imu.accel_bias**2, rel=1e-2
    )


def test_noise_at_a_change_of_region_enters_the_interval_that_it_lies_in():
    entry = {"from": "10 s", "velocity": "1 m/s"}
    scenario = loaded(LOOSE)
    plain, added = (
        bound(prepare_hop(scenario)),
        bound(prepare_hop(with_fields(scenario, **{"filter.region_noise": [entry]}))),
    )
    assert added.smallest_eigenvalue == pytest.approx(plain.smallest_eigenvalue, abs=1e-12)
    # 1 m/s beside 1 cm/s at the start
    assert added.largest_eigenvalue == pytest.approx(1.0 / scenario.initial.velocity**2, rel=1e-3)


def test_rows_have_the_noise_of_the_receiver():
    scenario = loaded(LOOSE)
    (first, second), solution = bound(case(LOOSE)).noise_bounds, scenario.receiver.solution
    assert first[0] == "m"
    assert first[1:] == pytest.approx((solution.position_sigma, solution.position_sigma))
    assert second[0] == "m/s"
    assert second[1:] == pytest.approx((solution.velocity_sigma, solution.velocity_sigma))


def test_without_a_measurement_there_is_nothing_to_tell():
    faults = [{"kind": "satellite_outage", "start": "-1 s", "duration": "100 s"}]
    with pytest.raises(InputError, match="uses no measurement on this trajectory"):
        bound(prepare_hop(with_fields(loaded(LOOSE), faults=faults)))
