"""Indexed row lookup and cached metrics of result tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from lvnav_trade.results.tables.read import PLACES, Tables

if TYPE_CHECKING:
    import pandas as pd

_Found = TypeVar("_Found")  # frame or list


def once(metric: Callable[..., _Found]) -> Callable[..., _Found]:
    """Return a function of tables (and of texts) that caches its result with the tables; each caller gets a copy."""

    @wraps(metric)
    def cached(tables: Tables, *texts: str) -> _Found:
        key = (metric.__module__, metric.__qualname__, *texts)
        if key not in tables.cache:
            tables.cache[key] = metric(tables, *texts)
        result: Any = tables.cache[key]
        return result.copy()

    return cached


def pick(rows: pd.DataFrame, **wanted: str) -> pd.DataFrame:
    """Return the rows of a table whose columns have the given values, by an index if the table is a stored one."""
    if id(rows) in PLACES:
        return rows.iloc[_places(rows, wanted)]
    for column, value in wanted.items():
        rows = rows[rows[column] == value]
    return rows


def pick_columns(rows: pd.DataFrame, names: Sequence[str], **wanted: str) -> list[np.ndarray]:
    """Return columns (n,) of the rows that `pick` selects, without building a frame of all columns."""
    if not wanted:
        return [rows[name].to_numpy() for name in names]
    if id(rows) in PLACES:
        places = _places(rows, wanted)
        return [rows[name].to_numpy()[places] for name in names]
    selected = pick(rows, **wanted)
    return [selected[name].to_numpy() for name in names]


def _places(rows: pd.DataFrame, wanted: dict[str, str]) -> Any:
    """Return the positions (n,) in a stored table of the rows whose columns have the given values."""
    index, columns, values = PLACES[id(rows)], tuple(wanted), tuple(wanted.values())
    if columns not in index:
        index[columns] = rows.groupby(list(columns), sort=False).indices
    return index[columns].get(values if len(values) > 1 else values[0], np.empty(0, dtype=np.intp))
