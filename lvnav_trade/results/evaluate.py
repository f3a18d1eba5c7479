"""Values of metrics in cases, and of the difference between two cases."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from lvnav_trade.quantities.state_layout import split_metric
from lvnav_trade.results.metric import Metric, MetricValue, SingleValue, dimension_message, event_of, scale_of
from lvnav_trade.results.registry import metric_of
from lvnav_trade.results.statistics.case_results import RunErrors
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.statistics.select import errors_by_axis, pick
from lvnav_trade.results.tables.read import Tables


def statement_metric(statement: Mapping[str, Any]) -> Metric:
    """Return the metric named by a statement or requirement."""
    return metric_of(str(statement["metric"]))


def name_of(statement: Mapping[str, Any]) -> str:
    """Return the label of a statement: statistic, metric, and event or phase; see `Metric.label`."""
    return statement_metric(statement).label(statement)


def evaluate(tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
    """Return the value of a metric in a case by formal sigma, by linear covariance and by the runs.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    statement : mapping
        Statement: metric, event or phase, statistic and further settings of the metric.
    unit : str
        Unit of the value; "-" for the SI unit.
    """
    return statement_metric(statement).value(tables, case, statement, unit)


def evaluate_single(tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> SingleValue:
    """Return the number to compare with a published number; NaN with the reason if it is not available.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    statement : mapping
        Statement: metric, event or phase, statistic and further settings of the metric.
    unit : str
        Unit of the value; "-" for the SI unit.

    Returns
    -------
    SingleValue
        Value by the runs, or by linear covariance if there are no runs.
    """
    return statement_metric(statement).single(tables, case, statement, unit)


def errors_at(tables: Tables, case: str, event: str, metric: str) -> RunErrors | None:
    """Return the magnitude of an error at an event in every run, in the order of the runs; None if not available.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    event : str
        Name of the event.
    metric : str
        Name of the metric.
    """
    return metric_of(metric).errors(CaseTables(tables, case), {"metric": metric, "at": event})


def difference(tables: Tables, case: str, other: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
    """Return the root mean square of the difference between the errors of two cases at an event.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case, other : str
        Digests of the two cases.
    statement : mapping
        Statement: metric and event.
    unit : str
        Unit of the value; "-" for the SI unit.

    Returns
    -------
    MetricValue
        Value by the runs only. `runs` are the squared differences. A run that failed in either case has an infinite
        difference and is not averaged.

    Notes
    -----
    The difference is taken run by run and axis by axis, since both cases have the same random draws.
    """
    quantity, axis = split_metric(str(statement["metric"]))
    event = event_of(statement)
    first = errors_by_axis(tables, case, event, quantity)
    second = errors_by_axis(tables, other, event, quantity)
    has_failed = (first.failure != "") | (second.failure != "")
    first = first.drop(columns="failure")
    second = second.drop(columns="failure")

    columns = [name for name in first.columns if axis == "3d" or f"_{axis}_" in name]
    if columns:
        si = str(pick(tables.outputs, case=case, quantity=quantity).unit.iloc[0])
    else:
        si = ""
    scale = scale_of(unit, si)
    if scale is None:
        return MetricValue(remark=dimension_message(unit))
    if not columns or first.empty:
        return MetricValue(remark="no runs")
    sum_of_squares = ((first[columns] - second[columns]) ** 2).sum(axis=1)
    squares = sum_of_squares.mask(has_failed, np.inf).to_numpy() / scale**2
    good_squares = squares[np.isfinite(squares)]
    if len(good_squares):
        root_mean_square = float(np.sqrt(good_squares.mean()))
    else:
        root_mean_square = np.nan
    return MetricValue(monte_carlo=root_mean_square, runs=squares)
