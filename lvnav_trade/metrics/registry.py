"""The registry: every metric that can be named, from the modules of `families`.

A module of `families` lists its metrics in ``METRICS``. Nothing else names them: requirements, references, the list of
metrics, tables and report read this registry.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterable
from functools import lru_cache

from lvnav_trade.metrics import families
from lvnav_trade.metrics.families.errors import StateError, error_named
from lvnav_trade.metrics.metric import STATEMENTS, Metric


@lru_cache(maxsize=1)
def registry() -> dict[str, Metric]:
    """Return every metric by name: those that a requirement can name first, family by family."""
    names = sorted(module.name for module in pkgutil.iter_modules(families.__path__))
    modules = [importlib.import_module(f"{families.__name__}.{name}") for name in names]
    metrics: list[Metric] = [metric for module in modules for metric in module.METRICS]
    found = {metric.name: metric for metric in sorted(metrics, key=lambda metric: metric.named_by == STATEMENTS)}
    if len(found) < len(metrics):
        raise ValueError("two metrics have the same name")
    return found


def add_metrics(metrics: Iterable[Metric]) -> None:
    """Make metrics of a script known by their names, to published numbers and statements that are read from then on.

    Parameters
    ----------
    metrics : iterable of Metric
        Metrics; those that are known already are left as they are.

    Raises
    ------
    ValueError
        The name of another metric.
    """
    known = registry()
    for metric in metrics:
        if known.setdefault(metric.name, metric) != metric:
            raise ValueError(f"another metric has the name {metric.name}")


def find(name: str) -> Metric | None:
    """Return the metric of a name; None where there is none.

    Errors of attitude, velocity, position and of any other known state are found for every axis.
    """
    return registry().get(name) or error_named(name)


def metric_of(name: str) -> Metric:
    """Return the metric of a name that results hold; one that is in no list is the error of a state of their filter."""
    return find(name) or StateError.of(name, "")


def names(wanted: Callable[[Metric], bool]) -> tuple[str, ...]:
    """Return the names of the metrics for which a condition holds."""
    return tuple(name for name, metric in registry().items() if wanted(metric))
