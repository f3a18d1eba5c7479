"""Estimates of rate and acceleration compared with IMU samples and formal sigmas; reduction of nozzle movement."""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.statistics.probability import rms_interval
from lvnav_trade.results.statistics.select import flight_events, history_of, pick, time_mean
from lvnav_trade.results.tables.read import Tables

QUANTITIES = ("rate", "acceleration")
COLUMNS = [
    "case",
    "phase",
    "metric",
    "axis",
    "unit",
    "raw",
    "filtered",
    "filter_sigma",
    "lincov_true",
    "reduction_percent",
    "formal_reduction_percent",
    "over_sigma_ratio",
    "low",
    "high",
    "verdict",
]
NOZZLE = [
    "case",
    "burn",
    "axis",
    "runs",
    "raw_deg",
    "filtered_deg",
    "true_deg",
    "reduction_percent",
    "low_percent",
    "high_percent",
]
_DEG_H = 206264.80624709636
_SHORTEST = 5.0  # s; shorter phases are omitted
_START_GAP = 2.0  # s after the start of a phase that are omitted
_END_GAP = 1.0  # s before the end of a phase that are omitted


def rate_and_acceleration(tables: Tables) -> pd.DataFrame:
    """Return errors of rate and acceleration by phase, of the raw sample and of the estimate.

    Parameters
    ----------
    tables : Tables
        Tables of the results.

    Returns
    -------
    pandas.DataFrame
        raw, filtered: RMS error of sample and estimate, of the runs or of linear covariance; filter_sigma: formal
        sigma; reduction_percent, formal_reduction_percent: reduction of the error by the filter, true and formal.
        over_sigma_ratio: RMS error of the estimate over the formal sigma; low, high: its 95 % interval for the runs at
        one time. verdict: "as modelled" if the interval includes 1, otherwise "smaller" or "larger".
    """
    rows = []
    for case, label in tables.labels.items():
        pairs = []
        for quantity in QUANTITIES:
            pairs += _error_pairs(tables, case, quantity)
        for first, second in pairwise(flight_events(tables, case).itertuples()):
            if second.t_s - first.t_s < _SHORTEST:
                continue
            phase = f"{first.event} to {second.event}"
            for pair in pairs:
                comparison = _compare_errors(tables, pair, first.t_s + _START_GAP, second.t_s - _END_GAP)
                if comparison:
                    rows.append({"case": label, "phase": phase, **comparison})
    return pd.DataFrame(rows, columns=COLUMNS)


class _Pair(NamedTuple):
    """Errors of a raw sample and of its estimate along an axis."""

    quantity: str  # rate or acceleration
    axis: str  # body axis
    raw: pd.DataFrame  # rows of the history of the sample's error
    estimate: pd.DataFrame  # rows of the history of the estimate's error


def _error_pairs(tables: Tables, case: str, quantity: str) -> list[_Pair]:
    outputs = pick(tables.outputs, case=case)
    # without a model of the vehicle the estimate is the sample minus its estimated bias
    estimate = quantity if (outputs.quantity == quantity).any() else f"corrected_{quantity}"
    pairs = []
    for axis in outputs.axis[outputs.quantity == f"raw_{quantity}"]:
        if axis != "3d":
            raw_history = history_of(tables, case, f"raw_{quantity}", str(axis))
            estimate_history = history_of(tables, case, estimate, str(axis))
            pairs.append(_Pair(quantity, str(axis), raw_history, estimate_history))
    return pairs


def _compare_errors(tables: Tables, pair: _Pair, start: float, end: float) -> dict[str, Any]:
    """Return the values of `COLUMNS` from the metric on.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    pair : _Pair
        Histories of the raw and of the estimated error of a quantity along an axis.
    start, end : float
        Times (s) between which the errors are compared, both excluded.

    Returns
    -------
    dict of str to Any
        Values by column; empty without rows between the times.
    """
    is_in_raw = (pair.raw.t_s > start) & (pair.raw.t_s < end)
    raw_rows = pair.raw[is_in_raw]
    is_in_estimate = (pair.estimate.t_s > start) & (pair.estimate.t_s < end)
    estimate_rows = pair.estimate[is_in_estimate]
    if raw_rows.empty or estimate_rows.empty:
        return {}
    unit, factor = tables.display_units[f"raw_{pair.quantity}", pair.axis]
    raw = _root_mean_squares(raw_rows)
    estimate = _root_mean_squares(estimate_rows)
    runs = int(estimate_rows.run_count.min())
    ratio = estimate.rms / estimate.sigma
    low, high = (ratio * float(bound) for bound in rms_interval(1.0, max(1, runs)))
    if not runs:
        verdict = "no runs"
    elif low <= 1.0 <= high:
        verdict = "as modelled"
    else:
        verdict = "smaller" if ratio < 1.0 else "larger"
    return {
        "metric": f"{pair.quantity}_error",
        "axis": pair.axis,
        "unit": unit,
        "raw": factor * raw.rms,
        "filtered": factor * estimate.rms,
        "filter_sigma": factor * estimate.sigma,
        "lincov_true": factor * estimate.true,
        "reduction_percent": 100.0 * (1.0 - estimate.rms / raw.rms),
        "formal_reduction_percent": 100.0 * (1.0 - estimate.sigma / raw.sigma),
        "over_sigma_ratio": ratio,
        "low": low,
        "high": high,
        "verdict": verdict,
    }


class _RootMeanSquares(NamedTuple):
    """Root mean squares of an error over time, SI."""

    rms: float  # error of the runs; without runs by linear covariance
    sigma: float  # formal sigma
    true: float  # error by linear covariance


