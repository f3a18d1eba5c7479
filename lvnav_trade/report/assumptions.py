"""Sections on the inputs: numbers that cards mark as assumed, and key numbers of every case."""

from collections.abc import Collection, Iterable, Sequence

import pandas as pd

from lvnav_trade.report.blocks import Block, Table, Text, formatted_table, join_names, table_section, words
from lvnav_trade.report.escape import note
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.assumed_numbers import varied_assumptions
from lvnav_trade.results.tables.read import Tables

_FEW = 4
_RESOURCES = r"(?:^|\.)resources\."
_ORDER = "Errors and ranking of the cases are only as reliable as these numbers."
_COST_ALONE = "Only the section Cost and performance uses them. Errors and margins do not depend on them."
_SPREADS = "vehicle.dispersions"
_SOURCE = {"wind_length": "wind"}  # fields of the dispersions that belong to the source of another field
_ALONG = "Navigation errors are those on the nominal trajectory. See Assumptions."
_NAMES = {"imu": "IMU", "receiver": "Receiver"}


@table_section("assumptions")
def assumptions(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return every assumed or second-hand number once, with the cases that it affects.

    Marks of one card with the same reason are combined.
    """
    columns = [name for name in frame if name != "case"]
    cases_by_number = frame.groupby(columns, sort=False).case
    rows = cases_by_number.agg(tuple).reset_index()
    rows["cases"] = [cases_in_words(tables, cases) for cases in rows.case]
    rows["number"] = rows.field + rows.value_text.map(_in_brackets)
    rows["place"] = rows.place.str.replace(r"\.\d+$", "", regex=True)  # items of a list share a row
    groups = rows.groupby(["place", "mark", "reason", "cases"], sort=False)
    combined_rows = groups[["card", "number"]].agg(_join_distinct).reset_index()
    sections = list(dict.fromkeys(_sections(frame.place)))
    combined_rows = combined_rows.sort_values(
        "place",
        key=lambda places: _sections(places).map(sections.index),
        kind="stable",
    )
    return [Text(note("assumptions")), formatted_table("assumptions", combined_rows)]


def _sections(places: pd.Series) -> pd.Series:
    """Return the section of the scenario, the first word of the place, of each number."""
    return places.str.partition(".")[0]


def _in_brackets(value: str) -> str:
    """Return a value with a space and brackets, to follow its name; empty without a value."""
    if value:
        return f" ({value})"
    return ""


def _join_distinct(names: Iterable[str]) -> str:
    return ", ".join(dict.fromkeys(names))


def ranking_warning(tables: Tables) -> list[Block]:
    """Return a warning if products are compared by numbers that are assumed or second hand; empty otherwise.

    It says whether these numbers decide the errors of the cases, or their cost and performance alone.
    """
    frame = varied_assumptions(tables)
    if len(tables.labels) < 2 or frame.empty:
        return []
    is_resource = frame.field.str.contains(_RESOURCES)
    sentences = []
    groups = ((frame[~is_resource], _ORDER), (frame[is_resource], _COST_ALONE))
    for rows, consequence in groups:
        if len(rows):
            sentences.append(f"{_marked_fields(rows)}. {consequence}")
    subject = "cost and performance" if is_resource.all() else "the cases"
    lead = f"The comparison of {subject} uses numbers that are not from the manufacturer's datasheet."
    return [Text(f"{' '.join(sentences)} See Assumptions.", lead)]


def orbit_warning(tables: Tables) -> list[Block]:
    """Return a warning if guided ascents draw vehicle dispersions that are assumed or second hand."""
    frame = METRICS["assumptions"](tables)
    guided_cases = set(METRICS["injection"](tables).case)
    is_spread = frame.place.str.endswith(_SPREADS)
    rows = frame[is_spread & frame.case.isin(guided_cases)]
    covariances = tables.injection_covariances
    is_of_vehicle = covariances.source_group == "vehicle"
    sources = set(covariances.source[is_of_vehicle])
    if sources and sources != {"vehicle"}:  # without an error budget they are one source
        field_sources = [_SOURCE.get(field, field.replace("_", " ")) for field in rows.field]
        rows = rows[[source in sources for source in field_sources]]
    if rows.empty:
        return []
    fields = _fields(list(rows.field))
    text = f"{fields}. Errors of the achieved orbit are only as reliable as these numbers. {_ALONG}"
    marks = " and ".join(mark.replace("_", " ") for mark in dict.fromkeys(rows.mark))
    lead = f"The achieved orbit depends on {marks} dispersions of the vehicle."
    return [Text(text[0].upper() + text[1:], lead)]


def _marked_fields(frame: pd.DataFrame) -> str:
    """Return the marked fields of each device, with the number of cases that use them."""
    devices = []
    for device, device_rows in frame.groupby("device", sort=False):
        fields = []
        for mark, rows in device_rows.groupby("mark", sort=False):
            count = f"in {rows.marked.max()} of {rows.cases.iloc[0]} cases"
            field_names = _fields(list(rows.field))
            fields.append(f"{field_names} ({mark} {count})")
        name = _NAMES.get(str(device), f"Sensor {str(device).partition('.')[2]}")
        devices.append(f"{name}: {'; '.join(fields)}")
    return ". ".join(devices)


def _fields(fields: Sequence[str]) -> str:
    """Return fields in words; of many only the first, with the number of the others."""
    names = [words(field.removeprefix("resources.").replace(".", " ")) for field in fields]
    return join_names(list(dict.fromkeys(names)), _FEW)


def cases_in_words(tables: Tables, cases: Collection[str]) -> str:
    """Return case labels in words: "all", the levels of one axis, or the first labels and the number of the others."""
    chosen_labels = set(cases)
    if chosen_labels == set(tables.labels.values()):
        return "all" if len(chosen_labels) > 1 else "the one case"
    levels = {tables.labels[case]: case_levels for case, case_levels in tables.levels.items()}
    labels = [label for label in levels if label in chosen_labels]
    axes = next(iter(levels.values()), {})
    for axis in axes:
        levels_of_chosen = [levels[label].get(axis, "") for label in labels]
        chosen_levels = list(dict.fromkeys(levels_of_chosen))
        with_levels = {label for label in levels if levels[label].get(axis) in chosen_levels}
        if len(chosen_levels) <= _FEW and with_levels == chosen_labels:
            level_names = " or ".join(chosen_levels)
            return f"{axis}={level_names}"
    return join_names(labels, _FEW, "; ")


@table_section("configuration")
def configuration(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return one table each for IMUs, receivers and filters; cases with equal numbers share a row."""
    device_types = frame.device.str.partition(" ")[0]
    return [
        _device_table(tables, device_type, frame[device_types == device_type])
        for device_type in dict.fromkeys(device_types)
    ]


def _device_table(tables: Tables, device_type: str, frame: pd.DataFrame) -> Table:
    """Return the table of the key numbers (terms) of all devices of one type.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    device_type : str
        Type of the devices, which becomes the first heading.
    frame : pandas.DataFrame
        Rows of these devices: case, device, name, term, value_text.
    """
    terms = list(dict.fromkeys(frame.term))
    lines: dict[tuple[str, ...], list[str]] = {}
    for (case, _), rows in frame.groupby(["case", "device"], sort=False):
        values = dict(zip(rows.term, rows.value_text, strict=True))
        name = str(rows["name"].iloc[0])
        line = (name, *(values.get(term, "–") for term in terms))
        lines.setdefault(line, []).append(str(case))
    table_rows = []
    for line, cases in lines.items():
        case_text = cases_in_words(tables, dict.fromkeys(cases))
        table_rows.append((*line, case_text))
    title = device_type[0].upper() + device_type[1:]
    return Table(
        head=(device_type, *terms, "cases"),
        rows=tuple(table_rows),
        numeric=(False,) * (len(terms) + 2),
        caption=f"{title}: key numbers of the cards; errors are 1 sigma.",
    )
