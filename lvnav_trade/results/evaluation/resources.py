"""Cost of designs: totals of their devices, Pareto front over totals and errors, ranking."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.quantities.marks import without_field_marks
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import parse
from lvnav_trade.results.requirements import confirmation, requirements
from lvnav_trade.results.requirements.margins import margins, severest_verdict
from lvnav_trade.results.statistics.select import cache_result
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
        total = device_totals(scenario_of(tables, case))
        if total:
            rows.append({"case": label, **total})
    return pd.DataFrame(rows, columns=["case", *TOTALLED])


def scenario_of(tables: Tables, case: str) -> dict[str, Any]:
    """Return the resolved scenario of a case as plain data, in the form of a campaign file."""
    data: Any = tables.campaign.get("base") or {}
    levels = tables.levels[case]
    for level, axis in zip(levels.values(), tables.campaign.get("axes") or (), strict=False):
        path = str(axis["path"]).split(".")
        if axis.get("between") and level != "base":
            data = _replace_field(data, path, level)
        elif level in (axis.get("labels") or ()):
            index = axis["labels"].index(level)
            data = _replace_field(data, path, axis["values"][index])
    return dict(data)


def _replace_field(data: Any, path: Sequence[str], value: Any) -> Any:
    """Return plain data with another value at a path; marks on the field no longer apply."""
    if not path:
        return value
    if isinstance(data, list):
        index = int(path[0])
        items = []
        for k, item in enumerate(data):
            items.append(_replace_field(item, path[1:], value) if k == index else item)
        return items
    data = without_field_marks(data or {}, path)
    name = path[0]
    field = _replace_field(data.get(name), path[1:], value)
    return {**data, name: field}


def _resources(scenario: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """Yield the resources of the devices of the vehicle, not of the models that a filter assumes."""
    imu = scenario.get("imu") or {}
    imus = imu.get("units") or [imu]
    sensors = (scenario.get("sensors") or {}).values()
    for device in [*imus, scenario.get("receiver"), *sensors]:
        if device and device.get("resources"):
            yield device["resources"]


def device_totals(scenario: Mapping[str, Any]) -> dict[str, float]:
    """Return the totals (`TOTALLED`) of the devices of a resolved scenario; empty if no device gives resources."""
    devices = list(_resources(scenario))

    def total(name: str) -> float:
        _, si, factor = TOTALS[name]
        numbers = []
        for device in devices:
            value = device.get(name)
            if value is not None:
                numbers.append(parse(value, si) if si and isinstance(value, str) else float(value))
        return factor * sum(numbers) if numbers else math.nan

    if not devices:
        return {}
    times = [device["mtbf"] for device in devices if device.get("mtbf") is not None]
    rates = [1.0 / parse(str(time), "s") for time in times]
    return {
        "cost": total("cost"),
        "mass_kg": total("mass"),
        "power_w": total("power"),
        "volume_l": total("volume"),
        "mtbf_h": 1.0 / sum(rates) / _HOUR if rates else math.nan,
        "devices": len(devices),
        "unknown": sum(device.get("cost") is None for device in devices),
    }


@cache_result
def pareto(tables: Tables) -> pd.DataFrame:
    """Return every case with its totals, its largest error over the limit, and whether it is on the Pareto front.

    error_ratio: largest ratio of an error to its limit, by linear covariance if it is applicable and confirmed, else by
    the runs. verdict: worst verdict on the requirements, by the runs if there are any. meets: whether all verdicts are
    "met". front: whether no other case is at least as good in all criteria and better in one; dominated_by: the first
    such case. Criteria are the error ratio and the totals known for every case, without the time between failures. The
    table is empty without totals or requirements.
    """
    totals = resource_totals(tables)
    if totals.empty or not tables.campaign.get("requirements"):
        return pd.DataFrame(columns=["case"])
    frame = totals.merge(_largest_error_ratios(tables), on="case")
    complete_totals = [name for name in ("cost", "mass_kg", "power_w", "volume_l") if frame[name].notna().all()]
    criteria = frame[[*complete_totals, "error_ratio"]].to_numpy(dtype=float)
    dominating_rows = [dominating(criteria, k) for k in range(len(criteria))]
    return frame.assign(
        meets=frame.verdict == "met",
        front=[row < 0 for row in dominating_rows],
        dominated_by=[str(frame.case.iloc[row]) if row >= 0 else "" for row in dominating_rows],
    )


def _largest_error_ratios(tables: Tables) -> pd.DataFrame:
    """Return for each case the largest ratio of an error to its limit, the limiting requirement, the worst verdict."""
    worst_verdicts = margins(tables).groupby("case").verdict.agg(severest_verdict)
    lincov_rows = confirmation.expected_verdicts(tables).set_index(["requirement", "case"])
    run_rows = requirements.verdicts(tables).set_index(["requirement", "case"])
    names = list(dict.fromkeys(run_rows.index.get_level_values(0)))
    rows = []
    for label in tables.labels.values():
        ratios = {}
        for name in names:
            result = lincov_rows.loc[name, label]
            if result.verdict not in ("met", "violated"):
                result = run_rows.loc[name, label]
            ratios[str(name)] = float(result.estimate) / float(result.limit)
        limiting_requirement, largest = "", math.inf  # of a case with an unknown error
        if not any(math.isnan(ratio) for ratio in ratios.values()):
            limiting_requirement = max(ratios, key=ratios.__getitem__)
            largest = ratios[limiting_requirement]
        row = {
            "case": label,
            "error_ratio": largest,
            "limiting_requirement": limiting_requirement,
            "verdict": worst_verdicts[label],
        }
        rows.append(row)
    return pd.DataFrame(rows, columns=["case", "error_ratio", "limiting_requirement", "verdict"])


def dominating(values: Floats, k: int) -> int:
    """Return the first row that is no worse than row k in any column and better in at least one; -1 if there is none.

    Parameters
    ----------
    values : (n, m) array
        Criteria of each row; smaller is better.
    k : int
        Index of the row.
    """
    is_as_good = np.all(values <= values[k], axis=1)
    is_better_in_one = np.any(values < values[k], axis=1)
    better = is_as_good & is_better_in_one
    if better.any():
        return int(np.argmax(better))
    return -1


def sort_by_preference(frame: pd.DataFrame, prefer: Sequence[str]) -> pd.DataFrame:
    """Return the rows of `pareto` in order of preference.

    Cases that meet all requirements come first, then undecided cases with errors below all limits, then the others;
    within these groups the order is by the preferred columns, smallest first.

    Parameters
    ----------
    frame : pandas.DataFrame
        Rows of `pareto`.
    prefer : sequence of str
        Names of `PREFERRED`, the most important first.
    """
    columns = [PREFERRED[name] for name in prefer]
    is_promising = (frame.verdict == "undecided") & (frame.error_ratio <= 1.0)
    rank = np.where(frame.meets, 0, np.where(is_promising, 1, 2))
    sorted_frame = frame.assign(rank_first=rank).sort_values(["rank_first", *columns], kind="stable")
    return sorted_frame.drop(columns="rank_first").reset_index(drop=True)
