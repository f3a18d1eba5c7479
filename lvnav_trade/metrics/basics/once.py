"""Results of a metric that several sections of a report use are computed once per set of tables."""

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from lvnav_trade.store import Tables

_Found = TypeVar("_Found")
"""Frame or list."""


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
