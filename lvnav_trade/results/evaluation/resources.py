"""Cost of designs: totals of their devices, Pareto front over totals and errors, ranking."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.quantities.marks import unmarked
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import parse
from lvnav_trade.results.requirements import confirmation, requirements
from lvnav_trade.results.requirements.margins import margins, worst
from lvnav_trade.results.statistics.select import once
from lvnav_trade.results.tables.read import Tables

# Totals by name: display unit, SI unit of the card's quantity (empty for a plain number), factor from SI to display
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


def resource_totals(tables: Tables) -> pd.DataFrame:
    """Return the total cost, mass, power and volume of the devices (IMUs, receiver, sensors) of each case.

    mtbf_h: mean time between failures of all devices in series; failure rates add. devices: number of devices with
    given resources; unknown: number of these without cost. A total is NaN if no device gives it. Cases without any
    resources have no row.
    """
    rows = []
    for case, label in tables.labels.items():
        if total := total_of(scenario_of(tables, case)):
            rows.append({"case": label, **total})
    return pd.DataFrame(rows, columns=["case", *TOTALLED])


def scenario_of(tables: Tables, case: str) -> dict[str, Any]:
    """Return the resolved scenario of a case as plain data, in the form of a campaign file."""
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
        return [_put(item, path[1:], value) if k == at else item for k, item in enumerate(data)]
    data = unmarked(data or {}, path)
    return {**data, path[0]: _put(data.get(path[0]), path[1:], value)}


def _resources(scenario: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """Yield the resources of the devices of the vehicle, not of the models that a filter assumes."""
    imu = scenario.get("imu") or {}
    devices = [*(imu.get("units") or [imu]), scenario.get("receiver") or {}, *(scenario.get("sensors") or {}).values()]
    for device in devices:
        if device and device.get("resources"):
            yield device["resources"]


def total_of(scenario: Mapping[str, Any]) -> dict[str, float]:
    """Return the totals (`TOTALLED`) of the devices of a resolved scenario; empty if no device gives resources."""
    devices = list(_resources(scenario))

    def total(name: str) -> float:
        _, si, factor = TOTALS[name]
        known = [device[name] for device in devices if device.get(name) is not None]
        numbers = [parse(value, si) if si and isinstance(value, str) else float(value) for value in known]
        return factor * sum(numbers) if numbers else math.nan

    if not devices:
        return {}
    rates = [1.0 / parse(str(device["mtbf"]), "s") for device in devices if device.get("mtbf") is not None]
    return {
        "cost": total("cost"),
        "mass_kg": total("mass"),
        "power_w": total("power"),
        "volume_l": total("volume"),
        "mtbf_h": 1.0 / sum(rates) / _HOUR if rates else math.nan,
        "devices": len(devices),
        "unknown": sum(device.get("cost") is None for device in devices),
    }


@once
def pareto(tables: Tables) -> pd.DataFrame:
    """Return every case with its totals, its largest error over the limit, and whether it is on the Pareto front.

    error_ratio: largest ratio of an error to its limit, by linear covariance if it is applicable and confirmed, else by
    the runs. verdict: worst verdict on the requirements, by the runs if there are any. meets: whether all verdicts are
    "met". front: whether no other case is at least as good in all criteria and better in one; dominated_by: the first
    such case. Criteria are the error ratio and the totals known for every case, without the time between failures. The
    table is empty without totals or requirements.
    """
    found = resource_totals(tables)
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
        front=[k < 0 for k in by],
        dominated_by=[str(frame.case.iloc[k]) if k >= 0 else "" for k in by],
    )


def _ratios(tables: Tables) -> pd.DataFrame:
    """Return for each case the largest ratio of an error to its limit, the limiting requirement, the worst verdict."""
    verdict = margins(tables).groupby("case").verdict.agg(worst)
    expected = confirmation.expected_verdicts(tables).set_index(["requirement", "case"])
    runs = requirements.verdicts(tables).set_index(["requirement", "case"])
    rows = []
    for label in tables.labels.values():
        by_name = {}
        for name in dict.fromkeys(runs.index.get_level_values(0)):
            chosen = expected.loc[name, label]
            chosen = chosen if chosen.verdict in ("met", "violated") else runs.loc[name, label]
            by_name[str(name)] = float(chosen.estimate) / float(chosen.limit)
        finite = {name: ratio for name, ratio in by_name.items() if ratio == ratio}
        limiting = max(finite, key=lambda name: finite[name]) if len(finite) == len(by_name) else ""
        rows.append((label, finite.get(limiting, math.inf), limiting, verdict[label]))
    return pd.DataFrame(rows, columns=["case", "error_ratio", "limiting_requirement", "verdict"])


def dominating(values: Floats, k: int) -> int:
    """Return the first row that is no worse than row k in any column and better in one; -1 if there is none."""
    better = np.all(values <= values[k], axis=1) & np.any(values < values[k], axis=1)
    return int(np.argmax(better)) if better.any() else -1


def ranked(frame: pd.DataFrame, prefer: Sequence[str]) -> pd.DataFrame:
    """Return the rows of `pareto` in order of preference.

    Cases that meet all requirements come first, then undecided cases with errors below all limits, then the others;
    within these groups the order is by the columns named in `prefer`, smallest first.
    """
    columns = [PREFERRED[name] for name in prefer]
    promising = (frame.verdict == "undecided") & (frame.error_ratio <= 1.0)
    rank = np.where(frame.meets, 0, np.where(promising, 1, 2))
    ordered = frame.assign(rank_first=rank).sort_values(["rank_first", *columns], kind="stable")
    return ordered.drop(columns="rank_first").reset_index(drop=True)
