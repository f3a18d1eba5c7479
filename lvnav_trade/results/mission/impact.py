"""Instantaneous impact point over the flight, the ellipse of its error, and compliance with a corridor."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import special

from lvnav_trade.kernels.earth import ECCENTRICITY_2, SEMI_MAJOR
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.results.evaluation.covariances import why_not_applicable
from lvnav_trade.results.mechanics import free_fall, mission_errors, stored_states
from lvnav_trade.results.mechanics.stored_states import ErrorGaussian, State
from lvnav_trade.results.statistics.case_results import number_in
from lvnav_trade.results.statistics.probability import success_verdict
from lvnav_trade.results.statistics.select import once, pick
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


class Corridor(NamedTuple):
    """Corridor on the ground that the impact point must not leave.

    corners : (m, 2), rad. Latitude and longitude, longitudes unwrapped.
    probability : Required probability.
    confidence : Confidence required of the runs.
    """

    corners: Floats
    probability: float
    confidence: float


def corridor_of(tables: Tables) -> Corridor | None:
    """Return the corridor of a campaign; None if it has none."""
    card: dict[str, Any] | None = tables.campaign.get("corridor")
    if not card:
        return None
    corners = np.array([[number_in(value, "rad") for value in corner] for corner in card["polygon"]])
    corners[:, 1] = np.unwrap(corners[:, 1])  # an edge takes the shorter way around the Earth
    return Corridor(corners, float(card.get("probability", 0.999)), float(card.get("confidence", 0.9)))


def unwrapped_longitude(longitude: ArrayLike, corners: Floats) -> Floats:
    """Return longitudes (...,) in rad, shifted by full turns to the range of the corridor."""
    middle = 0.5 * (corners[:, 1].min() + corners[:, 1].max())
    return np.asarray(longitude + 2.0 * np.pi * np.round((middle - np.asarray(longitude)) / (2.0 * np.pi)))


def metres(latitude: float) -> Floats:
    """Return metres per radian of latitude and of longitude on the ellipsoid, (2,).

    latitude : rad
    """
    w2 = 1.0 - ECCENTRICITY_2 * np.sin(latitude) ** 2
    return np.array([SEMI_MAJOR * (1.0 - ECCENTRICITY_2) / w2**1.5, SEMI_MAJOR * np.cos(latitude) / np.sqrt(w2)])


def probability(polygon: ArrayLike, mean: ArrayLike, covariance: ArrayLike) -> tuple[float, float]:
    """Return the probability that a Gaussian point lies in a polygon, and the margin of its mean.

    Parameters
    ----------
    polygon : (m, 2) array
        Corners.
    mean : (2,) array
        Mean, in the unit of the polygon.
    covariance : (2, 2) array
        Covariance, in its square.

    Returns
    -------
    probability : float
        Exact also in the far tails. In the whitened plane it is the winding number less two values of Owen's T function
        for each edge (Annals of Mathematical Statistics 27, 1956).
    margin : float
        Mahalanobis distance (sigmas) from the mean to the nearest edge; negative outside.
    """
    root = np.linalg.cholesky(np.asarray(covariance, dtype=float))
    start = np.linalg.solve(root, (np.asarray(polygon, dtype=float) - np.asarray(mean, dtype=float)).T).T
    end = np.roll(start, -1, axis=0)
    length = np.linalg.norm(end - start, axis=1)
    start, end, length = start[length > 0.0], end[length > 0.0], length[length > 0.0]
    along = (end - start) / length[:, None]
    away = start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]  # signed distance of the edge's line
    first, last = np.sum(start * along, axis=1), np.sum(end * along, axis=1)
    off = away != 0.0
    h, sign = np.abs(away[off]), np.sign(away[off])
    a, b = first[off] / h, last[off] / h
    winding = float(np.sum(sign * (np.arctan(b) - np.arctan(a)) / (2.0 * np.pi)))
    outside = float(np.sum(sign * (special.owens_t(h, b) - special.owens_t(h, a))))
    around = np.sign(np.sum(start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0]))
    margin = float(np.hypot(np.clip(0.0, first, last), away).min())
    return float(np.clip(around * (winding - outside), 0.0, 1.0)), margin if around * winding > 0.5 else -margin


def contains(polygon: ArrayLike, points: ArrayLike) -> Bools:
    """Return which points (n, 2) lie in a polygon (m, 2): a ray from such a point crosses an odd number of edges."""
    start, points = np.asarray(polygon, dtype=float), np.asarray(points, dtype=float)
    end = np.roll(start, -1, axis=0)
    x, y = points[:, :1], points[:, 1:]
    crosses = (start[:, 1] > y) != (end[:, 1] > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = start[:, 0] + (y - start[:, 1]) / (end[:, 1] - start[:, 1]) * (end[:, 0] - start[:, 0])
    return np.asarray(np.sum(crosses & (x < crossing), axis=1) % 2 == 1)


def impact(tables: Tables, only: str | None = None) -> pd.DataFrame:
    """Return each case's point of impact over the flight, with its error; rows only where there is one.

    only : digest of the only case to evaluate

    The impact point is that of a fall without thrust and atmosphere to a rotating Earth with J2 (see
    `results.mechanics.free_fall`). Its error is true less estimated: down-range along the ground velocity at impact,
    cross-range to its right; of first order for linear covariance. Columns:

    major, minor : semi-axes of the three-sigma ellipse (98.9 % of a Gaussian)
    corridor_probability : that the estimated point lies in the corridor while the vehicle flies as planned
    corridor_margin_sigma : sigmas to the nearest edge of the corridor
    mc_outside : number of runs, at events, whose estimated point is outside
    """
    cases = {case: label for case, label in tables.labels.items() if only in (None, case)}
    rows = [{"case": label} | row for case, label in cases.items() for row in _case_rows(tables, case)]
    return pd.DataFrame(rows, columns=COLUMNS)


@once
def _case_rows(tables: Tables, case: str) -> list[dict[str, Any]]:
    corridor = corridor_of(tables)
    states, laws = stored_states.states(tables, case), stored_states.laws(tables, case)
    if not states:
        return []
    true = [column.tobytes() for column in _arrays(states)]
    points, slopes = _points(*true), _slopes(*true)
    falling = [k for k in np.argsort([state.t for state in states], kind="stable") if np.isfinite(points.fall[k])]
    flown = _runs(tables, case, [states[k] for k in falling], corridor)
    return [
        _row(states[k], laws[k], free_fall.Impact(*(value[k] for value in points)), slopes[k], corridor) | of_runs
        for k, of_runs in zip(falling, flown, strict=True)
    ]


@lru_cache(maxsize=64)
def _points(r_i: bytes, v_i: bytes, earth_angle: bytes) -> free_fall.Impact:
    """Return the impact points of states given by their numbers, cached for all cases with the same trajectory."""
    return free_fall.impact(*_numbers(r_i, v_i, earth_angle))


def _numbers(r_i: bytes, v_i: bytes, earth_angle: bytes) -> tuple[Floats, Floats, Floats]:
    return np.frombuffer(r_i).reshape(-1, 3), np.frombuffer(v_i).reshape(-1, 3), np.frombuffer(earth_angle)


def _arrays(states: list[State]) -> tuple[Floats, Floats, Floats]:
    """Return positions and velocities (n, 3), frame i, and Earth angles (n,) of true states."""
    position, velocity = np.array([state.r_i for state in states]), np.array([state.v_i for state in states])
    return position, velocity, np.array([state.earth_angle for state in states])


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
        why_not = why_not_applicable(tables, case)
        verdict = "met" if worst.corridor_probability >= corridor.probability else "violated"
        outside, runs = outside_runs(tables, case, corridor)
        rows.append(
            {
                "case": label,
                "verdict": "not applicable" if why_not else verdict,
                "probability": corridor.probability,
                "expected_probability": worst.corridor_probability,
                "margin_sigma": worst.corridor_margin_sigma,
                "t_s": worst.t_s,
                "mc_verdict": success_verdict(runs, outside, corridor.probability, corridor.confidence),
                "runs": runs,
                "outside": outside,
                "reason": why_not,
            }
        )
    return pd.DataFrame(rows, columns=VERDICTS)


def outside_runs(tables: Tables, case: str, corridor: Corridor) -> tuple[int, int]:
    """Return the number of runs that failed or were outside the corridor at an event, and the number of all runs."""
    errors = [
        (state, *stored_states.run_errors(tables, case, state))
        for state in stored_states.states(tables, case)
        if state.event
    ]
    bad = [failed | _outside(state, error, corridor) for state, error, failed in errors]
    return (int(np.any(bad, axis=0).sum()), len(bad[0])) if bad else (0, 0)


def _outside(state: State, error: Floats, corridor: Corridor) -> Bools:
    """Return which estimated points are outside the corridor; none if the true state has no impact point."""
    out = np.zeros(len(error), dtype=bool)
    good = np.isfinite(error).all(axis=1)
    if not good.any() or not np.isfinite(free_fall.impact(*_arrays([state])).fall[0]):
        return out
    estimated = free_fall.impact(
        state.r_i - error[good, 3:], state.v_i - error[good, :3], state.earth_angle, lowest=0.0
    )
    points = np.stack([estimated.latitude, unwrapped_longitude(estimated.longitude, corridor.corners)], axis=1)
    out[good] = ~contains(corridor.corners, points)
    return out


def _row(
    state: State, law: ErrorGaussian, point: free_fall.Impact, slope: Floats, corridor: Corridor | None
) -> dict[str, Any]:
    """Return the impact point and its error by linear covariance at one time, in kilometres and degrees.

    No error is reported where the fall just grazes the ground, so that neighbouring states have no impact point.

    slope : derivative of the error at impact, as `_slopes`
    """
    row: dict[str, Any] = {
        "event": state.event,
        "t_s": state.t,
        "latitude_deg": np.degrees(point.latitude),
        "longitude_deg": np.degrees(point.longitude),
        "heading_deg": np.degrees(point.heading) % 360.0,
        "fall_s": float(point.fall),
    }
    if not np.isfinite(slope).all():
        return row
    covariance, formal, bias = slope @ law.true @ slope.T, slope @ law.formal @ slope.T, slope @ law.mean
    sigma, filter_sigma = np.sqrt(np.diag(covariance)), np.sqrt(np.diag(formal))
    bias_km = mission_errors.resolved(bias, sigma)
    variance, axes = np.linalg.eigh(covariance)
    major = float(np.arctan2(axes[1, 1], axes[0, 1])) + float(point.heading)
    row |= {
        "down_sigma_km": sigma[0],
        "cross_sigma_km": sigma[1],
        "correlation": covariance[0, 1] / (sigma[0] * sigma[1]) if sigma.all() else float("nan"),
        "major_3sigma_km": 3.0 * np.sqrt(variance[1]),
        "minor_3sigma_km": 3.0 * np.sqrt(max(0.0, variance[0])),
        "major_heading_deg": np.degrees(major) % 180.0,
        "down_filter_sigma_km": filter_sigma[0],
        "cross_filter_sigma_km": filter_sigma[1],
        "down_bias_km": bias_km[0],
        "cross_bias_km": bias_km[1],
    }
    if corridor is not None:
        chance, margin = _inside(corridor, point, covariance, bias)
        row |= {"corridor_probability": chance, "corridor_margin_sigma": margin}
    return row


@lru_cache(maxsize=64)
def _slopes(r_i: bytes, v_i: bytes, earth_angle: bytes) -> Floats:
    """Return the derivatives (n, 2, 6) of the error at impact (km) with respect to velocity and position of n states.

    The states are given by their numbers, and the result is cached for all cases with the same trajectory. All falls
    are integrated together, which takes as long as a single fall.
    """
    r, v, theta = _numbers(r_i, v_i, earth_angle)
    true = _points(r_i, v_i, earth_angle)

    def errors(error: Floats) -> Floats:
        """Return the errors at impact (m, n * 2) of errors (m, 6) at every state."""
        m, n = len(error), len(r)
        off = np.repeat(error, n, axis=0)
        estimated = free_fall.impact(
            np.tile(r, (m, 1)) - off[:, 3:], np.tile(v, (m, 1)) - off[:, :3], np.tile(theta, m), lowest=0.0
        )
        found = -free_fall.offsets(np.tile(true.r_e, (m, 1)), estimated.r_e, np.tile(true.heading, m))
        return np.asarray(found.reshape(m, n * 2))

    slopes = mission_errors.derivative(errors).reshape(len(r), 2, 6) * 1e-3
    slopes.flags.writeable = False
    return slopes


def _inside(corridor: Corridor, point: free_fall.Impact, covariance: Floats, bias: Floats) -> tuple[float, float]:
    """Return probability and margin of the estimated point, which is the true point less the error.

    Edges of the corridor are straight lines in latitude and longitude.
    """
    c, s = np.cos(point.heading), np.sin(point.heading)
    north_east = np.array([[c, -s], [s, c]])
    here = np.array([point.latitude, unwrapped_longitude(point.longitude, corridor.corners)])
    spread = north_east @ covariance @ north_east.T + 1e-12 * np.eye(2)  # a millimetre, so that the matrix is regular
    return probability((corridor.corners - here) * metres(float(point.latitude)) * 1e-3, -north_east @ bias, spread)


def _runs(tables: Tables, case: str, states: Sequence[State], corridor: Corridor | None) -> list[dict[str, Any]]:
    """Return the statistics of the runs at each state of an event; no runs are stored between events."""
    off = run_impacts(tables, case)
    return [
        _of_runs(tables, case, state, off[state.event], corridor) if state.event else {"runs": 0} for state in states
    ]


@once
def run_impacts(tables: Tables, case: str) -> dict[str, Floats]:
    """Return the true impact point less the estimated one of the runs that did not fail, by event.

    Down-range and cross-range, (n, 2), m; NaN if the true state has no impact point.
    """
    states = [state for state in stored_states.states(tables, case) if state.event]
    good = [stored_states.good_errors(tables, case, state) for state in states]
    off = mission_errors.impacts_errors(states, good) if states else []
    return {state.event: errors for state, errors in zip(states, off, strict=True)}


def _of_runs(tables: Tables, case: str, state: State, off: Floats, corridor: Corridor | None) -> dict[str, Any]:
    """Return the statistics of the runs at an event.

    off : their errors (n, 2) at impact, m
    """
    if len(off) < 2:
        return {"runs": len(off)}
    off = off * 1e-3
    spread = off.std(axis=0, ddof=1)
    far = float(np.quantile(np.linalg.norm(off, axis=1), 0.99))
    statistics = {"runs": len(off), "mc_down_sigma_km": spread[0], "mc_cross_sigma_km": spread[1], "mc_q99_km": far}
    if corridor is None:
        return statistics
    return statistics | {
        "mc_outside": int(_outside(state, stored_states.good_errors(tables, case, state), corridor).sum())
    }


def ellipse(row: Any, sigmas: float = 3.0, points: int = 73) -> tuple[Floats, Floats]:
    """Return latitude and longitude (deg) of the error ellipse about the true impact point, for a row of `impact`.

    sigmas : semi-axes in sigmas
    points : number of points
    """
    latitude, longitude = np.radians(row.latitude_deg), np.radians(row.longitude_deg)
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    heading = np.radians(row.major_heading_deg)
    a, b = (value * 1e3 * sigmas / 3.0 for value in (row.major_3sigma_km, row.minor_3sigma_km))
    north = a * np.cos(angle) * np.cos(heading) - b * np.sin(angle) * np.sin(heading)
    east = a * np.cos(angle) * np.sin(heading) + b * np.sin(angle) * np.cos(heading)
    per = metres(float(latitude))
    return np.degrees(latitude + north / per[0]), np.degrees(longitude + east / per[1])
