"""Published numbers compared with ours: which of them are evidence, and which are reproduced."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.results.evaluate import name_of
from lvnav_trade.results.evaluation.pooled_cases import axes_of, cases_of, evaluate, evaluate_single, label_of
from lvnav_trade.results.evaluation.verdicts import (
    FAILS,
    HOLDS,
    NOT_SET_UP,
    NUMBERS,
    ExpressionValue,
    value_of,
    verdict,
)
from lvnav_trade.results.metric import SingleValue
from lvnav_trade.results.metrics.state_errors import StateError
from lvnav_trade.results.registry import metric_of
from lvnav_trade.results.tables.read import Tables

COLUMNS = [
    "id", "source", "item", "case", "metric", "unit", "published", "formal", "true", "monte_carlo", "low", "high",
    "ours", "ratio", "band_low", "band_high", "in_band", "percentile", "repeats", "fitted", "own", "again",
    "verification", "counts_as", "verdict", "remark",
]  # fmt: skip


def references(tables: Tables, settings: Mapping[str, Any] | None = None) -> pd.DataFrame:
    """Return published numbers next to the results.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    settings : mapping, optional
        Campaign with the published numbers; by default that of the results.

    Returns
    -------
    pandas.DataFrame
        One row per number and case. ours: the result in the unit of the publication, by default the RMS error of the
        runs (of linear covariance without runs). A number that the results do not have is a row with a remark.
        formal, true, monte_carlo: by formal sigma, by the true error of linear covariance, and by the runs; low, high:
        95 % interval of the runs. in_band: whether ours / published lies in the band. verdict: whether the number with
        its interval does. percentile: percentage of the runs below a published single run. repeats: input that
        determines the number. fitted: whether settings were fitted to it. own: its part that is not published. again:
        row of which it is a second reading. verification: reason why it cannot fail. counts_as: see `marks`.
    """
    return pd.DataFrame(reference_rows(tables, settings), columns=COLUMNS)


def reference_rows(tables: Tables, settings: Mapping[str, Any] | None = None) -> list[dict[str, Any]]:
    """Return the rows of `references`, each as values by column; missing columns are empty."""
    campaign = tables.campaign if settings is None else settings
    return rows_of(tables, campaign, {"references": of_cases(_reference_row)})


Rows = Callable[[Tables, Mapping[str, Any]], Iterator[dict[str, Any]]]
"""Function that returns the rows of one entry of a list in a file."""


def rows_of(tables: Tables, settings: Mapping[str, Any], makers: Mapping[str, Rows]) -> list[dict[str, Any]]:
    """Return the rows of all entries of several lists.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    settings : mapping
        Settings with the lists.
    makers : mapping
        For each key of a list the function that returns the rows of an entry.

    Returns
    -------
    list of dict
        Rows; an entry without an id gets one from its place in the list.
    """
    name = str(settings.get("name") or tables.campaign.get("name") or "")
    rows = []
    for key, make_rows in makers.items():
        for number, entry in enumerate(settings.get(key) or (), 1):
            entry_id = entry.get("id") or f"{name} {key} {number}"
            for row in make_rows(tables, entry):
                rows.append({**row, "id": entry_id})
    return rows


def of_cases(make: Callable[..., dict[str, Any]]) -> Rows:
    """Return a function that returns a row for each case of a statement; one row without a case if there is none."""

    def rows(tables: Tables, statement: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
        cases = cases_of(tables, statement.get("case") or {}, axes_of(statement))
        for case in cases or (None,):
            yield make(tables, case, statement)

    return rows


def published_row(
    statement: Mapping[str, Any],
    remarks: Sequence[str],
    band: tuple[float, float],
    tested: float,
    value: ExpressionValue | None = None,
    scale: float = 1.0,
    **cells: Any,
) -> dict[str, Any]:
    """Return the row of a published statement.

    Parameters
    ----------
    statement : mapping
        The statement.
    remarks : sequence of str
        Remarks for the row.
    band : (float, float)
        Limits of the tested number.
    tested : float
        Tested number, such as the ratio of ours to published.
    value : ExpressionValue, optional
        Result with its interval. The value of the statistic must lie within `scale` times the band.
    scale : float
        Factor from the band to the unit of `value`.
    **cells
        Further cells by column.
    """
    is_in_band = bool(band[0] <= tested <= band[1])
    word = HOLDS if is_in_band else FAILS
    numbers = {}
    if value is not None:
        low, high = sorted(scale * end for end in band)
        word = verdict(value, low, high, (_tested_number(statement, value),))
        numbers = {key: getattr(value, key) for key in (*NUMBERS, "low", "high")}
    all_remarks = [str(statement.get("remark") or ""), *remarks]
    return {
        "source": statement["source"],
        "item": statement.get("item") or "",
        **marks(statement, "number" if "published" in cells else "order"),
        "unit": "-",
        **numbers,
        "verdict": word if np.isfinite(tested) else NOT_SET_UP,
        **cells,
        "band_low": float(band[0]),
        "band_high": float(band[1]),
        "in_band": is_in_band,
        "remark": "; ".join(remark for remark in all_remarks if remark),
    }


MARKS = ("repeats", "verification", "own", "again")
"""Reasons not to count a row as evidence; the first that a row has applies."""


def marks(statement: Mapping[str, Any], kind: str) -> dict[str, str]:
    """Return the marks of a statement by column, and the column `counts_as`: the first mark, or else its kind.

    kind : number, order or statement
    """
    mark_by_column = {name: str(statement.get(name) or "") for name in MARKS}
    set_marks = [name for name in MARKS if mark_by_column[name]]
    return {**mark_by_column, "counts_as": set_marks[0] if set_marks else kind}


def band_of(reference: Mapping[str, Any]) -> tuple[float, float]:
    """Return the band of ours over a published number, wider by half of its last printed digit."""
    low, high = reference.get("band") or (0.5, 2.0)
    last_digit = float(reference.get("digit") or 0.0)
    half = 0.5 * last_digit / abs(float(reference["value"]))
    return low - abs(low) * half, high + abs(high) * half


def verdict_in_band(row: Mapping[str, Any], reference: Mapping[str, Any]) -> dict[str, Any]:
    """Return band and verdict of a row of a published number, by its present band."""
    low, high = band_of(reference)
    value = ExpressionValue(
        formal=float(row["formal"]),
        true=float(row["true"]),
        monte_carlo=float(row["monte_carlo"]),
        low=float(row["low"]),
        high=float(row["high"]),
        runs=0,
        remarks=(),
    )
    word = row["verdict"]
    if not np.isnan(row["ratio"]):
        published_value = float(row["published"])
        lowest_value, highest_value = sorted(published_value * end for end in (low, high))
        word = verdict(value, lowest_value, highest_value, (_tested_number(reference, value),))
    return {
        "band_low": low,
        "band_high": high,
        "in_band": bool(low <= row["ratio"] <= high),
        "verdict": word,
    }


def _tested_number(statement: Mapping[str, Any], value: ExpressionValue) -> str:
    """Return which of the three numbers the statistic of a row asks for."""
    statistic = str(statement.get("statistic"))
    if statistic == "formal":
        return "formal"
    if statistic == "lincov" or np.isnan(value.monte_carlo):
        return "true"
    return "monte_carlo"


def _reference_row(tables: Tables, case: str | None, reference: Mapping[str, Any]) -> dict[str, Any]:
    """Return the row of a published number for a case; None: no case has the levels of the number."""
    value = float(reference["value"])
    unit = str(reference["unit"])
    result = SingleValue(np.nan, "no such case")
    label = ""
    if case is not None:
        result = _single_value(tables, case, reference)
        label = label_of(tables, case, axes_of(reference))
    suffix = ""
    if reference.get("against") is not None:
        suffix = ", how much smaller"
    elif reference.get("than") is not None:
        suffix = f", how much below {reference['than']}"
    ratio = result.value / value
    return published_row(
        reference,
        (result.remark,),
        band_of(reference),
        ratio,
        _expression_value(tables, case, reference),
        value,
        percentile=_percentile(reference, result),
        fitted=bool(reference.get("fitted")),
        case=label,
        metric=name_of(reference) + suffix,
        unit=unit,
        published=value,
        ours=result.value,
        ratio=ratio,
    )


def _single_value(tables: Tables, case: str, reference: Mapping[str, Any]) -> SingleValue:
    """Return our number for a published one: of a case, or its reduction against another metric or case."""
    other_metric = reference.get("than")
    other_levels = reference.get("against")
    if other_metric is not None:
        larger = in_own_unit(tables, case, {**reference, "metric": other_metric})
        return _reduction_percent(in_own_unit(tables, case, reference), larger)
    if other_levels is None:
        return evaluate_single(tables, case, reference, str(reference["unit"]))
    other_cases = cases_of(tables, other_levels, axes_of(reference))
    if len(other_cases) != 1:
        return SingleValue(np.nan, f"{len(other_cases)} cases to hold it against")
    larger = in_own_unit(tables, other_cases[0], reference)
    return _reduction_percent(in_own_unit(tables, case, reference), larger)


def _reduction_percent(smaller: SingleValue, larger: SingleValue) -> SingleValue:
    """Return by how many percent the first number is smaller than the second."""
    percent = 100.0 * (1.0 - smaller.value / larger.value)
    return SingleValue(percent, smaller.remark or larger.remark)


def in_own_unit(tables: Tables, case: str, statement: Mapping[str, Any]) -> SingleValue:
    """Return the number of a case in the display unit, which is common to all cases of a campaign."""
    return evaluate_single(tables, case, statement, written_unit(tables, str(statement["metric"])))


def written_unit(tables: Tables, name: str) -> str:
    """Return the display unit of a metric: for an error that of the results, for others the SI unit."""
    metric = metric_of(name)
    if isinstance(metric, StateError):
        return str(tables.display_units.get((metric.quantity, metric.axis), ("m", 1.0))[0])
    return metric.unit


def _expression_value(tables: Tables, case: str | None, reference: Mapping[str, Any]) -> ExpressionValue | None:
    """Return the number by formal sigma, linear covariance and runs; None if there is no case."""
    if case is None:
        return None
    other_metric = reference.get("than")
    other_levels = reference.get("against")
    if other_metric is None and other_levels is None:
        return value_of("a", {"a": evaluate(tables, case, reference, str(reference["unit"]))})
    other_cases = [case]
    if other_levels is not None:
        other_cases = cases_of(tables, other_levels, axes_of(reference))
    if len(other_cases) != 1:
        return None
    other_statement = {**reference, "metric": other_metric or reference["metric"]}
    terms = {
        "a": evaluate(tables, case, reference, "-"),
        "b": evaluate(tables, other_cases[0], other_statement, "-"),
    }
    return value_of("100 * (1 - a / b)", terms)


def _percentile(reference: Mapping[str, Any], value: SingleValue) -> float:
    """Return the percentage of the runs below a published single run; NaN if the number is not of a single run."""
    if not reference.get("single") or not len(value.runs):
        return float("nan")
    return 100.0 * float(np.mean(value.runs < float(reference["value"])))


EDGES = (1.0, 99.0)
"""Percentiles of the runs beyond which a published single flight is unlikely to belong to their distribution."""


def is_evidence(rows: pd.DataFrame) -> pd.Series:
    """Whether each row of `results.evaluation.published.references` is evidence.

    Evidence is published, not determined by an input, able to fail, and not the second reading of another row.
    """
    return ~rows.counts_as.isin(MARKS)


def is_unpublished(rows: pd.DataFrame) -> pd.Series:
    """Whether the statement of each row, or its bound, is not published."""
    return rows.counts_as == "own"


def has_fitted_settings(rows: pd.DataFrame) -> pd.Series:
    """Whether settings were fitted to the number of each row."""
    return rows.fitted.eq(True).fillna(False).astype(bool)  # orders and statements have no value in this column


def is_at_edge(rows: pd.DataFrame) -> pd.Series:
    """Whether the published single flight of each row lies at or beyond the 1st or 99th percentile of the runs."""
    return (rows.percentile <= EDGES[0]) | (rows.percentile >= EDGES[1])


def is_reproduced(rows: pd.DataFrame) -> pd.Series:
    """Whether the results reproduce each row: its number with the interval of the runs lies in the band."""
    return rows.verdict == HOLDS


def most_important(rows: pd.DataFrame, order: Sequence[str], n: int = 3) -> pd.DataFrame:
    """Return the most important rows, each of a different item.

    For each beginning of an item in `order` this is the row with the largest distance from its band; the remaining rows
    follow by their distance.

    Parameters
    ----------
    rows : pandas.DataFrame
        Rows of published numbers, with the column item.
    order : sequence of str
        Beginnings of items, the most important first.
    n : int
        Largest number of rows.
    """
    item_ranks = []  # place of each item in `order`; items without a place come last
    for item in rows["item"]:
        matches = [k for k, start in enumerate(order) if item.startswith(start)]
        item_ranks.append(matches[0] if matches else len(order))
    sorted_rows = rows.assign(place=item_ranks, closeness=-_band_distance(rows))
    sorted_rows = sorted_rows.sort_values(["place", "closeness"], kind="stable").drop_duplicates("item")
    has_place = sorted_rows.place < len(order)
    first_rows = sorted_rows[has_place].drop_duplicates("place")
    remaining_rows = sorted_rows.drop(first_rows.index)
    remaining_rows = remaining_rows.sort_values("closeness", kind="stable")
    important = pd.concat([first_rows, remaining_rows]).head(n)
    return important[list(rows.columns)]


def _band_distance(rows: pd.DataFrame) -> pd.Series:
    """Return the distance of each row from its band: the logarithm of the factor by which the ratio exceeds it.

    It is 0 inside the band and infinite without a number.
    """
    value = rows.ratio.fillna(rows.ours).astype(float)
    with np.errstate(divide="ignore", invalid="ignore"):
        low_excess = np.log(rows.band_low.astype(float) / value)
        high_excess = np.log(value / rows.band_high.astype(float))
    outside = np.maximum(np.maximum(low_excess, high_excess), 0.0)
    has_no_number = value.isna() | (value <= 0.0)
    distance = np.where(has_no_number, np.inf, outside)
    return pd.Series(distance, index=rows.index)
