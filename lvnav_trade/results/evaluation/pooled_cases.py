"""Pooled numbers: the cases of an axis are taken together, and their runs count as runs of one case."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lvnav_trade.results import evaluate as alone
from lvnav_trade.results.metric import MEDIAN, NUMBERS, MetricValue, SingleValue
from lvnav_trade.results.statistics import select
from lvnav_trade.results.tables.read import Tables


def axes_of(stated: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the pooled axes of a statement."""
    return tuple(stated.get("pool") or ())


def cases_of(tables: Tables, wanted: Mapping[str, str], pool: Sequence[str]) -> list[str]:
    """Return the digests of the cases with the wanted levels, one case for each pool."""
    first: dict[tuple[tuple[str, str], ...], str] = {}
    for case in select.cases_of(tables, wanted):
        first.setdefault(_others(tables, case, pool), case)
    return list(first.values())


def members(tables: Tables, case: str, pool: Sequence[str]) -> list[str]:
    """Return the cases of a pool: a case and all that differ from it only in the levels of the pooled axes."""
    fixed = _others(tables, case, pool)
    return [other for other in tables.levels if _others(tables, other, pool) == fixed]


def label_of(tables: Tables, case: str, pool: Sequence[str]) -> str:
    """Return the label of a case, or of a pool with the number of its cases."""
    if not pool or (count := len(members(tables, case, pool))) == 1:
        return tables.labels[case]
    rest = ", ".join(f"{axis}={level}" for axis, level in _others(tables, case, pool) if level != "base")
    return f"{rest or 'base'}; {count} levels of {', '.join(pool)} together"


def evaluate_single(tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> SingleValue:
    """Return the number of a case or pool that is compared with a published number, in `unit`.

    A root mean square or sigma is averaged over the pool as a root mean square, a count by the median, a fraction or
    signed error by the mean; a worst case is the median over all runs. `runs` are those of all cases. The arguments are
    those of `results.evaluate.evaluate_single`.
    """
    if not axes_of(stated):
        return alone.evaluate_single(tables, case, stated, unit)
    pool = [alone.evaluate_single(tables, each, stated, unit) for each in members(tables, case, axes_of(stated))]
    remark = "; ".join(dict.fromkeys(single.remark for single in pool if single.remark))
    runs = np.sort(np.concatenate([single.runs for single in pool]))
    values, metric = np.array([single.value for single in pool]), alone.metric_in(stated)
    if stated.get("statistic") == "worst" and len(runs):
        return SingleValue(float(np.median(runs)), remark, runs)
    if metric.is_mean(stated):
        return SingleValue(float(np.mean(values)), remark, runs)
    value = np.median(values) if metric.average == MEDIAN else np.sqrt(np.mean(values**2))
    return SingleValue(float(value), remark, runs)


def evaluate(tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> MetricValue:
    """Return the value of a case or pool by formal sigma, linear covariance and runs, in `unit` ("-": SI).

    Runs of the same number have the same random draws in all cases and are therefore not independent. They count as one
    run, whose square is the mean over the cases. `levels` (n_case,) is the mean over the runs of each case. It gives
    the part of the interval that is due to the choice of cases. The arguments are those of `results.evaluate.evaluate`.
    """
    if not axes_of(stated):
        return alone.evaluate(tables, case, stated, unit)
    pool = [alone.evaluate(tables, each, stated, unit) for each in members(tables, case, axes_of(stated))]
    first, least = pool[0], min(len(value.runs) for value in pool)
    remark = "; ".join(dict.fromkeys(value.remark for value in pool if value.remark))
    formal, true, drawn = (_mean([getattr(value, name) for value in pool], first, stated) for name in NUMBERS)
    whole = MetricValue(formal, true, drawn, remark, np.empty(0), first.is_root, first.is_share)
    if not least:
        return whole
    each = np.stack([value.runs[:least] for value in pool])
    sound = np.all(np.isfinite(each), axis=0)
    levels = each[:, sound].mean(axis=1) if sound.any() else np.empty(0)
    return whole._replace(runs=each.mean(axis=0), levels=levels)


def _mean(values: Sequence[float], first: MetricValue, stated: Mapping[str, Any]) -> float:
    if alone.metric_in(stated).average == MEDIAN or stated.get("statistic") in ("worst", "least"):
        return float(np.median(values))
    if first.is_root:
        return float(np.sqrt(np.mean(np.square(values))))
    return float(np.mean(values))


def _others(tables: Tables, case: str, pool: Sequence[str]) -> tuple[tuple[str, str], ...]:
    return tuple((axis, level) for axis, level in tables.levels[case].items() if axis not in pool)
