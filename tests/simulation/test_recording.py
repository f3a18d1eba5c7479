"""What a run leaves at a history time: errors defined once, the sum of an open loop, samples of the IMU."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.filter.ekf import correct
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.attitude import matrix
from lvnav_trade.kernels.random import seed_words
from lvnav_trade.kernels.strapdown import R, V
from lvnav_trade.kernels.transition import ACCEL, GYRO, OTHER_0, OWN_0, POS, SQUARE, VEL
from lvnav_trade.simulation.epoch.filter_case import OptionalState, case_of
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.inputs import Options
from lvnav_trade.simulation.recording import N_SAMPLE_OUTPUT, record, true_parameter
from lvnav_trade.simulation.run_arrays import new_work
from lvnav_trade.simulation.sensing import draw_initial_state
from tests.both_engines.modelled import BASELINE, modelled
from tests.building import LOOSE, case, loaded, prepare_hop, with_fields
from tests.simulation.test_flight_loop import scene


def recorded(work, prepared_case, history, hist, open_loop=None):
    alone = case_of(prepared_case, options=Options())  # no mode logic, no part of another option
    record(work, OptionalState(open_loop=open_loop), alone, None, history, 0, hist)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_error_that_is_injected_computed_and_fed_back_leaves_nothing(seed):
    """Error definition: inject by the start, compute by the record, feed back by the filter, compute again: 1e-12."""
    prepared_case, work = scene()
    model, start = prepared_case.model, prepared_case.initial_state
    k0, k1 = seed_words(seed)
    q = draw_initial_state(work, start, k0, k1, np.uint64(seed))
    work.nav[:4] = q
    at_start = prepared_case.record._replace(axes=np.tile(np.eye(3), (prepared_case.t_hist.size, 1, 1)))
    work.P[:] = np.eye(model.n_state)
    work.par[:] = [[1e-6, -2e-6, 3e-6], [1e-2, -2e-2, 3e-2]]
    work.clock[:] = [300.0, -3.0]
    recorded(work, prepared_case, at_start, 0)
    error = work.err[0].copy()
    C = np.reshape(np.array(matrix(*prepared_case.record.q[0])), (3, 3))
    work.x[:] = error
    work.x[:3] = C @ error[:3]  # reported in body axes, fed back in frame i
    assert np.abs(error[:9]).min() > 0.0
    correct(work, None, None, model)
    np.testing.assert_array_equal(work.x, 0.0)
    recorded(work, prepared_case, at_start, 0)
    left = work.err[0]
    np.testing.assert_allclose(left[:3], 0.0, atol=1e-12)
    np.testing.assert_allclose(left[3:6], 0.0, atol=1e-12)  # a float64 of 4 km/s counts in 1e-12 m/s
    np.testing.assert_allclose(left[6:9], 0.0, atol=2e-9)  # and one of 7000 km in 1e-9 m
    np.testing.assert_allclose(left[9:], 0.0, atol=1e-12)


def test_the_true_value_of_a_state_is_the_sum_of_all_parameters_of_its_driver():
    values = np.random.default_rng(1).standard_normal((4, 3))
    sensors, drivers = np.array([GYRO, GYRO, ACCEL, GYRO]), np.array([OWN_0 + 1, OWN_0 + 1, SQUARE, OTHER_0 + 2])
    tables = np.zeros((2, processes.N_TABLE))
    processes.gather(tables, values, sensors, drivers)
    for axis in range(3):
        assert true_parameter(tables, GYRO, OWN_0 + 1, axis) == pytest.approx(values[0, axis] + values[1, axis])
        assert true_parameter(tables, ACCEL, SQUARE, axis) == values[2, axis]
        assert true_parameter(tables, GYRO, OTHER_0 + 2, axis) == values[3, axis]
        assert true_parameter(tables, ACCEL, OTHER_0 + 2, axis) == 0.0


def test_of_an_open_loop_the_sum_is_recorded_and_the_inertial_system_stays_as_it_was():
    scenario = loaded(LOOSE)
    scenario = scenario.model_copy(update={"filter": with_fields(scenario.filter, feedback="open")})
    prepared_case = prepare_hop(scenario)
    work, optional_state = new_work(prepared_case, uses_lanes=False)
    work.nav[:], work.P[:] = prepared_case.initial_state.nav, np.eye(prepared_case.model.n_state)
    x = 1e-3 * np.arange(1.0, prepared_case.model.n_state + 1.0)
    axes = np.tile(np.eye(3), (prepared_case.t_hist.size, 1, 1))
    history = prepared_case.record._replace(axes=axes)
    recorded(work, prepared_case, history, 0, optional_state.open_loop)
    alone = work.err[0].copy()
    work.x[:] = x
    recorded(work, prepared_case, history, 0, optional_state.open_loop)
    np.testing.assert_allclose(alone[VEL : VEL + 3] - work.err[0, VEL : VEL + 3], x[VEL : VEL + 3], atol=1e-11)
    np.testing.assert_allclose(alone[POS : POS + 3] - work.err[0, POS : POS + 3], x[POS : POS + 3], atol=2e-9)
    np.testing.assert_allclose(alone[9:15] - work.err[0, 9:15], x[9:15], atol=1e-15)
    np.testing.assert_array_equal(work.x, x)
    np.testing.assert_array_equal(work.nav[[V, R]], prepared_case.initial_state.nav[[V, R]])
    assert not work.par.any()


def test_samples_are_recorded_raw_and_less_the_estimated_bias():
    prepared_case = modelled(BASELINE)
    block, samples, n = (
        run_block(prepared_case, 5, 0, 8),
        prepared_case.options.reported_samples,
        prepared_case.model.n_state,
    )
    assert block.err.shape[2] == n + N_SAMPLE_OUTPUT
    np.testing.assert_allclose(block.sigma[:, 1:, n : n + 6], np.broadcast_to(np.sqrt(samples.raw), (8, 30, 6)))
    raw, corrected = block.err[:, 1:, n : n + 6], block.err[:, 1:, n + 6 :]
    # raw less corrected is minus the estimate; truth minus estimate is the error of the bias: both give one true bias
    truth = block.err[:, 1:, samples.bias] - (raw - corrected)
    np.testing.assert_allclose(truth, np.broadcast_to(truth[:, :1], truth.shape), atol=1e-12)


def test_a_case_without_an_attitude_reference_reports_no_samples():
    assert case(LOOSE).options.reported_samples is None
    assert len(case(LOOSE).outputs) == case(LOOSE).model.n_state
