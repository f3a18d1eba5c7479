"""The cases in order of their errors at injection."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.intervals import rms_interval
from lvnav_trade.metrics.basics.select import NAVIGATION, at_time, final_event, flight_events, lincov_rms, series
from lvnav_trade.store import Tables, load


def ranking(results: Path | str | Tables) -> pd.DataFrame:
    """Return the 3-D navigation errors of every case at injection (or the last event), best velocity first.

    Columns: case, event, run_count, and for position, velocity and attitude NAME, NAME_low, NAME_high, NAME_unit:
    Monte-Carlo RMS with its 95 % interval, or LinCov's without interval where there are no runs.
    """
    tables = load(results)
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
