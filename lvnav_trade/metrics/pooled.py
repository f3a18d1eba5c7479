"""Numbers of the cases of an axis taken together: their runs count as runs of one case."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lvnav_trade.metrics import evaluate as alone
from lvnav_trade.metrics.basics import select
from lvnav_trade.metrics.metric import MEDIAN, NUMBERS, MetricValue, SingleValue
from lvnav_trade.store.read import Tables


def axes_of(stated: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the axes whose levels a number takes together."""
    return tuple(stated.get("pool") or ())


def cases_of(tables: Tables, wanted: Mapping[str, str], pool: Sequence[str]) -> list[str]:
    """Return the digests of the cases whose axes have the levels wanted: the first of those that are taken together."""
    found: dict[tuple[tuple[str, str], ...], str] = {}
    for case in select.cases_of(tables, wanted):
        found.setdefault(_others(tables, case, pool), case)
    return list(found.values())


def members(tables: Tables, case: str, pool: Sequence[str]) -> list[str]:
    """Return the cases that differ from a case in levels of these axes alone, itself among them."""
    mine = _others(tables, case, pool)
    return [other for other in tables.levels if _others(tables, other, pool) == mine]


def label_of(tables: Tables, case: str, pool: Sequence[str]) -> str:
    """Return the label of a case, or of the cases that are taken together and how many they are."""
    if not pool or (count := len(members(tables, case, pool))) == 1:
        return tables.labels[case]
    rest = ", ".join(f"{axis}={level}" for axis, level in _others(tables, case, pool) if level != "base")
    return f"{rest or 'base'}; {count} levels of {', '.join(pool)} together"


def evaluate_single(tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> SingleValue:
    """Return the number of a case, or of the cases that are taken together, in `unit`.

    The root mean square over the cases of a root mean square or a sigma, the median over all runs of a worst case, the
    median over the cases of a count, the mean of a share or of an error with its sign. runs: those of all cases.
    """
    if not axes_of(stated):
        return alone.evaluate_single(tables, case, stated, unit)
    found = [alone.evaluate_single(tables, one, stated, unit) for one in members(tables, case, axes_of(stated))]
    remark = "; ".join(dict.fromkeys(one.remark for one in found if one.remark))
    runs = np.sort(np.concatenate([one.runs for one in found]))
    values, metric = np.array([one.value for one in found]), alone.metric_in(stated)
    if stated.get("statistic") == "worst" and len(runs):
        return SingleValue(float(np.median(runs)), remark, runs)
    if metric.is_mean(stated):
        return SingleValue(float(np.mean(values)), remark, runs)
    value = np.median(values) if metric.average == MEDIAN else np.sqrt(np.mean(values**2))
    return SingleValue(float(value), remark, runs)


def evaluate(tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> MetricValue:
    """Return the value of a case, or of the cases that are taken together, in `unit` ("-": SI).

    Cases share the draws of runs of the same number, so these stay one run, whose square is the mean over the cases.
    levels (n_case,): the mean over the runs of each case, for the part of the interval due to the choice of cases.
    """
    if not axes_of(stated):
        return alone.evaluate(tables, case, stated, unit)
    found = [alone.evaluate(tables, one, stated, unit) for one in members(tables, case, axes_of(stated))]
    first, least = found[0], min(len(one.runs) for one in found)
    remark = "; ".join(dict.fromkeys(one.remark for one in found if one.remark))
    formal, true, drawn = (_mean([getattr(one, name) for one in found], first, stated) for name in NUMBERS)
    whole = MetricValue(formal, true, drawn, remark, np.empty(0), first.is_root, first.is_share)
    if not least:
        return whole
    each = np.stack([one.runs[:least] for one in found])
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
