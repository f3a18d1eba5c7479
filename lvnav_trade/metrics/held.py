"""Published numbers: which of them are evidence, and which are reproduced."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from lvnav_trade.metrics.published import MARKS
from lvnav_trade.metrics.verdicts import HOLDS

EDGES = (1.0, 99.0)
"""Points (%) of our runs beyond which a published single flight is none of them."""


def evidence(rows: pd.DataFrame) -> pd.Series:
    """Whether each row of `metrics.published.references` is counted: it is published, no input decides it, it can fail,
    and it is not the second reading of a row.
    """
    return ~rows.counts_as.isin(MARKS)


def own(rows: pd.DataFrame) -> pd.Series:
    """Whether the statement of each row, or its bound, is not published."""
    return rows.counts_as == "own"


def fitted(rows: pd.DataFrame) -> pd.Series:
    """Whether settings were searched for by each number."""
    return rows.fitted.eq(True).fillna(False).astype(bool)  # orders and statements have none


def at_an_edge(rows: pd.DataFrame) -> pd.Series:
    """Whether the published single flight of each row lies at or beyond the 1 % or 99 % point of our runs."""
    return (rows.percentile <= EDGES[0]) | (rows.percentile >= EDGES[1])


def held(rows: pd.DataFrame) -> pd.Series:
    """Whether each row holds: its number, with the interval of our runs, keeps its band."""
    return rows.verdict == HOLDS


def most_important(rows: pd.DataFrame, order: Sequence[str], n: int = 3) -> pd.DataFrame:
    """Return n rows of different items: for each beginning of an item in `order` the row furthest from its band that
    begins so, then the furthest of all, as the logarithm of a ratio.
    """
    first = [next((k for k, start in enumerate(order) if item.startswith(start)), len(order)) for item in rows["item"]]
    ranked = rows.assign(place=first, distance=-_distance(rows)).sort_values(["place", "distance"], kind="stable")
    ranked = ranked.drop_duplicates("item")
    named = ranked[ranked.place < len(order)].drop_duplicates("place")
    others = ranked.drop(named.index).sort_values("distance", kind="stable")
    return pd.concat([named, others]).head(n)[list(rows.columns)]


def _distance(rows: pd.DataFrame) -> pd.Series:
    """Return the logarithm of how many times ours over published lies beyond its band; 0 inside, and infinite where
    there is none.
    """
    ours = rows.ratio.fillna(rows.ours).astype(float)
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond = np.maximum(np.log(rows.band_low.astype(float) / ours), np.log(ours / rows.band_high.astype(float)))
    return pd.Series(np.where(ours.isna() | (ours <= 0.0), np.inf, np.maximum(beyond, 0.0)), index=rows.index)
