"""The forward pass itself: symmetric and positive covariances; what the mode logic does on the nominal flight."""

from __future__ import annotations

import numpy as np

from lvnav_trade.covariance.history import covariance
from lvnav_trade.simulation.montecarlo import run_block
from tests.both_engines.modelled import modelled
from tests.building import LOOSE, MATCHED, case, loaded, prepare_hop, with_fields


def test_covariances_are_symmetric_and_positive_all_along():
    history = covariance(modelled())
    for P in (history.formal_cov, history.true_cov):
        np.testing.assert_allclose(P, np.swapaxes(P, 1, 2), rtol=0.0, atol=1e-12 * np.abs(P).max())
        sigma = np.sqrt(np.diagonal(P, axis1=1, axis2=2))[5:]
        correlation = P[5:] / (sigma[:, :, None] * sigma[:, None, :])
        assert np.linalg.eigvalsh(correlation).min() > -1e-9


def test_a_filter_that_expects_more_than_comes_assumes_no_less_than_is_true():
    history = covariance(modelled())
    late = history.t > 5.0
    assert (history.formal_sigma[late] > 0.999 * history.true_sigma[late]).all()


def test_a_case_without_a_model_of_the_vehicle_has_the_filters_states_and_nothing_else():
    prepared_case = case(LOOSE)
    assert covariance(prepared_case).true_sigma.shape == (prepared_case.t_hist.size, 15)
    assert covariance(modelled()).true_sigma.shape == (modelled().t_hist.size, 36)


def test_on_the_nominal_flight_the_mode_logic_waits_and_predicts_as_in_the_runs():
    scenario = loaded(MATCHED, LOOSE)
    logic = {"start_after": 3, "wild_position": None, "wild_velocity": None}
    card = with_fields(scenario.filter, feedback="open", logic=logic)
    loss = {"kind": "satellite_outage", "start": "12 s", "duration": "3 s"}
    prepared_case = prepare_hop(with_fields(scenario.model_copy(update={"filter": card}), faults=[loss]))
    history, block = covariance(prepared_case), run_block(prepared_case, 3, 0, 8)
    np.testing.assert_array_equal(history.n_row, block.n_row[0])
    assert np.all(history.n_row[:2] == 0)
    np.testing.assert_array_equal(history.n_row[11:14], 0)
    assert history.n_row.max() == 6
    accepted = np.sqrt(np.mean(block.sigma[:, :, :9] ** 2, axis=0))
    np.testing.assert_allclose(accepted, history.formal_sigma[:, :9], rtol=5e-3)
