"""The configuration: key numbers of each IMU, receiver and filter, with the cases that have it."""

import pandas as pd

from lvnav_trade.report.assumptions import cases_in_words
from lvnav_trade.report.blocks import Block, Table, of
from lvnav_trade.results.tables.read import Tables


@of("configuration")
def configuration(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return a table for IMUs, receivers and filters; cases with the same numbers are in one line."""
    kinds = frame.device.str.partition(" ")[0]
    return [_table(tables, kind, frame[kinds == kind]) for kind in dict.fromkeys(kinds)]


def _table(tables: Tables, kind: str, frame: pd.DataFrame) -> Table:
    terms = list(dict.fromkeys(frame.term))
    lines: dict[tuple[str, ...], list[str]] = {}
    for (case, _), rows in frame.groupby(["case", "device"], sort=False):
        values = dict(zip(rows.term, rows.value_text, strict=True))
        lines.setdefault((str(rows["name"].iloc[0]), *(values.get(term, "–") for term in terms)), []).append(str(case))
    found = tuple((*line, cases_in_words(tables, dict.fromkeys(cases))) for line, cases in lines.items())
    caption = f"{kind[0].upper()}{kind[1:]}: key numbers of the cards, one sigma where they are errors."
    return Table((kind, *terms, "cases"), found, (False,) * (len(terms) + 2), caption)
