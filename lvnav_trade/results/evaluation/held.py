"""Published numbers: those that are evidence, and those that the results reproduce."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from lvnav_trade.results.evaluation.published import MARKS
from lvnav_trade.results.evaluation.verdicts import HOLDS

EDGES = (1.0, 99.0)
"""Percentiles of the runs beyond which a published single flight is unlikely to be one of them."""


def evidence(rows: pd.DataFrame) -> pd.Series:
    """Whether each row of `results.evaluation.published.references` is evidence.

    Evidence is published, not determined by an input, able to fail, and not the second reading of another row.
    """
    return ~rows.counts_as.isin(MARKS)


def own(rows: pd.DataFrame) -> pd.Series:
    """Whether the statement of each row, or its bound, is not published."""
    return rows.counts_as == "own"


def fitted(rows: pd.DataFrame) -> pd.Series:
    """Whether settings were fitted to the number of each row."""
    return rows.fitted.eq(True).fillna(False).astype(bool)  # orders and statements have no value in this column


def at_an_edge(rows: pd.DataFrame) -> pd.Series:
    """Whether the published single flight of each row lies at or beyond the 1st or 99th percentile of the runs."""
    return (rows.percentile <= EDGES[0]) | (rows.percentile >= EDGES[1])


def held(rows: pd.DataFrame) -> pd.Series:
    """Whether the results reproduce each row: its number with the interval of the runs lies in the band."""
    return rows.verdict == HOLDS


def most_important(rows: pd.DataFrame, order: Sequence[str], n: int = 3) -> pd.DataFrame:
    """Return the n most important rows, each of a different item.

    For each beginning of an item in `order` this is the row with the largest distance from its band; the remaining rows
    follow by their distance.
    """
    first = [next((k for k, start in enumerate(order) if item.startswith(start)), len(order)) for item in rows["item"]]
    ranked = rows.assign(place=first, distance=-_distance(rows)).sort_values(["place", "distance"], kind="stable")
    ranked = ranked.drop_duplicates("item")
    named = ranked[ranked.place < len(order)].drop_duplicates("place")
    others = ranked.drop(named.index).sort_values("distance", kind="stable")
    return pd.concat([named, others]).head(n)[list(rows.columns)]


def _distance(rows: pd.DataFrame) -> pd.Series:
    """Return the distance of each row from its band: the logarithm of the factor by which the ratio exceeds it.

    It is 0 inside the band and infinite without a number.
    """
    ours = rows.ratio.fillna(rows.ours).astype(float)
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond = np.maximum(np.log(rows.band_low.astype(float) / ours), np.log(ours / rows.band_high.astype(float)))
    return pd.Series(np.where(ours.isna() | (ours <= 0.0), np.inf, np.maximum(beyond, 0.0)), index=rows.index)
