"""Rate and acceleration of the vehicle: the estimate compared with IMU samples and with the filter's formal sigma."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.intervals import rms_interval
from lvnav_trade.metrics.basics.select import flight_events
from lvnav_trade.metrics.basics.spans import time_mean
from lvnav_trade.store import Tables, load

QUANTITIES = ("rate", "acceleration")
COLUMNS = [
    "case", "phase", "metric", "axis", "unit", "raw", "filtered", "filter_sigma", "lincov_true", "better_percent",
    "formal_better_percent", "over_sigma_ratio", "low", "high", "as_modelled",
]  # fmt: skip
_SHORTEST = 5.0
"""Seconds: phases that are shorter are left out."""


def motion(results: Path | str | Tables) -> pd.DataFrame:
    """Return errors of rate and acceleration by phase: raw sample and estimate (RMS of the runs, or of linear
    covariance), the filter's own sigma, by how many percent the estimate is better, true and formal, and the
    estimate's RMS over the filter's sigma with its 95 % interval from the runs at one time.

    as_modelled is "as modelled" where the interval holds 1, "smaller" or "larger" where it does not.
    """
    tables, rows = load(results), []
    for case, label in tables.labels.items():
        history = tables.history[tables.history.case == case]
        if not history.quantity.isin([f"raw_{one}" for one in QUANTITIES]).any():
            continue
        marks = flight_events(tables, case)
        for first, second in pairwise(marks.itertuples()):
            if second.t_s - first.t_s < _SHORTEST:
                continue
            inside = history[(history.t_s > first.t_s + 2.0) & (history.t_s < second.t_s - 1.0)]
            phase = f"{first.event} to {second.event}"
            rows += [row for quantity in QUANTITIES for row in _rows(tables, inside, label, phase, quantity)]
    return pd.DataFrame(rows, columns=COLUMNS)


def _rows(tables: Tables, inside: pd.DataFrame, label: str, phase: str, quantity: str) -> list[dict[str, Any]]:
    found = []
    for axis, raw in inside[inside.quantity == f"raw_{quantity}"].groupby("axis", sort=False):
        # without a model of the vehicle the estimate is the sample less its estimated bias
        name = quantity if (inside.quantity == quantity).any() else f"corrected_{quantity}"
        estimate = inside[(inside.quantity == name) & (inside.axis == axis)]
        if axis == "3d" or estimate.empty:
            continue
        unit, factor = tables.people[f"raw_{quantity}", str(axis)]
        sizes = [_rms(raw, "rms"), _rms(estimate, "rms"), _rms(estimate, "sigma"), _rms(estimate, "true")]
        formal = 1.0 - sizes[2] / _rms(raw, "sigma")
        runs = int(estimate.run_count.iloc[0])
        low, high = (float(x) for x in rms_interval(1.0, max(1, runs)))
        ratio = sizes[1] / sizes[2]
        verdict = (
            "no runs"
            if not runs
            else "as modelled"
            if ratio * low <= 1.0 <= ratio * high
            else ("smaller" if ratio < 1.0 else "larger")
        )
        found.append(dict(zip(COLUMNS, (
            label, phase, f"{quantity}_error", axis, unit, *(factor * size for size in sizes),
            100.0 * (1.0 - sizes[1] / sizes[0]), 100.0 * formal, ratio, ratio * low, ratio * high, verdict,
        ), strict=True)))  # fmt: skip
    return found


def _rms(rows: pd.DataFrame, what: str) -> float:
    """Return the root mean square over time of the runs' RMS, of the filter's sigma, or of the true error's."""
    runs = bool(rows.run_count.iloc[0])
    true = rows.lincov_true_si.to_numpy() ** 2 + rows.lincov_mean_si.to_numpy() ** 2
    square = {
        "rms": rows.rms_si.to_numpy() ** 2 if runs else true,
        "sigma": (rows.filter_sigma_si if runs else rows.lincov_formal_si).to_numpy() ** 2,
        "true": true,
    }[what]
    return float(np.sqrt(time_mean(rows.t_s.to_numpy(), square)))
