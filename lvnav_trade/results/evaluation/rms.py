"""Root mean square errors, plain and by control variates, cases in order of them, part within the filter's sigmas."""

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
# Each tenth of the runs is controlled by what the others say of how errors follow from draws.
FOLDS = 10


def rms(tables: Tables) -> pd.DataFrame:
    """Return the errors of every case, phase or event, quantity and axis, in display units.

    rms, low, high: Monte Carlo with its 95 % chi-square interval. Over a phase the errors of one run are taken as fully
    correlated in time, so the interval is never too narrow. formal_sigma: root mean square of the filter's own sigma,
    from the runs where there are any, or else LinCov's. lincov_true_sigma: what LinCov expects of rms, the mean error
    included. A failed run counts until it fails; the interval of a phase is that of the fewest runs in it.
    """
    rows = []
    for case, group in groupby(names_of_series(tables), key=itemgetter(0)):
        names = list(group)
        means = _means_of_phases(tables, case, names)
        for number, (_, quantity, axis) in enumerate(names):
            unit, factor = tables.people[quantity, axis]
            head = (tables.labels[case], f"{quantity}_error", axis, unit)
            for name, (squares, freedom) in means[number].items():
                rows.append((head[0], name, *head[1:], *(factor * np.sqrt(squares)), freedom))
    frame = pd.DataFrame(rows, columns=[*COLUMNS[:6], *COLUMNS[8:], "dof"])
    frame["low"], frame["high"] = rms_interval(frame.rms.to_numpy(), frame.dof.to_numpy())
    return frame[COLUMNS]


_Mean = tuple[Floats, float]  # mean squares (3,) of runs, formal sigma and linear covariance; degrees of freedom


def _means_of_phases(tables: Tables, case: str, names: list[tuple[str, str, str]]) -> list[dict[str, _Mean]]:
    """Return for each series of a case the mean squares by phase or event; series with the same times go together."""
    together: dict[bytes, list[int]] = {}
    columns = [_columns(tables, *name) for name in names]
    for number, (t, _, _, _) in enumerate(columns):
        together.setdefault(t.tobytes(), []).append(number)
    found: list[dict[str, _Mean]] = [{} for _ in names]
    for numbers in together.values():
        t = columns[numbers[0]][0]
        squares, runs, dof = (np.stack([columns[k][place] for k in numbers]) for place in (1, 2, 3))
        areas = np.diff(t) * (squares[..., 1:] + squares[..., :-1]) / 2.0  # of the trapezoidal rule
        for name, start, end in phases(tables, case):
            part = slice(np.searchsorted(t, start - SAME_TIME), np.searchsorted(t, end + SAME_TIME, side="right"))
            if len(t[part]):
                freedom = runs[:, part].min(axis=1) * dof[:, part].min(axis=1)
                means = _means(t, squares, areas, part)
                for k, mean, one in zip(numbers, means, freedom, strict=True):
                    found[k][name] = (mean, float(one))
    return found


def _columns(tables: Tables, case: str, quantity: str, axis: str) -> tuple[Floats, Floats, Floats, Floats]:
    """Return times (n,) of a series, squares (3, n) of runs, formal sigma, linear covariance, run count, freedom."""
    names = ("t_s", "rms_si", "filter_sigma_si", "lincov_formal_si", "lincov_true_si", "lincov_mean_si")
    t, rms, own, formal, true, mean, runs, dof = history_columns(
        tables, case, quantity, axis, *names, "run_count", "dof_ratio"
    )
    return t, np.stack([rms, own if runs.any() else formal, np.hypot(true, mean)]) ** 2, runs, dof


def _means(t: Floats, values: Floats, areas: Floats, part: slice) -> Floats:
    """Return means over a part of times t (n,) of values (..., n), of which areas (..., n - 1) are the integrals."""
    length = t[part.stop - 1] - t[part.start]
    if not length > 0.0:
        return values[..., part.start]
    return np.asarray(areas[..., part.start : part.stop - 1].sum(axis=-1) / length)


