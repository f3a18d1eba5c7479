"""Root mean square errors less noisy than the runs: draws at the start of each run as control variates."""

from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

from lvnav_trade.metrics.basics.intervals import rms_interval
from lvnav_trade.metrics.basics.select import (
    NAVIGATION,
    at_time,
    errors_by_axis,
    final_event,
    flight_events,
    history_of,
    lincov_rms,
    pick,
)
from lvnav_trade.records import Floats
from lvnav_trade.store import Tables

COLUMNS = [
    "case", "event", "metric", "unit", "runs", "rms", "low", "high", "controlled_rms", "controlled_low",
    "controlled_high", "effective_runs", "lincov", "known_share_ratio",
]  # fmt: skip
FOLDS = 10
"""Each tenth of the runs is controlled by what the others say of how errors follow from draws."""
ALPHA = 0.05


class Controlled(NamedTuple):
    """Root mean square with its interval; effective_runs: plain runs that would tell it as well; known: part of the
    mean square that the draws explain.
    """

    rms: float
    low: float
    high: float
    effective_runs: float
    known: float


def controlled_rms(error: Floats, draws: Floats, alpha: float = ALPHA) -> Controlled:
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
        return Controlled(*[float("nan")] * 5)
    spread = float(rest.std(ddof=1)) / (mean * np.sqrt(n))  # of ln(mean square)
    reach = float(stats.t.isf(alpha / 2.0, n - 1)) * spread
    worth = n * float(square.var()) / float(rest.var()) if rest.var() > 0.0 else float("inf")
    low, high = (float(np.sqrt(mean * np.exp(sign * reach))) for sign in (-1.0, 1.0))
    return Controlled(float(np.sqrt(mean)), low, high, worth, known / mean)


def _slope(error: Floats, draws: Floats) -> Floats:
    """Return how the error (n, k) follows the draws (n, m): least squares (m, k), drawn to zero where runs are few."""
    centred = error - error.mean(axis=0)
    gram = draws.T @ draws + draws.shape[1] * np.eye(draws.shape[1])
    return np.asarray(np.linalg.solve(gram, draws.T @ centred))


def controlled(tables: Tables) -> pd.DataFrame:
    """Return the 3-D navigation errors at injection (or the last event), plain and controlled, in people's units.

    rms, low, high: as everywhere, 95 % by chi-square. controlled_*: with control variates, 95 %. effective_runs: how
    many plain runs the controlled ones are worth. lincov: what linear covariance expects. known_share_ratio: part of
    the mean square that follows linearly from turn-on and initial errors.
    """
    rows = []
    for case, label in tables.labels.items():
        event = final_event(tables, case)
        starts = pick(tables.starts, case=case)
        draws = starts.pivot(index="run_number", columns=["source", "axis"], values="draw_ratio")
        for quantity in NAVIGATION:
            errors = errors_by_axis(tables, case, event, quantity)
            good = pick(errors, failure="").drop(columns="failure").dropna()
            both = draws.index.intersection(good.index)
            if good.shape[1] == 3 and len(both) >= 2 * FOLDS:
                values = _row(tables, case, event, quantity, good.loc[both].to_numpy(), draws.loc[both].to_numpy())
                rows.append((label, event, f"{quantity}_error_3d", *values))
    return pd.DataFrame(rows, columns=COLUMNS)


def _row(tables: Tables, case: str, event: str, quantity: str, error: Floats, draws: Floats) -> tuple[Any, ...]:
    """Return the values of `COLUMNS` from the unit on."""
    unit, factor = tables.people[quantity, "3d"]
    history = history_of(tables, case, quantity, "3d")
    t = float(flight_events(tables, case).set_index("event").t_s[event])
    at = at_time(history.assign(expected=lincov_rms(history)), t)
    rms = float(np.sqrt((error**2).sum(axis=1).mean()))
    plain = (rms, *map(float, rms_interval(rms, len(error) * at.dof_ratio)))
    found = controlled_rms(error, draws)
    sizes = [value * factor for value in (*plain, *found[:3])]
    return unit, len(error), *sizes, found.effective_runs, float(at.expected) * factor, found.known
