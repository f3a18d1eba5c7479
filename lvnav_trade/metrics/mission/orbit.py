"""The orbit at injection and its errors, by linear covariance and by the runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lvnav_trade.metrics.basics.select import final_event, flight_events
from lvnav_trade.metrics.mechanics import meanorbit, mission
from lvnav_trade.metrics.mechanics.mission import Law, State
from lvnav_trade.store import Tables, load

Floats = NDArray[np.float64]

COLUMNS = [
    "case", "event", "quantity", "unit", "osculating", "averaged", "lincov_sigma", "filter_sigma", "lincov_bias",
    "lincov_q99", "runs", "mc_sigma", "mc_bias", "mc_q99", "remark",
]  # fmt: skip
QUANTITIES = {
    "semi-major axis": ("semi_major_axis_error", 0), "perigee height": ("perigee_error", 0),
    "apogee height": ("apogee_error", 0), "eccentricity": ("eccentricity_error", 0),
    "eccentricity along the node": ("eccentricity_vector_error", 0),
    "eccentricity ahead of the node": ("eccentricity_vector_error", 1),
    "inclination": ("inclination_error", 0), "node": ("node_error", 0),
}  # fmt: skip
"""Quantities of an orbit, and the component of the error metric that belongs to each."""


def orbit(results: Path | str | Tables) -> pd.DataFrame:
    """Return the orbit of each case at its final event, and at earlier ones from which it does not fall, with errors.

    Heights count from the equatorial radius. averaged: over one revolution, J2's short-periodic swing taken out (see
    `meanorbit`); all errors are of averaged elements. lowest and highest height: those that the first revolution
    passes, the swing included. An error is true less estimated. lincov_sigma, filter_sigma: first order, true and
    formal; empty where an orbit is circular to within three sigma, with the remark. lincov_q99: 99 %
    quantile of |error|, from Gaussian draws through the map itself, so it stands there too. mc_sigma, mc_bias, mc_q99:
    of the runs that did not fail.
    """
    tables = load(results)
    rows = []
    for case, label in tables.labels.items():
        laws = dict(
            zip((state.event for state in mission.states(tables, case)), mission.laws(tables, case), strict=True)
        )
        for state in orbital_states(tables, case):
            head = {"case": label, "event": state.event}
            rows += [head | row for row in _rows(tables, case, state, laws[state.event])]
    return pd.DataFrame(rows, columns=COLUMNS)


def orbital_states(tables: Tables, case: str) -> list[State]:
    """Return the states at the final event and at earlier ones whose orbit clears the ground; not those at its time."""
    final = final_event(tables, case)
    last = mission.state_at(tables, case, final)
    if last is None:
        return []
    found = []
    for event in flight_events(tables, case).event:
        state = last if event == final else mission.state_at(tables, case, str(event))
        if state is None or (event != final and abs(state.t - last.t) < 1e-6):
            continue
        average = meanorbit.mean(state.r_i, state.v_i)
        if float(average.perigee) > 0.0 or (event == final and bool(average.elliptic)):
            found.append(state)
    return found


def values(orbit_of: meanorbit.Orbit) -> dict[str, float]:
    """Return the numbers of one orbit by the names of `QUANTITIES`, SI."""
    node = np.array([np.cos(orbit_of.node), np.sin(orbit_of.node), 0.0])
    ahead = np.cross(orbit_of.h_i / np.linalg.norm(orbit_of.h_i), node)
    found = (
        orbit_of.semi_major_axis, orbit_of.perigee, orbit_of.apogee, orbit_of.eccentricity, orbit_of.e_i @ node,
        orbit_of.e_i @ ahead, orbit_of.inclination, orbit_of.node,
    )  # fmt: skip
    return {name: float(value) for name, value in zip(QUANTITIES, found, strict=True)}


def _rows(tables: Tables, case: str, state: State, law: Law) -> list[dict[str, Any]]:
    now = values(meanorbit.osculating(state.r_i, state.v_i))
    average = values(meanorbit.mean(state.r_i, state.v_i))
    error, failed = mission.run_errors(tables, case, state)
    good = error[~failed]
    flown = mission.orbit_errors(state, good) if len(good) else {}
    drawn = mission.orbit_errors(state, mission.draws(law.mean, law.true))
    rows: list[dict[str, Any]] = []
    for name, (metric, component) in QUANTITIES.items():
        _, unit, factor = mission.people(metric)
        slope = mission.jacobian(state, metric)[component]
        reason = mission.applies(state, metric, law.true)
        row = {"quantity": name, "unit": unit, "osculating": now[name] * factor, "averaged": average[name] * factor}
        if not reason:
            sigma = np.sqrt(slope @ law.true @ slope)
            row |= {
                "lincov_sigma": float(sigma) * factor,
                "filter_sigma": float(np.sqrt(slope @ law.formal @ slope)) * factor,
                "lincov_bias": float(mission.resolved(slope @ law.mean, sigma)) * factor,
            }
        row |= {"lincov_q99": _quantile(_component(drawn[metric], component)) * factor, "remark": reason}
        rows.append(row | {"runs": len(good)} | _of_runs(flown, metric, component, factor))
    low, high = (float(height) for height in meanorbit.extremes(state.r_i, state.v_i))
    for name, height in (("lowest height", low), ("highest height", high)):
        rows.append({"quantity": name, "unit": "km", "averaged": height * 1e-3, "runs": len(good), "remark": ""})
    return rows


def _component(found: Floats, component: int) -> Floats:
    return found[:, component] if found.ndim == 2 else found


def _quantile(error: Floats) -> float:
    return float(np.quantile(np.abs(error), 0.99)) if np.isfinite(error).all() else float("nan")


def _of_runs(flown: dict[str, Floats], metric: str, component: int, factor: float) -> dict[str, float]:
    if not flown:
        return {}
    error = _component(flown[metric], component) * factor
    spread = float(error.std(ddof=1)) if len(error) > 1 else float("nan")
    return {"mc_sigma": spread, "mc_bias": float(error.mean()), "mc_q99": _quantile(error)}
