"""Linear covariance: its own algebra, and against Monte Carlo; every bound follows from the number of runs."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats

from lvnav_trade.covariance.history import adjoint, covariance
from lvnav_trade.scenario.filter_models import filter_models
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import INERTIAL, LOOSE, MATCHED, ascent, case, loaded, prepare_hop, with_fields

SEED, ALPHA = 20260802, 1e-3
FULL = "base.filter=filters/tight_extended"


def changed(*settings, **cards):
    """Prepare the short flight with fields of cards replaced: ``filter={"covariance_rate": "50 Hz"}``."""
    scenario = loaded(*settings)
    update = {name: with_fields(getattr(scenario, name), **fields) for name, fields in cards.items()}
    return prepare_hop(scenario.model_copy(update=update))


def agrees(prepared_case, n_run, times, n_family=None):
    """Ratios of Monte-Carlo RMS to LinCov's true RMS (mean included), and their interval of family-wise 1e-3.

    The sum of squares of n Gaussian errors over their variance is chi-square with n degrees of freedom.
    """
    cov, block = covariance(prepared_case), run_block(prepared_case, SEED, 0, n_run)
    at = [int(np.argmin(np.abs(prepared_case.t_hist - time))) for time in times]
    # about the mean that LinCov gives, so that a ramp or a wrong gravity model does not widen the law
    squares = np.sum((block.err[:, at] - cov.mean[at]) ** 2, axis=0)
    ratio = np.sqrt(squares / n_run) / cov.true_sigma[at]
    each = ALPHA / (n_family or ratio.size)
    return ratio, np.sqrt(stats.chi2.ppf([0.5 * each, 1.0 - 0.5 * each], n_run) / n_run)


def inside(ratio, interval):
    return np.all((interval[0] < ratio) & (ratio < interval[1]))


# ----------------------------------------------------------------------------------------------------- its own algebra

CASES = [(), (MATCHED,), (LOOSE,), (MATCHED, LOOSE), (INERTIAL,), (FULL,)]
IDS = ["tight", "tight matched", "loose", "loose matched", "inertial", "extended"]


@pytest.mark.parametrize("settings", CASES, ids=IDS)
def test_the_budget_sums_to_the_total(settings):
    cov = covariance(case(*settings))
    np.testing.assert_allclose(cov.budget.sum(axis=1), cov.true_sigma**2, rtol=1e-12)
    assert cov.budget.shape[1] == len(cov.sources)


@pytest.mark.parametrize("settings", CASES, ids=IDS)
def test_the_backward_pass_gives_the_budget_of_the_forward_one(settings):
    prepared_case = case(*settings)
    cov = covariance(prepared_case)
    for time in (20.0, 30.0):
        back, hist = adjoint(prepared_case, time), int(np.flatnonzero(prepared_case.t_hist == time)[0])
        assert back.sources == cov.sources
        # relative to the whole variance of the output: a source of no account is rounding of the others
        forward = cov.budget[hist, :, :9] / cov.true_sigma[hist, :9] ** 2
        backward = back.contribution.sum(axis=2).T / cov.true_sigma[hist, :9] ** 2
        np.testing.assert_allclose(backward, forward, rtol=0, atol=1e-10)


@pytest.mark.parametrize("settings", CASES, ids=IDS)
def test_both_covariances_stay_symmetric_and_positive(settings):
    cov = covariance(case(*settings))
    for matrices in (cov.formal_cov, cov.true_cov):
        scale = 1.0 / np.sqrt(np.diagonal(matrices, axis1=1, axis2=2))
        unit = matrices * scale[:, :, None] * scale[:, None, :]
        np.testing.assert_allclose(unit, np.swapaxes(unit, 1, 2), atol=1e-12)
        assert np.linalg.eigvalsh(unit).min() > -1e-12


@pytest.mark.parametrize("settings", [(MATCHED,), (MATCHED, LOOSE), (MATCHED, INERTIAL)])
def test_a_matched_filter_knows_its_own_error(settings):
    cov = covariance(case(*settings))
    np.testing.assert_allclose(cov.formal_sigma, cov.true_sigma, rtol=1e-2)
    n = case(*settings).layout.n_estimated
    np.testing.assert_allclose(cov.expected_nees, n, rtol=1e-2)
    np.testing.assert_allclose(cov.expected_nis, cov.n_row, rtol=1e-3)
    assert np.abs(cov.mean / cov.true_sigma).max() < 1e-2


def test_a_filter_that_carries_all_that_is_wrong_knows_its_error_but_for_what_it_leaves_out():
    """With every excited state propagated: bandwidth, drift, nonlinearity and instability are left, a few per cent."""
    cov = covariance(case(FULL))
    assert np.all(cov.true_sigma[1:] / cov.formal_sigma[1:] < 1.05)


@pytest.mark.parametrize("settings", [(), (MATCHED,)], ids=["true errors beyond the model", "matched"])
def test_the_covariance_does_not_depend_on_how_often_it_is_propagated(settings):
    """10, 50, 100 and 200 Hz within 0.1 %; at the end of the boost and of the coast."""
    sigmas = []
    for rate in ("200 Hz", "100 Hz", "50 Hz", "10 Hz"):
        cov = covariance(changed(*settings, filter={"covariance_rate": rate}))
        sigmas.append(np.stack([cov.formal_sigma[[20, -1]], cov.true_sigma[[20, -1]]]))
    for other in sigmas[1:]:
        np.testing.assert_allclose(other, sigmas[0], rtol=1e-3)


def test_josephs_form_and_the_symmetric_one_agree_for_an_optimal_gain():
    one, two = (covariance(changed(MATCHED, filter={"update": form})) for form in ("joseph", "symmetric"))
    np.testing.assert_allclose(one.formal_sigma, two.formal_sigma, rtol=1e-6)


def formal_position(prepared_case):
    cov = covariance(prepared_case)
    return np.linalg.norm(cov.formal_sigma[:, 6:9], axis=1)


def test_a_satellite_more_never_raises_the_filters_own_sigma():
    sigmas = [covariance(changed(MATCHED, receiver={"channels": n})).formal_sigma for n in (4, 5, 6, 8)]
    for fewer, more in itertools.pairwise(sigmas):
        assert np.all(more <= fewer * (1.0 + 1e-9))


def with_outage(seconds, keep=0):
    scenario = loaded(MATCHED)
    fault = {"kind": "satellite_outage", "start": "10 s", "duration": f"{seconds} s", "keep": keep}
    return prepare_hop(type(scenario).model_validate(scenario.model_dump(mode="json") | {"faults": [fault]}))


def test_a_longer_outage_or_one_of_more_satellites_is_never_better():
    for worse, better in ((with_outage(10), with_outage(5)), (with_outage(8), with_outage(8, keep=2))):
        assert np.all(covariance(worse).formal_sigma >= covariance(better).formal_sigma * (1.0 - 1e-9))


def test_a_noisier_receiver_puts_more_into_the_budget_and_nothing_else_grows_by_it_alone():
    quiet = covariance(changed(MATCHED, filter=_own_receiver(), receiver={"pseudorange_sigma": "2 m"}))
    noisy = covariance(changed(MATCHED, filter=_own_receiver(), receiver={"pseudorange_sigma": "4 m"}))
    at = quiet.sources.index("pseudorange noise")
    # gains are the filter model's, and so the same: the source's variance is four times, the others' as they were
    np.testing.assert_allclose(noisy.budget[:, at], 4.0 * quiet.budget[:, at], rtol=1e-10)
    others = [s for s in range(len(quiet.sources)) if s != at]
    np.testing.assert_allclose(noisy.budget[:, others], quiet.budget[:, others], rtol=1e-12)
    np.testing.assert_array_equal(noisy.formal_sigma, quiet.formal_sigma)


def _own_receiver():
    """A filter card with a filter model of its own about the receiver."""
    return {"receiver": {
        "pseudorange_sigma": "2 m", "range_rate_sigma": "0.1 m/s", "position_sigma": "2.2 m",
        "velocity_sigma": "0.11 m/s", "clock_h0": 2e-21, "clock_h_minus2": 3e-24,
    }}  # fmt: skip


# ------------------------------------------------------------------------------------------------- against Monte Carlo


@pytest.mark.parametrize("settings", [*CASES, (MATCHED, INERTIAL)], ids=[*IDS, "inertial matched"])
def test_monte_carlo_spreads_as_linear_covariance_says(settings):
    ratio, interval = agrees(case(*settings), 800, [5.0, 20.0, 30.0])
    assert inside(ratio, interval), np.round(ratio, 3)


def test_a_filter_that_neglects_scale_factor_and_g_sensitivity_is_optimistic_and_linear_covariance_knows():
    prepared_case = case()
    cov = covariance(prepared_case)
    end = -1
    # thrust of 3 g for 20 s times 1500 ppm is 0.9 m/s that the filter does not know of
    assert cov.true_sigma[end, 3:6].max() > 1.5 * cov.formal_sigma[end, 3:6].min()
    assert cov.expected_nees[end] > 2.0 * prepared_case.layout.n_estimated
    block = run_block(prepared_case, SEED, 0, 800)
    # the mean of NEES over runs: its law is not chi-square here, its own spread over runs bounds it
    nees = block.nees[:, end]
    assert abs(nees.mean() - cov.expected_nees[end]) < 5.0 * nees.std() / np.sqrt(800)
    nis = block.nis.sum(axis=1)
    assert abs(nis.mean() - cov.expected_nis.sum()) < 5.0 * nis.std() / np.sqrt(800)
    assert cov.expected_nis.sum() > 1.1 * cov.n_row.sum()


MISMATCHES = {
    "time constant": {"imu": {
        "gyro_random_walk": "0.03 deg/sqrt(h)", "accel_random_walk": "0.05 mg/sqrt(Hz)", "gyro_bias": "1 deg/h",
        "accel_bias": "2 mg", "gyro_bias_time": "5 s", "accel_bias_time": "5 s",
    }},
    "noise accepted twice too small": {"receiver": {
        "pseudorange_sigma": "1 m", "range_rate_sigma": "0.05 m/s", "position_sigma": "1.1 m",
        "velocity_sigma": "0.06 m/s", "clock_h0": 2e-21, "clock_h_minus2": 3e-24,
    }},
    "start accepted ten times too good": {"initial": {
        "tilt": "0.01 deg", "heading": "0.005 deg", "position": "0.1 m", "velocity": "1 mm/s", "clock_bias": "30 m",
        "clock_drift": "0.3 m/s",
    }},
    "considered bias": {"consider": ["accel_bias"]},
    "considered scale factor": {"consider": ["accel_scale_factor"]},
    "no biases": {"neglect": ["gyro_bias", "accel_bias"]},
    "first order": {"transition_order": 1, "covariance_rate": "2 Hz"},
}  # fmt: skip


@pytest.mark.parametrize("name", MISMATCHES)
def test_linear_covariance_is_true_for_a_filter_that_is_wrong(name):
    ratio, interval = agrees(changed(filter=MISMATCHES[name]), 800, [5.0, 20.0, 30.0])
    assert inside(ratio, interval), np.round(ratio, 3)


TRUTHS = {
    "lever arm": {"receiver": {"lever_b": ["2 m", "-1 m", "0.5 m"]}},
    "instability": {"imu": {
        "gyro.bias_instability": "20 deg/h", "gyro.instability_time": "5 s", "accel.bias_instability": "3 mg",
        "accel.instability_time": "5 s",
    }},
    "walks": {"imu": {"gyro.rate_random_walk": "200 deg/h/sqrt(h)", "accel.rate_random_walk": "60 mg/sqrt(h)"}},
    "quantisation": {"imu": {"gyro.quantisation": "1e-4 rad", "accel.quantisation": "2 cm/s"}},
    "nonlinearity": {"imu": {"gyro.nonlinearity": "1 percent", "accel.nonlinearity": "1 percent"}},
    "slow unit": {"imu": {"rate": "50 Hz", "process_rate": "5 Hz"}},
    "poor clock": {"receiver": {"clock.h0": 2e-19, "clock.h_minus2": 2e-20}},
}  # fmt: skip


@pytest.mark.parametrize("name", TRUTHS)
def test_linear_covariance_is_true_for_every_kind_of_error(name):
    ratio, interval = agrees(changed(**TRUTHS[name]), 800, [5.0, 20.0, 30.0])
    assert inside(ratio, interval), np.round(ratio, 3)


BY_AXIS = {
    "gyro.random_walk": ["0.02 deg/sqrt(h)", "0.2 deg/sqrt(h)", 0], "accel.random_walk": ["0.2 mg/sqrt(Hz)", 0, 0],
    "gyro.bias_repeatability": ["0.1 deg/h", "2 deg/h", "20 deg/h"], "accel.bias_repeatability": ["0.5 mg", 0, "3 mg"],
    "accel.scale_factor": [0, "500 ppm", "1500 ppm"], "gyro.rate_random_walk": [0, "100 deg/h/sqrt(h)", 0],
    "accel.bias_instability": ["0.2 mg", "1 mg", 0], "accel.instability_time": "5 s",
}  # fmt: skip


@pytest.mark.slow  # a kernel of its own, most of half a minute to compile
def test_errors_by_axis_spread_as_linear_covariance_says_and_a_matched_filter_has_them():
    prepared_case = changed(MATCHED, imu=BY_AXIS)
    ratio, interval = agrees(prepared_case, 800, [5.0, 20.0, 30.0])
    assert inside(ratio, interval), np.round(ratio, 3)
    bias, _, _ = filter_models(prepared_case.scenario)
    np.testing.assert_allclose(bias.gyro_bias, np.array([0.1, 2.0, 20.0]) * np.pi / 180.0 / 3600.0, rtol=1e-12)


def test_an_error_by_axis_puts_into_an_unaided_flight_what_its_axes_put_there_alone():
    name, field = "accelerometer bias repeatability", "accel.bias_repeatability"

    def variance(*values):
        cov = covariance(changed(MATCHED, INERTIAL, imu={field: list(values)}))
        return cov.budget[:, cov.sources.index(name)]

    one, two, three = variance("1 mg", 0, 0), variance(0, "1 mg", 0), variance(0, 0, "1 mg")
    assert one[-1, 6:9].max() > 0.0
    whole = variance("2 mg", "1 mg", "5 mg")
    np.testing.assert_allclose(whole, 4.0 * one + two + 25.0 * three, rtol=1e-9, atol=1e-18)


RAMP = {"start": "2 s", "end": "15 s", "amplitude": ["2 mg", "-4 mg", "1 mg"]}
MEANS = {
    "ramp": {"imu": {"accel.temperature": RAMP}},
    "bandwidth": {"imu": {"gyro.bandwidth": "5 Hz", "accel.bandwidth": "5 Hz"}},
    "gravity of a point": {"filter": {"gravity": "point"}},
}


# aiding takes the effect of a wrong gravity model away within this short flight
WHERE = [("ramp", (MATCHED,)), ("bandwidth", (MATCHED,)), *((name, (MATCHED, INERTIAL)) for name in MEANS)]


@pytest.mark.parametrize(("name", "settings"), WHERE)
def test_what_is_the_same_in_every_run_is_a_mean_of_the_error(name, settings):
    """The mean of 800 runs is within five of its own sigmas of LinCov's, and no zero would be."""
    prepared_case = changed(*settings, **MEANS[name])
    cov, block = covariance(prepared_case), run_block(prepared_case, SEED, 0, 800)
    for hist in (20, -1):
        off = (block.err[:, hist].mean(axis=0) - cov.mean[hist]) / (cov.true_sigma[hist] / np.sqrt(800))
        assert np.abs(off).max() < 5.0, np.round(off, 1)
    assert np.abs(cov.mean[-1] / (cov.true_sigma[-1] / np.sqrt(800))).max() > 10.0


@pytest.mark.slow
@pytest.mark.parametrize("settings", [(MATCHED,), (), (LOOSE,)], ids=["matched", "tight", "loose"])
def test_over_the_whole_ascent_monte_carlo_spreads_as_linear_covariance_says(settings):
    prepared_case = ascent(*settings)
    ratio, interval = agrees(prepared_case, 400, list(prepared_case.trajectory.events.values()))
    assert inside(ratio, interval), np.round(ratio, 3)
