"""Rows of the table of published numbers: orders of cases, statements on innovations, and expressions."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from lvnav_studies.evaluate import rows as statement_rows
from lvnav_trade.api.measures import (
    Rows,
    Tables,
    axes_of,
    cases_of,
    evaluate,
    in_own_unit,
    label_of,
    members,
    name_of,
    of_cases,
    published_row,
    rows_of,
    value_of,
    whiteness,
    written_unit,
)

_SMALLER = " < "
# First words of innovation channels that are named by quantity and axis; other names are satellite and measurement
_BY_AXIS = ("position", "velocity", "attitude", "gyro", "accelerometer")


def claim_rows(tables: Tables, claims: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the rows of the claims of a study on one campaign (`claims.Claims`, as JSON), compared with our numbers.

    Orders: published is empty, ours the largest ratio of a case to the next, which must lie in the band. Innovations:
    ours the largest autocorrelation. Statements: a row for each choice of the axes that they leave open, ours the value
    of the expression. A claim that these results cannot test is a row with a remark.
    """
    makers: dict[str, Rows] = {
        "orderings": _ordering,
        "innovations": of_cases(_innovations),
        "statements": statement_rows,
    }
    return rows_of(tables, claims, makers)


def _ordering(tables: Tables, statement: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the largest ratio of a case to the next of an order, smallest first."""
    pool = axes_of(statement)
    groups = [cases_of(tables, levels, pool) for levels in statement["cases"]]
    labels = [label_of(tables, group[0], pool) if group else "?" for group in groups]
    worst_ratio = np.nan
    value = None
    remarks = ["not one case each"]
    if all(len(group) == 1 for group in groups):
        cases = [group[0] for group in groups]
        singles = [in_own_unit(tables, case, statement) for case in cases]
        sizes = np.array([single.value for single in singles])
        size_ratios = sizes[:-1] / sizes[1:]
        worst_ratio = float(np.max(size_ratios))
        unit = written_unit(tables, str(statement["metric"])).replace("-", "")
        size_list = ", ".join(f"{size:.3g}" for size in sizes)
        case_remarks = dict.fromkeys(single.remark for single in singles)
        remarks = [f"{size_list} {unit}".rstrip(), *case_remarks]
        terms = {f"a{k}": evaluate(tables, case, statement, "-") for k, case in enumerate(cases)}
        ratios = ", ".join(f"a{k} / a{k + 1}" for k in range(len(cases) - 1))
        value = value_of(f"max({ratios})", terms)
    yield published_row(
        statement,
        remarks,
        (0.0, float(statement.get("factor") or 1.0)),
        worst_ratio,
        value,
        case=_SMALLER.join(labels),
        metric=name_of(statement) + ", ratio to the next",
        ours=worst_ratio,
    )


def _innovations(tables: Tables, case: str | None, statement: Mapping[str, Any]) -> dict[str, Any]:
    """Return the row of a statement on innovations: the median of the largest autocorrelation over the pooled cases."""
    channels = str(statement.get("channels") or "")
    bound = float(statement.get("largest", 0.15))
    is_white = statement["white"]
    label = ""
    largest = np.nan
    text = "no such case"
    if case is not None:
        label = label_of(tables, case, axes_of(statement))
        text = "no runs"
        pool = members(tables, case, axes_of(statement))
        correlations = [_most_correlated(tables, member, channels) for member in pool]
        sizes = np.array([size for size, _ in correlations])
        if np.isfinite(sizes).any():
            largest = float(np.nanmedian(sizes))  # the runs of one case are one number here
            _, text = correlations[int(np.nanargmin(np.abs(sizes - largest)))]
    return published_row(
        statement,
        (f"published: {'white' if is_white else 'correlated'}", text),
        (0.0, bound) if is_white else (bound, np.inf),  # an unbiased estimate may be above one
        largest,
        case=label,
        metric=f"{channels} innovations, largest autocorrelation".strip(),
        monte_carlo=largest,
        ours=largest,
    )


def _most_correlated(tables: Tables, case: str, words: str) -> tuple[float, str]:
    """Return the largest magnitude of the autocorrelation over the channels of a case that `words` name, and its place.

    The place is the channel and the lag in words. Without such a channel they are NaN and empty.
    """
    rows = whiteness(tables)
    rows = rows[rows.case == tables.labels[case]]
    is_selected = [_is_named(name, words) for name in rows.channel]
    rows = rows[is_selected]
    if rows.empty:
        return float("nan"), ""
    largest_row = rows.largest_ratio.abs().idxmax()
    worst = rows.loc[largest_row]
    magnitude = abs(float(worst.largest_ratio))
    text = f"{worst.channel} at lag {worst.largest_lag_number}, of {len(rows)} channels"
    return magnitude, text


def _is_named(channel: str, words: str) -> bool:
    """Whether a channel such as ``G05 range rate`` or ``position x`` is meant: its words without satellite and axis."""
    if not words:
        return True
    first, *following = channel.split(" ")
    if first == "receiver":
        measurement = [first, *following[1:]]
    elif first in _BY_AXIS:
        measurement = [first]
    else:
        measurement = following
    return " ".join(measurement) == words
