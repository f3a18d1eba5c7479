"""Orbit at injection, its errors and the delta-v of their correction, by linear covariance and by runs."""

from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.mechanics import impulses, mission_errors, orbits, stored_states
from lvnav_trade.results.mechanics.stored_states import ErrorGaussian, State
from lvnav_trade.results.metrics.mission import MISSION
from lvnav_trade.results.statistics.probability import holm
from lvnav_trade.results.statistics.select import cache_result, final_event, flight_events
from lvnav_trade.results.tables.read import Tables

COLUMNS = [
    "case",
    "event",
    "quantity",
    "unit",
    "osculating",
    "averaged",
    "lincov_sigma",
    "filter_sigma",
    "lincov_bias",
    "lincov_q99",
    "runs",
    "mc_sigma",
    "mc_bias",
    "mc_q99",
    "remark",
]
CORRECTION = [
    "case",
    "event",
    "unit",
    "by",
    "draw_count",
    "mean_delta_v",
    "q50",
    "q95",
    "q99",
    "velocity_q99",
    "position_q99",
]
NORMALITY = ["case", "event", "quantity", "runs", "skewness", "excess_kurtosis", "p_ratio", "gaussian"]
NORMALITY_ALPHA = 0.01  # probability that a Gaussian element of a case is reported as not Gaussian
_PAIR = ("perigee height", "apogee height")  # axes of the ellipse in the figure of the orbit
_LEAST_RUNS = 20  # smallest number of runs for an accurate test
_DRAWS = 2**10
# Quantities of an orbit, and the component of the error metric that belongs to each.
QUANTITIES = {
    "semi-major axis": ("semi_major_axis_error", 0),
    "perigee height": ("perigee_error", 0),
    "apogee height": ("apogee_error", 0),
    "eccentricity": ("eccentricity_error", 0),
    "eccentricity along the node": ("eccentricity_vector_error", 0),
    "eccentricity ahead of the node": ("eccentricity_vector_error", 1),
    "inclination": ("inclination_error", 0),
    "node": ("node_error", 0),
}


LEAST = 1e-7
"""Smallest value of an element, in its unit; smaller values are residuals of the ascent solution and rounding."""


def orbit(tables: Tables) -> pd.DataFrame:
    """Return the orbit of each case, with its errors, at the final event and at earlier events if it clears the ground.

    Heights are above the equatorial radius. An error is the true minus the estimated value of an averaged element.
    Columns:

    averaged : average over one revolution, without the short-periodic variation of J2 (see `results.mechanics.orbits`)
    lowest height, highest height : extremes of the first revolution, with the short-periodic variation
    lincov_sigma, filter_sigma : first order, true and formal; empty with a remark within 3 sigma of a circular orbit
    lincov_q99 : 99 % quantile of |error|, from Gaussian draws through the exact relation, also for circular orbits
    mc_sigma, mc_bias, mc_q99 : of the runs that did not fail

    An element below `LEAST` is written as 0.
    """
    rows: list[dict[str, Any]] = []
    for case, label in tables.labels.items():
        for state in orbital_states(tables, case):
            name = {"case": label, "event": state.event}
            rows += [name | row for row in _element_rows(tables, case, state)]
            rows += [name | row for row in _height_rows(tables, case, state)]
    return pd.DataFrame(rows, columns=COLUMNS)


def orbital_states(tables: Tables, case: str) -> list[State]:
    """Return the states at the final event, and at earlier events whose orbit clears the ground.

    Events at the time of the final event are omitted.
    """
    final = final_event(tables, case)
    last = stored_states.state_at(tables, case, final)
    if last is None:
        return []
    clear = []
    for event in flight_events(tables, case).event:
        is_final = event == final
        state = last if is_final else stored_states.state_at(tables, case, str(event))
        if state is None:
            continue
        if not is_final and abs(state.t - last.t) < 1e-6:
            continue
        average = mission_errors.mean_orbit(state)
        is_above_ground = float(average.perigee) > 0.0
        if is_above_ground or (is_final and bool(average.elliptic)):
            clear.append(state)
    return clear


