"""Summary of a study: number of published values that are evidence and reproduced, and the others by reason."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import pandas as pd

from lvnav_trade.report.blocks import Block, Text, stated
from lvnav_trade.report.printed import short_cases
from lvnav_trade.report.sentences import plural
from lvnav_trade.results.evaluation.published import EDGES, at_an_edge, evidence, fitted, held, most_important
from lvnav_trade.results.evaluation.verdicts import FAILS, HOLDS

_EXPRESSION = r"^[^:]*[-+*/(][^:]*: "  # metric of a statement: an expression, followed by the meaning of its terms


_KINDS = {"number": "numbers", "order": "orders and statements on innovations"}
_NOT_COUNTED = {
    "repeats": "results fixed by our inputs",
    "own": "results whose statement or bound is ours",
    "again": "second comparisons with a published number",
    "verification": "results that cannot fail here and verify the tool",
}


_TABLES = {"repeats": "repeated", "own": "own", "again": "again", "verification": "verification"}


class VerdictCounts(NamedTuple):
    """Number of rows of one kind by their verdicts.

    total : All rows.
    hold : Reproduced.
    fail : Not reproduced.
    undecided : Not decided by the runs.
    """

    total: int
    hold: int  # reproduced
    fail: int  # not reproduced
    undecided: int  # not decided by the runs


def counted(rows: pd.DataFrame) -> dict[str, VerdictCounts]:
    """Return the counts of rows by kind: number, order, statement.

    Parameters
    ----------
    rows : pandas.DataFrame
        Rows of `references.csv` with the columns `counts_as` (the kind) and `verdict`.
    """
    counts = {}
    for row_kind in (*_KINDS, "statement"):
        words = rows.verdict[rows.counts_as == row_kind]
        if len(words):
            hold, fail = int((words == HOLDS).sum()), int((words == FAILS).sum())
            counts[row_kind] = VerdictCounts(len(words), hold, fail, len(words) - hold - fail)
    return counts


def said(rows: pd.DataFrame, kinds: Mapping[str, VerdictCounts]) -> str:
    """Return the counts of numbers and orders as a sentence without its full stop."""
    each = []
    for row_kind, words in _KINDS.items():
        if row_kind in kinds:
            count = kinds[row_kind]
            verb = plural(count.undecided, "is", "are")
            open_count = f", {count.undecided} {verb} undecided" if count.undecided else ""
            each.append(f"{count.hold} of {count.total} {words} are reproduced, {count.fail} are not{open_count}")
    return f"Of {len(rows)} published results that count, {int(held(rows).sum())} are reproduced: {'; '.join(each)}"


def headline(frame: pd.DataFrame, important: Sequence[str], statements: pd.DataFrame | None = None) -> list[Block]:
    """Return the counts of rows, and the three most important rows and statements that are not reproduced.

    Parameters
    ----------
    frame : pandas.DataFrame
        Rows of published numbers. Without rows the result is empty.
    important : sequence of str
        Beginnings of items, most important first.
    statements : pandas.DataFrame, optional
        Rows of statements.
    """
    if frame.empty:
        return []
    rows = frame[evidence(frame)]
    lines = [f"{said(rows, counted(rows))}."] if len(rows) else []
    if (by := fitted(rows)).any():
        withheld = rows[~by & rows.published.notna()]
        lines.append(
            f"Settings were fitted to {int(by.sum())} of the numbers; {int(held(rows[by]).sum())} of these are "
            f"reproduced, and {int(held(withheld).sum())} of the {len(withheld)} numbers withheld from the fit."
        )
    single = rows[rows.percentile.notna() & rows.in_band.astype(bool)]
    if len(single):
        points = " % and ".join(f"{point:g}" for point in EDGES)
        among = int((~at_an_edge(single)).sum())
        lines.append(
            f"Separately, of {len(single)} numbers within their band that are of one published run, {among} lie "
            f"between the {points} % quantiles of our runs."
        )
    evidence_rows = frame if statements is None else pd.concat([frame, statements], ignore_index=True)
    apart = [
        f"{len(marked)} {words} ({int(held(marked).sum())} hold)"
        for mark, words in _NOT_COUNTED.items()
        if len(marked := evidence_rows[evidence_rows.counts_as == mark])
    ]
    if apart:
        lines.append(f"Not counted: {'; '.join(apart)}.")
    failing = rows[~held(rows)]
    if statements is not None:
        failing = pd.concat([failing, statements[statements.verdict == FAILS]], ignore_index=True)
    blocks: list[Block] = [Text(" ".join(lines))]
    if len(failing):
        all_rows = frame if statements is None else pd.concat([frame, statements], ignore_index=True)
        blocks.append(stated("most_important", _short(most_important(failing, important), all_rows)))
    return blocks


def _short(rows: pd.DataFrame, whole: pd.DataFrame) -> pd.DataFrame:
    """Return rows with shorter texts, for the first screen.

    An item that occurs in one case only gets the campaign in place of the case. If a row has an item, its expression is
    omitted, because the item describes it.
    """
    has_item, cases = rows["item"] != "", whole.groupby("item")["case"].nunique()
    alone = has_item & rows["item"].map(cases).eq(1)
    expression = has_item & rows.metric.str.contains(_EXPRESSION)
    case_names = short_cases(rows)["case"]
    return rows.assign(
        case=case_names.where(~alone, rows["case"].str.partition(": ")[0]), metric=rows.metric.mask(expression, "")
    )


def those_that_miss(frame: pd.DataFrame) -> list[Block]:
    """Return the counted rows that are not reproduced, with reasons."""
    rows = frame[evidence(frame) & ~held(frame)]
    return [stated("out_of_band", short_cases(rows))] if len(rows) else []


def not_counted(frame: pd.DataFrame) -> list[Block]:
    """Return the rows that are not counted: repeated, not published, read again, or checks of the tool."""
    groups = ((name, frame[frame.counts_as == mark]) for mark, name in _TABLES.items())
    return [stated(name, short_cases(rows)) for name, rows in groups if len(rows)]
