"""Root mean square errors, plain and by control variates; ranking of cases; paired differences of cases."""

from itertools import groupby
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.statistics.probability import rms_interval
from lvnav_trade.results.statistics.select import (
    NAVIGATION,
    SAME_TIME,
    at_time,
    errors_by_axis,
    final_event,
    flight_events,
    history_columns,
    history_of,
    lincov_rms,
    names_of_series,
    phases,
    pick,
)
from lvnav_trade.results.tables.read import Tables

COLUMNS = [
    "case",
    "phase_or_event",
    "metric",
    "axis",
    "unit",
    "rms",
    "low",
    "high",
    "formal_sigma",
    "lincov_true_sigma",
]
_TAIL = 0.025  # of each side of the interval
CONTROLLED = [
    "case",
    "event",
    "metric",
    "unit",
    "runs",
    "rms",
    "low",
    "high",
    "controlled_rms",
    "controlled_low",
    "controlled_high",
    "effective_runs",
    "lincov",
    "known_share_ratio",
]
# Cross-fitting: the dependence of the errors on the draws is fitted without the fold to which it is applied.
FOLDS = 10


def rms(tables: Tables) -> pd.DataFrame:
    """Return the errors of every case, phase or event, quantity and axis, in display units.

    rms, low, high: Monte Carlo with its 95 % chi-square interval. Over a phase the errors of one run are taken as fully
    correlated in time, so the interval is never too narrow. formal_sigma: root mean square of the formal sigma, by the
    runs or, without runs, by LinCov. lincov_true_sigma: RMS error expected by LinCov, with the mean error. A failed run
    counts until it fails; the interval of a phase is that of the fewest runs in it.
    """
    rows = []
    for case, group in groupby(names_of_series(tables), key=itemgetter(0)):
        names = list(group)
        means_of_series = _phase_means(tables, case, names)
        for (_, quantity, axis), means in zip(names, means_of_series, strict=True):
            unit, factor = tables.display_units[quantity, axis]
            for phase_or_event, (mean_squares, freedom) in means.items():
                monte_carlo, formal, true = factor * np.sqrt(mean_squares)
                row = {
                    "case": tables.labels[case],
                    "phase_or_event": phase_or_event,
                    "metric": f"{quantity}_error",
                    "axis": axis,
                    "unit": unit,
                    "rms": monte_carlo,
                    "formal_sigma": formal,
                    "lincov_true_sigma": true,
                    "dof": freedom,
                }
                rows.append(row)
    frame = pd.DataFrame(rows, columns=[*COLUMNS, "dof"])
    frame["low"], frame["high"] = rms_interval(frame.rms.to_numpy(), frame.dof.to_numpy())
    return frame[COLUMNS]


_Mean = tuple[Floats, float]  # mean squares (3,) of runs, formal sigma and linear covariance; degrees of freedom


class _Series(NamedTuple):
    """History of an error."""

    t: Floats  # (n,) s
    squares: Floats  # (3, n) squares of the RMS of the runs, the formal sigma, and the RMS by linear covariance
    runs: Floats  # (n,) number of runs
    dof: Floats  # (n,) degrees of freedom per run


def _phase_means(tables: Tables, case: str, names: list[tuple[str, str, str]]) -> list[dict[str, _Mean]]:
    """Return for each series of a case the mean squares by phase or event.

    Series with the same times are computed together, as there are many phases.
    """
    numbers_by_times: dict[bytes, list[int]] = {}
    all_series = [_read_series(tables, *name) for name in names]
    for number, series in enumerate(all_series):
        times = series.t.tobytes()
        numbers_by_times.setdefault(times, []).append(number)
    means: list[dict[str, _Mean]] = [{} for _ in names]
    for numbers in numbers_by_times.values():
        group = [all_series[k] for k in numbers]
        t = group[0].t
        squares = np.stack([series.squares for series in group])
        runs = np.stack([series.runs for series in group])
        dof = np.stack([series.dof for series in group])
        end_sums = squares[..., 1:] + squares[..., :-1]
        areas = np.diff(t) * end_sums / 2.0  # of the trapezoidal rule
        for name, start, end in phases(tables, case):
            first = int(np.searchsorted(t, start - SAME_TIME))
            stop = int(np.searchsorted(t, end + SAME_TIME, side="right"))
            if stop <= first:
                continue
            fewest_runs = runs[:, first:stop].min(axis=1)
            least_dof = dof[:, first:stop].min(axis=1)
            freedom = fewest_runs * least_dof
            duration = t[stop - 1] - t[first]
            if duration > 0.0:
                integrals = areas[..., first : stop - 1].sum(axis=-1)
                mean_squares = integrals / duration
            else:
                mean_squares = squares[..., first]
            for k, mean, degrees in zip(numbers, mean_squares, freedom, strict=True):
                means[k][name] = (mean, float(degrees))
    return means


