"""Numbers that the cards of a campaign mark as assumed or second hand, by case."""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from lvnav_trade.quantities.marks import marks_in
from lvnav_trade.results.evaluation.resources import scenario_of
from lvnav_trade.results.statistics.display_units import in_people
from lvnav_trade.results.statistics.select import once
from lvnav_trade.results.tables.read import Tables

ASSUMPTIONS = ["case", "place", "card", "field", "mark", "value_text", "reason"]
DEVICES = ("imu", "receiver", "sensors")
"""Sections of a scenario that describe products."""
_OF_RESOURCES = ("cost", "mass", "power", "volume", "mtbf")


@once
def assumptions(tables: Tables) -> pd.DataFrame:
    """Return every marked number of every case.

    Columns: case, place (dotted path of the card below the base), card (its name), field (dotted path within it), mark
    (assumed, second hand), value_text (in the unit of data sheets), reason. Without marks the table is empty.
    """
    rows = [
        (label, marked.card, marked.name, marked.field, marked.mark, in_people(marked.value), marked.reason)
        for case, label in tables.labels.items()
        for marked in marks_in(scenario_of(tables, case))
    ]
    return pd.DataFrame(rows, columns=ASSUMPTIONS)


@once
def compared_by(tables: Tables) -> pd.DataFrame:
    """Return the marked numbers of devices in which the cases differ, and on which a ranking of the cases depends.

    Columns: device (such as imu), field (within the device), mark, marked (number of cases with the mark), cases
    (number of all cases).
    """
    by_field: dict[tuple[str, str, str], set[str]] = {}
    scenarios = {label: scenario_of(tables, case) for case, label in tables.labels.items()}
    for label, scenario in scenarios.items():
        for marked in marks_in({name: scenario[name] for name in DEVICES if scenario.get(name)}):
            device = ".".join(marked.card.split(".")[: 2 if marked.card.startswith("sensors.") else 1])
            path = f"{marked.card}.{marked.field}".removeprefix(f"{device}.")
            for field in _single(path, marked.value):
                by_field.setdefault((device, field, marked.mark), set()).add(label)
    rows = [
        (device, field, mark, len(labels), len(scenarios))
        for (device, field, mark), labels in by_field.items()
        if len({str(_at(scenario, f"{device}.{field}")) for scenario in scenarios.values()}) > 1
    ]
    return pd.DataFrame(rows, columns=["device", "field", "mark", "marked", "cases"])


def _single(field: str, value: Any) -> list[str]:
    """Return the fields to which a mark applies: a mark on resources applies to each of them, others to one field."""
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
