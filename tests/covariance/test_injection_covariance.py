"""Linear covariance of the injection of guided ascents against runs: each run for itself, and their spread."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import chi2

from lvnav_trade.covariance.history import covariance
from lvnav_trade.covariance.injection_covariance import injection_law, injection_rows
from lvnav_trade.quantities.records import INJECTION, NO_INJECTIONS, ORBIT
from lvnav_trade.simulation.guided_runs import inertial_errors_of
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.prepare import prepare
from lvnav_trade.trajectory.guided.ascent_runs import inject
from lvnav_trade.trajectory.guided.guidance_plan import steering_times
from lvnav_trade.trajectory.guided.guided_dynamics import NavigationErrors
from lvnav_trade.trajectory.guided.orbit_numbers import orbit_difference, osculating_orbit
from lvnav_trade.trajectory.guided.sensitivity import sensitivity
from tests.building import loaded

RUNS, SEED, LEVEL = 64, 20261127, 1e-3
LINEAR = [ORBIT.index(name) for name in ORBIT if name not in ("perigee", "apogee")]
"""Numbers that are linear near a circle too."""
START = "base.initial={tilt: 0.1 deg, heading: 0.05 deg, position: 1 m, velocity: 0.01 m/s}"


@lru_cache(maxsize=3)
def case(vehicle="electron_leo", guidance="explicit", runs=RUNS, filter_card="tight", aided=True):
    """Prepare, cover and fly a guided ascent."""
    trajectory = f"base.trajectory={{card: trajectories/{vehicle}, guidance: {guidance}, dispersion: {{draw: all}}}}"
    scenario = loaded(
        trajectory,
        "base.imu=imu/tactical_fog",
        "base.constellation=constellations/gps_24",
        "base.receiver=receivers/l1_four_patch",
        f"base.filter=filters/{filter_card}",
        START,
        *([] if aided else ["base.filter.measurements=[]"]),
    )
    prepared_case = prepare(scenario, 1.0)
    found = run_block(prepared_case, SEED, 0, runs) if runs else None
    return prepared_case, covariance(prepared_case), found


def parts(block):
    """Return error and knowledge (2, n_run, n_orbit) of the runs that are injected."""
    rows = block.injections[block.injections[:, 0] == 0]
    return np.moveaxis(rows[:, 3:].reshape(-1, 2, len(ORBIT)), 1, 0)


def derivatives(prepared_case):
    """Return the derivatives of an injection by the navigation errors that guidance has."""
    return sensitivity(
        prepared_case.plan, prepared_case.t_hist[steering_times(prepared_case.plan, prepared_case.t_hist)]
    )


@lru_cache(maxsize=1)
def by_navigation():
    """Return the error (n_run, n_orbit) of vehicles of which nothing is drawn, with the navigation errors of runs."""
    prepared_case, _, block = case()
    plan, errors = prepared_case.plan, inertial_errors_of(prepared_case, block.err)
    known = steering_times(plan, prepared_case.record.t)
    flown = [inject(plan, {}, NavigationErrors(prepared_case.record.t[known], one[known])).y for one in errors]
    return orbit_difference(osculating_orbit(np.stack(flown)), osculating_orbit(plan.nominal[None])[0])


def within(spread, sigma, n, n_test):
    """Whether standard deviations of n Gaussian values lie within the interval of their sigmas, each of n_test."""
    low, high = np.sqrt(chi2.ppf([0.5 * LEVEL / n_test, 1.0 - 0.5 * LEVEL / n_test], n - 1) / (n - 1))
    return (low * sigma < spread) & (spread < high * sigma)


def test_the_injection_of_each_run_is_that_of_its_navigation_errors_to_first_order():
    """No statistics: what a run's navigation errors do to the vehicle of the card is a sum over its flight."""
    prepared_case, _, block = case()
    found = derivatives(prepared_case)
    errors = inertial_errors_of(prepared_case, block.err)[:, : len(found.navigation)]
    expected = np.einsum("kne,rke->rn", found.navigation, errors)[:, : len(ORBIT)]
    off = found.reference[: len(ORBIT)] - found.target
    flown = by_navigation() - off
    for k in LINEAR:
        assert np.std(flown[:, k] - expected[:, k]) < 0.1 * np.std(expected[:, k]), ORBIT[k]


def test_both_engines_agree_on_the_injection():
    _, history, block = case()
    law, (error, knowledge), navigation = history.injection, parts(block), by_navigation()
    assert len(error) == RUNS
    total = np.sqrt(np.einsum("snn->n", law.covariance))
    of_navigation = np.sqrt(np.einsum("snn->n", law.covariance[: law.n_navigation]))[: len(ORBIT)]
    pairs = [
        (error, total[: len(ORBIT)]),
        (navigation, of_navigation),
        (knowledge, np.sqrt(law.knowledge.sum(axis=0))),
        (error - knowledge, np.sqrt(law.execution.sum(axis=0))),
    ]
    for number, (flown, sigma) in enumerate(pairs):
        good = within(flown[:, LINEAR].std(axis=0, ddof=1), sigma[LINEAR], RUNS, 4 * len(LINEAR) + 2)
        assert np.all(good), (number, [ORBIT[k] for k in LINEAR], good)
    for name, column in (("cutoff_time", 1), ("propellant_left", 2)):
        k, values = INJECTION.index(name), block.injections[:, column]
        assert within(values.std(ddof=1), total[k], RUNS, 4 * len(LINEAR) + 2), name
        assert abs(values.mean() - law.mean[k]) < 4.0 * total[k] / np.sqrt(RUNS), name