def values(orbit_of: orbits.OrbitVectors) -> dict[str, float]:
    """Return the elements of an orbit (SI) by the names of `QUANTITIES`."""
    h_unit = orbit_of.h_i / np.linalg.norm(orbit_of.h_i)
    node = np.array([np.cos(orbit_of.node), np.sin(orbit_of.node), 0.0])
    ahead = np.cross(h_unit, node)
    return {
        "semi-major axis": float(orbit_of.semi_major_axis),
        "perigee height": float(orbit_of.perigee),
        "apogee height": float(orbit_of.apogee),
        "eccentricity": float(orbit_of.eccentricity),
        "eccentricity along the node": float(orbit_of.e_i @ node),
        "eccentricity ahead of the node": float(orbit_of.e_i @ ahead),
        "inclination": float(orbit_of.inclination),
        "node": float(orbit_of.node),
    }


def _element_rows(tables: Tables, case: str, state: State) -> list[dict[str, Any]]:
    """Return a row for each element of the orbit at an event, with its error by linear covariance and by the runs."""
    law = stored_states.law_at(tables, case, state.event)
    run_errors = stored_states.good_errors(tables, case, state)
    run_differences = mission_errors.orbit_errors(state, run_errors)
    draw_differences = mission_errors.orbit_errors(state, mission_errors.draws(law.mean, law.true))
    osculating_elements = values(orbits.osculating(state.r_i, state.v_i))
    mean_elements = values(mission_errors.mean_orbit(state))

    rows: list[dict[str, Any]] = []
    for quantity, (metric, component) in QUANTITIES.items():
        unit = MISSION[metric].label_unit
        factor = MISSION[metric].label_factor
        row: dict[str, Any] = {
            "quantity": quantity,
            "unit": unit,
            "osculating": _without_residual(osculating_elements[quantity] * factor),
            "averaged": _without_residual(mean_elements[quantity] * factor),
            "lincov_q99": _quantile(draw_differences[metric][:, component]) * factor,
            "runs": len(run_errors),
            "remark": mission_errors.nonlinearity_reason(state, metric, law.true),
        }
        if not row["remark"]:
            slope = mission_errors.jacobian(state, metric)[component]
            row |= _first_order_columns(slope, law, factor)
        if len(run_errors):
            row |= _run_columns(run_differences[metric][:, component] * factor)
        rows.append(row)
    return rows


def _height_rows(tables: Tables, case: str, state: State) -> list[dict[str, Any]]:
    """Return the rows of the lowest and the highest altitude over the revolution after an event."""
    lowest, highest = orbits.extremes(state.r_i, state.v_i)
    n_run = len(stored_states.good_errors(tables, case, state))
    return [
        {
            "quantity": quantity,
            "averaged": float(height) * 1e-3,
            "unit": "km",
            "runs": n_run,
            "remark": "",
        }
        for quantity, height in (("lowest height", lowest), ("highest height", highest))
    ]


def _without_residual(element: float) -> float:
    """Return an element, or zero if it is smaller than `LEAST`."""
    return element if abs(element) >= LEAST else 0.0


def _first_order_columns(slope: Floats, law: ErrorGaussian, factor: float) -> dict[str, float]:
    """Return sigmas and bias of an element to first order in the state error: variance s'Ps, mean s'm.

    Parameters
    ----------
    slope : (6,) array
        Derivative s of the element (SI) with respect to velocity (m/s) and position (m), frame i.
    law : ErrorGaussian
        Gaussian of the errors of velocity and position.
    factor : float
        Factor from SI to the display unit.

    Returns
    -------
    dict of str to float
        Values by column of the table, in the display unit.
    """
    sigma = float(np.sqrt(slope @ law.true @ slope))
    filter_sigma = float(np.sqrt(slope @ law.formal @ slope))
    bias = float(mission_errors.round_bias(slope @ law.mean, sigma))
    return {
        "lincov_sigma": sigma * factor,
        "filter_sigma": filter_sigma * factor,
        "lincov_bias": bias * factor,
    }


