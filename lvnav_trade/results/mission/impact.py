"""Instantaneous impact point over the flight, the ellipse of its error, and compliance with a corridor."""

from functools import lru_cache
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.evaluation.covariances import why_not_applicable
from lvnav_trade.results.mechanics import free_fall, mission_errors, stored_states
from lvnav_trade.results.mechanics.stored_states import ErrorGaussian, State
from lvnav_trade.results.mission.corridor import (
    Corridor,
    corridor_of,
    metres,
    outside_corridor,
    outside_runs,
    probability_inside,
)
from lvnav_trade.results.statistics.probability import success_verdict
from lvnav_trade.results.statistics.select import cache_result, pick
from lvnav_trade.results.tables.read import Tables

COLUMNS = [
    "case",
    "event",
    "t_s",
    "latitude_deg",
    "longitude_deg",
    "heading_deg",
    "fall_s",
    "down_sigma_km",
    "cross_sigma_km",
    "correlation",
    "major_3sigma_km",
    "minor_3sigma_km",
    "major_heading_deg",
    "down_filter_sigma_km",
    "cross_filter_sigma_km",
    "down_bias_km",
    "cross_bias_km",
    "corridor_probability",
    "corridor_margin_sigma",
    "runs",
    "mc_down_sigma_km",
    "mc_cross_sigma_km",
    "mc_q99_km",
    "mc_outside",
]
VERDICTS = [
    "case",
    "verdict",
    "probability",
    "expected_probability",
    "margin_sigma",
    "t_s",
    "mc_verdict",
    "runs",
    "outside",
    "reason",
]


def impact(tables: Tables, only: str | None = None) -> pd.DataFrame:
    """Return each case's point of impact over the flight, with its error; no rows for times without impact point.

    only : digest of the only case to evaluate

    The impact point is that of a fall without thrust and atmosphere to a rotating Earth with J2 (see
    `results.mechanics.free_fall`). Its error is true less estimated: down-range along the ground velocity at impact,
    cross-range to its right; of first order for linear covariance. Columns:

    major, minor : semi-axes of the three-sigma ellipse (98.9 % of a Gaussian)
    corridor_probability : that the estimated point lies in the corridor while the vehicle flies as planned
    corridor_margin_sigma : sigmas to the nearest edge of the corridor
    mc_outside : number of runs, at events, whose estimated point is outside
    """
    rows: list[dict[str, Any]] = []
    for case, label in tables.labels.items():
        if only is None or case == only:
            rows += [{"case": label} | row for row in _case_rows(tables, case)]
    return pd.DataFrame(rows, columns=COLUMNS)


@cache_result
def _case_rows(tables: Tables, case: str) -> list[dict[str, Any]]:
    corridor = corridor_of(tables)
    states = stored_states.states(tables, case)
    laws = stored_states.laws(tables, case)
    if not states:
        return []
    key = _cache_key(states)
    points = _points(*key)
    slopes = _slopes(*key)
    run_errors = run_impacts(tables, case)

    rows = []
    for k in np.argsort([state.t for state in states], kind="stable"):
        if not np.isfinite(points.fall[k]):
            continue
        point = free_fall.Impact(
            r_e=points.r_e[k],
            latitude=points.latitude[k],
            longitude=points.longitude[k],
            fall=points.fall[k],
            heading=points.heading[k],
        )
        row = _point_row(states[k], point)
        # Where the fall just grazes the ground, neighbouring states have no impact point and the error is undefined.
        if np.isfinite(slopes[k]).all():
            row |= _error_columns(laws[k], point, slopes[k], corridor)
        if states[k].event:
            state = states[k]
            row |= _run_columns(tables, case, state, run_errors[state.event], corridor)
        else:
            row |= {"runs": 0}  # no runs are stored between events
        rows.append(row)
    return rows


@lru_cache(maxsize=64)
def _points(r_i: bytes, v_i: bytes, earth_angle: bytes) -> free_fall.Impact:
    """Return the impact points of states, cached for all cases with the same trajectory; see `_cache_key`."""
    return free_fall.impact(*_read_key(r_i, v_i, earth_angle))


def _read_key(r_i: bytes, v_i: bytes, earth_angle: bytes) -> tuple[Floats, Floats, Floats]:
    """Return positions and velocities (n, 3), frame i, and Earth angles (n,) of a `_cache_key`."""
    return np.frombuffer(r_i).reshape(-1, 3), np.frombuffer(v_i).reshape(-1, 3), np.frombuffer(earth_angle)