def ranking(tables: Tables) -> pd.DataFrame:
    """Return the 3-D navigation errors of every case at injection (or the last event), best velocity first.

    Columns: case, event, run_count, and for position, velocity and attitude NAME, NAME_low, NAME_high, NAME_unit:
    Monte-Carlo RMS with its 95 % interval, or LinCov's without interval where there are no runs.
    """
    found: dict[str, dict[str, Any]] = {case: {"case": label} for case, label in tables.labels.items()}
    names = ("t_s", "rms_si", "lincov_true_si", "lincov_mean_si", "run_count", "dof_ratio")
    for case, quantity, axis in names_of_series(tables):
        if quantity in NAVIGATION and axis == "3d":
            event = final_event(tables, case)
            t, *values = history_columns(tables, case, quantity, axis, *names)
            moment = pick(tables.events, case=case, kind="event", event=event).t_s
            at = int(np.argmin(np.abs(t - (float(moment.iloc[0]) if len(moment) else t.max()))))
            rms, true, mean, runs, dof = (float(column[at]) for column in values)
            unit, factor = tables.people[quantity, axis]
            n = int(runs)
            value = rms if n else float(np.hypot(true, mean))
            low, high = rms_interval(value, n * dof)
            found[case] |= {
                "event": event,
                "run_count": n,
                quantity: value * factor,
                f"{quantity}_low": float(low) * factor,
                f"{quantity}_high": float(high) * factor,
                f"{quantity}_unit": unit,
            }
    frame = pd.DataFrame(list(found.values()))
    by = next((name for name in ("velocity", "position", "attitude") if name in frame), None)
    return frame.sort_values(by, kind="stable", ignore_index=True) if by else frame.replace({None: np.nan})


def paired_levels(tables: Tables, axis: str) -> pd.DataFrame:
    """Return the paired differences of cases that differ in one axis alone: its first level and each other one.

    Columns: case (the other levels), levels, event, quantity, unit, first_rms, second_rms, difference_rms (root mean
    square over the runs of the norm of the difference of their errors), difference_ratio (of the smaller of the two).
    """
    groups: dict[str, list[tuple[str, str]]] = {}
    for case, levels in tables.levels.items():
        if axis in levels:
            rest = ", ".join(f"{name}={level}" for name, level in levels.items() if name != axis) or "base"
            groups.setdefault(rest, []).append((levels[axis], case))
    rows = [
        {"case": rest, "levels": f"{first} and {level}", "event": event} | sizes
        for rest, ((first, base), *others) in groups.items()
        for level, other in others
        for event in flight_events(tables, base).event
        for quantity in NAVIGATION
        if (sizes := _paired(tables, (base, other), str(event), quantity))
    ]
    return pd.DataFrame(rows)


def _paired(tables: Tables, pair: tuple[str, str], event: str, quantity: str) -> dict[str, Any]:
    """Return the root mean squares of two cases and of their difference at an event; empty where one is not stored."""
    both = [errors_by_axis(tables, case, event, quantity).sort_index().drop(columns="failure") for case in pair]
    if any(errors.empty for errors in both):
        return {}
    n = min(map(len, both))
    first, second = (errors.to_numpy(dtype=float)[:n] for errors in both)
    unit, factor = tables.people[quantity, "3d"]
    sizes = [factor * float(np.sqrt(np.mean(np.sum(e**2, axis=1)))) for e in (first, second, second - first)]
    found = {"quantity": quantity, "unit": unit, "first_rms": sizes[0], "second_rms": sizes[1]}
    return found | {"difference_rms": sizes[2], "difference_ratio": sizes[2] / min(sizes[:2])}


class ControlledRms(NamedTuple):
    """Root mean square with its interval; effective_runs: plain runs that would tell it as well; known: part of the
    mean square that the draws explain.
    """

    rms: float
    low: float
    high: float
    effective_runs: float
    known: float


