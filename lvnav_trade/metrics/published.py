"""Published numbers, orders of cases, innovations and statements compared with ours."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.layout import MODE_METRICS, split_metric
from lvnav_trade.metrics.basics.select import pick
from lvnav_trade.metrics.filter import whiteness
from lvnav_trade.metrics.numbers import Ours, is_ratio, name_of
from lvnav_trade.metrics.pooled import axes_of, cases_of, columns, label_of, members, ours
from lvnav_trade.metrics.statements import FAILS, HOLDS, NOT_SET_UP, NUMBERS, Value, value_of, verdict
from lvnav_trade.metrics.statements import rows as statement_rows
from lvnav_trade.store.read import Tables

COLUMNS = [
    "id", "source", "item", "case", "metric", "unit", "published", "formal", "true", "monte_carlo", "low", "high",
    "ours", "ratio", "band_low", "band_high", "in_band", "percentile", "repeats", "fitted", "own", "verdict",
    "remark",
]  # fmt: skip
INTERPRETATIONS = ["during", "error", "case", "stated_percent", "raw_percent", "unbiased_percent"]
_RAW, _UNBIASED = "raw_", "corrected_"
_SMALLER = " < "
# Innovation channels whose name ends with an axis, not with what of a satellite.
_BY_AXIS = ("position", "velocity", "attitude", "gyro", "accelerometer")


def references(tables: Tables, stated: Mapping[str, Any] | None = None) -> pd.DataFrame:
    """Return what the campaign holds for published beside ours; `stated` in place of what was asked with these results.

    Numbers: ours in the unit of the publication, RMS error of the runs (LinCov without runs) or the statistic that is
    stated; in_band says whether ours / published lies in the band. Orders of cases: published is empty, ours the
    largest ratio of a case to the next, which must lie in the band. Innovations: ours the largest autocorrelation.
    Statements: a row for each choice of the axes that they leave open, ours the value of the expression. What these
    results cannot give keeps its row, with a remark.

    formal, true, monte_carlo: the same by formal sigma, by the true error of linear covariance, and by the runs, whose
    95 % interval is low to high; verdict: whether they keep the bounds; percentile: part of our runs below a published
    single run, in percent; repeats: the input that decides a number; fitted: whether settings were
    searched for by it; own: what of the row is not published.
    """
    campaign = tables.campaign if stated is None else stated
    name = str(campaign.get("name") or tables.campaign.get("name") or "")
    rows = [
        {**row, "id": one.get("id") or f"{name} {key} {number}"}
        for key, make in _MADE.items()
        for number, one in enumerate(campaign.get(key) or (), 1)
        for row in make(tables, one)
    ]
    return pd.DataFrame(rows, columns=COLUMNS)


def _of_cases(make: Callable[..., dict[str, Any]]) -> Callable[..., Iterator[dict[str, Any]]]:
    """Return what makes a row for each case that a statement names; one without a case where there is none."""

    def rows(tables: Tables, one: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
        yield from (
            make(tables, case, one) for case in cases_of(tables, one.get("case") or {}, axes_of(one)) or (None,)
        )

    return rows


def _row(
    stated: Mapping[str, Any],
    remarks: Sequence[str],
    band: tuple[float, float],
    tested: float,
    found: Value | None = None,
    scale: float = 1.0,
    **cells: Any,
) -> dict[str, Any]:
    """Return a row; found: the value three times, of which that of the statistic must lie in `scale` times the band."""
    ends, word = sorted(scale * end for end in band), HOLDS if band[0] <= tested <= band[1] else FAILS
    if found is not None:
        number = {"formal": "formal", "lincov": "true"}.get(str(stated.get("statistic")), "monte_carlo")
        number = "true" if number == "monte_carlo" and np.isnan(found.monte_carlo) else number
        word = verdict(found, ends[0], ends[1], (number,))
    return {
        "source": stated["source"],
        "item": stated.get("item") or "",
        "own": str(stated.get("own") or ""),
        "unit": "-",
        **({key: getattr(found, key) for key in (*NUMBERS, "low", "high")} if found is not None else {}),
        "verdict": word if np.isfinite(tested) else NOT_SET_UP,
        **cells,
        "band_low": float(band[0]),
        "band_high": float(band[1]),
        "in_band": bool(band[0] <= tested <= band[1]),
        "remark": "; ".join(remark for remark in (str(stated.get("remark") or ""), *remarks) if remark),
    }


def _number(tables: Tables, case: str | None, published: Mapping[str, Any]) -> dict[str, Any]:
    value, unit, against = float(published["value"]), str(published["unit"]), published.get("against")
    than, found = published.get("than"), Ours(np.nan, "no such case")
    if case is not None and than is not None:
        found = _part(_in_si(tables, case, published), _in_si(tables, case, {**published, "metric": than}))
    elif case is not None:
        found = ours(tables, case, published, unit) if against is None else _smaller(tables, case, published, against)
    words = ", how much smaller" if against is not None else f", how much below {than}" if than is not None else ""
    ratio = found.value / value
    return _row(
        published,
        (found.remark,),
        published.get("band", (0.5, 2.0)),
        ratio,
        _three(tables, case, published),
        value,
        percentile=_below_published(published, found),
        repeats=str(published.get("repeats") or ""),
        fitted=bool(published.get("fitted")),
        case=label_of(tables, case, axes_of(published)) if case is not None else "",
        metric=name_of(published) + words,
        unit=unit,
        published=value,
        ours=found.value,
        ratio=ratio,
    )


def _smaller(tables: Tables, case: str, published: Mapping[str, Any], against: Mapping[str, str]) -> Ours:
    others = cases_of(tables, against, axes_of(published))
    if len(others) != 1:
        return Ours(np.nan, f"{len(others)} cases to hold it against")
    return _part(*(_in_si(tables, one, published) for one in (case, others[0])))


def _part(smaller: Ours, larger: Ours) -> Ours:
    return Ours(100.0 * (1.0 - smaller.value / larger.value), smaller.remark or larger.remark)


def _in_si(tables: Tables, case: str, stated: Mapping[str, Any]) -> Ours:
    """Return our number in the unit for people, which all cases of a campaign share."""
    return ours(tables, case, stated, _unit(tables, str(stated["metric"])))


def _unit(tables: Tables, metric: str) -> str:
    unit, _ = tables.people.get(split_metric(metric), (MODE_METRICS.get(metric, "m"), 1.0))
    return str(unit)


def _three(tables: Tables, case: str | None, published: Mapping[str, Any]) -> Value | None:
    """Return our number three times; nothing where there is no case."""
    than, against = published.get("than"), published.get("against")
    other = cases_of(tables, against, axes_of(published)) if against is not None else [case]
    if case is None or len(other) != 1:
        return None
    unit = str(published["unit"]) if than is None and against is None else "-"
    terms = {"a": columns(tables, case, published, unit)}
    if unit == "-" and (than is not None or against is not None):
        terms["b"] = columns(tables, str(other[0]), {**published, "metric": than or published["metric"]}, unit)
    return value_of("100 * (1 - a / b)" if "b" in terms else "a", terms)


def _below_published(published: Mapping[str, Any], found: Ours) -> float:
    """Return the part (%) of our runs below a published single run; NaN where it is not of one."""
    if not published.get("single") or not len(found.runs):
        return float("nan")
    return 100.0 * float(np.mean(found.runs < float(published["value"])))


def _ordering(tables: Tables, stated: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the largest ratio of a case to the next of an order, smallest first."""
    pool = axes_of(stated)
    groups = [cases_of(tables, wanted, pool) for wanted in stated["cases"]]
    alone = all(len(group) == 1 for group in groups)
    found = [_in_si(tables, group[0], stated) for group in groups] if alone else []
    values = np.array([one.value for one in found])
    worst = float(np.max(values[:-1] / values[1:])) if len(values) else np.nan
    named = str(stated["metric"])
    bare = is_ratio(named) or named == "satellites_tracked"
    unit = "" if bare else _unit(tables, named).replace("-", "")
    sizes = f"{', '.join(f'{value:.3g}' for value in values)} {unit}".rstrip()
    text = sizes if len(values) else "not one case each"
    terms = {f"a{k}": columns(tables, group[0], stated, "-") for k, group in enumerate(groups)} if alone else {}
    largest = f"max({', '.join(f'a{k} / a{k + 1}' for k in range(len(terms) - 1))})"
    yield _row(
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
    return _row(
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
    rows = pick(whiteness(tables), case=tables.labels[case])
    rows = rows[[_named(name, words) for name in rows.channel]]
    if rows.empty:
        return float("nan"), ""
    worst = rows.loc[rows.largest_ratio.abs().idxmax()]
    text = f"{worst.channel} at lag {worst.largest_lag_number}, of {len(rows)} channels"
    return abs(float(worst.largest_ratio)), text


_MADE: dict[str, Callable[[Tables, Mapping[str, Any]], Iterable[dict[str, Any]]]] = {
    "references": _of_cases(_number),
    "orderings": _ordering,
    "innovations": _of_cases(_innovations),
    "statements": statement_rows,
}


def _named(channel: str, words: str) -> bool:
    """Whether a channel such as ``G05 range rate`` or ``position x`` is meant: its words without satellite and axis."""
    first, *rest = channel.split(" ")
    kind = [first, *rest[1:]] if first == "receiver" else [first] if first in _BY_AXIS else rest
    return not words or " ".join(kind) == words


def interpretations(tables: Tables) -> pd.DataFrame:
    """Return improvements by phase, error and case, where the campaign's references hold estimates against raw samples.

    case is what sets a case apart from the others that are held so. stated_percent: what is stated of that case, NaN
    where nothing is. raw_percent: the filter's own sigma against that of the sample as it is, which is charged with its
    bias. unbiased_percent: against the sample less its estimated bias. Empty where nothing is held so.
    """
    stated = {
        (str(one["during"]), str(one["metric"]), case): float(one["value"])
        for one in tables.campaign.get("references") or ()
        if str(one.get("than") or "").startswith(_RAW)
        for case in cases_of(tables, one.get("case") or {}, ())
    }
    phases, metrics, cases = ([*dict.fromkeys(names)] for names in (zip(*stated, strict=True) if stated else ((),) * 3))
    names, rows = short_names(tables, cases), []
    for during, metric, case in product(phases, metrics, cases):
        below = [_below(tables, case, metric, during, prefix) for prefix in (_RAW, _UNBIASED)]
        known = stated.get((during, metric, case), np.nan)
        rows.append((during, metric.replace("_error_", " "), names[case], known, *below))
    return pd.DataFrame(rows, columns=INTERPRETATIONS)


def _below(tables: Tables, case: str, metric: str, during: str, prefix: str) -> float:
    asked: Mapping[str, Any] = {"metric": metric, "during": during, "statistic": "formal"}
    unit = "deg/h" if metric.startswith("rate") else "mg"
    estimate, sample = (ours(tables, case, {**asked, "metric": name}, unit).value for name in (metric, prefix + metric))
    return 100.0 * (1.0 - estimate / sample)


def short_names(tables: Tables, cases: Sequence[str]) -> dict[str, str]:
    """Return by case, of those given, the levels of the axes that set them apart."""
    first = tables.levels[cases[0]] if cases else {}
    differ = [axis for axis in first if len({tables.levels[case].get(axis) for case in cases}) > 1]
    return {case: ", ".join(tables.levels[case][axis] for axis in differ) or tables.labels[case] for case in cases}
