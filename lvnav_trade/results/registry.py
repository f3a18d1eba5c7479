"""Registry of the metrics that can be named, collected from the modules of the folder `metrics`.

A module there lists its metrics in ``METRICS``. No other place lists metrics: requirements, references, the
list of metrics, tables and the report use this registry.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterable
from functools import lru_cache

from lvnav_trade.results import metrics as families
from lvnav_trade.results.metric import STATEMENTS, Metric
from lvnav_trade.results.metrics.state_errors import StateError, error_named


@lru_cache(maxsize=1)
def registry() -> dict[str, Metric]:
    """Return all metrics by name, family by family; metrics that a requirement can name come first."""
    module_names = sorted(module.name for module in pkgutil.iter_modules(families.__path__))
    metrics: list[Metric] = []
    for name in module_names:
        module = importlib.import_module(f"{families.__name__}.{name}")
        metrics += module.METRICS
    metrics.sort(key=lambda metric: metric.named_by == STATEMENTS)
    metric_by_name = {metric.name: metric for metric in metrics}
    if len(metric_by_name) < len(metrics):
        raise ValueError("two metrics have the same name")
    return metric_by_name


def add_metrics(metrics: Iterable[Metric]) -> None:
    """Register metrics of a script, so that published numbers and statements read afterwards can name them.

    Parameters
    ----------
    metrics : iterable of Metric
        Metrics to register; registering a metric again has no effect.

    Raises
    ------
    ValueError
        A name is already used by another metric.
    """
    metric_by_name = registry()
    for metric in metrics:
        if metric_by_name.setdefault(metric.name, metric) != metric:
            raise ValueError(f"another metric has the name {metric.name}")


def find(name: str) -> Metric | None:
    """Return the metric with a name, including errors of known states on every axis; None if there is none."""
    return registry().get(name) or error_named(name)


def metric_of(name: str) -> Metric:
    """Return the metric with a name found in results; a name that is not registered is the error of a filter state."""
    return find(name) or StateError.from_name(name, "")


def names(condition: Callable[[Metric], bool]) -> tuple[str, ...]:
    """Return the names of the metrics that satisfy a condition."""
    return tuple(name for name, metric in registry().items() if condition(metric))