def _read_series(tables: Tables, case: str, quantity: str, axis: str) -> _Series:
    names = ("rms_si", "filter_sigma_si", "lincov_formal_si", "lincov_true_si", "lincov_mean_si")
    columns = history_columns(tables, case, quantity, axis, "t_s", "run_count", "dof_ratio", *names)
    t, runs, dof, rms, sigma_of_runs, formal, true, mean = columns
    sigma = sigma_of_runs if runs.any() else formal
    squares = np.stack([rms, sigma, np.hypot(true, mean)]) ** 2
    return _Series(t, squares, runs, dof)


def ranking(tables: Tables) -> pd.DataFrame:
    """Return the 3-D navigation errors of every case at injection (or the last event), best velocity first.

    Columns: case, event, run_count, and for position, velocity and attitude NAME, NAME_low, NAME_high, NAME_unit:
    Monte-Carlo RMS with its 95 % interval; without runs that of LinCov, without interval.
    """
    rows: dict[str, dict[str, Any]] = {case: {"case": label} for case, label in tables.labels.items()}
    for case, quantity, axis in names_of_series(tables):
        if quantity in NAVIGATION and axis == "3d":
            event = final_event(tables, case)
            history = history_of(tables, case, quantity, axis)
            event_times = pick(tables.events, case=case, kind="event", event=event).t_s
            if len(event_times):
                t = float(event_times.iloc[0])
            else:
                t = float(history.t_s.max())
            last = at_time(history, t)
            runs = int(last.run_count)
            if runs:
                value = float(last.rms_si)
            else:
                value = float(np.hypot(last.lincov_true_si, last.lincov_mean_si))
            low, high = rms_interval(value, runs * float(last.dof_ratio))
            unit, factor = tables.display_units[quantity, axis]
            rows[case] |= {
                "event": event,
                "run_count": runs,
                quantity: value * factor,
                f"{quantity}_low": float(low) * factor,
                f"{quantity}_high": float(high) * factor,
                f"{quantity}_unit": unit,
            }
    frame = pd.DataFrame(list(rows.values()))
    for quantity in ("velocity", "position", "attitude"):
        if quantity in frame:
            return frame.sort_values(quantity, kind="stable", ignore_index=True)
    return frame.replace({None: np.nan})


def paired_levels(tables: Tables, axis: str) -> pd.DataFrame:
    """Return the paired differences of cases that differ in one axis alone: its first level and each other one.

    Columns: case (the other levels), levels, event, quantity, unit, first_rms, second_rms, difference_rms (root mean
    square over the runs of the norm of the difference of their errors), difference_ratio (of the smaller of the two).
    """
    groups: dict[str, list[tuple[str, str]]] = {}  # level of the axis and case, by the levels of all other axes
    for case, levels in tables.levels.items():
        if axis in levels:
            other_levels = [f"{name}={level}" for name, level in levels.items() if name != axis]
            label = ", ".join(other_levels) or "base"
            groups.setdefault(label, []).append((levels[axis], case))
    rows = []
    for label, ((first_level, base), *variants) in groups.items():
        for level, variant in variants:
            for event in flight_events(tables, base).event:
                for quantity in NAVIGATION:
                    sizes = _difference_sizes(tables, (base, variant), str(event), quantity)
                    if sizes:
                        rows.append({"case": label, "levels": f"{first_level} and {level}", "event": event} | sizes)
    return pd.DataFrame(rows)


def _difference_sizes(tables: Tables, pair: tuple[str, str], event: str, quantity: str) -> dict[str, Any]:
    """Return the root mean squares of two cases and of their difference at an event.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    pair : (str, str)
        Digests of the two cases.
    event : str
        Name of the event.
    quantity : str
        Quantity, such as velocity.

    Returns
    -------
    dict of str to Any
        Values by column, in the display unit; empty if the errors of a case are not stored.
    """
    base, variant = (
        errors_by_axis(tables, case, event, quantity).sort_index().drop(columns="failure") for case in pair
    )
    if base.empty or variant.empty:
        return {}
    n = min(len(base), len(variant))
    first = base.to_numpy(dtype=float)[:n]
    second = variant.to_numpy(dtype=float)[:n]
    unit, factor = tables.display_units[quantity, "3d"]
    first_rms, second_rms, difference_rms = (
        factor * float(np.sqrt(np.mean(np.sum(error**2, axis=1)))) for error in (first, second, second - first)
    )
    return {
        "quantity": quantity,
        "unit": unit,
        "first_rms": first_rms,
        "second_rms": second_rms,
        "difference_rms": difference_rms,
        "difference_ratio": difference_rms / min(first_rms, second_rms),
    }


class ControlledRms(NamedTuple):
    """Root mean square by control variates, with its interval."""

    rms: float  # root mean square, in the unit of the errors
    low: float  # lower end of its 95 % interval
    high: float  # upper end
    effective_runs: float  # number of plain runs with an interval of the same width
    explained_share: float  # fraction of the mean square that the draws explain


