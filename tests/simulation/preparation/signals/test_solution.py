"""A solution's own error and late measurements in linear covariance: against runs, against the dense cascade."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import chi2, norm

from lvnav_trade.covariance.history import adjoint, covariance
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.signals.solution import RANGE, direct_error_model
from tests.building import MATCHED, loaded, prepare_hop

POINT = {"kind": "bancroft", "range_sigma": "2 m", "rate_sigma": "0.1 m/s", "reported": True}
# The flight starts at 3 g, which the receiver's filter must find out: with little jerk its first velocities are so far
# off that the attitude leaves the linear range.
FILTERED = {**POINT, "kind": "filtered", "jerk": "10 m/s^3", "clock_noise": "0.1 m/s^2"}
FILTERED["start_acceleration"] = "50 m/s^2"
DIRECT = {"kind": "direct", "position_sigma": "2.2 m", "velocity_sigma": "0.11 m/s"}
BUFFERED, EXTRAPOLATED = {"kind": "buffered"}, {"kind": "extrapolated", "delay_sigma": "1 ms"}
RUNS = 1000


@lru_cache(maxsize=8)
def analyse(solution: str, coupling: str, compensation: str, **fields: str):
    """Prepare, cover and fly a matched case: 300 ms late where the delay is compensated."""
    text = loaded(MATCHED, f"base.filter=filters/{coupling}", "base.receiver=receivers/l1_two_metre").model_dump(
        mode="json"
    )
    text["faults"] = []
    text["receiver"]["solution"] = {"point": POINT, "filtered": FILTERED, "direct": DIRECT}[solution]
    text["receiver"] |= {"multipath": "1 m", "latency": "300 ms" if compensation else "0 s"}
    text["filter"]["delay_compensation"] = {"buffered": BUFFERED, "extrapolated": EXTRAPOLATED}.get(compensation)
    if "delay" in fields:
        text["filter"]["delay_compensation"] = {**BUFFERED, "delay": fields["delay"]}
    case = prepare_hop(Scenario.model_validate(text))
    return case, covariance(case), run_block(case, 7, 0, RUNS)


CASES = [
    ("point", "loose", ""),
    ("filtered", "loose", ""),
    ("direct", "loose", "buffered"),
    ("direct", "loose", "extrapolated"),
    ("direct", "tight", "buffered"),
    pytest.param("filtered", "loose", "extrapolated", marks=pytest.mark.slow),
    pytest.param("point", "loose", "buffered", marks=pytest.mark.slow),
]
each = pytest.mark.parametrize(("solution", "coupling", "compensation"), CASES)


@each
def test_runs_lie_within_the_interval_of_the_true_sigma_and_about_its_mean(solution, coupling, compensation):
    case, history, runs = analyse(solution, coupling, compensation)
    at = [8, 16, len(case.t_hist) - 1]
    asked = 9 * len(at)
    low, high = np.sqrt(chi2.ppf([0.005 / asked, 1.0 - 0.005 / asked], RUNS - 1) / (RUNS - 1))
    ratio = runs.err[:, at, :9].std(axis=0, ddof=1) / history.true_sigma[at, :9]
    assert low < ratio.min() <= ratio.max() < high
    off = (runs.err[:, at, :9].mean(axis=0) - history.mean[at, :9]) / history.true_sigma[at, :9] * np.sqrt(RUNS)
    assert np.abs(off).max() < norm.isf(0.005 / asked)


@each
def test_the_filter_assumes_in_the_runs_what_it_assumes_on_the_nominal_flight(solution, coupling, compensation):
    _, history, runs = analyse(solution, coupling, compensation)
    assumed = np.sqrt(np.mean(runs.sigma[:, 5:, :9] ** 2, axis=0))
    np.testing.assert_allclose(assumed, history.formal_sigma[5:, :9], rtol=2e-3)
    with np.errstate(invalid="ignore"):
        nis = runs.nis.mean(axis=0) / np.maximum(1, history.n_row)
    expected = history.expected_nis / np.maximum(1, history.n_row)
    assert nis[5:].mean() == pytest.approx(expected[5:].mean(), rel=0.05)


@each
def test_backwards_the_budget_is_that_of_the_way_forwards(solution, coupling, compensation):
    case, history, _ = analyse(solution, coupling, compensation)
    back = adjoint(case, float(case.t_hist[-1])).contribution.sum(axis=2)
    np.testing.assert_allclose(back, history.budget[-1, :, :9].T, rtol=1e-8, atol=1e-9 * back.sum(axis=1).min())


def test_behind_a_receivers_own_filter_the_formal_covariance_is_far_too_small():
    """Coloured errors taken for new ones at every epoch: the true NEES is that of the cascade."""
    case, history, runs = analyse("filtered", "loose", "")
    n = case.layout.n_estimated
    assert history.expected_nees[-1] > 1.5 * n
    assert runs.nees[:, -1].mean() == pytest.approx(history.expected_nees[-1], rel=0.1)
    white, history, _ = analyse("direct", "loose", "buffered")
    assert history.expected_nees[-1] == pytest.approx(white.layout.n_estimated, rel=0.05)


def test_a_wrong_delay_displaces_by_the_speed_times_what_is_wrong():
    case, history, _ = analyse("direct", "tight", "buffered", delay="290 ms")
    speed = np.linalg.norm(case.record.v[-1])
    displaced = np.linalg.norm(history.mean[-1, 6:9])
    assert displaced == pytest.approx(0.010 * speed, rel=0.1)


def test_a_simulated_solution_has_no_memory_and_its_axes_their_own_noise():
    case, _, _ = analyse("direct", "loose", "extrapolated")
    chain = direct_error_model(case.signals, case.signals.variance)
    assert not chain.transition.any()
    np.testing.assert_array_equal(chain.noise_input[3], -np.eye(6))
    np.testing.assert_allclose(chain.reported_covariance[3], np.diag([2.2**2] * 3 + [0.11**2] * 3))
    assert chain.noise_type.min() > RANGE
    # in memory as those of a receiver that solves: in another order they would be a kernel of their own
    assert all(array.flags.c_contiguous for array in (*chain, *analyse("point", "loose", "")[0].chain))
