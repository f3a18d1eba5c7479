"""Root mean square errors, by phase and at events, with their intervals, and the cases in order of their errors."""

from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.intervals import rms_interval
from lvnav_trade.metrics.basics.select import (
    NAVIGATION,
    at_time,
    final_event,
    flight_events,
    lincov_rms,
    metric_name,
    phases,
    rows_between,
    series,
    time_mean,
)
from lvnav_trade.store import Tables

COLUMNS = [
    "case", "phase_or_event", "metric", "axis", "unit", "rms", "low", "high", "formal_sigma", "lincov_true_sigma",
]  # fmt: skip


def rms(tables: Tables) -> pd.DataFrame:
    """Return the errors of every case, phase or event, quantity and axis, in the units of people.

    rms, low, high: Monte Carlo with its 95 % chi-square interval. Over a phase the errors of one run are taken as fully
    correlated in time, so the interval is never too narrow. formal_sigma: root mean square of the filter's own sigma,
    from the runs where there are any, or else LinCov's. lincov_true_sigma: what LinCov expects of rms, the mean error
    included.
    """
    spans = {case: phases(tables, case) for case in tables.labels}
    rows = []
    for case, quantity, axis, history in series(tables):
        unit, factor = tables.people[quantity, axis]
        n = int(history.run_count.iloc[0])
        formal = history.filter_sigma_si if n else history.lincov_formal_si
        squares = history[["t_s", "dof_ratio"]].assign(
            rms=history.rms_si**2, formal=formal**2, true=lincov_rms(history) ** 2
        )
        for phase in spans[case]:
            part = rows_between(squares, phase.start, phase.end)
            if part.empty:
                continue
            size, formal_sigma, true = (_root_mean(part, name) for name in ("rms", "formal", "true"))
            values = (size, *rms_interval(size, n * float(part.dof_ratio.min())), formal_sigma, true)
            head = (tables.labels[case], phase.name, metric_name(quantity), axis, unit)
            rows.append((*head, *(float(value) * factor for value in values)))
    return pd.DataFrame(rows, columns=COLUMNS)


def _root_mean(rows: pd.DataFrame, name: str) -> float:
    return float(np.sqrt(time_mean(rows.t_s.to_numpy(), rows[name].to_numpy())))


def ranking(tables: Tables) -> pd.DataFrame:
    """Return the 3-D navigation errors of every case at injection (or the last event), best velocity first.

    Columns: case, event, run_count, and for position, velocity and attitude NAME, NAME_low, NAME_high, NAME_unit:
    Monte-Carlo RMS with its 95 % interval, or LinCov's without interval where there are no runs.
    """
    found: dict[str, dict[str, Any]] = {case: {"case": label} for case, label in tables.labels.items()}
    for case, quantity, axis, history in series(tables):
        if quantity in NAVIGATION and axis == "3d":
            event = final_event(tables, case)
            events = flight_events(tables, case).set_index("event").t_s
            row = at_time(history.assign(expected=lincov_rms(history)), float(events.get(event, history.t_s.max())))
            unit, factor = tables.people[quantity, axis]
            n = int(row.run_count)
            value = row.rms_si if n else row.expected
            low, high = rms_interval(value, n * row.dof_ratio)
            found[case] |= {"event": event, "run_count": n, quantity: value * factor}
            found[case] |= {f"{quantity}_low": float(low) * factor, f"{quantity}_high": float(high) * factor}
            found[case][f"{quantity}_unit"] = unit
    frame = pd.DataFrame(list(found.values()))
    by = next((name for name in ("velocity", "position", "attitude") if name in frame), None)
    return frame.sort_values(by, kind="stable", ignore_index=True) if by else frame.replace({None: np.nan})
