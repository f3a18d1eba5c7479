"""Published numbers beside ours: numbers, orders of cases, innovations, and several interpretations of one table."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.select import pick, split_metric
from lvnav_trade.metrics.filter.consistency import whiteness
from lvnav_trade.metrics.published.published import Ours, cases_of, name_of, ours
from lvnav_trade.store import Tables

COLUMNS = [
    "source", "item", "case", "metric", "unit", "published", "ours", "ratio", "band_low", "band_high", "in_band",
    "remark",
]  # fmt: skip
INTERPRETATIONS = ["during", "error", "case", "stated_percent", "raw_percent", "unbiased_percent"]
_RAW, _UNBIASED = "raw_", "corrected_"
_SMALLER = " < "
_BY_AXIS = ("position", "velocity", "attitude", "gyro", "accelerometer")
"""Innovation channels whose name ends with an axis, not with what of a satellite."""


def references(tables: Tables, stated: Mapping[str, Any] | None = None) -> pd.DataFrame:
    """Return what the campaign holds for published beside ours; `stated` in place of what was asked with these results.

    Numbers: ours in the unit of the publication, RMS error of the runs (LinCov without runs) or the statistic that is
    stated; in_band says whether ours / published lies in the band. Orders of cases: published is empty, ours the
    largest ratio of a case to the next, which must lie in the band. Innovations: ours the largest autocorrelation. What
    these results cannot give keeps its row, with a remark.
    """
    campaign = tables.campaign if stated is None else stated
    rows = []
    for key, make in (("references", _number), ("orderings", _ordering), ("innovations", _innovations)):
        for one in campaign.get(key) or ():
            cases = [] if make is _ordering else cases_of(tables, one.get("case") or {})
            rows += [make(tables, case, one) for case in (*cases, *([] if cases else [None]))]
    return pd.DataFrame(rows, columns=COLUMNS)


def _row(
    stated: Mapping[str, Any], remarks: Sequence[str], band: tuple[float, float], tested: float, **cells: Any
) -> dict[str, Any]:
    text = "; ".join(remark for remark in (str(stated.get("remark") or ""), *remarks) if remark)
    return {
        "source": stated["source"],
        "item": stated.get("item") or "",
        "unit": "-",
        **cells,
        "band_low": float(band[0]),
        "band_high": float(band[1]),
        "in_band": bool(band[0] <= tested <= band[1]),
        "remark": text,
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
        (_single(published, found), found.remark),
        published.get("band", (0.5, 2.0)),
        ratio,
        case=tables.labels[case] if case is not None else "",
        metric=name_of(published) + words,
        unit=unit,
        published=value,
        ours=found.value,
        ratio=ratio,
    )


def _smaller(tables: Tables, case: str, published: Mapping[str, Any], against: Mapping[str, str]) -> Ours:
    """Return by how many percent a case's number is smaller than that of the case it is held against."""
    others = cases_of(tables, against)
    if len(others) != 1:
        return Ours(np.nan, f"{len(others)} cases to hold it against")
    return _part(*(_in_si(tables, one, published) for one in (case, others[0])))


def _part(smaller: Ours, larger: Ours) -> Ours:
    """Return by how many percent a number is smaller than another of its unit."""
    return Ours(100.0 * (1.0 - smaller.value / larger.value), smaller.remark or larger.remark)


def _in_si(tables: Tables, case: str, stated: Mapping[str, Any]) -> Ours:
    """Return our number in the unit for people, which all cases of a campaign share."""
    quantity, axis = split_metric(str(stated["metric"]))
    unit, _ = tables.people.get((quantity, axis), ("m", 1.0))
    return ours(tables, case, stated, unit)


def _single(published: Mapping[str, Any], found: Ours) -> str:
    """Say where a published single run lies among ours, each by itself."""
    if not published.get("single") or not len(found.runs):
        return ""
    below = float(np.mean(found.runs < float(published["value"])))
    return f"a single flight: {100 * below:.0f} % of our {len(found.runs)} flights lie below it"