def _cache_key(states: list[State]) -> tuple[bytes, bytes, bytes]:
    """Return positions and velocities, frame i, and Earth angles of true states as the key of a cache."""
    r_i = np.array([state.r_i for state in states])
    v_i = np.array([state.v_i for state in states])
    earth_angle = np.array([state.earth_angle for state in states])
    return r_i.tobytes(), v_i.tobytes(), earth_angle.tobytes()


def corridor_verdicts(tables: Tables) -> pd.DataFrame:
    """Return the verdicts on the corridor of the estimated point of impact.

    verdict : by linear covariance at the stored time with the least probability (t_s): "met", "violated", or
        "not applicable" if a gate rejects too many measurements
    mc_verdict : by the runs, exact binomial at the required confidence; a run outside at any event, or failed, counts
        as a failure

    No rows without a corridor in the campaign.
    """
    corridor = corridor_of(tables)
    if corridor is None:
        return pd.DataFrame(columns=VERDICTS)
    points = impact(tables)
    rows: list[dict[str, Any]] = []
    for case, label in tables.labels.items():
        case_points = pick(points, case=label)
        if not case_points.corridor_probability.notna().any():
            rows.append({"case": label, "verdict": "not applicable", "reason": "no point of impact in the flight"})
            continue
        worst = case_points.loc[case_points.corridor_probability.idxmin()]
        reason = why_not_applicable(tables, case)
        if reason:
            verdict = "not applicable"
        elif worst.corridor_probability >= corridor.probability:
            verdict = "met"
        else:
            verdict = "violated"
        n_outside, n_run = outside_runs(tables, case, corridor)
        rows.append(
            {
                "case": label,
                "verdict": verdict,
                "probability": corridor.probability,
                "expected_probability": worst.corridor_probability,
                "margin_sigma": worst.corridor_margin_sigma,
                "t_s": worst.t_s,
                "mc_verdict": success_verdict(n_run, n_outside, corridor.probability, corridor.confidence),
                "runs": n_run,
                "outside": n_outside,
                "reason": reason,
            }
        )
    return pd.DataFrame(rows, columns=VERDICTS)


def _point_row(state: State, point: free_fall.Impact) -> dict[str, Any]:
    """Return the impact point of a true state, in degrees."""
    return {
        "event": state.event,
        "t_s": state.t,
        "latitude_deg": np.degrees(point.latitude),
        "longitude_deg": np.degrees(point.longitude),
        "heading_deg": np.degrees(point.heading) % 360.0,
        "fall_s": float(point.fall),
    }


def _error_columns(
    law: ErrorGaussian,
    point: free_fall.Impact,
    slope: Floats,
    corridor: Corridor | None,
) -> dict[str, Any]:
    """Return the error of an impact point by linear covariance, in kilometres and degrees.

    Parameters
    ----------
    law : ErrorGaussian
        Gaussian of the errors of velocity and position, frame i.
    point : free_fall.Impact
        True impact point.
    slope : (2, 6) array
        Derivative S of the error at impact (km), as `_slopes`. The covariance is S P S', the mean S m.
    corridor : Corridor or None
        Corridor of the impact point.

    Returns
    -------
    dict of str to float
        Values by column of the table.
    """
    covariance = slope @ law.true @ slope.T
    filter_covariance = slope @ law.formal @ slope.T
    bias = slope @ law.mean
    sigma = np.sqrt(np.diag(covariance))
    filter_sigma = np.sqrt(np.diag(filter_covariance))
    bias_km = mission_errors.round_bias(bias, sigma)
    if sigma.all():
        correlation = covariance[0, 1] / (sigma[0] * sigma[1])
    else:
        correlation = float("nan")

    variance, axes = np.linalg.eigh(covariance)
    axis_angle = np.arctan2(axes[1, 1], axes[0, 1])
    major_heading = float(axis_angle) + float(point.heading)
    columns = {
        "down_sigma_km": sigma[0],
        "cross_sigma_km": sigma[1],
        "correlation": correlation,
        "major_3sigma_km": 3.0 * np.sqrt(variance[1]),
        "minor_3sigma_km": 3.0 * np.sqrt(max(0.0, variance[0])),
        "major_heading_deg": np.degrees(major_heading) % 180.0,
        "down_filter_sigma_km": filter_sigma[0],
        "cross_filter_sigma_km": filter_sigma[1],
        "down_bias_km": bias_km[0],
        "cross_bias_km": bias_km[1],
    }
    if corridor is not None:
        inside, margin = probability_inside(corridor, point, covariance, bias)
        columns |= {"corridor_probability": inside, "corridor_margin_sigma": margin}
    return columns