def controlled_rms(error: Floats, draws: Floats) -> ControlledRms:
    """Return the root mean square of errors with a variance reduced by control variates.

    Parameters
    ----------
    error : (n_run, k) array
        Errors of the runs.
    draws : (n_run, m) array
        Standard normals of the same runs, drawn once per run: turn-on and initial errors.

    Returns
    -------
    ControlledRms
        Root mean square in the unit of `error`, with its 95 % interval; NaN for fewer than two runs.

    Notes
    -----
    An error follows the draws about linearly, and the mean square of a linear form b . u of standard normals is exactly
    |b|^2. So (b . u)^2 - |b|^2 has mean zero for any b, and subtracting it from the squared error of each run changes
    no expectation. b is fitted on the other folds only and is therefore independent of the draws that it multiplies:
    the mean square is unbiased even if the errors are not linear in the draws; only its variance depends on that.
    """
    n = len(error)
    square = (error**2).sum(axis=1)
    fold = np.arange(n) % FOLDS
    control = np.zeros(n)  # (b . u)^2 - |b|^2
    explained_square = 0.0  # |b|^2, mean over the runs
    for k in range(FOLDS):
        is_in_fold = fold == k
        slope = _ridge_slope(error[~is_in_fold], draws[~is_in_fold])
        slope_square = float((slope**2).sum())
        linear_error = draws[is_in_fold] @ slope
        control[is_in_fold] = (linear_error**2).sum(axis=1) - slope_square
        explained_square += slope_square * is_in_fold.sum() / n
    controlled_square = square - control
    mean = float(controlled_square.mean())
    if n < 2 or not mean > 0.0:
        return ControlledRms(np.nan, np.nan, np.nan, np.nan, np.nan)
    sigma_of_log = float(controlled_square.std(ddof=1)) / (mean * np.sqrt(n))  # of ln(mean square)
    half = float(stats.t.isf(_TAIL, n - 1)) * sigma_of_log
    variance = float(controlled_square.var())
    return ControlledRms(
        rms=float(np.sqrt(mean)),
        low=float(np.sqrt(mean * np.exp(-half))),
        high=float(np.sqrt(mean * np.exp(half))),
        effective_runs=n * float(square.var()) / variance if variance > 0.0 else float("inf"),
        explained_share=explained_square / mean,
    )


def _ridge_slope(error: Floats, draws: Floats) -> Floats:
    """Return the slope (m, k) of the errors (n, k) against the draws (n, m), by ridge regression.

    The penalty m shrinks the slope if there are few runs: b = (u'u + m I)^-1 u'e.
    """
    m = draws.shape[1]
    deviations = error - error.mean(axis=0)
    normal_matrix = draws.T @ draws + m * np.eye(m)
    return np.asarray(np.linalg.solve(normal_matrix, draws.T @ deviations))


def control_variates(tables: Tables) -> pd.DataFrame:
    """Return the 3-D navigation errors at injection (or the last event), plain and controlled, in display units.

    rms, low, high: as everywhere, 95 % by chi-square. controlled_*: with control variates, 95 %. effective_runs: number
    of plain runs with an interval of the same width. lincov: RMS error by linear covariance. known_share_ratio: part of
    the mean square that follows linearly from turn-on and initial errors.
    """
    rows = []
    for case, label in tables.labels.items():
        event = final_event(tables, case)
        initial_draws = pick(tables.initial_draws, case=case)
        if initial_draws.empty:
            continue
        draws = initial_draws.pivot(index="run_number", columns=["source", "axis"], values="draw_ratio")
        for quantity in NAVIGATION:
            sound_runs = pick(errors_by_axis(tables, case, event, quantity), failure="")
            errors = sound_runs.drop(columns="failure").dropna()
            runs = draws.index.intersection(errors.index)
            if errors.shape[1] == 3 and len(runs) >= 2 * FOLDS:
                values = _controlled_values(
                    tables, case, event, quantity, errors.loc[runs].to_numpy(), draws.loc[runs].to_numpy()
                )
                rows.append({"case": label, "event": event, "metric": f"{quantity}_error_3d", **values})
    return pd.DataFrame(rows, columns=CONTROLLED)


def _controlled_values(
    tables: Tables, case: str, event: str, quantity: str, error: Floats, draws: Floats
) -> dict[str, Any]:
    """Return the values of `CONTROLLED` from the unit on.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    event : str
        Name of the event.
    quantity : str
        Quantity, such as velocity.
    error : (n_run, 3) array
        Errors of the runs at the event, SI.
    draws : (n_run, m) array
        Standard normals of the same runs, used as control variates.
    """
    unit, factor = tables.display_units[quantity, "3d"]
    history = history_of(tables, case, quantity, "3d")
    t = float(flight_events(tables, case).set_index("event").t_s[event])
    lincov_row = at_time(history.assign(rms=lincov_rms(history)), t)
    plain_rms = float(np.sqrt((error**2).sum(axis=1).mean()))
    plain_low, plain_high = rms_interval(plain_rms, len(error) * lincov_row.dof_ratio)
    controlled_error = controlled_rms(error, draws)
    return {
        "unit": unit,
        "runs": len(error),
        "rms": plain_rms * factor,
        "low": float(plain_low) * factor,
        "high": float(plain_high) * factor,
        "controlled_rms": controlled_error.rms * factor,
        "controlled_low": controlled_error.low * factor,
        "controlled_high": controlled_error.high * factor,
        "effective_runs": controlled_error.effective_runs,
        "lincov": float(lincov_row.rms) * factor,
        "known_share_ratio": controlled_error.explained_share,
    }