def _ordering(tables: Tables, _: str | None, stated: Mapping[str, Any]) -> dict[str, Any]:
    """Return the largest ratio of a case to the next of an order, smallest first."""
    groups = [cases_of(tables, wanted) for wanted in stated["cases"]]
    alone = all(len(group) == 1 for group in groups)
    found = [_in_si(tables, group[0], stated) for group in groups] if alone else []
    values = np.array([one.value for one in found])
    worst = float(np.max(values[:-1] / values[1:])) if len(values) else np.nan
    unit = tables.people.get(split_metric(str(stated["metric"])), ("m", 1.0))[0]
    text = _SMALLER.join(f"{value:.3g}" for value in values) + f" {unit}" if len(values) else "not one case each"
    return _row(
        stated,
        (text, *dict.fromkeys(one.remark for one in found)),
        (0.0, float(stated.get("factor") or 1.0)),
        worst,
        case=_SMALLER.join(tables.labels[group[0]] if group else "?" for group in groups),
        metric=name_of(stated) + ", ratio to the next",
        ours=worst,
    )


def _innovations(tables: Tables, case: str | None, stated: Mapping[str, Any]) -> dict[str, Any]:
    """Return the largest autocorrelation of the innovation channels that a statement names."""
    label = tables.labels[case] if case is not None else ""
    words, bound, white = str(stated.get("channels") or ""), float(stated.get("largest", 0.15)), stated["white"]
    rows = pick(whiteness(tables), case=label)
    rows = rows[[_named(name, words) for name in rows.channel]]
    largest, text = np.nan, "no runs" if case is not None else "no such case"
    if len(rows):
        worst = rows.loc[rows.largest_ratio.abs().idxmax()]
        largest = abs(float(worst.largest_ratio))
        text = f"{worst.channel} at lag {worst.largest_lag_number}, of {len(rows)} channels"
    return _row(
        stated,
        (f"published: {'white' if white else 'correlated'}", text),
        (0.0, bound) if white else (bound, 1.0),
        largest,
        case=label,
        metric=f"{words} innovations, largest autocorrelation".strip(),
        ours=largest,
    )


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
    held = [one for one in tables.campaign.get("references") or () if str(one.get("than") or "").startswith(_RAW)]
    stated: dict[tuple[str, str, str], float] = {}
    for one in held:
        for case in cases_of(tables, one.get("case") or {}):
            stated[str(one["during"]), str(one["metric"]), case] = float(one["value"])
    names = short_names(tables, list(dict.fromkeys(case for _, _, case in stated)))
    rows = []
    for during in dict.fromkeys(key[0] for key in stated):
        for metric in dict.fromkeys(key[1] for key in stated):
            for case, name in names.items():
                below = [_below(tables, case, metric, during, prefix) for prefix in (_RAW, _UNBIASED)]
                known = stated.get((during, metric, case), np.nan)
                rows.append((during, metric.replace("_error_", " "), name, known, *below))
    return pd.DataFrame(rows, columns=INTERPRETATIONS)


def _below(tables: Tables, case: str, metric: str, during: str, prefix: str) -> float:
    """Return by how many percent the filter's sigma of a metric is below that of the prefixed one."""
    asked: Mapping[str, Any] = {"metric": metric, "during": during, "statistic": "formal"}
    unit = "deg/h" if metric.startswith("rate") else "mg"
    estimate, sample = (ours(tables, case, {**asked, "metric": name}, unit).value for name in (metric, prefix + metric))
    return 100.0 * (1.0 - estimate / sample)


def short_names(tables: Tables, cases: Sequence[str]) -> dict[str, str]:
    """Return by case, of those given, the levels of the axes that set them apart."""
    axes = {row.case: json.loads(row.axes) for row in tables.cases.itertuples() if row.case in cases}
    differ = [axis for axis in next(iter(axes.values()), {}) if len({levels.get(axis) for levels in axes.values()}) > 1]
    return {case: ", ".join(axes[case][axis] for axis in differ) or tables.labels[case] for case in cases}
