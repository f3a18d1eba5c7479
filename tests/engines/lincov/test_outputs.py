"""The receiver's own solution beside the filter's: runs against linear covariance, the innovations against the gain."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import chi2, norm

from lvnav_trade.engines import reported
from lvnav_trade.engines.lincov.history import covariance
from lvnav_trade.engines.montecarlo import run_block
from lvnav_trade.layout import solution_outputs
from lvnav_trade.receivers.base import POS, VEL, transition
from lvnav_trade.receivers.cascade import design, filtered
from lvnav_trade.scenario import Scenario
from tests.building import LOOSE, MATCHED, case, loaded, prepare_hop

POINT = {"kind": "bancroft", "range_sigma": "2 m", "rate_sigma": "0.1 m/s", "reported": True}
FILTERED = {**POINT, "kind": "filtered", "jerk": "10 m/s^3", "clock_noise": "0.1 m/s^2"}
FILTERED["start_acceleration"] = "50 m/s^2"
RUNS = 200
N_STATE = 15


@lru_cache(maxsize=2)
def flown(kind: str):
    """Prepare, cover and fly a short flight whose receiver tells its own solution, with multipath that lasts."""
    text = loaded(MATCHED, "base.filter=filters/loose", "base.receiver=receivers/l1_two_metre").model_dump(mode="json")
    text["faults"] = []
    text["receiver"] |= {"solution": POINT if kind == "bancroft" else FILTERED, "multipath": "1 m"}
    prepared = prepare_hop(Scenario.model_validate(text))
    return prepared, covariance(prepared), run_block(prepared, 7, 0, RUNS)


each = pytest.mark.parametrize("kind", ["bancroft", "filtered"])


@each
def test_errors_of_the_solution_lie_within_the_interval_of_the_true_sigma_and_about_its_mean(kind):
    prepared, history, runs = flown(kind)
    assert prepared.outputs[N_STATE:] == solution_outputs(prepared.scenario.frame)
    at = [8, 16, len(prepared.t_hist) - 1]
    asked = 8 * len(at)
    low, high = np.sqrt(chi2.ppf([0.005 / asked, 1.0 - 0.005 / asked], RUNS - 1) / (RUNS - 1))
    ratio = runs.err[:, at, N_STATE:].std(axis=0, ddof=1) / history.true_sigma[at, N_STATE:]
    assert low < ratio.min() <= ratio.max() < high
    off = (runs.err[:, at, N_STATE:].mean(axis=0) - history.mean[at, N_STATE:]) / history.true_sigma[at, N_STATE:]
    assert np.abs(off * np.sqrt(RUNS)).max() < norm.isf(0.005 / asked)
    np.testing.assert_allclose(history.budget.sum(axis=1), history.true_sigma**2, rtol=1e-9, atol=1e-30)


@each
def test_the_receiver_believes_in_the_runs_what_it_believes_on_the_nominal_flight(kind):
    _, history, runs = flown(kind)
    believed = np.sqrt(np.mean(runs.sigma[:, 5:, N_STATE:] ** 2, axis=0))
    np.testing.assert_allclose(believed, history.formal[5:, N_STATE:], rtol=5e-3)


def test_the_innovations_times_the_gain_are_what_the_receivers_filter_corrects(monkeypatch):
    """L^-1 y of all rows, taken through P H' L^-T, is the step of the kernel that took them one after the other."""
    prepared, _, _ = flown("filtered")
    within, original = [], reported._innovate

    def check(out, prepared, work, model, epoch, nav, P, memory):
        original(out, prepared, work, model, epoch, nav, P, memory)
        signals, state = prepared.signals, transition(model) @ nav
        use = signals.used[epoch, : signals.n_used[epoch]]
        rows = design(
            state[POS : POS + 3], state[VEL : VEL + 3], signals.satellite[epoch, use],
            signals.satellite_velocity[epoch, use],
        )  # fmt: skip
        gains = filtered(P, model, rows, np.zeros(3))
        before = np.linalg.solve(gains.keep, gains.P)  # (I - K H) P- = P+
        root = np.linalg.cholesky(rows @ before @ rows.T + np.diag(np.tile([4.0, 0.01], use.size)))
        normalised = np.stack([out[2 * use], out[2 * use + 1]], axis=1).ravel()
        corrected = before @ rows.T @ np.linalg.solve(root.T, normalised)
        within.append(np.abs(corrected - (work.rx.nav - state))[3:] / np.sqrt(np.diag(gains.P))[3:])

    monkeypatch.setattr(reported, "_innovate", check)
    reported._fly(prepared, 7, 0)
    assert len(within) > 10
    assert np.max(within) < 1e-4


def test_innovations_are_told_of_the_satellites_in_use_by_a_filter_alone():
    prepared, _, runs = flown("filtered")
    n = 2 * len(prepared.sky.names)
    assert runs.innovation.shape[2] == 6 + n
    assert flown("bancroft")[2].innovation.shape[2] == 6
    used = np.isfinite(runs.innovation[0, -1, 6:]).reshape(-1, 2)
    last = prepared.signals.used[-1, : prepared.signals.n_used[-1]]
    assert np.flatnonzero(used.all(axis=1)).tolist() == sorted(last.tolist())


def test_without_a_solution_the_error_of_the_last_one_stays():
    """Of twelve satellites none from the tenth epoch on: what is told does not move any more, in both engines."""
    prepared, _, _ = flown("bancroft")
    n_used = prepared.signals.n_used.copy()
    n_used[10:] = 0
    chain = prepared.chain._replace(solved=np.arange(n_used.size) < 10)
    blind = prepared._replace(signals=prepared.signals._replace(n_used=n_used), chain=chain)
    error = reported._fly(blind, 7, 0).error
    assert np.all(error[9] == error[-2])
    assert np.any(error[9] != error[8])
    assert not error[-1].any()  # before the first epoch
    mean = reported.beside_covariance(blind, covariance(prepared._replace(scenario=case(LOOSE).scenario)))
    assert np.all(mean.true_sigma[-1, N_STATE + 6 :] == mean.true_sigma[-2, N_STATE + 6 :])


def test_nothing_is_added_where_nothing_of_the_solution_is_reported():
    prepared = case(LOOSE)
    history = covariance(prepared)
    assert reported.beside_covariance(prepared, history) is history
    assert history.formal.shape[1] == len(prepared.outputs) == N_STATE
