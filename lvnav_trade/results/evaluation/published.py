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


def references(tables: Tables, stated: Mapping[str, Any] | None = None) -> pd.DataFrame:
    """Return published numbers next to the results.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    stated : mapping, optional
        Campaign with the published numbers; by default that of the results.

    Returns
    -------
    pandas.DataFrame
        One row per number and case. ours: the result in the unit of the publication, by default the RMS error of the
        runs (of linear covariance without runs). A number that the results do not have keeps its row, with a remark.
        formal, true, monte_carlo: by formal sigma, by the true error of linear covariance, and by the runs; low, high:
        95 % interval of the runs. in_band: whether ours / published lies in the band. verdict: whether the number with
        its interval does. percentile: percentage of the runs below a published single run. repeats: input that
        determines the number. fitted: whether settings were fitted to it. own: its part that is not published. again:
        row of which it is a second reading. verification: reason why it cannot fail. counts_as: see `marks`.
    """
    return pd.DataFrame(reference_rows(tables, stated), columns=COLUMNS)


def reference_rows(tables: Tables, stated: Mapping[str, Any] | None = None) -> list[dict[str, Any]]:
    """Return the rows of `references`, each as values by column; missing columns are empty."""
    return rows_of(tables, tables.campaign if stated is None else stated, {"references": of_cases(_number)})


Rows = Callable[[Tables, Mapping[str, Any]], Iterator[dict[str, Any]]]
"""Function that returns the rows of one entry of a list in a file."""


def rows_of(tables: Tables, stated: Mapping[str, Any], makers: Mapping[str, Rows]) -> list[dict[str, Any]]:
    """Return the rows of all entries of several lists.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    stated : mapping
        Settings with the lists.
    makers : mapping
        For each key of a list the function that returns the rows of an entry.

    Returns
    -------
    list of dict
        Rows; an entry without an id gets one from its place in the list.
    """
    name = str(stated.get("name") or tables.campaign.get("name") or "")
    return [
        {**row, "id": entry.get("id") or f"{name} {key} {number}"}
        for key, make in makers.items()
        for number, entry in enumerate(stated.get(key) or (), 1)
        for row in make(tables, entry)
    ]