def _run_columns(errors: Floats) -> dict[str, float]:
    """Return standard deviation, mean and 99 % quantile of the errors (n_run,) of an element."""
    return {
        "mc_sigma": float(errors.std(ddof=1)) if len(errors) > 1 else float("nan"),
        "mc_bias": float(errors.mean()),
        "mc_q99": _quantile(errors),
    }


@cache_result
def normality(tables: Tables) -> pd.DataFrame:
    """Return whether the errors of orbital elements of the runs are Gaussian, at the final event of each case.

    skewness, excess_kurtosis : 0 for a Gaussian
    p_ratio : p-value of the test of D'Agostino and Pearson, or for perigee and apogee together of that of Mardia,
        adjusted for the tests of a case by Holm's method
    gaussian : whether p_ratio is 1 % or more

    No rows for cases with fewer than 20 good runs.
    """
    rows = []
    for case, label in tables.labels.items():
        for state in orbital_states(tables, case)[-1:]:
            run_errors = stored_states.good_errors(tables, case, state)
            if len(run_errors) < _LEAST_RUNS:
                continue
            tests = _normality_tests(state, run_errors)
            adjusted_p = holm([test.p for test in tests.values()])
            for (quantity, test), p in zip(tests.items(), adjusted_p, strict=True):
                rows.append(
                    {
                        "case": label,
                        "event": state.event,
                        "quantity": quantity,
                        "runs": len(run_errors),
                        "skewness": test.skewness,
                        "excess_kurtosis": test.excess_kurtosis,
                        "p_ratio": float(p),
                        "gaussian": bool(p >= NORMALITY_ALPHA),
                    }
                )
    return pd.DataFrame(rows, columns=NORMALITY)


class _NormalityTest(NamedTuple):
    """Shape of a sample and the p-value of a test whether it is Gaussian."""

    skewness: float  # 0 for a Gaussian
    excess_kurtosis: float  # 0 for a Gaussian
    p: float  # p-value of the test


def _normality_tests(state: State, run_errors: Floats) -> dict[str, _NormalityTest]:
    """Return the tests of each element of the orbit, and that of perigee and apogee together.

    Elements without a finite error in every run, or with the same error in every run, are not tested.
    """
    differences = mission_errors.orbit_errors(state, run_errors)
    samples: dict[str, Floats] = {}
    for quantity, (metric, component) in QUANTITIES.items():
        sample = differences[metric][:, component]
        if np.isfinite(sample).all() and np.ptp(sample) > 0.0:
            samples[quantity] = sample

    tests = {}
    for quantity, sample in samples.items():
        tests[quantity] = _NormalityTest(
            skewness=float(stats.skew(sample)),
            excess_kurtosis=float(stats.kurtosis(sample)),
            p=float(stats.normaltest(sample).pvalue),
        )
    if all(quantity in samples for quantity in _PAIR):
        pair = np.stack([samples[quantity] for quantity in _PAIR], axis=1)
        tests[" with ".join(_PAIR)] = _NormalityTest(*mardia(pair))
    return tests


