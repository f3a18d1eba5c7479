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
    """Return a published table in its own layout, with three columns for each of its columns."""
    lines = {label: [_find_row(cell, rows) for cell in cells] for label, cells in layout.rows.items()}
    headings = [layout.head]
    for k, name in enumerate(layout.columns):
        unit = _common_unit([cells[k] for cells in lines.values()])
        headings += [f"{name} {unit}".rstrip(), "ours", "ratio"]
    table_rows = []
    for label, cells in lines.items():
        texts = [label]
        for row in cells:
            texts += _cells(row)
        table_rows.append(tuple(texts))
    return Table(
        head=tuple(headings),
        rows=tuple(table_rows),
        numeric=(False,) + (True,) * (len(headings) - 1),
        caption=layout.title,
    )


def _find_row(cell: Cell | None, rows: pd.DataFrame) -> pd.Series | None:
    """Return the row of a cell; None if the published table is empty there, or its campaign has no results."""
    if cell is None:
        return None
    prefix = f"{cell.campaign}: " if cell.campaign else ""
    is_of_campaign = rows["case"].str.startswith(prefix)
    matching = rows[(rows["item"] == cell.item) & is_of_campaign]
    for axis, level in cell.case.items():
        level_text = f"{axis}={level}"
        has_level = [level_text in _levels(text) for text in matching["case"]]
        matching = matching[has_level]
    if len(matching):
        return matching.iloc[0]
    return None


def _common_unit(rows: Sequence[pd.Series | None]) -> str:
    """Return the unit of a column in brackets; empty if the rows have no unit or several."""
    units = {str(row.unit) for row in rows if row is not None and not pd.isna(row.published)}
    if len(units) == 1 and units != {"-"}:
        return f"({units.pop()})"
    return ""


def _cells(row: pd.Series | None) -> tuple[str, str, str]:
    """Return published value, computed value, and ratio or verdict of a row."""
    if row is None:
        return "", "", ""
    if row.verdict == HOLDS:
        remark = ""
    elif row.verdict.startswith("does not"):
        remark = " out"
    else:
        remark = f" {row.verdict}"
    if not pd.isna(row.published):
        if row.counts_as == "repeats":
            remark += " input"
        ratio = f"{number(row.ratio)}{remark}"
        return f"{row.published:g}", number(row.ours), ratio
    published_match = _PUBLISHED.search(str(row.remark))
    word = published_match[1] if published_match else ""
    return _WORDS.get(word, word), number(row.ours), remark.strip() or "as printed"


def mistakes(study: StudyCard, questions: Sequence[StudySection], script: StudyScript) -> Iterator[Mistake]:
    """Yield the cells of printed tables for which no statement exists.

    Parameters
    ----------
    study : StudyCard
        Study with the printed tables.
    questions : sequence of StudySection
        Sections of study.yaml with their campaigns, whose references are statements.
    script : StudyScript
        Script of the study, which may add statements.
    """
    items: dict[str, set[str]] = {}
    for question in questions:
        campaign = question.campaign
        lists = [campaign.model_dump(mode="json")["references"], *script.entries(campaign.name).values()]
        items[campaign.name] = {str(entry["item"]) for entries in lists for entry in entries}
    all_items: set[str] = set().union(*items.values())
    study_file = questions[0].source_tree if questions else None
    if study_file is None:
        return
    for place, table in enumerate(study.printed):
        for label, cells in table.rows.items():
            for index, cell in enumerate(cells):
                if cell is None:
                    continue
                campaign_items = items.get(cell.campaign, set()) if cell.campaign else all_items
                if cell.item not in campaign_items:
                    message = f"nothing with the item {quoted(cell.item)} is stated of a campaign of this study"
                    yield study_file.mistake(f"printed.{place}.rows.{label}.{index}", message)


def short_cases(rows: pd.DataFrame) -> pd.DataFrame:
    """Return rows with short case names: the campaign, and the levels that differ from the base."""
    return rows.assign(case=[_short(str(text)) for text in rows["case"]])


def _short(text: str) -> str:
    """Return the name of a case with the levels that differ from the base; of an order, of all its cases."""
    campaign, colon, cases = text.partition(": ")
    if not colon:
        return text
    if not cases.strip():
        return campaign
    short_names = []
    for case in cases.split(" < "):
        levels = [_level(level) for level in _levels(case)]
        short_names.append(", ".join(levels) or "base")
    return f"{campaign}: {' < '.join(short_names)}"


def _levels(text: str) -> list[str]:
    """Return ``axis=level`` for the axes of a case that differ from the base; a level may contain commas."""
    case = text.partition(": ")[2] or text
    levels: list[str] = []
    for piece in _POOLED.sub("", case).split(", "):
        if "=" in piece or not levels:
            levels.append(piece)
        else:
            levels[-1] += f", {piece}"
    return [level for level in levels if level and level != "base" and not level.endswith("=base")]


def _level(text: str) -> str:
    level = text.partition("=")[2]
    if not level or _UNCLEAR.match(level):
        return text
    return level