def _root_mean_squares(rows: pd.DataFrame) -> _RootMeanSquares:
    t = rows.t_s.to_numpy()
    true_square = rows.lincov_true_si**2 + rows.lincov_mean_si**2
    if rows.run_count.iloc[0]:
        squares = (rows.rms_si**2, rows.filter_sigma_si**2, true_square)
    else:
        squares = (true_square, rows.lincov_formal_si**2, true_square)
    means = [time_mean(t, square.to_numpy()) for square in squares]
    rms, sigma, true = (float(np.sqrt(mean)) for mean in means)
    return _RootMeanSquares(rms, sigma, true)


def reduction(base: Floats, lower: Floats, alpha: float = 0.05) -> tuple[Floats, Floats, Floats]:
    """Return the relative reduction of paired totals, with its confidence interval.

    Parameters
    ----------
    base, lower : (n_run, k) array
        Totals of each run with the same random draws, any unit.
    alpha : float
        One minus the confidence.

    Returns
    -------
    (k,) array, (k,) array, (k,) array
        Reduction, and lower and upper limit of its interval, as fractions.

    Raises
    ------
    ValueError
        There are fewer than two runs, or different numbers of runs.

    Notes
    -----
    The reduction is one minus the geometric mean of the ratios of the runs. The interval is Student's t for their
    logarithms. Effects common to both runs of a pair, such as the wind, cancel.
    """
    if len(base) != len(lower) or len(base) < 2:
        raise ValueError(f"{len(base)} and {len(lower)} runs: a paired comparison needs two or more of each, alike")
    log_ratio = np.log(lower / base)
    n = len(log_ratio)
    mean = log_ratio.mean(axis=0)
    student_quantile = float(stats.t.isf(alpha / 2.0, n - 1))
    half = student_quantile * log_ratio.std(axis=0, ddof=1) / np.sqrt(n)
    mean_reduction = 1.0 - np.exp(mean)
    low = 1.0 - np.exp(mean + half)
    high = 1.0 - np.exp(mean - half)
    return mean_reduction, low, high


def nozzle_travel(tables: Tables, alpha: float = 0.05) -> pd.DataFrame:
    """Return the mean movement of the nozzle (deg) for each rate that feeds the controller, and its reduction (%).

    The reduction compares the filtered with the raw rate in paired runs, with its interval, for each burn and for the
    whole flight. It is NaN for a single run, and for a burn in which the nozzle does not move in some run.
    """
    rows = []
    for (case, burn, axis), group in tables.nozzle_travel.groupby(["case", "burn", "axis"], sort=False):
        travel = group.pivot(index="run_number", columns="controller_rate", values="travel_rad")
        percent = np.nan
        low = np.nan
        high = np.nan
        if len(travel) > 1 and bool((travel > 0.0).all(axis=None)):
            reductions = reduction(travel[["raw"]].to_numpy(), travel[["filtered"]].to_numpy(), alpha)
            percent, low, high = (100.0 * float(fraction[0]) for fraction in reductions)
        row = {
            "case": tables.labels[str(case)],
            "burn": burn,
            "axis": axis,
            "runs": len(travel),
            "raw_deg": float(np.degrees(travel["raw"].mean())),
            "filtered_deg": float(np.degrees(travel["filtered"].mean())),
            "true_deg": float(np.degrees(travel["true"].mean())),
            "reduction_percent": percent,
            "low_percent": low,
            "high_percent": high,
        }
        rows.append(row)
    return pd.DataFrame(rows, columns=NOZZLE)


def rate_filter_benefit(tables: Tables) -> pd.DataFrame:
    """Return the benefit of the filtered rate for a controller over the flight, by case and axis.

    Movement of the nozzle and reduction_percent as in `nozzle_travel`. possible_percent: reduction with the true rate,
    the largest that any filter can achieve. *_error_mrad: RMS attitude error of the controlled vehicle in burns.
    """
    travel = pick(nozzle_travel(tables), burn="flight")
    travel = travel.drop(columns=["burn", "runs"]).reset_index(drop=True)
    positive_raw = travel.raw_deg.where(travel.raw_deg > 0.0)
    travel["possible_percent"] = 100.0 * (1.0 - travel.true_deg / positive_raw)
    statistics = pick(motion_statistics(tables), phase="burn")
    errors = statistics.pivot_table(index=["case", "axis"], columns="controller_rate", values="attitude_error_mrad")
    errors = errors.reindex(columns=["raw", "filtered", "true"]).add_suffix("_error_mrad")
    return travel.join(errors, on=["case", "axis"])


def motion_statistics(tables: Tables) -> pd.DataFrame:
    """Return how long angular acceleration and jerk stay in their envelopes, and the attitude and rate errors.

    The rows are by case, axis, phase and rate that feeds the controller. *_inside_percent: percentage of the time steps
    inside the envelope; *_peak_ratio: largest value over the envelope.
    """
    rows = tables.motion_statistics
    return rows[["case", "controller_rate", "axis", "phase"]].assign(
        case=rows.case.map(tables.labels),
        angular_acceleration_inside_percent=100.0 * rows.angular_acceleration_inside_ratio,
        angular_acceleration_peak_ratio=rows.angular_acceleration_peak_ratio,
        jerk_inside_percent=100.0 * rows.jerk_inside_ratio,
        jerk_peak_ratio=rows.jerk_peak_ratio,
        attitude_error_mrad=1e3 * rows.attitude_error_rad,
        rate_error_deg_per_h=_DEG_H * rows.rate_error_rad_per_s,
        rate_sigma_deg_per_h=_DEG_H * rows.rate_sigma_rad_per_s,
    )