def mardia(sample: Floats) -> tuple[float, float, float]:
    """Return Mardia's skewness and excess kurtosis of a sample (n, k), and the p-value of the two tests together.

    Both are 0 for a Gaussian vector (Mardia, Biometrika 57, 1970). The p-value is twice the smaller of the two
    (Bonferroni).
    """
    n, k = sample.shape
    deviations = sample - sample.mean(axis=0)
    covariance = deviations.T @ deviations / n
    products = deviations @ np.linalg.solve(covariance, deviations.T)  # (n, n), x_i' S^-1 x_j
    skewness = float(np.mean(products**3))
    kurtosis = float(np.mean(np.diagonal(products) ** 2))
    gaussian_kurtosis = k * (k + 2)
    excess_kurtosis = kurtosis - gaussian_kurtosis

    # Of a Gaussian: n skewness / 6 is chi-squared, the kurtosis normal with variance 8 k (k + 2) / n.
    n_freedom = k * (k + 1) * (k + 2) // 6
    p_skewness = float(stats.chi2.sf(n * skewness / 6.0, n_freedom))
    kurtosis_sigma = np.sqrt(8.0 * k * (k + 2) / n)
    p_kurtosis = 2.0 * float(stats.norm.sf(abs(excess_kurtosis) / kurtosis_sigma))
    p = min(1.0, 2.0 * min(p_skewness, p_kurtosis))
    return skewness, excess_kurtosis, p


def _quantile(error: Floats) -> float:
    if not np.isfinite(error).all():
        return float("nan")
    return float(np.quantile(np.abs(error), 0.99))


@cache_result
def orbit_correction(tables: Tables) -> pd.DataFrame:
    """Return the least delta-v that brings the estimated orbit to the true one, at the last event of `orbit`.

    It is the least sum of impulses, anywhere in one revolution and linear in the error, that nulls the errors of
    semi-major axis, eccentricity, perigee, inclination and node (see `results.mechanics.impulses`). The position along
    the orbit is not corrected. For a vehicle that steers by its estimate, it is the correction that a perfect orbit
    determination would command.

    by : "linear covariance" (draws of its Gaussian) or "Monte Carlo" (runs that did not fail)
    q50, q95, q99 : quantiles
    velocity_q99, position_q99 : 99 % quantile with the error of velocity, or of position, alone
    """
    rows = []
    for case, label in tables.labels.items():
        for state in orbital_states(tables, case)[-1:]:
            for method, (total, velocity, position) in costs(tables, case, state.event).items():
                rows.append(
                    {
                        "case": label,
                        "event": state.event,
                        "unit": "m/s",
                        "by": method,
                        "draw_count": len(total),
                        "mean_delta_v": float(total.mean()),
                        "q50": float(np.quantile(total, 0.5)),
                        "q95": float(np.quantile(total, 0.95)),
                        "q99": float(np.quantile(total, 0.99)),
                        "velocity_q99": float(np.quantile(velocity, 0.99)),
                        "position_q99": float(np.quantile(position, 0.99)),
                    }
                )
    return pd.DataFrame(rows, columns=CORRECTION)


@cache_result
def costs(tables: Tables, case: str, event: str) -> dict[str, Floats]:
    """Return the least delta-v of a correction at an event.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    event : str
        Event with a stored state.

    Returns
    -------
    dict of str to (3, n) array
        Delta-v (m/s) by "linear covariance" (n draws) and by "Monte Carlo" (n good runs, if there are any). The rows
        are those of the whole error, of the velocity error alone, and of the position error alone.
    """
    state = stored_states.state_at(tables, case, event)
    assert state is not None
    law = stored_states.law_at(tables, case, event)
    draws = mission_errors.draws(law.mean, law.true, _DRAWS)
    runs = stored_states.good_errors(tables, case, state)

    # All errors are corrected in one call, which takes hardly longer than that of a single sample.
    velocity_only = np.repeat([1.0, 0.0], 3)
    position_only = np.repeat([0.0, 1.0], 3)
    masks = np.array([np.ones(6), velocity_only, position_only])[:, None]
    errors = np.concatenate([draws * masks, runs * masks], axis=1)
    corrections = impulses.least_state_correction(state.r_i, state.v_i, errors.reshape(-1, 6))
    delta_v = corrections.delta_v.reshape(3, -1)
    cost_by_method = {"linear covariance": delta_v[:, : len(draws)]}
    if len(runs):
        cost_by_method["Monte Carlo"] = delta_v[:, len(draws) :]
    return cost_by_method