def controlled_rms(error: Floats, draws: Floats) -> ControlledRms:
    """Return the root mean square of errors (n_run, k), its variance reduced by standard normals (n_run, m) drawn once.

    An error follows the draws about linearly, and the mean square of a linear form b . u of standard normals is |b|^2
    exactly, as linear covariance has it. So (b . u)^2 - |b|^2 has no mean whatever b is, and taking it off each run's
    squared error changes no expectation. b is fitted on the other folds only, so that it does not know the draws it is
    multiplied with: the mean square is unbiased however wrong linear theory is; only its variance depends on how right
    it is.
    """
    n = len(error)
    square = (error**2).sum(axis=1)
    fold = np.arange(n) % FOLDS
    control, known = np.zeros(n), 0.0
    for k in range(FOLDS):
        own = fold == k
        slope = _slope(error[~own], draws[~own])
        exact = float((slope**2).sum())
        control[own] = ((draws[own] @ slope) ** 2).sum(axis=1) - exact
        known += exact * own.sum() / n
    rest = square - control
    mean = float(rest.mean())
    if n < 2 or not mean > 0.0:
        return ControlledRms(*[float("nan")] * 5)
    spread = float(rest.std(ddof=1)) / (mean * np.sqrt(n))  # of ln(mean square)
    reach = float(stats.t.isf(_TAIL, n - 1)) * spread
    worth = n * float(square.var()) / float(rest.var()) if rest.var() > 0.0 else float("inf")
    low, high = (float(np.sqrt(mean * np.exp(sign * reach))) for sign in (-1.0, 1.0))
    return ControlledRms(float(np.sqrt(mean)), low, high, worth, known / mean)


def _slope(error: Floats, draws: Floats) -> Floats:
    """Return how the error (n, k) follows the draws (n, m): least squares (m, k), drawn to zero where runs are few."""
    centred = error - error.mean(axis=0)
    return np.asarray(np.linalg.solve(draws.T @ draws + draws.shape[1] * np.eye(draws.shape[1]), draws.T @ centred))


def control_variates(tables: Tables) -> pd.DataFrame:
    """Return the 3-D navigation errors at injection (or the last event), plain and controlled, in display units.

    rms, low, high: as everywhere, 95 % by chi-square. controlled_*: with control variates, 95 %. effective_runs: how
    many plain runs the controlled ones are worth. lincov: what linear covariance expects. known_share_ratio: part of
    the mean square that follows linearly from turn-on and initial errors.
    """
    rows = []
    for case, label in tables.labels.items():
        event = final_event(tables, case)
        starts = pick(tables.initial_draws, case=case)
        if starts.empty:
            continue
        draws = starts.pivot(index="run_number", columns=["source", "axis"], values="draw_ratio")
        for quantity in NAVIGATION:
            good = pick(errors_by_axis(tables, case, event, quantity), failure="").drop(columns="failure").dropna()
            both = draws.index.intersection(good.index)
            if good.shape[1] == 3 and len(both) >= 2 * FOLDS:
                values = _row(tables, case, event, quantity, good.loc[both].to_numpy(), draws.loc[both].to_numpy())
                rows.append((label, event, f"{quantity}_error_3d", *values))
    return pd.DataFrame(rows, columns=CONTROLLED)


def _row(tables: Tables, case: str, event: str, quantity: str, error: Floats, draws: Floats) -> tuple[Any, ...]:
    """Return the values of `CONTROLLED` from the unit on."""
    unit, factor = tables.people[quantity, "3d"]
    history = history_of(tables, case, quantity, "3d")
    t = float(flight_events(tables, case).set_index("event").t_s[event])
    at = at_time(history.assign(expected=lincov_rms(history)), t)
    rms = float(np.sqrt((error**2).sum(axis=1).mean()))
    plain = (rms, *map(float, rms_interval(rms, len(error) * at.dof_ratio)))
    *controlled, worth, known = controlled_rms(error, draws)
    sizes = [value * factor for value in (*plain, *controlled)]
    return unit, len(error), *sizes, worth, float(at.expected) * factor, known
