"""Orbit at injection, its errors and the delta-v of their correction, by linear covariance and by runs."""

from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.mechanics import impulses, mission_errors, orbits, stored_states
from lvnav_trade.results.metrics.mission import MISSION
from lvnav_trade.results.statistics.probability import holm
from lvnav_trade.results.statistics.select import final_event, flight_events, once
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
    """Return the orbit of each case at its final event, and at earlier ones from which it does not fall, with errors.

    Heights are above the equatorial radius. An error is true less estimated, of averaged elements. Columns:

    averaged : average over one revolution, without the short-periodic variation of J2 (see `results.mechanics.orbits`)
    lowest height, highest height : extremes of the first revolution, with the short-periodic variation
    lincov_sigma, filter_sigma : first order, true and formal; empty with a remark within 3 sigma of a circular orbit
    lincov_q99 : 99 % quantile of |error|, from Gaussian draws through the exact relation, also for circular orbits
    mc_sigma, mc_bias, mc_q99 : of the runs that did not fail

    An element below `LEAST` is written as 0.
    """
    rows = [
        {"case": label, "event": state.event} | row
        for case, label in tables.labels.items()
        for state in orbital_states(tables, case)
        for row in _rows(tables, case, state)
    ]
    return pd.DataFrame(rows, columns=COLUMNS)


def orbital_states(tables: Tables, case: str) -> list[stored_states.State]:
    """Return the states at the final event, and at earlier events whose orbit clears the ground.

    Events at the time of the final event are omitted.
    """
    final = final_event(tables, case)
    last = stored_states.state_at(tables, case, final)
    if last is None:
        return []
    clear = []
    for event in flight_events(tables, case).event:
        state = last if event == final else stored_states.state_at(tables, case, str(event))
        if state is None or (event != final and abs(state.t - last.t) < 1e-6):
            continue
        average = mission_errors.mean_orbit(state)
        if float(average.perigee) > 0.0 or (event == final and bool(average.elliptic)):
            clear.append(state)
    return clear


def values(orbit_of: orbits.OrbitVectors) -> dict[str, float]:
    """Return the elements of an orbit (SI) by the names of `QUANTITIES`."""
    node = np.array([np.cos(orbit_of.node), np.sin(orbit_of.node), 0.0])
    ahead = np.cross(orbit_of.h_i / np.linalg.norm(orbit_of.h_i), node)
    elements = (
        orbit_of.semi_major_axis,
        orbit_of.perigee,
        orbit_of.apogee,
        orbit_of.eccentricity,
        orbit_of.e_i @ node,
        orbit_of.e_i @ ahead,
        orbit_of.inclination,
        orbit_of.node,
    )
    return {name: float(value) for name, value in zip(QUANTITIES, elements, strict=True)}


def _rows(tables: Tables, case: str, state: stored_states.State) -> list[dict[str, Any]]:
    law = stored_states.law_at(tables, case, state.event)
    now, average = values(orbits.osculating(state.r_i, state.v_i)), values(mission_errors.mean_orbit(state))
    good = stored_states.good_errors(tables, case, state)
    of_runs, drawn = (
        mission_errors.orbit_errors(state, some) for some in (good, mission_errors.draws(law.mean, law.true))
    )
    rows: list[dict[str, Any]] = []
    for name, (metric, component) in QUANTITIES.items():
        unit, factor = MISSION[metric].label_unit, MISSION[metric].label_factor
        columns = {"osculating": now[name] * factor, "averaged": average[name] * factor}
        columns = {column: value if abs(value) >= LEAST else 0.0 for column, value in columns.items()}
        row = {"quantity": name, "unit": unit, **columns}
        row["remark"] = mission_errors.applies(state, metric, law.true)
        if not row["remark"]:
            slope = mission_errors.jacobian(state, metric)[component]
            sigma, formal = (float(np.sqrt(slope @ covariance @ slope)) for covariance in (law.true, law.formal))
            bias = float(mission_errors.resolved(slope @ law.mean, sigma))
            row |= {"lincov_sigma": sigma * factor, "filter_sigma": formal * factor, "lincov_bias": bias * factor}
        row |= {"lincov_q99": _quantile(drawn[metric][:, component]) * factor, "runs": len(good)}
        if len(good):
            errors = of_runs[metric][:, component] * factor
            spread = float(errors.std(ddof=1)) if len(good) > 1 else float("nan")
            row |= {"mc_sigma": spread, "mc_bias": float(errors.mean()), "mc_q99": _quantile(errors)}
        rows.append(row)
    heights = zip(("lowest height", "highest height"), orbits.extremes(state.r_i, state.v_i), strict=True)
    end = {"unit": "km", "runs": len(good), "remark": ""}
    return rows + [{"quantity": name, "averaged": float(height) * 1e-3} | end for name, height in heights]


