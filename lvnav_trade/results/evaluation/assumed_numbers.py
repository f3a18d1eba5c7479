"""Numbers that cards mark as assumed or second hand, and key numbers of IMU, receiver and filter, by case."""

from collections.abc import Iterator, Mapping
from typing import Any

import pandas as pd

from lvnav_trade.quantities.marks import marks_in
from lvnav_trade.results.evaluation.resources import scenario_of
from lvnav_trade.results.statistics.display_units import display_text, split_quantity
from lvnav_trade.results.statistics.select import cache_result
from lvnav_trade.results.tables.read import Tables

ASSUMPTIONS = ["case", "place", "card", "field", "mark", "value_text", "reason"]
DEVICES = ("imu", "receiver", "sensors")
"""Sections of a scenario that describe products."""
_RESOURCES = ("cost", "mass", "power", "volume", "mtbf")


@cache_result
def assumptions(tables: Tables) -> pd.DataFrame:
    """Return every marked number of every case.

    Columns: case, place (dotted path of the card below the base), card (its name), field (dotted path within it), mark
    (assumed, second hand), value_text (in the unit of data sheets), reason. Without marks the table is empty.
    """
    rows = []
    for case, label in tables.labels.items():
        for marked_number in marks_in(scenario_of(tables, case)):
            row = {
                "case": label,
                "place": marked_number.card,
                "card": marked_number.name,
                "field": marked_number.field,
                "mark": marked_number.mark,
                "value_text": display_text(marked_number.value),
                "reason": marked_number.reason,
            }
            rows.append(row)
    return pd.DataFrame(rows, columns=ASSUMPTIONS)


@cache_result
def varied_assumptions(tables: Tables) -> pd.DataFrame:
    """Return the marked numbers of devices in which the cases differ, and on which a ranking of the cases depends.

    Columns: device (such as imu), field (within the device), mark, marked (number of cases with the mark), cases
    (number of all cases).
    """
    cases_by_field: dict[tuple[str, str, str], set[str]] = {}
    scenarios = {label: scenario_of(tables, case) for case, label in tables.labels.items()}
    for label, scenario in scenarios.items():
        devices = {name: scenario[name] for name in DEVICES if scenario.get(name)}
        for marked_number in marks_in(devices):
            depth = 2 if marked_number.card.startswith("sensors.") else 1
            device = ".".join(marked_number.card.split(".")[:depth])
            path = f"{marked_number.card}.{marked_number.field}".removeprefix(f"{device}.")
            for field in _marked_fields(path, marked_number.value):
                cases_by_field.setdefault((device, field, marked_number.mark), set()).add(label)
    rows = []
    for (device, field, mark), labels in cases_by_field.items():
        values = {str(_value_at(scenario, f"{device}.{field}")) for scenario in scenarios.values()}
        if len(values) > 1:
            row = {
                "device": device,
                "field": field,
                "mark": mark,
                "marked": len(labels),
                "cases": len(scenarios),
            }
            rows.append(row)
    return pd.DataFrame(rows, columns=["device", "field", "mark", "marked", "cases"])


def _marked_fields(field: str, value: Any) -> list[str]:
    """Return the fields to which a mark applies: a mark on resources applies to each of them, others to one field."""
    if field.rpartition(".")[2] != "resources" or not isinstance(value, Mapping):
        return [field]
    return [f"{field}.{name}" for name in _RESOURCES if value.get(name) is not None]


def _value_at(data: Any, path: str) -> Any:
    """Return the value at a dotted path of plain data; None if there is none."""
    for step in path.split("."):
        if isinstance(data, list):
            if step.isdigit() and int(step) < len(data):
                data = data[int(step)]
            else:
                data = None
        else:
            data = data.get(step) if isinstance(data, Mapping) else None
    return data


CONFIGURATION = ["case", "device", "name", "term", "value_text", "value_si", "unit_si"]
_TERMS = {
    "IMU": {
        "rate": "rate",
        "gyro bias, turn-on": "gyro.bias_repeatability",
        "gyro bias, in-run": "gyro.bias_instability",
        "ARW": "gyro.random_walk",
        "gyro scale factor": "gyro.scale_factor",
        "accel. bias, turn-on": "accel.bias_repeatability",
        "accel. bias, in-run": "accel.bias_instability",
        "VRW": "accel.random_walk",
        "accel. scale factor": "accel.scale_factor",
    },
    "receiver": {
        "rate": "rate",
        "latency": "latency",
        "pseudorange": "pseudorange_sigma",
        "range rate": "range_rate_sigma",
        "position": "solution.position_sigma",
        "velocity": "solution.velocity_sigma",
    },
    "filter": {
        "measurements": "measurements",
        "update rate": "update_rate",
        "covariance rate": "covariance_rate",
        "correction": "feedback",
    },
}
"""Terms of each device with their dotted path in its card."""


@cache_result
def configuration(tables: Tables) -> pd.DataFrame:
    """Return the key numbers of every case.

    Columns: case, device (IMU, receiver, filter; several IMUs are numbered), name of its card, term, value_text in the
    unit of data sheets, value_si and unit_si for a single quantity. The terms of the filter include its coupling and
    the number of estimated states. Without a base scenario the table is empty.
    """
    states = tables.cases.set_index("case").nees_dof_count
    rows = []
    for case, label in tables.labels.items():
        scenario = scenario_of(tables, case)
        for device, device_type, card in _devices(scenario):
            n_state = int(states[case])
            for row in _configuration_rows(device, device_type, card, n_state):
                rows.append((label, *row))
    return pd.DataFrame(rows, columns=CONFIGURATION)


def _devices(scenario: Mapping[str, Any]) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """Yield name, type and card of the devices of a scenario."""
    imu = scenario.get("imu") or {}
    imus = imu.get("units") or ([imu] if imu else [])
    for number, card in enumerate(imus, 1):
        yield f"IMU {number}" if len(imus) > 1 else "IMU", "IMU", card
    for name in ("receiver", "filter"):
        if scenario.get(name):
            yield name, name, scenario[name]


def _configuration_rows(
    device: str, device_type: str, card: Mapping[str, Any], states: int
) -> Iterator[tuple[Any, ...]]:
    """Yield the values of `CONFIGURATION` from the device on."""
    name = str(card.get("name") or "")
    if device_type == "filter":
        yield device, name, "estimated states", str(states), float(states), ""
        yield device, name, "coupling", _coupling(card.get("measurements") or ()), None, ""
    for term, path in _TERMS[device_type].items():
        value: Any = card
        for step in path.split("."):
            value = value.get(step) if isinstance(value, Mapping) else None
        number, unit = split_quantity(value) or (None, "")
        text = "none" if number == 0.0 else display_text(value) or "–"
        yield device, name, term, text, number, unit


def _coupling(measurements: Any) -> str:
    """Return the coupling with the receiver: loose (solution), tight (ranges), or inertial (none)."""
    names = set(measurements)
    if names & {"position", "velocity"}:
        return "loose"
    tight = {"pseudorange", "range_rate", "carrier_phase", "tdcp", "delta_pseudorange"}
    return "tight" if names & tight else "inertial"
