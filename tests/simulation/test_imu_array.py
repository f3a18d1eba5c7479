"""What several inertial units put out in a run, and what it is fused to."""

from __future__ import annotations

import numpy as np

from lvnav_trade.covariance.history import covariance
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import IDEAL, INERTIAL, loaded, prepare_hop, with_units


def test_a_set_of_one_unit_is_that_unit_to_the_last_bit():
    scenario = loaded("base.imu=imu/tactical_fog", "base.filter=filters/tight", "base.imu.gyro.quantisation=1e-7 rad")
    one, many = (run_block(prepare_hop(s), 3, 0, 2) for s in (scenario, with_units(scenario, [{}])))
    assert np.array_equal(one.err, many.err)
    assert np.array_equal(one.nis, many.nis)


def test_units_draw_errors_of_their_own_and_the_first_those_of_a_unit_alone():
    scenario = loaded(INERTIAL, "base.imu=imu/tactical_fog", *IDEAL)
    alone, pair = prepare_hop(scenario), prepare_hop(with_units(scenario, [{}, {}]))
    n = alone.unit.sources.size
    assert np.array_equal(pair.unit.sources[:n], alone.unit.sources)
    assert pair.options.imu_array.noise_sources[0] == alone.unit.noise_source
    words = {*pair.unit.sources.tolist(), *pair.options.imu_array.noise_sources.tolist()}
    assert len(words) == pair.unit.sources.size + 2


def test_a_lever_arm_that_is_compensated_leaves_in_a_run_what_the_mean_of_linear_covariance_has():
    units = [{}, {"lever_arm": ["2 m", "1 m", "-1 m"]}]
    still = {"gyro": {"random_walk": "1e-9 rad/s**0.5"}, "accel": {"random_walk": "1e-6 m/s**1.5"}}
    scenario = with_units(loaded(INERTIAL, *IDEAL), [still | unit for unit in units])
    prepared_case = prepare_hop(scenario)
    found, block = covariance(prepared_case), run_block(prepared_case, 5, 0, 1)
    off = np.abs(block.err[0, 1:, 3:6] - found.mean[1:, 3:6]) / np.maximum(found.true_sigma[1:, 3:6], 1e-9)
    assert np.max(off) < 5.0
