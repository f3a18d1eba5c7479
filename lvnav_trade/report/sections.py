"""What sections share: the rows of a metric, the cases that are shown, and figures of them."""

from collections.abc import Callable, Iterable, Sequence
from functools import wraps

import pandas as pd

from lvnav_trade.metrics import METRICS
from lvnav_trade.plots import PLOTS
from lvnav_trade.report import blocks
from lvnav_trade.report.blocks import Block, Picture, Table, Text, picture
from lvnav_trade.report.escape import texts
from lvnav_trade.store import Tables

MOST_CASES = 8
"""Cases whose own figures are drawn; of more, the best and the worst."""

Blocks = Callable[[Tables], list[Block]]


def of(metric: str, nothing: str = "") -> Callable[[Callable[[Tables, pd.DataFrame], list[Block]]], Blocks]:
    """Make the blocks of a function from the rows of a metric; without rows they are the text `nothing`, or none."""

    def decorate(make: Callable[[Tables, pd.DataFrame], list[Block]]) -> Blocks:
        @wraps(make)
        def section(tables: Tables) -> list[Block]:
            frame = METRICS[metric](tables)
            return make(tables, frame) if len(frame) else [Text(nothing)] * bool(nothing)

        return section

    return decorate


def stated(name: str, frame: pd.DataFrame, alike: bool = False, **content: str) -> Table:
    """Return a frame as the table of that name in `templates/texts.toml`.

    Its columns are chosen (see `blocks.shown`) or get other headings; braces of its caption are filled with content.
    alike: cases that have the same rows stand once.
    """
    found = texts()["tables"][name]
    if "columns" in found:
        frame = blocks.shown(frame, " ".join(found["columns"].split()))
    else:
        frame = frame.set_axis(" ".join(found["headings"].split()).split(" | "), axis=1)
    caption = " ".join(found.get("caption", "").split()).format(**content)
    return blocks.table(blocks.alike(frame) if alike else frame, caption)


def chosen_cases(tables: Tables) -> dict[str, str]:
    """Return digest and label of the cases that get figures of their own, in the order of the plan."""
    if len(tables.labels) <= MOST_CASES:
        return tables.labels
    order = list(METRICS["ranking"](tables).case)
    kept = {*order[: MOST_CASES - 2], *order[-2:]}
    return {case: label for case, label in tables.labels.items() if label in kept}


def left_out(tables: Tables) -> list[Block]:
    """Say that cases are left out, where some are."""
    more = len(tables.labels) - len(chosen_cases(tables))
    text = f"Shown are the {MOST_CASES - 2} best cases and the 2 worst; {more} more are in the tables."
    return [Text(text)] * (more > 0)


def distinct(tables: Tables, name: str, columns: Sequence[str], cases: Iterable[str]) -> list[str]:
    """Return one of these cases for each group whose rows of a table are the same."""
    frame, first = getattr(tables, name), dict[bytes, str]()
    for case in cases:
        rows = frame.loc[frame.case == case, columns]
        first.setdefault(pd.util.hash_pandas_object(rows, index=False).to_numpy().tobytes(), case)
    return list(first.values())


def few(group: Sequence[str]) -> tuple[Sequence[str], list[Block]]:
    """Return no more cases than are drawn, and what to say then."""
    more = len(group) - MOST_CASES
    return group[:MOST_CASES], [Text(f"{more} more cases that differ here are in the tables.")] * (more > 0)


def named(tables: Tables, case: str, cases: Sequence[str]) -> str:
    """Return the label of a case as a sentence where a figure does not stand for all cases."""
    return f" {tables.labels[case]}." * (len(cases) > 1)


def figures(tables: Tables, plot: str, cases: Sequence[str], caption: str) -> list[Block]:
    """Return a figure of each case, numbered; the caption names it where there are several."""
    return [
        picture(f"{plot}-{k}", PLOTS[plot](tables, case), caption + named(tables, case, cases))
        for k, case in enumerate(cases, 1)
    ]


def figure(tables: Tables, plot: str, *about: str, caption: str, name: str = "") -> Picture:
    """Return a figure of a case, a quantity or both, named by them and by its plot, or by `name` in its place."""
    return picture("-".join((name or plot, *about)), PLOTS[plot](tables, *about), caption)
