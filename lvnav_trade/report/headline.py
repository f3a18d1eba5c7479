"""Summary of a study: number of published values that are evidence and reproduced, and the others by reason."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import pandas as pd

from lvnav_trade.report.blocks import Block, Text, formatted_table
from lvnav_trade.report.printed import short_cases
from lvnav_trade.report.sentences import plural
from lvnav_trade.results.evaluation.published import (
    EDGES,
    has_fitted_settings,
    is_at_edge,
    is_evidence,
    is_reproduced,
    most_important,
)
from lvnav_trade.results.evaluation.verdicts import FAILS, HOLDS

_EXPRESSION = r"^[^:]*[-+*/(][^:]*: "  # metric of a statement: an expression, followed by the meaning of its terms


_KINDS = {"number": "numbers", "order": "orders and statements on innovations"}
# mark of a row: singular and plural
_NOT_COUNTED = {
    "repeats": ("result fixed by our inputs", "results fixed by our inputs"),
    "own": ("result whose statement or bound is ours", "results whose statement or bound is ours"),
    "again": ("second comparison with a published result", "second comparisons with a published result"),
    "verification": (
        "result that cannot fail here and verifies the tool",
        "results that cannot fail here and verify the tool",
    ),
}


_TABLES = {"repeats": "repeated", "own": "own", "again": "again", "verification": "verification"}


class VerdictCounts(NamedTuple):
    """Number of rows of one kind by their verdicts.

    total : Number of all rows.
    reproduced_count : Number of reproduced rows.
    failed_count : Number of rows that are not reproduced.
    undecided_count : Number of rows that the runs do not decide.
    """

    total: int
    reproduced_count: int
    failed_count: int
    undecided_count: int


def verdict_counts(rows: pd.DataFrame) -> dict[str, VerdictCounts]:
    """Return the counts of rows by kind: number, order, statement.

    Parameters
    ----------
    rows : pandas.DataFrame
        Rows of `references.csv` with the columns `counts_as` (the kind) and `verdict`.
    """
    counts = {}
    for row_kind in (*_KINDS, "statement"):
        verdicts = rows.verdict[rows.counts_as == row_kind]
        if len(verdicts):
            reproduced_count = int((verdicts == HOLDS).sum())
            failed_count = int((verdicts == FAILS).sum())
            undecided_count = len(verdicts) - reproduced_count - failed_count
            counts[row_kind] = VerdictCounts(len(verdicts), reproduced_count, failed_count, undecided_count)
    return counts


def counts_sentence(rows: pd.DataFrame, kinds: Mapping[str, VerdictCounts]) -> str:
    """Return the counts of numbers and orders as a sentence without its full stop."""
    texts = []
    for row_kind, name in _KINDS.items():
        if row_kind not in kinds:
            continue
        count = kinds[row_kind]
        text = f"{count.reproduced_count} of {count.total} {name} are reproduced, {count.failed_count} are not"
        if count.undecided_count:
            text += f", {count.undecided_count} {plural(count.undecided_count, 'is', 'are')} undecided"
        texts.append(text)
    n_held = int(is_reproduced(rows).sum())
    text_list = "; ".join(texts)
    return f"Of {len(rows)} published results that count, {n_held} are reproduced: {text_list}"


def headline(frame: pd.DataFrame, item_priority: Sequence[str], statements: pd.DataFrame | None = None) -> list[Block]:
    """Return the counts of rows, and the three most important rows and statements that are not reproduced.

    Parameters
    ----------
    frame : pandas.DataFrame
        Rows of published numbers. Without rows the result is empty.
    item_priority : sequence of str
        Beginnings of items, most important first.
    statements : pandas.DataFrame, optional
        Rows of statements.
    """
    if frame.empty:
        return []
    rows = frame[is_evidence(frame)]
    all_rows = frame
    failed_rows = rows[~is_reproduced(rows)]
    if statements is not None:
        all_rows = pd.concat([frame, statements], ignore_index=True)
        failed_rows = pd.concat([failed_rows, statements[statements.verdict == FAILS]], ignore_index=True)
    sentences = [_counted_sentence(rows), _fitted_sentence(rows), _single_sentence(rows), _uncounted_sentence(all_rows)]
    blocks: list[Block] = [Text(" ".join(sentence for sentence in sentences if sentence))]
    if len(failed_rows):
        important_rows = most_important(failed_rows, item_priority)
        short_rows = _short(important_rows, all_rows)
        blocks.append(formatted_table("most_important", short_rows))
    return blocks


def _counted_sentence(rows: pd.DataFrame) -> str:
    if len(rows):
        return f"{counts_sentence(rows, verdict_counts(rows))}."
    return ""


def _fitted_sentence(rows: pd.DataFrame) -> str:
    """Return the counts of the numbers to which settings were fitted, and of those withheld from the fit."""
    is_fitted = has_fitted_settings(rows)
    if not is_fitted.any():
        return ""
    withheld_rows = rows[~is_fitted & rows.published.notna()]
    n_fitted = int(is_reproduced(rows[is_fitted]).sum())
    n_withheld = int(is_reproduced(withheld_rows).sum())
    return (
        f"Settings were fitted to {int(is_fitted.sum())} of the numbers; {n_fitted} of these are reproduced, "
        f"and {n_withheld} of the {len(withheld_rows)} numbers withheld from the fit."
    )


def _single_sentence(rows: pd.DataFrame) -> str:
    """Return how many numbers of a single published run lie among the runs, of those within their band."""
    single = rows[rows.percentile.notna() & rows.in_band.astype(bool)]
    if single.empty:
        return ""
    points = " % and ".join(f"{point:g}" for point in EDGES)
    n_among = int((~is_at_edge(single)).sum())
    return (
        f"Separately, of {len(single)} numbers within their band that are of one published run, {n_among} lie "
        f"between the {points} % quantiles of our runs."
    )


def _uncounted_sentence(rows: pd.DataFrame) -> str:
    """Return the counts of the rows that are no evidence, by reason."""
    counts = []
    for mark, (singular, several) in _NOT_COUNTED.items():
        marked_rows = rows[rows.counts_as == mark]
        n_hold = int(is_reproduced(marked_rows).sum())
        if len(marked_rows):
            name = plural(len(marked_rows), singular, several)
            verb = plural(n_hold, "holds", "hold")
            counts.append(f"{len(marked_rows)} {name} ({n_hold} {verb})")
    return f"Not counted: {'; '.join(counts)}." if counts else ""


def _short(rows: pd.DataFrame, all_rows: pd.DataFrame) -> pd.DataFrame:
    """Return rows with shorter texts, for the first screen.

    An item that occurs in one case only gets the campaign in place of the case. If a row has an item, its expression is
    omitted, because the item describes it.
    """
    has_item = rows["item"] != ""
    n_cases = all_rows.groupby("item")["case"].nunique()
    is_unique = has_item & rows["item"].map(n_cases).eq(1)
    has_expression = has_item & rows.metric.str.contains(_EXPRESSION)
    campaigns = rows["case"].str.partition(": ")[0]
    return rows.assign(
        case=short_cases(rows)["case"].where(~is_unique, campaigns),
        metric=rows.metric.mask(has_expression, ""),
    )


def failed_table(frame: pd.DataFrame) -> list[Block]:
    """Return the counted rows that are not reproduced, with reasons."""
    rows = frame[is_evidence(frame) & ~is_reproduced(frame)]
    if len(rows):
        return [formatted_table("out_of_band", short_cases(rows))]
    return []


def uncounted_tables(frame: pd.DataFrame) -> list[Block]:
    """Return the rows that are not counted: repeated, not published, read again, or checks of the tool."""
    blocks: list[Block] = []
    for mark, name in _TABLES.items():
        rows = frame[frame.counts_as == mark]
        if len(rows):
            blocks.append(formatted_table(name, short_cases(rows)))
    return blocks
