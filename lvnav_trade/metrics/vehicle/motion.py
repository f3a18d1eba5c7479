"""Rate and acceleration of the vehicle: the estimate compared with IMU samples and with the filter's formal sigma."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.intervals import rms_interval
from lvnav_trade.metrics.basics.select import flight_events, metric_name, pick, time_mean
from lvnav_trade.store import Tables

QUANTITIES = ("rate", "acceleration")
COLUMNS = [
    "case", "phase", "metric", "axis", "unit", "raw", "filtered", "filter_sigma", "lincov_true", "better_percent",
    "formal_better_percent", "over_sigma_ratio", "low", "high", "as_modelled",
]  # fmt: skip
_SHORTEST = 5.0
"""Seconds: phases that are shorter are left out."""


def motion(tables: Tables) -> pd.DataFrame:
    """Return errors of rate and acceleration by phase: raw sample and estimate (RMS of the runs, or of linear
    covariance), the filter's own sigma, by how many percent the estimate is better, true and formal, and the
    estimate's RMS over the filter's sigma with its 95 % interval from the runs at one time.

    as_modelled is "as modelled" where the interval holds 1, "smaller" or "larger" where it does not.
    """
    rows = []
    for case, label in tables.labels.items():
        history = pick(tables.history, case=case)
        for first, second in pairwise(flight_events(tables, case).itertuples()):
            if second.t_s - first.t_s >= _SHORTEST:
                inside = history[(history.t_s > first.t_s + 2.0) & (history.t_s < second.t_s - 1.0)]
                head = (label, f"{first.event} to {second.event}")
                rows += [(*head, *row) for quantity in QUANTITIES for row in _rows(tables, inside, quantity)]
    return pd.DataFrame(rows, columns=COLUMNS)


def _rows(tables: Tables, inside: pd.DataFrame, quantity: str) -> list[tuple[Any, ...]]:
    """Return the values of `COLUMNS` from the metric on, axis by axis."""
    found = []
    # without a model of the vehicle the estimate is the sample less its estimated bias
    name = quantity if (inside.quantity == quantity).any() else f"corrected_{quantity}"
    for axis, raw in pick(inside, quantity=f"raw_{quantity}").groupby("axis", sort=False):
        estimate = pick(inside, quantity=name, axis=str(axis))
        if axis == "3d" or estimate.empty:
            continue
        unit, factor = tables.people[f"raw_{quantity}", str(axis)]
        (raw_rms, raw_sigma, _), (rms, sigma, true) = _sizes(raw), _sizes(estimate)
        runs, ratio = int(estimate.run_count.iloc[0]), rms / sigma
        low, high = (ratio * float(bound) for bound in rms_interval(1.0, max(1, runs)))
        verdict = "as modelled" if low <= 1.0 <= high else ("smaller" if ratio < 1.0 else "larger")
        sizes = [factor * size for size in (raw_rms, rms, sigma, true)]
        better = (100.0 * (1.0 - rms / raw_rms), 100.0 * (1.0 - sigma / raw_sigma))
        head = (metric_name(quantity), axis, unit)
        found.append((*head, *sizes, *better, ratio, low, high, verdict if runs else "no runs"))
    return found


def _sizes(rows: pd.DataFrame) -> list[float]:
    """Return the root mean squares over time of the runs' RMS, of the filter's sigma, and of the true error's."""
    true, t = rows.lincov_true_si**2 + rows.lincov_mean_si**2, rows.t_s.to_numpy()
    runs = bool(rows.run_count.iloc[0])
    squares = (rows.rms_si**2, rows.filter_sigma_si**2, true) if runs else (true, rows.lincov_formal_si**2, true)
    return [float(np.sqrt(time_mean(t, square.to_numpy()))) for square in squares]
