"""Summary of a study: how many published numbers are evidence, how many are reproduced, and the rest with reasons."""

from collections.abc import Sequence

import pandas as pd

from lvnav_trade.metrics.held import EDGES, at_an_edge, evidence, fitted, held, most_important, own
from lvnav_trade.metrics.verdicts import FAILS
from lvnav_trade.report.blocks import Block, Text, stated

_EXPRESSION = r"^[^:]*[-+*/(][^:]*: "  # a metric of a statement: the expression, and what its terms are


def headline(frame: pd.DataFrame, important: Sequence[str], statements: pd.DataFrame | None = None) -> list[Block]:
    """Return the counts of rows, and the three most important of rows and statements that do not hold; nothing without
    rows.
    """
    if frame.empty:
        return []
    rows = frame[evidence(frame)]
    kinds = (
        (rows.published.notna(), "numbers are within their band (single runs: among ours)"),
        (rows.published.isna(), "orders and statements on innovations are as published"),
    )
    each = [f"{int(held(rows[kind]).sum())} of {int(kind.sum())} {what}" for kind, what in kinds if kind.any()]
    lines = [
        f"Of {len(rows)} published results that are not fixed by our inputs, {int(held(rows).sum())} are reproduced: "
        f"{'; '.join(each)}."
    ]
    if (by := fitted(rows)).any():
        withheld = rows[~by & rows.published.notna()]
        lines.append(
            f"Settings were fitted to {int(by.sum())} of the numbers; {int(held(rows[by]).sum())} of these are "
            f"reproduced, and {int(held(withheld).sum())} of the {len(withheld)} numbers withheld from the fit."
        )
    edge = int((rows.in_band.astype(bool) & at_an_edge(rows)).sum())
    if edge:
        points = " % or ".join(f"{point:g}" for point in EDGES)
        lines.append(
            f"Results within their band whose published run is at or beyond the {points} % quantile of ours: {edge}."
        )
    mine = frame[own(frame)]
    if repeated := len(frame) - len(rows) - len(mine):
        lines.append(f"Results that repeat an input and are not counted: {repeated}.")
    if len(mine):
        lines.append(
            f"Results without a published statement or bound, which are not counted: {len(mine)}; "
            f"{int(held(mine).sum())} of them hold."
        )
    failing = rows[~held(rows)]
    if statements is not None:
        failing = pd.concat([failing, statements[statements.verdict == FAILS]], ignore_index=True)
    blocks: list[Block] = [Text(" ".join(lines))]
    if len(failing):
        whole = frame if statements is None else pd.concat([frame, statements], ignore_index=True)
        blocks.append(stated("most_important", _short(most_important(failing, important), whole)))
    return blocks


def _short(rows: pd.DataFrame, whole: pd.DataFrame) -> pd.DataFrame:
    """Return rows for the first screen: an item of one case alone names its campaign, and an expression is left out
    where an item says what it is.
    """
    said, cases = rows["item"] != "", whole.groupby("item")["case"].nunique()
    alone = said & rows["item"].map(cases).eq(1)
    expression = said & rows.metric.str.contains(_EXPRESSION)
    return rows.assign(
        case=rows["case"].where(~alone, rows["case"].str.partition(": ")[0]), metric=rows.metric.mask(expression, "")
    )


def those_that_fail(frame: pd.DataFrame) -> list[Block]:
    """Return the rows that do not hold, those that repeat an input, and those that are not published."""
    counted, mine = evidence(frame), own(frame)
    groups = (
        ("out_of_band", frame[counted & ~held(frame)]),
        ("repeated", frame[~counted & ~mine]),
        ("own", frame[mine]),
    )
    return [stated(name, rows) for name, rows in groups if len(rows)]
