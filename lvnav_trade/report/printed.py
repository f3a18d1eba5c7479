"""Published tables in their own layout, with published value, computed value and ratio; short names of cases."""

import re
from collections.abc import Iterator, Sequence

import pandas as pd

from lvnav_trade.campaign.reading.study_card import Cell, PrintedTable, StudyCard, StudySection
from lvnav_trade.quantities.errors import Mistake, quoted
from lvnav_trade.report.blocks import Block, Table, number
from lvnav_trade.report.script import StudyScript
from lvnav_trade.results.evaluation.verdicts import HOLDS

_PUBLISHED = re.compile(r"(?:^|; )published: (\w+)")  # in remarks on innovations: white or correlated
_WORDS = {"white": "yes", "correlated": "no"}
_POOLED = re.compile(r"; \d+ levels of [^<]*? together")
_UNCLEAR = re.compile(r"[-+\d.]|(none|on|off|yes|no|true|false)$")  # a level that is unclear without its axis


def printed_tables(study: StudyCard, rows: pd.DataFrame) -> list[Block]:
    """Return the published tables laid out in study.yaml.

    rows : rows of all campaigns (`results.evaluation.published`)
    """
    return [_table(layout, rows) for layout in study.printed]


def _table(layout: PrintedTable, rows: pd.DataFrame) -> Table:
    rows_of_line = {label: [_row_of(cell, rows) for cell in cells] for label, cells in layout.rows.items()}
    units = [_unit_of([cells[k] for cells in rows_of_line.values()]) for k in range(len(layout.columns))]
    head = [(f"{name} {unit}".rstrip(), "ours", "ratio") for name, unit in zip(layout.columns, units, strict=True)]
    lines = [(label, *(text for row in cells for text in _cells(row))) for label, cells in rows_of_line.items()]
    headings = (layout.head, *(text for group in head for text in group))
    return Table(headings, tuple(lines), (False,) + (True,) * (len(headings) - 1), layout.title)


def _row_of(cell: Cell | None, rows: pd.DataFrame) -> pd.Series | None:
    """Return the row of a cell; None if the published table is empty there, or its campaign has no results."""
    if cell is None:
        return None
    matching = rows[
        (rows["item"] == cell.item) & rows["case"].str.startswith(f"{cell.campaign}: " if cell.campaign else "")
    ]
    for axis, level in cell.case.items():
        matching = matching[[f"{axis}={level}" in _levels(text) for text in matching["case"]]]
    return matching.iloc[0] if len(matching) else None


def _unit_of(rows: Sequence[pd.Series | None]) -> str:
    units = {str(row.unit) for row in rows if row is not None and row.published == row.published}
    return f"({units.pop()})" if len(units) == 1 and units != {"-"} else ""


def _cells(row: pd.Series | None) -> tuple[str, str, str]:
    """Return published value, computed value, and ratio or verdict of a row."""
    if row is None:
        return "", "", ""
    missed = "" if row.verdict == HOLDS else " out" if row.verdict.startswith("does not") else f" {row.verdict}"
    by_input = " input" if row.counts_as == "repeats" else ""
    if row.published == row.published:
        return f"{row.published:g}", number(row.ours), f"{number(row.ratio)}{missed}{by_input}"
    verdict_text = _PUBLISHED.search(str(row.remark))
    return (
        _WORDS.get(verdict_text[1], verdict_text[1]) if verdict_text else "",
        number(row.ours),
        missed.strip() or "as printed",
    )


def mistakes(study: StudyCard, questions: Sequence[StudySection], script: StudyScript) -> Iterator[Mistake]:
    """Yield the cells of printed tables for which no statement exists."""
    stated: dict[str, set[str]] = {}
    for question in questions:
        lists = [
            question.campaign.model_dump(mode="json")["references"],
            *script.stated(question.campaign.name).values(),
        ]
        stated[question.campaign.name] = {str(entry["item"]) for entries in lists for entry in entries}
    written = questions[0].written if questions else None
    for place, table in enumerate(study.printed):
        for label, cells in table.rows.items():
            for index, cell in enumerate(cells):
                identifiers = (
                    stated.get(cell.campaign, set()) if cell and cell.campaign else set().union(*stated.values())
                )
                if cell is not None and cell.item not in identifiers and written is not None:
                    message = f"nothing with the item {quoted(cell.item)} is stated of a campaign of this study"
                    yield written.mistake(f"printed.{place}.rows.{label}.{index}", message)


def short_cases(rows: pd.DataFrame) -> pd.DataFrame:
    """Return rows with short case names: the campaign, and the levels that differ from the base."""
    return rows.assign(case=[_short(str(text)) for text in rows["case"]])


def _short(text: str) -> str:
    campaign, colon, compared = text.partition(": ")
    if not colon:
        return text
    parts = (
        [", ".join(map(_level, _levels(case_text))) or "base" for case_text in compared.split(" < ")]
        if compared.strip()
        else []
    )
    return f"{campaign}: {' < '.join(parts)}" if parts else campaign


def _levels(text: str) -> list[str]:
    """Return ``axis=level`` for the axes of a case that differ from the base; a level may contain commas."""
    levels: list[str] = []
    for piece in _POOLED.sub("", text.partition(": ")[2] or text).split(", "):
        if "=" in piece or not levels:
            levels.append(piece)
        else:
            levels[-1] += f", {piece}"
    return [level for level in levels if level and level != "base" and not level.endswith("=base")]


def _level(text: str) -> str:
    level = text.partition("=")[2]
    return text if not level or _UNCLEAR.match(level) else level
