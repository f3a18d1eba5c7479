"""Pooled numbers: the cases of an axis are taken together, and their runs count as runs of one case."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lvnav_trade.results import evaluate as single_case
from lvnav_trade.results.metric import MEDIAN, NUMBERS, MetricValue, SingleValue
from lvnav_trade.results.statistics import select
from lvnav_trade.results.tables.read import Tables


def axes_of(statement: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the pooled axes of a statement."""
    return tuple(statement.get("pool") or ())


def cases_of(tables: Tables, level_by_axis: Mapping[str, str], pool: Sequence[str]) -> list[str]:
    """Return the digests of the cases with the wanted levels, one case for each pool.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    level_by_axis : mapping of str to str
        Label of the level by axis.
    pool : sequence of str
        Names of the pooled axes.
    """
    first: dict[tuple[tuple[str, str], ...], str] = {}
    for case in select.cases_of(tables, level_by_axis):
        first.setdefault(_unpooled_levels(tables, case, pool), case)
    return list(first.values())


def members(tables: Tables, case: str, pool: Sequence[str]) -> list[str]:
    """Return the cases of a pool: a case and all cases that differ from it only in the levels of the pooled axes."""
    unpooled_levels = _unpooled_levels(tables, case, pool)
    return [member for member in tables.levels if _unpooled_levels(tables, member, pool) == unpooled_levels]


def label_of(tables: Tables, case: str, pool: Sequence[str]) -> str:
    """Return the label of a case, or of a pool with the number of its cases."""
    count = len(members(tables, case, pool)) if pool else 1
    if count == 1:
        return tables.labels[case]
    unpooled_levels = _unpooled_levels(tables, case, pool)
    level_text = ", ".join(f"{axis}={level}" for axis, level in unpooled_levels if level != "base")
    return f"{level_text or 'base'}; {count} levels of {', '.join(pool)} together"


def evaluate_single(tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> SingleValue:
    """Return the number of a case or pool that is compared with a published number.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case, or of a case of the pool.
    statement : mapping
        Statement: metric, event or phase, statistic and pooled axes.
    unit : str
        Unit of the number; "-" for the SI unit.

    Returns
    -------
    SingleValue
        `runs` are those of all cases.

    Notes
    -----
    A root mean square or sigma is averaged over the pool as a root mean square, a count by the median, a fraction or
    signed error by the mean. A worst case is the median over all runs.
    """
    if not axes_of(statement):
        return single_case.evaluate_single(tables, case, statement, unit)
    cases = members(tables, case, axes_of(statement))
    pool = [single_case.evaluate_single(tables, member, statement, unit) for member in cases]
    remark = _joined_remarks(pool)
    values = np.array([single.value for single in pool])
    runs = np.sort(np.concatenate([single.runs for single in pool]))
    metric = single_case.statement_metric(statement)
    if statement.get("statistic") == "worst" and len(runs):
        value = np.median(runs)
    elif metric.is_mean(statement):
        value = np.mean(values)
    elif metric.average == MEDIAN:
        value = np.median(values)
    else:
        value = np.sqrt(np.mean(values**2))
    return SingleValue(float(value), remark, runs)


def evaluate(tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
    """Return the value of a case or pool by formal sigma, linear covariance and runs.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case, or of a case of the pool.
    statement : mapping
        Statement: metric, event or phase, statistic and pooled axes.
    unit : str
        Unit of the value; "-" for the SI unit.

    Returns
    -------
    MetricValue
        `levels` (n_case,) is the mean over the runs of each case. It gives the part of the interval that is due to the
        choice of cases.

    Notes
    -----
    Runs of the same number have the same random draws in all cases and are therefore not independent. They count as one
    run, whose square is the mean over the cases.
    """
    if not axes_of(statement):
        return single_case.evaluate(tables, case, statement, unit)
    cases = members(tables, case, axes_of(statement))
    pool = [single_case.evaluate(tables, member, statement, unit) for member in cases]
    first = pool[0]
    formal, true, monte_carlo = (
        _pooled_number([getattr(value, name) for value in pool], first.is_root, statement) for name in NUMBERS
    )
    pooled_value = MetricValue(
        formal=formal,
        true=true,
        monte_carlo=monte_carlo,
        remark=_joined_remarks(pool),
        is_root=first.is_root,
        is_share=first.is_share,
    )
    n_run = min(len(value.runs) for value in pool)
    if not n_run:
        return pooled_value
    runs = np.stack([value.runs[:n_run] for value in pool])
    is_finite = np.all(np.isfinite(runs), axis=0)
    if is_finite.any():
        levels = runs[:, is_finite].mean(axis=1)
    else:
        levels = np.empty(0)
    return pooled_value._replace(runs=runs.mean(axis=0), levels=levels)


def _joined_remarks(pool: Sequence[SingleValue] | Sequence[MetricValue]) -> str:
    return "; ".join(dict.fromkeys(value.remark for value in pool if value.remark))


def _pooled_number(values: Sequence[float], is_root: bool, statement: Mapping[str, Any]) -> float:
    """Return the median, root mean square or mean over the cases of a pool, as the statistic requires."""
    if single_case.statement_metric(statement).average == MEDIAN or statement.get("statistic") in ("worst", "least"):
        return float(np.median(values))
    if is_root:
        return float(np.sqrt(np.mean(np.square(values))))
    return float(np.mean(values))


def _unpooled_levels(tables: Tables, case: str, pool: Sequence[str]) -> tuple[tuple[str, str], ...]:
    levels = tables.levels[case]
    return tuple((axis, level) for axis, level in levels.items() if axis not in pool)
