"""The filter's steps on a prepared case: rows of an epoch, feedback, propagation of what it estimates."""

from __future__ import annotations

import numpy as np

from lvnav_trade.filter.ekf import clear_epoch, correct, place_antenna, predict_window
from lvnav_trade.kernels.attitude import matrix, small_rotation
from lvnav_trade.kernels.strapdown import Q, R, V
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.simulation.run_arrays import new_work
from tests.building import case, loaded, prepare_hop, with_fields


def work_of(prepared_case):
    work, _ = new_work(prepared_case, uses_lanes=False)
    work.nav[:] = prepared_case.initial_state.nav
    work.P[:] = prepared_case.initial_state.P
    return work


def test_feedback_adds_the_error_to_the_estimate():
    prepared_case = case()
    work, x = work_of(prepared_case), np.arange(1.0, 18.0) * 1e-4
    work.x[:] = x
    before = work.nav.copy()
    correct(work, None, None, prepared_case.model)
    np.testing.assert_allclose(small_rotation(*work.nav[Q : Q + 4], *before[Q : Q + 4]), x[ATT : ATT + 3], atol=1e-15)
    np.testing.assert_allclose(work.nav[V : V + 3] - before[V : V + 3], x[VEL : VEL + 3], atol=1e-12)
    np.testing.assert_allclose(work.nav[R : R + 3] - before[R : R + 3], x[POS : POS + 3], atol=2e-9)
    np.testing.assert_allclose(work.par.ravel(), x[9:15])
    np.testing.assert_allclose(work.clock_hat, x[15:])
    np.testing.assert_array_equal(work.x, 0.0)
    # what is estimated is what the next window takes off
    np.testing.assert_allclose(work.tables[0, :3], x[9:12])
    np.testing.assert_allclose(work.tables[1, :3], x[12:15])


def test_the_antenna_swings_with_the_rate_of_the_last_tick():
    scenario = loaded()
    receiver = with_fields(scenario.receiver, lever_b=["1 m", "2 m", "-1 m"])
    prepared_case = prepare_hop(scenario.model_copy(update={"receiver": receiver}))
    work = work_of(prepared_case)
    work.previous[:3] = 0.005 * np.array([0.1, -0.2, 0.3])
    place_antenna(work, None, None, prepared_case.model, 0.005, 0)
    C = np.reshape(np.array(matrix(*work.nav[Q : Q + 4])), (3, 3))
    lever = np.array([1.0, 2.0, -1.0])
    np.testing.assert_allclose(work.antenna[0, :3], work.nav[R : R + 3] + C @ lever, rtol=1e-14)
    np.testing.assert_allclose(
        work.antenna[0, 3:6], work.nav[V : V + 3] + C @ np.cross([0.1, -0.2, 0.3], lever), rtol=1e-13
    )


def test_an_epoch_starts_with_no_rows_and_no_innovations():
    prepared_case = case()
    work = work_of(prepared_case)
    work.nis[2], work.n_row[2], work.n_reject[2] = 5.0, 6.0, 7.0
    clear_epoch(work, 2)
    assert (work.nis[2], work.n_row[2], work.n_reject[2]) == (0.0, 0.0, 0.0)
    assert np.isnan(work.innovation[2]).all()


def test_a_clock_estimate_runs_on_by_its_drift_and_a_gauss_markov_estimate_decays():
    scenario = loaded()
    model = {
        "gyro_random_walk": "0.03 deg/sqrt(h)", "accel_random_walk": "50 ug/sqrt(Hz)", "gyro_bias": "1 deg/h",
        "gyro_bias_time": "2 s", "accel_bias": "2 mg",
    }  # fmt: skip
    prepared_case = prepare_hop(scenario.model_copy(update={"filter": with_fields(scenario.filter, imu=model)}))
    work = work_of(prepared_case)
    work.clock_hat[:], work.par[:] = [100.0, -3.0], 1.0
    length_index = int(np.argmax(prepared_case.lengths))
    seconds = prepared_case.lengths[length_index]
    predict_window(work, prepared_case.model, length_index, -1)
    np.testing.assert_allclose(work.clock_hat, [100.0 - 3.0 * seconds, -3.0], rtol=1e-15)
    np.testing.assert_allclose(work.par[0], np.exp(-seconds / 2.0), rtol=1e-14)
    np.testing.assert_array_equal(work.par[1], 1.0)
    np.testing.assert_allclose(work.tables[0, :3], np.exp(-seconds / 2.0), rtol=1e-14)
