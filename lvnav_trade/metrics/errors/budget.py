"""Which error source makes how much of the error at each event."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from lvnav_trade.metrics.basics.select import NAVIGATION
from lvnav_trade.store import Tables, load

LEAST_SHARE = 1e-9
"""Share of the variance below which a source counts as zero: smaller ones have fewer than six digits, and other ones on
another machine."""
COLUMNS = ["case", "event", "source", "metric", "unit", "sigma", "share_ratio"]


def budget(results: Path | str | Tables) -> pd.DataFrame:
    """Return LinCov's 3-D navigation errors by source at every event, in the units of people.

    Columns: case, event, source, metric, unit, sigma (of this source alone; squares of sources add), share_ratio (of
    the variance); both are zero below `LEAST_SHARE`. Largest first within case, event and metric. Empty where the
    campaign asked for no budget.
    """
    tables = load(results)
    rows = tables.budget
    rows = rows[(rows.event != "") & (rows.axis == "3d") & rows.quantity.isin(NAVIGATION)]
    if rows.empty:
        return pd.DataFrame(columns=COLUMNS)
    negligible = rows.share_ratio < LEAST_SHARE
    rows = rows.assign(**{name: rows[name].mask(negligible, 0.0) for name in ("sigma_si", "share_ratio")})
    people = {quantity: tables.people[quantity, "3d"] for quantity in NAVIGATION if (quantity, "3d") in tables.people}
    found = pd.DataFrame(
        {
            "case": rows.case.map(tables.labels),
            "event": rows.event,
            "source": rows.source,
            "metric": rows.quantity + "_error",
            "unit": rows.quantity.map({name: unit for name, (unit, _) in people.items()}),
            "sigma": rows.sigma_si * rows.quantity.map({name: factor for name, (_, factor) in people.items()}),
            "share_ratio": rows.share_ratio,
        }
    )
    order = {key: number for number, key in enumerate(zip(found.case, found.event, found.metric, strict=True))}
    place = [order[key] for key in zip(found.case, found.event, found.metric, strict=True)]
    return (
        found.assign(place=place)
        .sort_values(["place", "share_ratio"], ascending=[True, False], kind="stable", ignore_index=True)
        .drop(columns="place")
    )
