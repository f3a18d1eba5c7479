"""Our number for a published one, and published numbers, orders of cases and innovations compared with ours."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade import units
from lvnav_trade.layout import MISSION, split_metric
from lvnav_trade.metrics.basics.select import (
    SAME_TIME,
    errors_at,
    history_of,
    instant,
    phase,
    pick,
    rows_between,
    time_mean,
)
from lvnav_trade.metrics.errors.covariances import LINEAR_ATTITUDE, NUMERICAL, beyond_at_start, beyond_linear, observed
from lvnav_trade.metrics.filter import whiteness
from lvnav_trade.metrics.vehicle import nozzle
from lvnav_trade.records import Floats
from lvnav_trade.store.read import Tables
from lvnav_trade.store.schema import error_column, rms_column

# Columns of the history behind a statistic, with runs and without.
_SIGMAS = {"formal": ("filter_sigma_si", "lincov_formal_si"), "lincov": ("lincov_true_si", "lincov_true_si")}
# Metrics of a whole flight, and what they are.
_WHOLE = {
    "observable_states": "least of all stretches",
    "nozzle_movement_pitch": "less with the filtered rate, flight",
    "nozzle_movement_yaw": "less with the filtered rate, flight",
}
COLUMNS = [
    "source", "item", "case", "metric", "unit", "published", "ours", "ratio", "band_low", "band_high", "in_band",
    "remark",
]  # fmt: skip
INTERPRETATIONS = ["during", "error", "case", "stated_percent", "raw_percent", "unbiased_percent"]
_RAW, _UNBIASED = "raw_", "corrected_"
_SMALLER = " < "
# Innovation channels whose name ends with an axis, not with what of a satellite.
_BY_AXIS = ("position", "velocity", "attitude", "gyro", "accelerometer")


class Ours(NamedTuple):
    """Our number in a unit; what should be said of it; the same of each run by itself, sorted, where that is known."""

    value: float
    remark: str = ""
    runs: Floats = np.empty(0)


_MISSING, _NOT_FLOWN = Ours(np.nan, "not among our results"), Ours(np.nan, "not in our flight")


def cases_of(tables: Tables, wanted: Mapping[str, str]) -> list[str]:
    """Return the digests of the cases whose axes have the levels wanted."""
    return [
        case
        for case, levels in tables.levels.items()
        if all(levels.get(axis) == str(level) for axis, level in wanted.items())
    ]


def name_of(stated: Mapping[str, Any]) -> str:
    """Return the metric, the statistic where it is not the root mean square, and where it holds."""
    if str(stated["metric"]) in _WHOLE:
        return f"{stated['metric']}, {_WHOLE[str(stated['metric'])]}"
    words = {"rms": "", "worst": "worst ", "least": "least ", "formal": "filter's own sigma of "}
    first, during = words.get(stated.get("statistic", "rms"), "linear covariance of "), stated.get("during")
    place = f", {during}" if during else f" at {stated.get('at') or 'injection'}"
    return f"{first}{stated['metric']}{place}"


def ours(tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> Ours:
    """Return our number for what is stated of a case, in `unit`; NaN with the reason where these results lack it."""
    metric = str(stated["metric"])
    if metric in MISSION:
        return _of_mission(tables, case, stated, unit)
    if metric.startswith("nozzle_movement_"):
        return _of_nozzle(tables, case, metric.rpartition("_")[2])
    if metric == "observable_states":
        return _of_rank(tables, case)
    if metric == "satellites_tracked" or metric.endswith("_left"):
        return _of_signals(tables, case, stated, unit)
    quantity, axis = split_metric(metric)
    rows = history_of(tables, case, quantity, axis)
    if rows.empty:
        return _MISSING
    scale, statistic = _scale(unit, str(rows.unit.iloc[0])), str(stated.get("statistic", "rms"))
    if scale is None:
        return Ours(np.nan, f"unit {unit} does not fit")
    if statistic == "worst":
        found = _per_run(tables, case, stated, error_column(quantity, axis, rows.unit.iloc[0]))
        if not len(found):
            return Ours(np.nan, "no runs, or the phase does not begin and end at events")
        return Ours(float(np.median(found)) / scale, "", found / scale)
    chosen = _within(tables, case, rows, stated)
    if chosen.empty:
        return _NOT_FLOWN
    with_runs = bool(chosen.run_count.iloc[0])
    beyond = _beyond_linear(tables, case, stated, quantity, unit) if statistic == "lincov" else ""
    if beyond:
        return Ours(np.nan, f"not applicable: {beyond}")
    if statistic in _SIGMAS:
        square = chosen[_SIGMAS[statistic][0 if with_runs else 1]] ** 2
    else:
        square = chosen.rms_si**2 if with_runs else chosen.lincov_true_si**2 + chosen.lincov_mean_si**2
    value = float(np.sqrt(time_mean(chosen.t_s.to_numpy(), square.to_numpy()))) / scale
    return Ours(value, "" if with_runs else "linear covariance", _each(tables, case, stated, rows) / scale)


def _beyond_linear(tables: Tables, case: str, stated: Mapping[str, Any], quantity: str, unit: str) -> str:
    """Say why linear covariance has no number beside what is stated of an attitude: one of the two is not small."""
    published = float(stated.get("value", 0.0)) * (_scale(unit, "rad") or 0.0) if quantity == "attitude" else 0.0
    return beyond_linear(published) if published > LINEAR_ATTITUDE else beyond_at_start(tables, case)


def _scale(unit: str, si: str) -> float | None:
    """Return how many SI units one unit of the publication is; None where it is one of another kind."""
    try:
        return units.parse(f"1 {unit}", si)
    except ValueError:
        return None


def _within(tables: Tables, case: str, rows: pd.DataFrame, stated: Mapping[str, Any]) -> pd.DataFrame:
    """Return the rows of a history at the event, or during the phase, that a statement names; none where not flown."""
    if stated.get("during"):
        return rows_between(rows, *phase(tables, case, str(stated["during"])))
    at = instant(tables, case, str(stated.get("at") or "injection"))
    if not np.isfinite(at):
        return rows.iloc[:0]
    nearest = int(np.argmin(np.abs(rows.t_s.to_numpy() - at)))
    return rows.iloc[nearest : nearest + 1]


def _each(tables: Tables, case: str, stated: Mapping[str, Any], rows: pd.DataFrame) -> Floats:
    """Return the number of every run by itself, SI and sorted; empty where it is not stored."""
    if stated.get("statistic", "rms") != "rms":
        return np.empty(0)
    if stated.get("during"):
        return _per_run(tables, case, stated, rms_column(*split_metric(str(stated["metric"])), rows.unit.iloc[0]))
    errors = errors_at(tables, case, str(stated.get("at") or "injection"), str(stated["metric"]))
    return np.empty(0) if errors is None else np.sort(errors.size)


def _per_run(tables: Tables, case: str, stated: Mapping[str, Any], column: str) -> Floats:
    """Return each run's largest, or root mean square, error of a phase between events, SI and sorted; none where the
    results lack it. A failed run's is infinite.
    """
    first, last = phase(tables, case, str(stated["during"]))
    within = rows_between(pick(tables.worst, case=case), first, last, end="t_end_s")
    lacks = within.empty or column not in within.columns or within[column].isna().all()
    if lacks or abs(within.t_s.min() - first) > SAME_TIME or abs(within.t_end_s.max() - last) > SAME_TIME:
        return np.empty(0)
    size = within[column].astype(float).mask(within.failure != "", np.inf)
    if "_rms_" not in column:
        return np.sort(size.groupby(within.run_number).max().to_numpy())
    length = within.t_end_s - within.t_s
    total, duration = (part.groupby(within.run_number).sum() for part in (size**2 * length, length))
    return np.sort(np.sqrt((total / duration).to_numpy()))


def _of_nozzle(tables: Tables, case: str, axis: str) -> Ours:
    """Return by how many percent less a nozzle moves with the filtered than with the raw rate, over the flight."""
    for row in pick(nozzle(tables), case=tables.labels[case], axis=axis, burn="flight").itertuples():
        interval = f"{row.low_percent:.1f} to {row.high_percent:.1f} %"
        return Ours(float(row.less_percent), f"{row.runs} paired runs, 95 %: {interval}")
    return Ours(np.nan, "no vehicle under control, or fewer than two runs")


def _of_rank(tables: Tables, case: str) -> Ours:
    for row in pick(observed(tables), case=tables.labels[case]).itertuples():
        above = f"{row.stretches} stretches, singular values above {NUMERICAL:g} of the largest"
        return Ours(float(row.least_rank), above)
    return _MISSING


def _of_mission(tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> Ours:
    """Return the root mean square over runs of a number of the orbit or the point of impact."""
    metric = str(stated["metric"])
    scale = _scale(unit, MISSION[metric].unit)
    found = errors_at(tables, case, str(stated.get("at") or "injection"), metric)
    if scale is None:
        return Ours(np.nan, f"unit {unit} does not fit")
    if found is None or not len(found.size):
        return _MISSING
    return Ours(float(np.sqrt(np.mean(found.size**2))) / scale, "", np.sort(found.size) / scale)


def _of_signals(tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> Ours:
    """Return how many satellites are tracked, or what corrections leave of their delays: the same in every run."""
    rows = pick(tables.satellites, case=case)
    if rows.empty:
        return _MISSING
    metric, statistic = str(stated["metric"]), str(stated.get("statistic", "rms"))
    if metric == "satellites_tracked":
        counts = rows.groupby("t_s").tracked.sum().rename("value").reset_index()
    else:
        counts = rows[rows.tracked].assign(value=rows[f"{metric}_m"].abs())
    value = _within(tables, case, counts, stated).value.dropna().to_numpy(dtype=float) if len(counts) else np.empty(0)
    if not len(value):
        return _NOT_FLOWN
    scale = 1.0 if metric == "satellites_tracked" else _scale(unit, "m")
    if scale is None:
        return Ours(np.nan, f"unit {unit} does not fit")
    found = {"worst": value.max(), "least": value.min()}.get(statistic, np.sqrt(np.mean(value**2)))
    return Ours(float(found) / scale)


def references(tables: Tables, stated: Mapping[str, Any] | None = None) -> pd.DataFrame:
    """Return what the campaign holds for published beside ours; `stated` in place of what was asked with these results.

    Numbers: ours in the unit of the publication, RMS error of the runs (LinCov without runs) or the statistic that is
    stated; in_band says whether ours / published lies in the band. Orders of cases: published is empty, ours the
    largest ratio of a case to the next, which must lie in the band. Innovations: ours the largest autocorrelation. What
    these results cannot give keeps its row, with a remark.
    """
    campaign = tables.campaign if stated is None else stated
    rows = [
        make(tables, case, one)
        for key, make in (("references", _number), ("orderings", _ordering), ("innovations", _innovations))
        for one in campaign.get(key) or ()
        for case in (cases_of(tables, one.get("case") or {}) if make is not _ordering else ()) or (None,)
    ]
    return pd.DataFrame(rows, columns=COLUMNS)


def _row(
    stated: Mapping[str, Any], remarks: Sequence[str], band: tuple[float, float], tested: float, **cells: Any
) -> dict[str, Any]:
    return {
        "source": stated["source"],
        "item": stated.get("item") or "",
        "unit": "-",
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
    others = cases_of(tables, against)
    if len(others) != 1:
        return Ours(np.nan, f"{len(others)} cases to hold it against")
    return _part(*(_in_si(tables, one, published) for one in (case, others[0])))


def _part(smaller: Ours, larger: Ours) -> Ours:
    return Ours(100.0 * (1.0 - smaller.value / larger.value), smaller.remark or larger.remark)


def _in_si(tables: Tables, case: str, stated: Mapping[str, Any]) -> Ours:
    """Return our number in the unit for people, which all cases of a campaign share."""
    quantity, axis = split_metric(str(stated["metric"]))
    unit, _ = tables.people.get((quantity, axis), ("m", 1.0))
    return ours(tables, case, stated, unit)


def _single(published: Mapping[str, Any], found: Ours) -> str:
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
    stated = {
        (str(one["during"]), str(one["metric"]), case): float(one["value"])
        for one in tables.campaign.get("references") or ()
        if str(one.get("than") or "").startswith(_RAW)
        for case in cases_of(tables, one.get("case") or {})
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
