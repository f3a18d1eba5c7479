"""Indexed row lookup and cached metrics of result tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from lvnav_trade.store.read import PLACES, Tables

if TYPE_CHECKING:
    import pandas as pd

_Found = TypeVar("_Found")  # frame or list


def once(metric: Callable[..., _Found]) -> Callable[..., _Found]:
    """Return a function of tables, and of words, that keeps with the tables what it found; each caller gets a copy."""

    @wraps(metric)
    def kept(tables: Tables, *asked: str) -> _Found:
        key = (metric.__module__, metric.__qualname__, *asked)
        if key not in tables.cache:
            tables.cache[key] = metric(tables, *asked)
        found: Any = tables.cache[key]
        return found.copy()

    return kept


def pick(rows: pd.DataFrame, **wanted: str) -> pd.DataFrame:
    """Return the rows of a table whose columns have the values wanted; of a whole table without a search."""
    if id(rows) not in PLACES:
        for column, value in wanted.items():
            rows = rows[rows[column] == value]
        return rows
    span, places = _where(rows, wanted)
    return rows.iloc[span] if places is None else rows.iloc[span].iloc[places]


def pick_columns(rows: pd.DataFrame, names: Sequence[str], **wanted: str) -> list[np.ndarray]:
    """Return columns of the rows that `pick` finds, each (n,); of a whole table without a frame of the others."""
    if id(rows) not in PLACES:
        rows, wanted = pick(rows, **wanted), {}
    span, places = _where(rows, wanted) if wanted else (slice(None), None)
    found = [rows[name].iloc[span].to_numpy() for name in names]
    return found if places is None else [values[places] for values in found]


def _where(rows: pd.DataFrame, wanted: dict[str, str]) -> tuple[slice, Any]:
    """Return where in a whole table the rows stand whose columns have the values wanted (see `_within`)."""
    known, columns, values = PLACES[id(rows)], tuple(wanted), tuple(wanted.values())
    if columns not in known:
        known[columns] = {value: _within(at) for value, at in rows.groupby(list(columns), sort=False).indices.items()}
    return known[columns].get(values if len(values) > 1 else values[0], (slice(0, 0), None))


def _within(places: Any) -> tuple[slice, Any]:
    """Return a slice, which copies nothing, and the places in it; None where they are adjacent."""
    first, last = int(places[0]), int(places[-1])
    return slice(first, last + 1), None if last - first + 1 == len(places) else places - first
