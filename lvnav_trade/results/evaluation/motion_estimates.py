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
        pairs = [pair for quantity in QUANTITIES for pair in _pairs(tables, case, quantity)]
        for first, second in pairwise(flight_events(tables, case).itertuples()) if pairs else ():
            if second.t_s - first.t_s >= _SHORTEST:
                head = (label, f"{first.event} to {second.event}")
                rows += [(*head, *row) for row in _rows(tables, pairs, first.t_s + 2.0, second.t_s - 1.0)]
    return pd.DataFrame(rows, columns=COLUMNS)


class _Pair(NamedTuple):
    """Errors of a raw sample and of its estimate along an axis."""

    quantity: str  # rate or acceleration
    axis: str
    raw: pd.DataFrame  # rows of the history of the sample's error
    estimate: pd.DataFrame  # rows of the history of the estimate's error


def _pairs(tables: Tables, case: str, quantity: str) -> list[_Pair]:
    known = pick(tables.outputs, case=case)
    # without a model of the vehicle the estimate is the sample minus its estimated bias
    name = quantity if (known.quantity == quantity).any() else f"corrected_{quantity}"
    axes = [str(axis) for axis in known.axis[known.quantity == f"raw_{quantity}"] if axis != "3d"]
    histories = [(axis, *(history_of(tables, case, of, axis) for of in (f"raw_{quantity}", name))) for axis in axes]
    return [_Pair(quantity, *history) for history in histories]


def _rows(tables: Tables, pairs: list[_Pair], after: float, before: float) -> list[tuple[Any, ...]]:
    """Return the values of `COLUMNS`, beginning with the metric, by axis, between two times (s), both excluded."""
    found = []
    for quantity, axis, *both in pairs:
        raw, estimate = (rows[(rows.t_s > after) & (rows.t_s < before)] for rows in both)
        if raw.empty or estimate.empty:
            continue
        unit, factor = tables.people[f"raw_{quantity}", axis]
        (raw_rms, raw_sigma, _), (rms, sigma, true) = _sizes(raw), _sizes(estimate)
        runs, ratio = int(estimate.run_count.min()), rms / sigma
        low, high = (ratio * float(bound) for bound in rms_interval(1.0, max(1, runs)))
        verdict = "as modelled" if low <= 1.0 <= high else ("smaller" if ratio < 1.0 else "larger")
        sizes = [factor * size for size in (raw_rms, rms, sigma, true)]
        better = (100.0 * (1.0 - rms / raw_rms), 100.0 * (1.0 - sigma / raw_sigma))
        head = (f"{quantity}_error", axis, unit)
        found.append((*head, *sizes, *better, ratio, low, high, verdict if runs else "no runs"))
    return found


def _sizes(rows: pd.DataFrame) -> list[float]:
    """Return the root mean squares over time of the runs' RMS error, of the formal sigma, and of the true RMS error."""
    true, t = rows.lincov_true_si**2 + rows.lincov_mean_si**2, rows.t_s.to_numpy()
    runs = bool(rows.run_count.iloc[0])
    squares = (rows.rms_si**2, rows.filter_sigma_si**2, true) if runs else (true, rows.lincov_formal_si**2, true)
    return [float(np.sqrt(time_mean(t, square.to_numpy()))) for square in squares]


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
    ratio = np.log(lower / base)
    mean, n = ratio.mean(axis=0), len(ratio)
    reach = float(stats.t.isf(alpha / 2.0, n - 1)) * ratio.std(axis=0, ddof=1) / np.sqrt(n)
    return 1.0 - np.exp(mean), 1.0 - np.exp(mean + reach), 1.0 - np.exp(mean - reach)


def nozzle_travel(tables: Tables, alpha: float = 0.05) -> pd.DataFrame:
    """Return the mean movement of the nozzle (deg) for each rate that feeds the controller, and its reduction (%).

    The reduction compares the filtered with the raw rate in paired runs, with its interval, for each burn and for the
    whole flight. It is NaN for a single run, and for a burn in which the nozzle does not move in some run.
    """
    rows = []
    for (case, burn, axis), group in tables.nozzle_travel.groupby(["case", "burn", "axis"], sort=False):
        moved = group.pivot(index="run_number", columns="controller_rate", values="travel_rad")
        less: tuple[float, ...] = (np.nan, np.nan, np.nan)
        if len(moved) > 1 and bool((moved > 0.0).all(axis=None)):
            less = tuple(
                100.0 * float(number[0])
                for number in reduction(moved[["raw"]].to_numpy(), moved[["filtered"]].to_numpy(), alpha)
            )
        means = [float(np.degrees(moved[feed].mean())) for feed in ("raw", "filtered", "true")]
        rows.append((tables.labels[str(case)], burn, axis, len(moved), *means, *less))
    return pd.DataFrame(rows, columns=NOZZLE)


def rate_filter_benefit(tables: Tables) -> pd.DataFrame:
    """Return the benefit of the filtered rate for a controller over the flight, by case and axis.

    Movement of the nozzle and reduction_percent as in `nozzle_travel`. possible_percent: reduction with the true rate,
    the largest that any filter can achieve. *_error_mrad: RMS attitude error of the controlled vehicle in burns.
    """
    moved, errors = pick(nozzle_travel(tables), burn="flight"), pick(motion_statistics(tables), phase="burn")
    moved = moved.drop(columns=["burn", "runs"]).reset_index(drop=True)
    moved["possible_percent"] = 100.0 * (1.0 - moved.true_deg / moved.raw_deg.where(moved.raw_deg > 0.0))
    wide = errors.pivot_table(index=["case", "axis"], columns="controller_rate", values="attitude_error_mrad")
    wide = wide.reindex(columns=["raw", "filtered", "true"]).add_suffix("_error_mrad")
    return moved.join(wide, on=["case", "axis"])


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