def of_cases(make: Callable[..., dict[str, Any]]) -> Rows:
    """Return a function that returns a row for each case of a statement; one row without a case if there is none."""

    def rows(tables: Tables, statement: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
        named = cases_of(tables, statement.get("case") or {}, axes_of(statement))
        yield from (make(tables, case, statement) for case in named or (None,))

    return rows


def published_row(
    stated: Mapping[str, Any],
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
    stated : mapping
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
    ends, word = sorted(scale * end for end in band), HOLDS if band[0] <= tested <= band[1] else FAILS
    if value is not None:
        word = verdict(value, ends[0], ends[1], (_tested(stated, value),))
    return {
        "source": stated["source"],
        "item": stated.get("item") or "",
        **marks(stated, "number" if "published" in cells else "order"),
        "unit": "-",
        **({key: getattr(value, key) for key in (*NUMBERS, "low", "high")} if value is not None else {}),
        "verdict": word if np.isfinite(tested) else NOT_SET_UP,
        **cells,
        "band_low": float(band[0]),
        "band_high": float(band[1]),
        "in_band": bool(band[0] <= tested <= band[1]),
        "remark": "; ".join(remark for remark in (str(stated.get("remark") or ""), *remarks) if remark),
    }


MARKS = ("repeats", "verification", "own", "again")
"""Reasons not to count a row as evidence; the first that a row has applies."""


def marks(stated: Mapping[str, Any], kind: str) -> dict[str, str]:
    """Return the marks of a statement by column, and the column `counts_as`: the first mark, or else its kind.

    kind : number, order or statement
    """
    by_column = {name: str(stated.get(name) or "") for name in MARKS}
    return {**by_column, "counts_as": next((name for name in MARKS if by_column[name]), kind)}


def band_of(published: Mapping[str, Any]) -> tuple[float, float]:
    """Return the band of ours over a published number, wider by half of its last printed digit."""
    low, high = published.get("band") or (0.5, 2.0)
    half = 0.5 * float(published.get("digit") or 0.0) / abs(float(published["value"]))
    return low - abs(low) * half, high + abs(high) * half


def verdict_in_band(row: Mapping[str, Any], published: Mapping[str, Any]) -> dict[str, Any]:
    """Return band and verdict of a row of a published number, by the band that is stated of it now."""
    low, high = band_of(published)
    formal, true, drawn, least, most = (float(row[key]) for key in (*NUMBERS, "low", "high"))
    found = ExpressionValue(formal, true, drawn, least, most, 0, ())
    ends = sorted(float(row["published"]) * end for end in (low, high))
    known = row["ratio"] == row["ratio"]
    word = verdict(found, ends[0], ends[1], (_tested(published, found),)) if known else row["verdict"]
    inside = bool(low <= row["ratio"] <= high)
    return {"band_low": low, "band_high": high, "in_band": inside, "verdict": word}


def _tested(stated: Mapping[str, Any], value: ExpressionValue) -> str:
    """Return which of the three numbers the statistic of a row asks for."""
    number = {"formal": "formal", "lincov": "true"}.get(str(stated.get("statistic")), "monte_carlo")
    return "true" if number == "monte_carlo" and np.isnan(value.monte_carlo) else number


def _number(tables: Tables, case: str | None, published: Mapping[str, Any]) -> dict[str, Any]:
    value, unit, against = float(published["value"]), str(published["unit"]), published.get("against")
    than, found = published.get("than"), SingleValue(np.nan, "no such case")
    if case is not None and than is not None:
        found = _part(in_own_unit(tables, case, published), in_own_unit(tables, case, {**published, "metric": than}))
    elif case is not None:
        found = (
            evaluate_single(tables, case, published, unit)
            if against is None
            else _smaller(tables, case, published, against)
        )
    words = ", how much smaller" if against is not None else f", how much below {than}" if than is not None else ""
    ratio = found.value / value
    return published_row(
        published,
        (found.remark,),
        band_of(published),
        ratio,
        _three(tables, case, published),
        value,
        percentile=_below_published(published, found),
        fitted=bool(published.get("fitted")),
        case=label_of(tables, case, axes_of(published)) if case is not None else "",
        metric=name_of(published) + words,
        unit=unit,
        published=value,
        ours=found.value,
        ratio=ratio,
    )


def _smaller(tables: Tables, case: str, published: Mapping[str, Any], against: Mapping[str, str]) -> SingleValue:
    others = cases_of(tables, against, axes_of(published))
    if len(others) != 1:
        return SingleValue(np.nan, f"{len(others)} cases to hold it against")
    return _part(*(in_own_unit(tables, each, published) for each in (case, others[0])))


def _part(smaller: SingleValue, larger: SingleValue) -> SingleValue:
    """Return by how many percent the first number is smaller than the second."""
    return SingleValue(100.0 * (1.0 - smaller.value / larger.value), smaller.remark or larger.remark)


def in_own_unit(tables: Tables, case: str, stated: Mapping[str, Any]) -> SingleValue:
    """Return the number of a case in the display unit, which is common to all cases of a campaign."""
    return evaluate_single(tables, case, stated, written_unit(tables, str(stated["metric"])))


def written_unit(tables: Tables, name: str) -> str:
    """Return the display unit of a metric: for an error that of the results, for others the SI unit."""
    metric = metric_of(name)
    if isinstance(metric, StateError):
        return str(tables.people.get((metric.quantity, metric.axis), ("m", 1.0))[0])
    return metric.unit


def _three(tables: Tables, case: str | None, published: Mapping[str, Any]) -> ExpressionValue | None:
    """Return the number by formal sigma, linear covariance and runs; None if there is no case."""
    than, against = published.get("than"), published.get("against")
    other = cases_of(tables, against, axes_of(published)) if against is not None else [case]
    if case is None or len(other) != 1:
        return None
    unit = str(published["unit"]) if than is None and against is None else "-"
    terms = {"a": evaluate(tables, case, published, unit)}
    if unit == "-" and (than is not None or against is not None):
        terms["b"] = evaluate(tables, str(other[0]), {**published, "metric": than or published["metric"]}, unit)
    return value_of("100 * (1 - a / b)" if "b" in terms else "a", terms)


def _below_published(published: Mapping[str, Any], value: SingleValue) -> float:
    """Return the percentage of the runs below a published single run; NaN if the number is not of a single run."""
    if not published.get("single") or not len(value.runs):
        return float("nan")
    return 100.0 * float(np.mean(value.runs < float(published["value"])))


EDGES = (1.0, 99.0)
"""Percentiles of the runs beyond which a published single flight is unlikely to be one of them."""


def evidence(rows: pd.DataFrame) -> pd.Series:
    """Whether each row of `results.evaluation.published.references` is evidence.

    Evidence is published, not determined by an input, able to fail, and not the second reading of another row.
    """
    return ~rows.counts_as.isin(MARKS)


def own(rows: pd.DataFrame) -> pd.Series:
    """Whether the statement of each row, or its bound, is not published."""
    return rows.counts_as == "own"


def fitted(rows: pd.DataFrame) -> pd.Series:
    """Whether settings were fitted to the number of each row."""
    return rows.fitted.eq(True).fillna(False).astype(bool)  # orders and statements have no value in this column


def at_an_edge(rows: pd.DataFrame) -> pd.Series:
    """Whether the published single flight of each row lies at or beyond the 1st or 99th percentile of the runs."""
    return (rows.percentile <= EDGES[0]) | (rows.percentile >= EDGES[1])


def held(rows: pd.DataFrame) -> pd.Series:
    """Whether the results reproduce each row: its number with the interval of the runs lies in the band."""
    return rows.verdict == HOLDS


def most_important(rows: pd.DataFrame, order: Sequence[str], n: int = 3) -> pd.DataFrame:
    """Return the n most important rows, each of a different item.

    For each beginning of an item in `order` this is the row with the largest distance from its band; the remaining rows
    follow by their distance.
    """
    first = [next((k for k, start in enumerate(order) if item.startswith(start)), len(order)) for item in rows["item"]]
    ranked = rows.assign(place=first, distance=-_distance(rows)).sort_values(["place", "distance"], kind="stable")
    ranked = ranked.drop_duplicates("item")
    named = ranked[ranked.place < len(order)].drop_duplicates("place")
    others = ranked.drop(named.index).sort_values("distance", kind="stable")
    return pd.concat([named, others]).head(n)[list(rows.columns)]


def _distance(rows: pd.DataFrame) -> pd.Series:
    """Return the distance of each row from its band: the logarithm of the factor by which the ratio exceeds it.

    It is 0 inside the band and infinite without a number.
    """
    ours = rows.ratio.fillna(rows.ours).astype(float)
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond = np.maximum(np.log(rows.band_low.astype(float) / ours), np.log(ours / rows.band_high.astype(float)))
    return pd.Series(np.where(ours.isna() | (ours <= 0.0), np.inf, np.maximum(beyond, 0.0)), index=rows.index)
