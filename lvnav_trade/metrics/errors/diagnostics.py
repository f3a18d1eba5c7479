"""What is behind linear covariance: budgets, when sources act, what better ones are worth, what measurements tell."""

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.select import NAVIGATION, metric_name
from lvnav_trade.store import Tables

LEAST_SHARE = 1e-9
"""Share of the variance below which a source counts as zero: smaller ones have fewer than six digits, and other ones on
another machine."""
NUMERICAL = 1e-10
"""Of the largest singular value: what is below is lost to rounding."""
OBSERVED = [
    "case", "stretches", "states", "least_rank", "least_rank_with_information", "smallest_ratio",
    "position_against_bias_ratio", "weakest",
]  # fmt: skip


def budget(tables: Tables) -> pd.DataFrame:
    """Return LinCov's 3-D navigation errors by source at every event, in the units of people.

    Columns: case, event, source, metric, unit, sigma (of this source alone; squares of sources add), share_ratio (of
    the variance); both are zero below `LEAST_SHARE`. Largest first within case, event and metric. Empty where the
    campaign asked for no budget.
    """
    rows = tables.budget
    rows = rows[(rows.event != "") & (rows.axis == "3d") & rows.quantity.isin(NAVIGATION)]
    negligible = rows.share_ratio < LEAST_SHARE
    found = _labelled(tables, rows, "event", "source").assign(
        sigma=rows.sigma_si.mask(negligible, 0.0) * _factors(tables, rows),
        share_ratio=rows.share_ratio.mask(negligible, 0.0),
    )
    found = found[["case", "event", "source", "metric", "unit", "sigma", "share_ratio"]]
    place = found.groupby(["case", "event", "metric"], sort=False).ngroup()
    order = found.assign(place=place).sort_values(["place", "share_ratio"], ascending=[True, False], kind="stable")
    return order.drop(columns="place").reset_index(drop=True)


def _labelled(tables: Tables, rows: pd.DataFrame, *columns: str) -> pd.DataFrame:
    """Return case and columns of rows with the name of the metric, a 3-D error, and its unit for people."""
    units = [tables.people[quantity, "3d"][0] for quantity in rows.quantity]
    found = rows[["case", *columns]].assign(metric=rows.quantity.map(metric_name), unit=units)
    return found.assign(case=rows.case.map(tables.labels))


def _factors(tables: Tables, rows: pd.DataFrame) -> list[float]:
    return [tables.people[quantity, "3d"][1] for quantity in rows.quantity]


def contributions(tables: Tables) -> pd.DataFrame:
    """Return what each source put into the 3-D navigation errors at the explained event, and when.

    Columns: case, event, metric, source, t_start_s, t_end_s, share_ratio (of the variance at the event; over sources
    and bins they sum to 1).
    """
    rows = tables.adjoint[tables.adjoint.axis == "3d"]
    total = rows.groupby(["case", "quantity"], sort=False).variance_si2.transform("sum")
    rows = rows.rename(columns={"bin_start_s": "t_start_s", "bin_end_s": "t_end_s"})
    found = _labelled(tables, rows, "event", "source", "t_start_s", "t_end_s")
    found = found.assign(share_ratio=rows.variance_si2 / total).reset_index(drop=True)
    return found[["case", "event", "metric", "source", "t_start_s", "t_end_s", "share_ratio"]]


def sensitivity(tables: Tables) -> pd.DataFrame:
    """Return the 3-D navigation errors at the explained event with each source's sigma multiplied.

    Columns: case, event, metric, unit, source, factor_ratio, frozen (with the gains of the campaign's filter), retuned
    (with a filter that knows the new sigma); root mean squares by linear covariance, in the units of people.
    """
    rows, factors = tables.sensitivity, _factors(tables, tables.sensitivity)
    found = _labelled(tables, rows, "event", "source", "factor_ratio")
    found = found.assign(frozen=rows.frozen_si * factors, retuned=rows.retuned_si * factors)
    return found[["case", "event", "metric", "unit", "source", "factor_ratio", "frozen", "retuned"]]


def observability(tables: Tables) -> pd.DataFrame:
    """Return per case and phase what the measurements tell of the filter's states.

    Columns: case, phase, t_start_s, t_end_s, row_count, rank_count, state_count, tolerance_ratio, smallest_ratio,
    second_ratio, third_ratio (singular values from the smallest up), weakest.
    """
    counts = ["row_count", "rank_count", "state_count", "tolerance_ratio"]
    smallest = ["smallest_ratio", "second_ratio", "third_ratio"]
    found = []
    for _, group in tables.observability.groupby(["case", "phase", "t_s"], sort=False):
        first = group.iloc[0]
        values = dict(zip(smallest, np.sort(group.singular_ratio.to_numpy()), strict=False))
        found.append({**first[["phase", "t_end_s", *counts, "weakest"]], "t_start_s": first.t_s, **values})
        found[-1]["case"] = tables.labels[first.case]
    return pd.DataFrame(found, columns=["case", "phase", "t_start_s", "t_end_s", *counts, *smallest, "weakest"])


def nonlinearity(tables: Tables) -> pd.DataFrame:
    """Return the nonlinearity at every event: case, event, t_s, motion_ratio, state, transition_ratio, row_ratio."""
    rows = tables.nonlinearity
    return rows.assign(case=rows.case.map(tables.labels)).reset_index(drop=True)


def observed(tables: Tables) -> pd.DataFrame:
    """Return the least rank of any stretch (singular values above 1e-10 of the largest), the least rank with
    information (above the tolerance of the results), the smallest singular value, the smallest of a direction in
    which a position trades with its bias (NaN where there is none), and the direction of the smallest of all, in words.
    """
    rows = []
    for case, one in tables.observability.groupby("case", sort=False):
        stretches = [part for _, part in one.groupby("t_s")]
        ranks = [int((part.singular_ratio > NUMERICAL * part.singular_ratio.max()).sum()) for part in stretches]
        apart = one.singular_ratio[np.array([is_position_bias(text) for text in one.direction], dtype=bool)]
        counts = (len(stretches), int(one.state_count.iloc[0]), min(ranks), int(one.rank_count.min()))
        smallest = (float(one.singular_ratio.min()), float(apart.min()) if len(apart) else np.nan)
        rows.append((tables.labels[str(case)], *counts, *smallest, str(one.direction[one.singular_ratio.idxmin()])))
    return pd.DataFrame(rows, columns=OBSERVED)


def is_position_bias(direction: str) -> bool:
    """Say whether a direction in words is one in which a position trades with its bias."""
    names = [part.split(" ", 1)[1] for part in direction.split(", ") if " " in part]
    of_bias = any(name.startswith("position bias") for name in names)
    return of_bias and all(name.startswith("position") for name in names)
