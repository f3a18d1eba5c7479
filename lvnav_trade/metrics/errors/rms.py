"""Root mean square errors over the flight, by phase and at events, with their intervals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.intervals import rms_interval
from lvnav_trade.metrics.basics.select import Phase, lincov_rms, metric_name, phases, series
from lvnav_trade.metrics.basics.spans import time_mean
from lvnav_trade.store import Tables, load

COLUMNS = [
    "case", "phase_or_event", "metric", "axis", "unit", "rms", "low", "high", "formal_sigma", "lincov_true_sigma",
]  # fmt: skip


def rms(results: Path | str | Tables) -> pd.DataFrame:
    """Return the errors of every case, phase or event, quantity and axis, in the units of people.

    rms, low, high: Monte Carlo with its 95 % chi-square interval. Over a phase the errors of one run are taken as fully
    correlated in time, so the interval is never too narrow. formal_sigma: root mean square of the filter's own sigma,
    from the runs where there are any, or else LinCov's. lincov_true_sigma: what LinCov expects of rms, the mean error
    included.
    """
    tables = load(results)
    spans = {case: phases(tables, case) for case in tables.labels}
    rows = []
    for case, quantity, axis, history in series(tables):
        unit, factor = tables.people[quantity, axis]
        start = {"case": tables.labels[case]}
        end = {"metric": metric_name(quantity), "axis": axis, "unit": unit}
        for phase, values in _over(history, spans[case]):
            rows.append(start | {"phase_or_event": phase} | end | {key: v * factor for key, v in values.items()})
    return pd.DataFrame(rows, columns=COLUMNS)


def _over(history: pd.DataFrame, spans: list[Phase]) -> list[tuple[str, dict[str, float]]]:
    """Return the values of one error, SI, over each phase."""
    t = history.t_s.to_numpy()
    n = int(history.run_count.iloc[0])
    square = {
        "rms": history.rms_si.to_numpy() ** 2,
        "formal_sigma": (history.filter_sigma_si if n else history.lincov_formal_si).to_numpy() ** 2,
        "lincov_true_sigma": lincov_rms(history).to_numpy() ** 2,
    }
    freedom = history.dof_ratio.to_numpy()
    found = []
    for phase in spans:
        chosen = np.flatnonzero((t >= phase.start - 1e-6) & (t <= phase.end + 1e-6))
        if not len(chosen):
            continue
        values: dict[str, Any] = {
            name: float(np.sqrt(time_mean(t[chosen], value[chosen]))) for name, value in square.items()
        }
        low, high = rms_interval(values["rms"], n * float(freedom[chosen].min()))
        found.append((phase.name, values | {"low": float(low), "high": float(high)}))
    return found