def test_the_covariance_by_source_sums_to_that_of_each_pair_of_numbers():
    _, history, _ = case()
    law = history.injection
    total = law.covariance.sum(axis=0)
    np.testing.assert_allclose(total, total.T, rtol=1e-12)
    base = [INJECTION.index(name) for name in INJECTION if name not in ("perigee", "apogee")]
    scale = np.sqrt(np.diag(total))[base]
    assert np.linalg.eigvalsh(total[np.ix_(base, base)] / np.outer(scale, scale)).min() > -1e-6
    assert law.sources[law.n_navigation :] == tuple(name.replace("_", " ") for name, _ in _vehicle())
    # guidance flies to the navigated target: the axis is missed by what is not known of it, and by the last tail-off
    axis, tail = ORBIT.index("semi_major_axis"), law.sources.index("tail off")
    own = law.covariance[: law.n_navigation, axis, axis].sum()
    assert own == pytest.approx(law.knowledge[:, axis].sum(), rel=2e-2)
    assert law.covariance[law.n_navigation :, axis, axis].sum() == pytest.approx(
        law.covariance[tail, axis, axis], rel=1e-3
    )


def _vehicle():
    prepared_case, _, _ = case()
    return derivatives(prepared_case).vehicle


def test_a_variance_of_sums_gives_back_a_covariance_that_is_known():
    """Errors (9,) at one time with a known covariance, through the rows and back."""
    prepared_case, _, _ = case()
    found = derivatives(prepared_case)
    draws = np.random.default_rng(3)
    root = draws.standard_normal((9, 9)) * np.array([1e-5] * 3 + [0.05] * 3 + [5.0] * 3)[:, None]
    k = len(found.navigation) // 2
    rows = injection_rows(found)[k]
    law = injection_law(
        found._replace(vehicle=(), curvature=np.zeros((0, len(INJECTION)))),
        ("one",),
        np.sum((rows @ root) ** 2, axis=1)[:, None],
        np.zeros((len(found.navigation), 9)),
    )
    wanted = found.navigation[k] @ root @ root.T @ found.navigation[k].T
    scale = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
    np.testing.assert_allclose(law.covariance[0] / scale, wanted / scale, atol=1e-6)
    np.testing.assert_allclose(
        law.execution[0], np.diag((found.navigation[k, : len(ORBIT)] - found.knowledge[k]) @ root @ root.T @ (
            found.navigation[k, : len(ORBIT)] - found.knowledge[k]).T), rtol=1e-9
    )  # fmt: skip


def test_the_injection_does_not_depend_on_how_often_the_history_is_kept():
    """Searches and trade spaces keep a history time a minute; guidance reads the errors every second all the same."""
    prepared_case, history, _ = case()
    seldom = covariance(prepare(prepared_case.scenario, 60.0)).injection
    np.testing.assert_allclose(seldom.covariance, history.injection.covariance, rtol=1e-9)


def test_without_guidance_there_is_no_injection():
    prepared_case, history, block = case()
    assert covariance(prepared_case._replace(plan=None)).injection is None
    assert history.injection.reason == ""
    assert block.injections is not NO_INJECTIONS


def test_navigation_is_the_same_with_and_without_the_injection():
    prepared_case, history, _ = case()
    plain = covariance(prepared_case._replace(plan=None))
    for name in ("formal_sigma", "true_sigma", "mean", "budget"):
        np.testing.assert_array_equal(getattr(history, name), getattr(plain, name))


@pytest.mark.slow
@pytest.mark.parametrize("guidance", ["explicit", "open_loop"])
@pytest.mark.parametrize("aided", [True, False])
@pytest.mark.parametrize("vehicle", ["two_stage_leo", "electron_leo", "churchill_sso"])
def test_both_engines_agree_on_three_vehicles(vehicle, aided, guidance):
    """500 runs, family-wise; numbers that act to second order, or deplete, are said to do so first."""
    prepared_case, history, _ = case(vehicle, guidance, 0, "tight_extended", aided)
    blocks = (run_block(prepared_case, SEED, first, 50) for first in range(0, 500, 50))  # 500 whole runs are 3 GB
    law, (error, knowledge) = history.injection, np.concatenate([parts(block) for block in blocks], axis=1)
    sigma = np.sqrt(np.einsum("snn->n", law.covariance))
    usable = [k for k in LINEAR if law.second_order[k] <= 0.3 * sigma[k]]
    assert len(usable) >= 3
    n = len(error)
    for flown, expected in ((error, sigma), (knowledge, np.sqrt(law.knowledge.sum(axis=0)))):
        good = within(flown[:, usable].std(axis=0, ddof=1), expected[usable], n, 10)
        assert np.all(good), [ORBIT[k] for k in usable]
