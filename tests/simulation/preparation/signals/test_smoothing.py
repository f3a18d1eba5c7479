"""Ranges smoothed by carrier phase before they are solved, and a receiver beside an inertial system: both engines."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import chi2, norm

from lvnav_trade.covariance.history import adjoint, covariance
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.signals.solution import CLOCK
from tests.building import LOOSE, MATCHED, loaded, prepare_hop, with_fields

RUNS = 400
POINT = {"kind": "bancroft", "range_sigma": "1 m", "rate_sigma": "0.1 m/s", "reported": True}
WINDOW = 8
SMOOTHING = {"time": f"{WINDOW} s"}
ERRORS = {
    "receiver.multipath": "0.5 m", "receiver.multipath_time": "15 s",
    "atmosphere": {
        "ionosphere": {"kind": "content"}, "ionosphere_scale": "60 percent", "ionosphere_scale_time": "20 s",
    },
}  # fmt: skip
SLIPS = {
    "": {},
    "noticed": {"receiver.cycle_slips": {"rate": "300 1/h"}},
    "unnoticed": {"faults": [{"kind": "cycle_slip", "size": 40, "start": "12 s"}]},
}
N_STATE = 15


@lru_cache(maxsize=8)
def prepared_case(smoothing, errors=False, filters="loose", slips=""):
    scenario = loaded(MATCHED, LOOSE if filters == "loose" else f"base.filter=filters/{filters}")
    solution = POINT | ({"smoothing": SMOOTHING | dict(smoothing)} if smoothing is not None else {})
    fields = {"receiver.solution": solution} | (ERRORS if errors else {})
    return prepare_hop(with_fields(scenario, **fields, **SLIPS[slips]))


@lru_cache(maxsize=8)
def analyse(*args):
    found = prepared_case(*args)
    return found, covariance(found), run_block(found, 11, 0, RUNS)


def agree(history, runs, at, columns):
    err = runs.err[:, at][:, :, columns]
    sigma, mean = history.true_sigma[at][:, columns], history.mean[at][:, columns]
    asked = sigma.size
    low, high = np.sqrt(chi2.ppf([0.005 / asked, 1.0 - 0.005 / asked], RUNS - 1) / (RUNS - 1))
    ratio = err.std(axis=0, ddof=1) / sigma
    assert low < ratio.min() <= ratio.max() < high, ratio.round(3)
    off = (err.mean(axis=0) - mean) / sigma
    assert np.abs(off * np.sqrt(RUNS)).max() < norm.isf(0.005 / asked)


def test_both_engines_have_the_smoothed_solution_and_what_a_filter_makes_of_it():
    case, history, runs = analyse((), True)
    at = [4, 12, 20, len(case.t_hist) - 1]
    agree(history, runs, at, list(range(N_STATE)))
    agree(history, runs, at, list(range(N_STATE, N_STATE + 8)))
    np.testing.assert_allclose(history.budget.sum(axis=1), history.true_sigma**2, rtol=1e-9, atol=1e-30)
    assert history.budget[-1, history.sources.index("carrier-phase noise"), 6:9].max() > 0.0


def test_the_backward_pass_of_the_smoothed_solution_is_the_forward_one():
    case, history, _ = analyse((), True)
    back = adjoint(case, 30.0)
    np.testing.assert_allclose(
        back.contribution.sum(axis=2).T, history.budget[-1, :, :9], rtol=1e-8, atol=1e-12 * history.budget[-1].max()
    )


def test_errors_of_the_solution_last_as_long_as_the_window():
    """Of white code the average's variance is that of the closed form, and so is what two epochs have in common."""
    case, _, runs = analyse((), False)
    plain = analyse(None, False)
    position = slice(N_STATE + 3, N_STATE + 6)
    at = int(np.argmin(np.abs(case.t_hist - case.t_epoch[-1])))
    error, before = runs.err[:, at, position], runs.err[:, at - 1, position]
    a = 1.0 / WINDOW
    smoothed = np.mean(error**2) / np.mean(plain[2].err[:, at, position] ** 2)
    # what is in common from run to run is code; the phase has 2 mm
    assert smoothed == pytest.approx(a / (2.0 - a), rel=0.15)
    assert np.sum(error * before) / np.sum(before**2) == pytest.approx(1.0 - a, abs=0.06)
    ratio = plain[1].true_sigma[at, position] / analyse((), False)[1].true_sigma[at, position]
    np.testing.assert_allclose(ratio, np.sqrt((2.0 - a) / a), rtol=0.02)


