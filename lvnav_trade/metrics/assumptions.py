"""Numbers that the cards of a campaign mark as assumed or second hand, by case."""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from lvnav_trade.marks import marks_in
from lvnav_trade.metrics.basics.people import in_people
from lvnav_trade.metrics.basics.select import once
from lvnav_trade.metrics.resources import scenario_of
from lvnav_trade.store.read import Tables

ASSUMPTIONS = ["case", "place", "card", "field", "mark", "value_text", "reason"]
DEVICES = ("imu", "receiver", "sensors")
"""Sections of a scenario that are products."""
_OF_RESOURCES = ("cost", "mass", "power", "volume", "mtbf")


@once
def assumptions(tables: Tables) -> pd.DataFrame:
    """Return every marked number of every case.

    Columns: case, place (dotted path of the card below the base), card (its name), field (dotted path within it), mark
    (assumed, second hand), value_text (in the unit of data sheets; in words where the field has several), reason. No
    rows where no card marks any.
    """
    rows = [
        (label, one.card, one.name, one.field, one.mark, in_people(one.value), one.reason)
        for case, label in tables.labels.items()
        for one in marks_in(scenario_of(tables, case))
    ]
    return pd.DataFrame(rows, columns=ASSUMPTIONS)


@once
def compared_by(tables: Tables) -> pd.DataFrame:
    """Return the marked numbers of devices in which the cases differ: those that an order of the cases rests on.

    Columns: device (such as imu), field (within the device), mark, marked (so many cases have the mark), cases (so many
    there are).
    """
    found: dict[tuple[str, str, str], set[str]] = {}
    scenarios = {label: scenario_of(tables, case) for case, label in tables.labels.items()}
    for label, scenario in scenarios.items():
        for one in marks_in({name: scenario[name] for name in DEVICES if scenario.get(name)}):
            device = ".".join(one.card.split(".")[: 2 if one.card.startswith("sensors.") else 1])
            whole = f"{one.card}.{one.field}".removeprefix(f"{device}.")
            for field in _single(whole, one.value):
                found.setdefault((device, field, one.mark), set()).add(label)
    rows = [
        (device, field, mark, len(labels), len(scenarios))
        for (device, field, mark), labels in found.items()
        if len({str(_at(scenario, f"{device}.{field}")) for scenario in scenarios.values()}) > 1
    ]
    return pd.DataFrame(rows, columns=["device", "field", "mark", "marked", "cases"])


def _single(field: str, value: Any) -> list[str]:
    """Return the fields that a mark on resources stands for; any other mark is one field."""
    if field.rpartition(".")[2] != "resources" or not isinstance(value, Mapping):
        return [field]
    return [f"{field}.{name}" for name in _OF_RESOURCES if value.get(name) is not None]


def _at(data: Any, path: str) -> Any:
    for step in path.split("."):
        if isinstance(data, list):
            data = data[int(step)] if step.isdigit() and int(step) < len(data) else None
        else:
            data = data.get(step) if isinstance(data, Mapping) else None
    return data