@lru_cache(maxsize=64)
def _slopes(r_i: bytes, v_i: bytes, earth_angle: bytes) -> Floats:
    """Return the derivatives of the error at impact with respect to velocity and position.

    Parameters
    ----------
    r_i, v_i, earth_angle : bytes
        Positions (m) and velocities (m/s) of n states, frame i, and Earth angles (rad), as `_cache_key`.

    Returns
    -------
    (n, 2, 6) array
        Derivatives of the error down-range and cross-range (km) with respect to velocity (m/s) and position (m).

    Notes
    -----
    The result is cached for all cases with the same trajectory. All falls are integrated together, which takes as long
    as a single fall.
    """
    position, velocity, theta = _read_key(r_i, v_i, earth_angle)
    true = _points(r_i, v_i, earth_angle)
    n = len(position)

    def errors(error: Floats) -> Floats:
        """Return the errors at impact (m, n * 2) of errors (m, 6) at every state."""
        m = len(error)
        state_error = np.repeat(error, n, axis=0)
        estimated_impact = free_fall.impact(
            np.tile(position, (m, 1)) - state_error[:, 3:],
            np.tile(velocity, (m, 1)) - state_error[:, :3],
            np.tile(theta, m),
            lowest=0.0,
        )
        true_points = np.tile(true.r_e, (m, 1))
        headings = np.tile(true.heading, m)
        offset = free_fall.offsets(true_points, estimated_impact.r_e, headings)
        return np.asarray(-offset.reshape(m, n * 2))

    slopes = mission_errors.derivative(errors).reshape(n, 2, 6) * 1e-3
    slopes.flags.writeable = False
    return slopes


@cache_result
def run_impacts(tables: Tables, case: str) -> dict[str, Floats]:
    """Return the true impact point minus the estimated impact point, for the runs that did not fail.

    Returns
    -------
    dict of str to (n, 2) array
        Down-range and cross-range errors (m) by event; NaN if the true state has no impact point.
    """
    states = [state for state in stored_states.states(tables, case) if state.event]
    if not states:
        return {}
    run_errors = [stored_states.good_errors(tables, case, state) for state in states]
    point_errors = mission_errors.impacts_errors(states, run_errors)
    return {state.event: errors for state, errors in zip(states, point_errors, strict=True)}


def _run_columns(
    tables: Tables,
    case: str,
    state: State,
    point_errors: Floats,
    corridor: Corridor | None,
) -> dict[str, Any]:
    """Return the statistics of the runs at an event.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    state : State
        True state at the event.
    point_errors : (n_run, 2) array
        Errors of the runs at impact (m), as `run_impacts`.
    corridor : Corridor or None
        Corridor of the impact point.

    Returns
    -------
    dict of str to Any
        Values by column of the table.
    """
    n_run = len(point_errors)
    if n_run < 2:
        return {"runs": n_run}
    errors_km = point_errors * 1e-3
    sigma = errors_km.std(axis=0, ddof=1)
    columns = {
        "runs": n_run,
        "mc_down_sigma_km": sigma[0],
        "mc_cross_sigma_km": sigma[1],
        "mc_q99_km": float(np.quantile(np.linalg.norm(errors_km, axis=1), 0.99)),
    }
    if corridor is not None:
        state_errors = stored_states.good_errors(tables, case, state)
        columns["mc_outside"] = int(outside_corridor(state, state_errors, corridor).sum())
    return columns


def ellipse(row: Any, sigmas: float = 3.0, points: int = 73) -> tuple[Floats, Floats]:
    """Return the error ellipse about the true impact point.

    Parameters
    ----------
    row : named tuple
        Row of the table `impact`.
    sigmas : float
        Semi-axes in sigmas.
    points : int
        Number of points.

    Returns
    -------
    (points,) array, (points,) array
        Latitude and longitude (deg).
    """
    latitude = np.radians(row.latitude_deg)
    longitude = np.radians(row.longitude_deg)
    heading = np.radians(row.major_heading_deg)
    major = row.major_3sigma_km * 1e3 * sigmas / 3.0
    minor = row.minor_3sigma_km * 1e3 * sigmas / 3.0
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    along = major * np.cos(angle)
    across = minor * np.sin(angle)
    north = along * np.cos(heading) - across * np.sin(heading)
    east = along * np.sin(heading) + across * np.cos(heading)
    metres_per_latitude, metres_per_longitude = metres(float(latitude))
    latitudes = latitude + north / metres_per_latitude
    longitudes = longitude + east / metres_per_longitude
    return np.degrees(latitudes), np.degrees(longitudes)
