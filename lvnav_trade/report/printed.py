"""Published tables in their own layout: what is printed, ours beside it, and their ratio; and short names of cases."""

import re
from collections.abc import Iterator, Sequence

import pandas as pd

from lvnav_trade.campaign.reading.study import Cell, PrintedTable, Question, Study
from lvnav_trade.quantities.errors import Mistake, quoted
from lvnav_trade.report.blocks import Block, Table, number
from lvnav_trade.report.script import StudyScript
from lvnav_trade.results.evaluation.verdicts import HOLDS

_PUBLISHED = re.compile(r"(?:^|; )published: (\w+)")  # a remark of innovations: white or correlated
_WORDS = {"white": "yes", "correlated": "no"}
_POOLED = re.compile(r"; \d+ levels of [^<]*? together")
_UNCLEAR = re.compile(r"[-+\d.]|(none|on|off|yes|no|true|false)$")  # a level that says nothing without its axis


def printed_tables(study: Study, rows: pd.DataFrame) -> list[Block]:
    """Return the published tables that study.yaml lays out, from the rows of all campaigns
    (`results.evaluation.published`).
    """
    return [_table(one, rows) for one in study.printed]


def _table(one: PrintedTable, rows: pd.DataFrame) -> Table:
    found = {label: [_row_of(cell, rows) for cell in cells] for label, cells in one.rows.items()}
    units = [_unit_of([cells[k] for cells in found.values()]) for k in range(len(one.columns))]
    head = [(f"{name} {unit}".rstrip(), "ours", "ratio") for name, unit in zip(one.columns, units, strict=True)]
    lines = [(label, *(text for row in cells for text in _cells(row))) for label, cells in found.items()]
    whole = (one.head, *(text for group in head for text in group))
    return Table(whole, tuple(lines), (False,) + (True,) * (len(whole) - 1), one.title)


def _row_of(cell: Cell | None, rows: pd.DataFrame) -> pd.Series | None:
    """Return the row of a cell; nothing where the table has none there, or its campaign has no results."""
    if cell is None:
        return None
    mine = rows[
        (rows["item"] == cell.item) & rows["case"].str.startswith(f"{cell.campaign}: " if cell.campaign else "")
    ]
    for axis, level in cell.case.items():
        mine = mine[[f"{axis}={level}" in _levels(text) for text in mine["case"]]]
    return mine.iloc[0] if len(mine) else None


def _unit_of(found: Sequence[pd.Series | None]) -> str:
    units = {str(row.unit) for row in found if row is not None and row.published == row.published}
    return f"({units.pop()})" if len(units) == 1 and units != {"-"} else ""


def _cells(row: pd.Series | None) -> tuple[str, str, str]:
    """Return what is printed, ours, and the ratio or the verdict of a row."""
    if row is None:
        return "", "", ""
    missed = "" if row.verdict == HOLDS else " out" if row.verdict.startswith("does not") else f" {row.verdict}"
    by_input = " input" if row.counts_as == "repeats" else ""
    if row.published == row.published:
        return f"{row.published:g}", number(row.ours), f"{number(row.ratio)}{missed}{by_input}"
    said = _PUBLISHED.search(str(row.remark))
    return _WORDS.get(said[1], said[1]) if said else "", number(row.ours), missed.strip() or "as printed"


def mistakes(study: Study, questions: Sequence[Question], script: StudyScript) -> Iterator[Mistake]:
    """Yield the cells of printed tables of which nothing is stated."""
    stated: dict[str, set[str]] = {}
    for one in questions:
        lists = [one.campaign.model_dump(mode="json")["references"], *script.stated(one.campaign.name).values()]
        stated[one.campaign.name] = {str(entry["item"]) for entries in lists for entry in entries}
    written = questions[0].written if questions else None
    for place, table in enumerate(study.printed):
        for label, cells in table.rows.items():
            for index, cell in enumerate(cells):
                known = stated.get(cell.campaign, set()) if cell and cell.campaign else set().union(*stated.values())
                if cell is not None and cell.item not in known and written is not None:
                    message = f"nothing with the item {quoted(cell.item)} is stated of a campaign of this study"
                    yield written.mistake(f"printed.{place}.rows.{label}.{index}", message)


def short_cases(rows: pd.DataFrame) -> pd.DataFrame:
    """Return rows with the names of their cases shortened: campaign, and the levels that differ from the base."""
    return rows.assign(case=[_short(str(text)) for text in rows["case"]])


def _short(text: str) -> str:
    campaign, colon, rest = text.partition(": ")
    if not colon:
        return text
    parts = [", ".join(map(_level, _levels(one))) or "base" for one in rest.split(" < ")] if rest.strip() else []
    return f"{campaign}: {' < '.join(parts)}" if parts else campaign


def _levels(text: str) -> list[str]:
    """Return ``axis=level`` of the axes of a case that are not at their base; a level may hold commas."""
    found: list[str] = []
    for part in _POOLED.sub("", text.partition(": ")[2] or text).split(", "):
        if "=" in part or not found:
            found.append(part)
        else:
            found[-1] += f", {part}"
    return [one for one in found if one and one != "base" and not one.endswith("=base")]


def _level(text: str) -> str:
    level = text.partition("=")[2]
    return text if not level or _UNCLEAR.match(level) else level
