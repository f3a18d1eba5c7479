"""Sections on the inputs: numbers that cards mark as assumed, and key numbers of every case."""

from collections.abc import Callable, Collection, Sequence

import pandas as pd

from lvnav_trade.report.blocks import Block, Table, Text, among, of, stated, words
from lvnav_trade.report.escape import note
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.assumed_numbers import compared_by
from lvnav_trade.results.tables.read import Tables

_FEW = 4
_RESOURCES = r"(?:^|\.)resources\."
_ORDER = "Errors and ranking of the cases are only as reliable as these numbers."
_COST_ALONE = "Only the section Cost and performance uses them. Errors and margins do not depend on them."
_SPREADS = "vehicle.dispersions"
_SOURCE = {"wind_length": "wind"}  # fields of the dispersions that belong to the source of another field
_ALONG = "Navigation errors are those on the nominal trajectory. See Assumptions."
_NAMES = {"imu": "IMU", "receiver": "Receiver"}


@of("assumptions")
def assumptions(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return every assumed or second-hand number once, with the cases that it affects.

    Marks of one card with the same reason are combined.
    """
    once_each = [name for name in frame if name != "case"]
    several = frame.groupby(once_each, sort=False).case.agg(tuple).reset_index()
    several["cases"] = several.case.map(lambda cases: cases_in_words(tables, cases))
    several["number"] = several.field + several.value_text.map(lambda value: f" ({value})" if value else "")
    several["place"] = several.place.str.replace(r"\.\d+$", "", regex=True)  # items of a list share a row
    together = several.groupby(["place", "mark", "reason", "cases"], sort=False)
    grouped = together[["card", "number"]].agg(lambda names: ", ".join(dict.fromkeys(names))).reset_index()
    grouped = grouped.sort_values("place", key=lambda places: places.map(_first_of(frame)), kind="stable")
    return [Text(note("assumptions")), stated("assumptions", grouped)]


def _first_of(frame: pd.DataFrame) -> Callable[[str], int]:
    """Return a sort key for fields of a scenario: sections in their order, and within a section card by card."""
    sections = list(dict.fromkeys(frame.place.str.partition(".")[0]))
    return lambda place: sections.index(place.partition(".")[0])


def ranked_by_assumptions(tables: Tables) -> list[Block]:
    """Return a warning if products are compared by numbers that are assumed or second hand; empty otherwise.

    It says whether these numbers decide the errors of the cases, or their cost and performance alone.
    """
    frame = compared_by(tables)
    if len(tables.labels) < 2 or frame.empty:
        return []
    of_cost = frame.field.str.contains(_RESOURCES)
    sentences = [
        f"{_marked(rows)}. {decided}"
        for rows, decided in ((frame[~of_cost], _ORDER), (frame[of_cost], _COST_ALONE))
        if len(rows)
    ]
    lead = "The comparison of the cases uses numbers that are not from the manufacturer's datasheet."
    if of_cost.all():
        lead = "The comparison of cost and performance uses numbers that are not from the manufacturer's datasheet."
    return [Text(f"{' '.join(sentences)} See Assumptions.", lead)]


def placed_by_assumptions(tables: Tables) -> list[Block]:
    """Return a warning if guided ascents draw vehicle dispersions that are assumed or second hand."""
    frame, guided = METRICS["assumptions"](tables), set(METRICS["injection"](tables).case)
    rows = frame[frame.place.str.endswith(_SPREADS) & frame.case.isin(guided)]
    drawn = set(tables.injection_covariances.source[tables.injection_covariances.source_group == "vehicle"])
    if drawn and drawn != {"vehicle"}:  # without an error budget they are one source
        rows = rows[[_SOURCE.get(field, field.replace("_", " ")) in drawn for field in rows.field]]
    if rows.empty:
        return []
    text = f"{_fields(list(rows.field))}. Errors of the achieved orbit are only as reliable as these numbers. {_ALONG}"
    marks = " and ".join(mark.replace("_", " ") for mark in dict.fromkeys(rows.mark))
    return [Text(text[0].upper() + text[1:], f"The achieved orbit depends on {marks} dispersions of the vehicle.")]


def _marked(frame: pd.DataFrame) -> str:
    """Return the marked fields of each device, with the number of cases that use them."""
    parts = []
    for device, rows in frame.groupby("device", sort=False):
        name = _NAMES.get(str(device), f"Sensor {str(device).partition('.')[2]}")
        devices = []
        for mark, of_mark in rows.groupby("mark", sort=False):
            count = f"in {of_mark.marked.max()} of {of_mark.cases.iloc[0]} cases"
            devices.append(f"{_fields(list(of_mark.field))} ({mark} {count})")
        parts.append(f"{name}: {'; '.join(devices)}")
    return ". ".join(parts)


def _fields(fields: Sequence[str]) -> str:
    """Return fields in words; of many only the first, with the number of the others."""
    names = list(dict.fromkeys(words(field.removeprefix("resources.").replace(".", " ")) for field in fields))
    return among(names, _FEW)


def cases_in_words(tables: Tables, cases: Collection[str]) -> str:
    """Return case labels in words: "all", the levels of one axis, or the first labels and the number of the others."""
    chosen = set(cases)
    if chosen == set(tables.labels.values()):
        return "all" if len(chosen) > 1 else "the one case"
    levels = {tables.labels[case]: axes for case, axes in tables.levels.items()}
    for axis in next(iter(levels.values()), {}):
        axis_levels = list(dict.fromkeys(levels[label].get(axis, "") for label in levels if label in chosen))
        if len(axis_levels) <= _FEW and {label for label in levels if levels[label].get(axis) in axis_levels} == chosen:
            return f"{axis}={' or '.join(axis_levels)}"
    return among([label for label in levels if label in chosen], _FEW, "; ")


@of("configuration")
def configuration(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return one table each for IMUs, receivers and filters; cases with equal numbers share a row."""
    kinds = frame.device.str.partition(" ")[0]
    return [_table(tables, device, frame[kinds == device]) for device in dict.fromkeys(kinds)]


def _table(tables: Tables, kind: str, frame: pd.DataFrame) -> Table:
    terms = list(dict.fromkeys(frame.term))
    lines: dict[tuple[str, ...], list[str]] = {}
    for (case, _), rows in frame.groupby(["case", "device"], sort=False):
        values = dict(zip(rows.term, rows.value_text, strict=True))
        lines.setdefault((str(rows["name"].iloc[0]), *(values.get(term, "–") for term in terms)), []).append(str(case))
    body = tuple((*line, cases_in_words(tables, dict.fromkeys(cases))) for line, cases in lines.items())
    caption = f"{kind[0].upper()}{kind[1:]}: key numbers of the cards; errors are 1 sigma."
    return Table((kind, *terms, "cases"), body, (False,) * (len(terms) + 2), caption)
