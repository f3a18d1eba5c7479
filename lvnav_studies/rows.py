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
# Innovation channels whose name ends with an axis, not with what of a satellite.
_BY_AXIS = ("position", "velocity", "attitude", "gyro", "accelerometer")


def claim_rows(tables: Tables, claims: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the rows of what a study claims of one campaign (`claims.Claims`, as JSON), beside our numbers.

    Orders: published is empty, ours the largest ratio of a case to the next, which must lie in the band. Innovations:
    ours the largest autocorrelation. Statements: a row for each choice of the axes that they leave open, ours the value
    of the expression. What these results cannot give keeps its row, with a remark.
    """
    makers: dict[str, Rows] = {
        "orderings": _ordering,
        "innovations": of_cases(_innovations),
        "statements": statement_rows,
    }
    return rows_of(tables, claims, makers)


def _ordering(tables: Tables, stated: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the largest ratio of a case to the next of an order, smallest first."""
    pool = axes_of(stated)
    groups = [cases_of(tables, wanted, pool) for wanted in stated["cases"]]
    alone = all(len(group) == 1 for group in groups)
    found = [in_own_unit(tables, group[0], stated) for group in groups] if alone else []
    values = np.array([one.value for one in found])
    worst = float(np.max(values[:-1] / values[1:])) if len(values) else np.nan
    unit = written_unit(tables, str(stated["metric"])).replace("-", "")
    sizes = f"{', '.join(f'{value:.3g}' for value in values)} {unit}".rstrip()
    text = sizes if len(values) else "not one case each"
    terms = {f"a{k}": evaluate(tables, group[0], stated, "-") for k, group in enumerate(groups)} if alone else {}
    largest = f"max({', '.join(f'a{k} / a{k + 1}' for k in range(len(terms) - 1))})"
    yield published_row(
        stated,
        (text, *dict.fromkeys(one.remark for one in found)),
        (0.0, float(stated.get("factor") or 1.0)),
        worst,
        value_of(largest, terms) if terms else None,
        case=_SMALLER.join(label_of(tables, group[0], pool) if group else "?" for group in groups),
        metric=name_of(stated) + ", ratio to the next",
        ours=worst,
    )


def _innovations(tables: Tables, case: str | None, stated: Mapping[str, Any]) -> dict[str, Any]:
    words, bound, white = str(stated.get("channels") or ""), float(stated.get("largest", 0.15)), stated["white"]
    together = members(tables, case, axes_of(stated)) if case is not None else []
    found = [_most_correlated(tables, one, words) for one in together]
    sizes = np.array([size for size, _ in found])
    largest, text = np.nan, "no runs" if case is not None else "no such case"
    if len(sizes) and np.isfinite(sizes).any():
        largest = float(np.nanmedian(sizes))  # the runs of one case are one number here
        text = found[int(np.nanargmin(np.abs(sizes - largest)))][1]
    return published_row(
        stated,
        (f"published: {'white' if white else 'correlated'}", text),
        (0.0, bound) if white else (bound, np.inf),  # an unbiased estimate may be above one
        largest,
        case=label_of(tables, case, axes_of(stated)) if case is not None else "",
        metric=f"{words} innovations, largest autocorrelation".strip(),
        monte_carlo=largest,
        ours=largest,
    )


def _most_correlated(tables: Tables, case: str, words: str) -> tuple[float, str]:
    """Return the largest autocorrelation of the channels of a case that `words` name, and where it is."""
    rows = whiteness(tables)
    rows = rows[rows.case == tables.labels[case]]
    rows = rows[[_named(name, words) for name in rows.channel]]
    if rows.empty:
        return float("nan"), ""
    worst = rows.loc[rows.largest_ratio.abs().idxmax()]
    text = f"{worst.channel} at lag {worst.largest_lag_number}, of {len(rows)} channels"
    return abs(float(worst.largest_ratio)), text


def _named(channel: str, words: str) -> bool:
    """Whether a channel such as ``G05 range rate`` or ``position x`` is meant: its words without satellite and axis."""
    first, *rest = channel.split(" ")
    kind = [first, *rest[1:]] if first == "receiver" else [first] if first in _BY_AXIS else rest
    return not words or " ".join(kind) == words
