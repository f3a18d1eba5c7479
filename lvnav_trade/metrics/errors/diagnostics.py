"""What is behind linear covariance: when sources act, what better ones are worth, what the measurements tell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.select import metric_name
from lvnav_trade.store import Tables, load


def contributions(results: Path | str | Tables) -> pd.DataFrame:
    """Return what each source put into the 3-D navigation errors at the explained event, and when.

    Columns: case, event, metric, source, t_start_s, t_end_s, share_ratio (of the variance at the event; over sources
    and bins they sum to 1).
    """
    tables = load(results)
    rows = tables.adjoint
    rows = rows[rows.axis == "3d"]
    total = rows.groupby(["case", "quantity"], sort=False).variance_si2.transform("sum")
    return pd.DataFrame(
        {
            "case": rows.case.map(tables.labels),
            "event": rows.event,
            "metric": rows.quantity.map(metric_name),
            "source": rows.source,
            "t_start_s": rows.bin_start_s,
            "t_end_s": rows.bin_end_s,
            "share_ratio": rows.variance_si2 / total,
        }
    ).reset_index(drop=True)


def sensitivity(results: Path | str | Tables) -> pd.DataFrame:
    """Return the 3-D navigation errors at the explained event with each source's sigma multiplied.

    Columns: case, event, metric, unit, source, factor_ratio, frozen (with the gains of the campaign's filter), retuned
    (with a filter that knows the new sigma); root mean squares by linear covariance, in the units of people.
    """
    tables = load(results)
    rows = tables.sensitivity
    people = {quantity: tables.people[quantity, "3d"] for quantity in dict.fromkeys(rows.quantity)}
    factor = np.array([people[quantity][1] for quantity in rows.quantity], dtype=float)
    return pd.DataFrame(
        {
            "case": rows.case.map(tables.labels),
            "event": rows.event,
            "metric": rows.quantity.map(metric_name),
            "unit": [people[quantity][0] for quantity in rows.quantity],
            "source": rows.source,
            "factor_ratio": rows.factor_ratio,
            "frozen": rows.frozen_si * factor,
            "retuned": rows.retuned_si * factor,
        }
    )


def observability(results: Path | str | Tables) -> pd.DataFrame:
    """Return per case and phase what the measurements tell of the filter's states.

    Columns: case, phase, t_start_s, t_end_s, row_count, rank_count, state_count, tolerance_ratio, smallest_ratio,
    second_ratio, third_ratio (singular values from the smallest up), weakest.
    """
    tables = load(results)
    found = []
    for (case, phase, _), group in tables.observability.groupby(["case", "phase", "t_s"], sort=False):
        first = group.iloc[0]
        values = np.sort(group.singular_ratio.to_numpy())
        found.append(
            {
                "case": tables.labels[case],
                "phase": phase,
                "t_start_s": first.t_s,
                "t_end_s": first.t_end_s,
                "row_count": int(first.row_count),
                "rank_count": int(first.rank_count),
                "state_count": int(first.state_count),
                "tolerance_ratio": first.tolerance_ratio,
                **dict(zip(("smallest_ratio", "second_ratio", "third_ratio"), values, strict=False)),
                "weakest": first.weakest,
            }
        )
    names = ["case", "phase", "t_start_s", "t_end_s", "row_count", "rank_count", "state_count", "tolerance_ratio"]
    return pd.DataFrame(found, columns=[*names, "smallest_ratio", "second_ratio", "third_ratio", "weakest"])


def nonlinearity(results: Path | str | Tables) -> pd.DataFrame:
    """Return the nonlinearity at every event: case, event, t_s, motion_ratio, state, transition_ratio, row_ratio."""
    tables = load(results)
    rows = tables.nonlinearity
    return rows.assign(case=rows.case.map(tables.labels)).reset_index(drop=True)