def test_states_of_the_average_have_the_closed_form_of_the_window():
    case = prepared_case((), False)
    chain, m, P = case.chain, 11, np.zeros((case.chain.transition.shape[1],) * 2)
    white = case.signals.sigma[0, 0] ** 2 + case.options.solver.smoothing.sigma[0, 0] ** 2
    a = 1.0 / WINDOW
    for epoch in range(len(chain.transition)):
        W = chain.noise_input[epoch] * (chain.noise_type != CLOCK)
        P = chain.transition[epoch] @ P @ chain.transition[epoch].T + (W * chain.variance[epoch]) @ W.T
        assert P[m, m] / white == pytest.approx(1.0 / (epoch + 1) if epoch < WINDOW else P[m, m] / white, rel=1e-9)
    n = len(chain.transition) - WINDOW
    steady = a / (2.0 - a)
    expected = steady + (1.0 / WINDOW - steady) * (1.0 - a) ** (2 * n)
    assert P[m, m] / white == pytest.approx(expected, rel=1e-9)


def test_a_velocity_of_carrier_differences_is_late_by_half_an_interval_unless_it_is_centred():
    doppler, late, centred = (
        analyse((("velocity", name), *more), False)
        for name, more in (
            ("doppler", ()), ("backward", (("rate_interval", "0.2 s"),)), ("centred", (("rate_interval", "0.2 s"),)),
        )
    )  # fmt: skip
    velocity, at = slice(N_STATE, N_STATE + 3), 10
    push = np.linalg.norm(doppler[0].chain.point[at, 3:] - doppler[0].chain.point[at - 1, 3:])
    assert np.linalg.norm(late[1].mean[at, velocity]) == pytest.approx(0.1 * push, rel=0.1)
    assert np.linalg.norm(centred[1].mean[at, velocity]) < 1e-3
    noise = np.sqrt(2.0) * 0.002 / 0.2 / doppler[0].scenario.receiver.range_rate_sigma
    ratio = centred[1].true_sigma[at, velocity] / doppler[1].true_sigma[at, velocity]
    np.testing.assert_allclose(ratio, noise, rtol=0.05)
    agree(late[1], late[2], [10, 25], list(range(N_STATE, N_STATE + 8)))


def test_an_uncoupled_system_reports_both_solutions_and_fuses_nothing():
    case, history, runs = analyse(None, False, "uncoupled")
    inertial = prepare_hop(loaded(MATCHED, "base.filter=filters/inertial"))
    alone, free = covariance(inertial), run_block(inertial, 11, 0, RUNS)
    np.testing.assert_allclose(runs.err[:, :, :N_STATE], free.err, rtol=1e-9, atol=1e-8)
    np.testing.assert_allclose(history.true_sigma[:, :N_STATE], alone.true_sigma, rtol=1e-12)
    at = [5, 15, len(case.t_hist) - 1]
    agree(history, runs, at, list(range(N_STATE)))
    agree(history, runs, at, list(range(N_STATE, N_STATE + 8)))
    coupled = analyse(None, False)[1]
    np.testing.assert_allclose(history.true_sigma[:, N_STATE:], coupled.true_sigma[:, N_STATE:], rtol=1e-9)
    np.testing.assert_allclose(history.budget.sum(axis=1), history.true_sigma**2, rtol=1e-9, atol=1e-30)


def test_noise_of_the_carrier_has_tables_of_its_own():
    grown = {"specific_force": ["0 m/s^2", "20 m/s^2"], "factor": [1.0, 4.0], "of": ["carrier_phase"]}
    scenario = prepared_case((("velocity", "centred"),)).scenario
    plain, more = prepare_hop(scenario), prepare_hop(with_fields(scenario, **{"receiver.noise_by": [grown]}))
    rates = slice(1, 2 * len(plain.sky.names), 2)
    for epoch, factor in ((5, 4.0), (-1, 1.0)):  # under thrust, and without
        ratio = more.options.solver.smoothing.sigma[epoch] / plain.options.solver.smoothing.sigma[epoch]
        np.testing.assert_allclose(ratio, factor, rtol=1e-3)
        np.testing.assert_allclose(
            more.signals.sigma[epoch, rates] / plain.signals.sigma[epoch, rates], factor, rtol=1e-3
        )
    np.testing.assert_array_equal(more.signals.sigma[:, ::2], plain.signals.sigma[:, ::2])


def test_a_slip_that_the_receiver_notices_starts_its_average_again():
    case = prepared_case((), True, "loose", "noticed")
    gain, lost = case.options.solver.smoothing.gain, ~case.sky.continuous & case.sky.is_tracked
    assert 10 < lost[1:].sum() < lost[1:].size / 4
    np.testing.assert_array_equal(gain == 1.0, lost)


def test_a_slip_that_the_receiver_does_not_notice_moves_the_solution_in_both_engines():
    _, history, runs = analyse((), False, "loose", "unnoticed")
    before, just_after = 11, 13
    position = slice(N_STATE + 3, N_STATE + 6)
    shift = np.linalg.norm(history.mean[:, position], axis=1)
    assert shift[before] < 0.05 < 1.0 < shift[just_after]
    agree(history, runs, [before, just_after, 20], list(range(N_STATE, N_STATE + 8)))
