"""Outputs beside the filter's states: the receiver's own solution and its innovations, runs against covariance."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import chi2, norm

from lvnav_trade.covariance.history import covariance
from lvnav_trade.covariance.outputs import append_sample_outputs, append_solution_outputs
from lvnav_trade.quantities.state_layout import solution_outputs
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.montecarlo import run_block
from tests.both_engines.modelled import BASELINE, modelled
from tests.building import LOOSE, MATCHED, case, loaded, prepare_hop

POINT = {"kind": "bancroft", "range_sigma": "2 m", "rate_sigma": "0.1 m/s", "reported": True}
FILTERED = {**POINT, "kind": "filtered", "jerk": "10 m/s^3", "clock_noise": "0.1 m/s^2"}
FILTERED["start_acceleration"] = "50 m/s^2"
RUNS = 200
N_STATE = 15


@lru_cache(maxsize=2)
def analyse(kind: str):
    """Prepare, cover and fly a short flight whose receiver tells its own solution, with multipath that lasts."""
    text = loaded(MATCHED, "base.filter=filters/loose", "base.receiver=receivers/l1_two_metre").model_dump(mode="json")
    text["faults"] = []
    text["receiver"] |= {"solution": POINT if kind == "bancroft" else FILTERED, "multipath": "1 m"}
    prepared_case = prepare_hop(Scenario.model_validate(text))
    return prepared_case, covariance(prepared_case), run_block(prepared_case, 7, 0, RUNS)


each = pytest.mark.parametrize("kind", ["bancroft", "filtered"])


@each
def test_errors_of_the_solution_lie_within_the_interval_of_the_true_sigma_and_about_its_mean(kind):
    prepared_case, history, runs = analyse(kind)
    assert prepared_case.outputs[N_STATE:] == solution_outputs(prepared_case.scenario.frame)
    at = [8, 16, len(prepared_case.t_hist) - 1]
    asked = 8 * len(at)
    low, high = np.sqrt(chi2.ppf([0.005 / asked, 1.0 - 0.005 / asked], RUNS - 1) / (RUNS - 1))
    ratio = runs.err[:, at, N_STATE:].std(axis=0, ddof=1) / history.true_sigma[at, N_STATE:]
    assert low < ratio.min() <= ratio.max() < high
    off = (runs.err[:, at, N_STATE:].mean(axis=0) - history.mean[at, N_STATE:]) / history.true_sigma[at, N_STATE:]
    assert np.abs(off * np.sqrt(RUNS)).max() < norm.isf(0.005 / asked)
    np.testing.assert_allclose(history.budget.sum(axis=1), history.true_sigma**2, rtol=1e-9, atol=1e-30)


@each
def test_the_receiver_assumes_in_the_runs_what_it_assumes_on_the_nominal_flight(kind):
    _, history, runs = analyse(kind)
    accepted = np.sqrt(np.mean(runs.sigma[:, 5:, N_STATE:] ** 2, axis=0))
    np.testing.assert_allclose(accepted, history.formal_sigma[5:, N_STATE:], rtol=5e-3)


def test_innovations_are_reported_of_the_satellites_in_use_by_a_filter_alone():
    prepared_case, _, runs = analyse("filtered")
    n = 2 * len(prepared_case.sky.names)
    assert runs.innovation.shape[2] == 6 + n
    assert analyse("bancroft")[2].innovation.shape[2] == 6
    used = np.isfinite(runs.innovation[0, -1, 6:]).reshape(-1, 2)
    last = prepared_case.signals.satellite_by_slot[-1, : prepared_case.signals.n_used[-1]]
    assert np.flatnonzero(used.all(axis=1)).tolist() == sorted(last.tolist())


def test_without_a_solution_the_error_of_the_last_one_stays():
    """Of twelve satellites none from the tenth epoch on: what is reported does not move any more, in both engines."""
    prepared_case, _, _ = analyse("bancroft")
    n_used = prepared_case.signals.n_used.copy()
    n_used[10:] = 0
    chain = prepared_case.chain._replace(has_solution=np.arange(n_used.size) < 10)
    blind = prepared_case._replace(signals=prepared_case.signals._replace(n_used=n_used), chain=chain)
    # velocity and position are reported in axes that move with the flight; the clock's two are not turned
    error, clock = run_block(blind, 7, 0, 8).err, slice(N_STATE + 6, N_STATE + 8)
    epoch = int(np.argmin(np.abs(blind.t_hist - blind.t_epoch[9])))
    assert np.all(error[:, epoch, clock] == error[:, -1, clock])
    assert np.any(error[:, epoch - 1, clock] != error[:, epoch, clock])
    assert not error[:, 0, N_STATE:].any()  # before the first epoch
    history = covariance(blind)
    assert np.all(history.true_sigma[epoch:, clock] == history.true_sigma[-1, clock])
    sizes = [np.linalg.norm(history.true_sigma[k, N_STATE : N_STATE + 3]) for k in (epoch, -1)]
    assert sizes[0] == pytest.approx(sizes[1], rel=1e-12)


def test_nothing_is_added_where_nothing_of_the_solution_is_reported():
    prepared_case = case(LOOSE)
    history = covariance(prepared_case)
    assert prepared_case.options.reported_solution is None
    assert append_solution_outputs(prepared_case, history, None) is history
    assert append_sample_outputs(prepared_case, None, history, None) is history
    assert history.formal_sigma.shape[1] == len(prepared_case.outputs) == N_STATE


def test_what_is_reported_stands_behind_the_states_and_apart_from_them():
    _, history, _ = analyse("bancroft")
    n = history.true_sigma.shape[1]
    assert history.formal_cov.shape == history.true_cov.shape == (len(history.t), n, n)
    assert not history.true_cov[:, :N_STATE, N_STATE:].any()
    np.testing.assert_allclose(
        np.diagonal(history.true_cov, axis1=1, axis2=2), history.true_sigma**2, rtol=1e-12, atol=1e-30
    )


def test_samples_have_noise_and_bias_raw_and_less_the_estimate():
    """Raw: noise and the whole bias; corrected: what of the bias is not known yet. Sources sum to the whole."""
    prepared_case = modelled(BASELINE)
    history, samples, n = (
        covariance(prepared_case),
        prepared_case.options.reported_samples,
        prepared_case.layout.n_state,
    )
    raw, corrected = history.true_sigma[:, n : n + 6], history.true_sigma[:, n + 6 :]
    np.testing.assert_allclose(raw, np.broadcast_to(np.sqrt(samples.raw), raw.shape), rtol=1e-9)
    left = history.true_sigma[:, samples.bias]
    np.testing.assert_allclose(corrected**2, left**2 + samples.variance, rtol=1e-9)
    assert np.all(corrected[-1] <= raw[-1])
    np.testing.assert_allclose(history.budget.sum(axis=1)[:, n:], history.true_sigma[:, n:] ** 2, rtol=1e-9)
