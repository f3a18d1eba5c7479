"""Cost of designs: totals of their devices, Pareto front over totals and errors, ranking."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.marks import unmarked
from lvnav_trade.metrics.basics.select import once
from lvnav_trade.metrics.requirements import confirmation, requirements
from lvnav_trade.metrics.requirements.margins import margins, worst
from lvnav_trade.records import Floats
from lvnav_trade.store.read import Tables
from lvnav_trade.units import parse

# Totals: column, its unit for people, SI unit of the card's quantity (empty: a plain number), factor
TOTALS = {
    "cost": ("", "", 1.0),
    "mass": ("kg", "kg", 1.0),
    "power": ("W", "W", 1.0),
    "volume": ("l", "m**3", 1e3),
}
PREFERRED = {
    "cost": "cost",
    "mass": "mass_kg",
    "power": "power_w",
    "volume": "volume_l",
    "error": "error_ratio",
}
TOTALLED = ["cost", "mass_kg", "power_w", "volume_l", "mtbf_h", "devices", "unknown"]
_HOUR = 3600.0


def totals(tables: Tables) -> pd.DataFrame:
    """Return for each case what its devices (inertial units, receiver, sensors) cost and need together.

    Columns: case, cost, mass_kg, power_w, volume_l, mtbf_h (of all devices in series: failure rates add), devices (so
    many state something), unknown (so many state no cost). NaN where no device states a number. No rows where none
    states anything.
    """
    rows = []
    for case, label in tables.labels.items():
        if found := total_of(scenario_of(tables, case)):
            rows.append({"case": label, **found})
    return pd.DataFrame(rows, columns=["case", *TOTALLED])


def scenario_of(tables: Tables, case: str) -> dict[str, Any]:
    """Return the resolved scenario of a case, as a campaign states it."""
    data: Any = tables.campaign.get("base") or {}
    names = list(tables.levels[case])
    for name, axis in zip(names, tables.campaign.get("axes") or (), strict=False):
        level = tables.levels[case][name]
        if axis.get("between") and level != "base":
            data = _put(data, str(axis["path"]).split("."), level)
        elif level in (axis.get("labels") or ()):
            data = _put(data, str(axis["path"]).split("."), axis["values"][axis["labels"].index(level)])
    return dict(data)


def _put(data: Any, path: Sequence[str], value: Any) -> Any:
    if not path:
        return value
    if isinstance(data, list):
        at = int(path[0])
        return [_put(one, path[1:], value) if k == at else one for k, one in enumerate(data)]
    data = unmarked(data or {}, path)
    return {**data, path[0]: _put(data.get(path[0]), path[1:], value)}


def _resources(scenario: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """Yield what the devices of a scenario state: those of the vehicle, not those that a filter assumes."""
    imu = scenario.get("imu") or {}
    devices = [*(imu.get("units") or [imu]), scenario.get("receiver") or {}, *(scenario.get("sensors") or {}).values()]
    for device in devices:
        if device and device.get("resources"):
            yield device["resources"]


def total_of(scenario: Mapping[str, Any]) -> dict[str, float]:
    """Return what the devices of a resolved scenario cost and need together (`TOTALLED`); nothing where none states
    anything.
    """
    found = list(_resources(scenario))

    def total(name: str) -> float:
        _, si, factor = TOTALS[name]
        known = [one[name] for one in found if one.get(name) is not None]
        numbers = [parse(value, si) if si and isinstance(value, str) else float(value) for value in known]
        return factor * sum(numbers) if numbers else math.nan

    if not found:
        return {}
    rates = [1.0 / parse(str(one["mtbf"]), "s") for one in found if one.get("mtbf") is not None]
    return {
        "cost": total("cost"),
        "mass_kg": total("mass"),
        "power_w": total("power"),
        "volume_l": total("volume"),
        "mtbf_h": 1.0 / sum(rates) / _HOUR if rates else math.nan,
        "devices": len(found),
        "unknown": sum(one.get("cost") is None for one in found),
    }


@once
def pareto(tables: Tables) -> pd.DataFrame:
    """Return every case with its totals and, of each requirement, its error over its limit; which are on the front.

    Smaller is better in all of them (totals that not every case states do not count, nor does the mean time between
    failures). error_ratio: the largest error over its limit, by linear covariance where it applies and is confirmed,
    else by the runs. verdict: the worst of the requirements' verdicts, by the runs where there are any. meets: all
    verdicts are "met". front: no other case is as good in
    everything and better in something; dominated_by: the first that is.
    No rows without totals or requirements.
    """
    found = totals(tables)
    stated = tables.campaign.get("requirements") or ()
    if found.empty or not stated:
        return pd.DataFrame(columns=["case"])
    ratios = _ratios(tables)
    frame = found.merge(ratios, on="case")
    used = [name for name in ("cost", "mass_kg", "power_w", "volume_l") if frame[name].notna().all()]
    values = frame[[*used, "error_ratio"]].to_numpy(dtype=float)
    by = [dominating(values, k) for k in range(len(values))]
    return frame.assign(
        meets=frame.verdict == "met",
        front=[one < 0 for one in by],
        dominated_by=[str(frame.case.iloc[one]) if one >= 0 else "" for one in by],
    )


def _ratios(tables: Tables) -> pd.DataFrame:
    """Return case, the largest ratio of error to limit over the requirements, the requirement that has it, and the
    worst verdict.
    """
    verdict = margins(tables).groupby("case").verdict.agg(worst)
    expected = confirmation.expected(tables).set_index(["requirement", "case"])
    runs = requirements.verdicts(tables).set_index(["requirement", "case"])
    rows = []
    for label in tables.labels.values():
        by_name = {}
        for name in dict.fromkeys(runs.index.get_level_values(0)):
            chosen = expected.loc[name, label]
            chosen = chosen if chosen.verdict in ("met", "violated") else runs.loc[name, label]
            by_name[str(name)] = float(chosen.estimate) / float(chosen.limit)
        finite = {name: ratio for name, ratio in by_name.items() if ratio == ratio}
        binding = max(finite, key=lambda name: finite[name]) if len(finite) == len(by_name) else ""
        rows.append((label, finite.get(binding, math.inf), binding, verdict[label]))
    return pd.DataFrame(rows, columns=["case", "error_ratio", "binding", "verdict"])


def dominating(values: Floats, k: int) -> int:
    """Return the first row that is no worse than row k in any column and better in one; -1 where none is."""
    better = np.all(values <= values[k], axis=1) & np.any(values < values[k], axis=1)
    return int(np.argmax(better)) if better.any() else -1


def ranked(frame: pd.DataFrame, prefer: Sequence[str]) -> pd.DataFrame:
    """Return the rows of `pareto`: those that meet everything, then those that are undecided and whose error is below
    every limit, then the others; among them by the columns preferred, smallest first.
    """
    columns = [PREFERRED[one] for one in prefer]
    open_ones = (frame.verdict == "undecided") & (frame.error_ratio <= 1.0)
    rank = np.where(frame.meets, 0, np.where(open_ones, 1, 2))
    found = frame.assign(rank_first=rank).sort_values(["rank_first", *columns], kind="stable")
    return found.drop(columns="rank_first").reset_index(drop=True)
