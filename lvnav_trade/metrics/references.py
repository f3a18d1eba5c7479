"""Published numbers beside ours."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade import units
from lvnav_trade.metrics.select import flight_events, split_metric
from lvnav_trade.store import Tables, load

COLUMNS = [
    "source", "item", "case", "metric", "unit", "published", "ours", "ratio", "band_low", "band_high", "in_band",
    "remark",
]  # fmt: skip


def references(results: Path | str | Tables) -> pd.DataFrame:
    """Return every published number of the campaign beside our RMS error (Monte Carlo, or LinCov without runs).

    ours is in the unit of the publication; in_band says whether ours / published lies in the band that the campaign
    states. A number that these results cannot give keeps its row, with a remark.
    """
    tables = load(results)
    rows = []
    for published in tables.campaign.get("references") or ():
        cases = _cases(tables, published.get("case") or {})
        rows += [_row(tables, case, published) for case in cases] or [_row(tables, None, published)]
    return pd.DataFrame(rows, columns=COLUMNS)


def _cases(tables: Tables, wanted: dict[str, str]) -> list[str]:
    """Return the cases whose axes have the levels wanted."""
    return [
        row.case
        for row in tables.cases.itertuples()
        if all(json.loads(row.axes).get(axis) == str(level) for axis, level in wanted.items())
    ]


def _row(tables: Tables, case: str | None, published: dict[str, Any]) -> dict[str, Any]:
    low, high = published.get("band", (0.5, 2.0))
    ours, why = (np.nan, "no such case") if case is None else _ours(tables, case, published)
    ratio = ours / float(published["value"])
    remarks = (published.get("remark", ""), why)
    return {
        "source": published["source"],
        "item": published.get("item", ""),
        "case": tables.labels[case] if case is not None else "",
        "metric": f"{published['metric']} at {published.get('at', 'injection')}",
        "unit": published["unit"],
        "published": float(published["value"]),
        "ours": ours,
        "ratio": ratio,
        "band_low": float(low),
        "band_high": float(high),
        "in_band": bool(low <= ratio <= high),
        "remark": "; ".join(remark for remark in remarks if remark),
    }


def _ours(tables: Tables, case: str, published: dict[str, Any]) -> tuple[float, str]:
    """Return our number in the unit of the publication, and what should be said of it."""
    quantity, axis = split_metric(published["metric"])
    events = flight_events(tables, case).set_index("event").t_s
    at = published.get("at", "injection")
    history = tables.history
    rows = history[(history.case == case) & (history.quantity == quantity) & (history.axis == axis)]
    if rows.empty or at not in events.index:
        return np.nan, "not among our results"
    row = rows.iloc[int(np.argmin(np.abs(rows.t_s - events[at])))]
    try:
        scale = units.parse(f"1 {published['unit']}", row.unit)
    except ValueError:
        return np.nan, f"unit {published['unit']} does not fit"
    if row.run_count:
        return float(row.rms_si) / scale, ""
    return float(np.hypot(row.lincov_true_si, row.lincov_mean_si)) / scale, "linear covariance"