@once
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
            good = stored_states.good_errors(tables, case, state)
            if len(good) < _LEAST_RUNS:
                continue
            errors = mission_errors.orbit_errors(state, good)
            each = {name: errors[metric][:, component] for name, (metric, component) in QUANTITIES.items()}
            each = {name: error for name, error in each.items() if np.isfinite(error).all() and np.ptp(error) > 0.0}
            shapes = {
                name: (float(stats.skew(error)), float(stats.kurtosis(error)), float(stats.normaltest(error).pvalue))
                for name, error in each.items()
            }
            if {*_PAIR} <= set(each):
                shapes[" with ".join(_PAIR)] = mardia(np.stack([each[name] for name in _PAIR], axis=1))
            for (name, shape), p in zip(
                shapes.items(), holm([shape_of[-1] for shape_of in shapes.values()]), strict=True
            ):
                rows.append((label, state.event, name, len(good), *shape[:2], float(p), bool(p >= NORMALITY_ALPHA)))
    return pd.DataFrame(rows, columns=NORMALITY)


def mardia(sample: Floats) -> tuple[float, float, float]:
    """Return Mardia's skewness and excess kurtosis of a sample (n, k), and the p-value of the two tests together.

    Both are 0 for a Gaussian vector (Mardia, Biometrika 57, 1970). The p-value is twice the smaller of the two
    (Bonferroni).
    """
    n, k = sample.shape
    centred = sample - sample.mean(axis=0)
    products = centred @ np.linalg.solve(centred.T @ centred / n, centred.T)
    skewness, kurtosis = float(np.mean(products**3)), float(np.mean(np.diagonal(products) ** 2)) - k * (k + 2)
    chances = (
        float(stats.chi2.sf(n * skewness / 6.0, k * (k + 1) * (k + 2) // 6)),
        2.0 * float(stats.norm.sf(abs(kurtosis) / np.sqrt(8.0 * k * (k + 2) / n))),
    )
    return skewness, kurtosis, min(1.0, 2.0 * min(chances))


def _quantile(error: Floats) -> float:
    return float(np.quantile(np.abs(error), 0.99)) if np.isfinite(error).all() else float("nan")


@once
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
    rows = [
        (label, state.event, "m/s", by, cost.shape[1], *_quantiles(cost))
        for case, label in tables.labels.items()
        for state in orbital_states(tables, case)[-1:]
        for by, cost in costs(tables, case, state.event).items()
    ]
    return pd.DataFrame(rows, columns=CORRECTION)


@once
def costs(tables: Tables, case: str, event: str) -> dict[str, Floats]:
    """Return the least delta-v of a correction at an event, by "linear covariance" (draws) and by "Monte Carlo" (good
    runs).

    Each is (3, n), m/s: for the whole error, for that of velocity alone, and for that of position alone.
    """
    state = stored_states.state_at(tables, case, event)
    assert state is not None
    law = stored_states.law_at(tables, case, event)
    of = {
        "linear covariance": mission_errors.draws(law.mean, law.true, _DRAWS),
        "Monte Carlo": stored_states.good_errors(tables, case, state),
    }
    masks = np.array([np.ones(6), np.repeat([1.0, 0.0], 3), np.repeat([0.0, 1.0], 3)])[:, None]
    errors = np.concatenate([error * masks for error in of.values()], axis=1)
    least = impulses.least_at(state.r_i, state.v_i, errors.reshape(-1, 6)).delta_v.reshape(3, -1)
    parts = np.split(least, np.cumsum([len(error) for error in of.values()])[:-1], axis=1)
    return {by: delta_v for by, delta_v in zip(of, parts, strict=True) if delta_v.size}


def _quantiles(cost: Floats) -> list[float]:
    """Return the values of the columns `CORRECTION`, from the mean on, for costs (3, n)."""
    total, velocity, position = cost
    columns = [(total, 0.5), (total, 0.95), (total, 0.99), (velocity, 0.99), (position, 0.99)]
    return [float(total.mean()), *(float(np.quantile(cost_of, probability)) for cost_of, probability in columns)]
