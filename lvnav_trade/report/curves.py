"""Sections on choice: curves over numeric axes with crossings, tornado, cost against performance."""

from collections.abc import Iterator
from typing import Any

import pandas as pd

from lvnav_trade.metrics import METRICS
from lvnav_trade.metrics.resources import ranked
from lvnav_trade.report.blocks import Block, Text, figure, stated
from lvnav_trade.report.escape import note
from lvnav_trade.store.read import Tables

_FEW = 6  # crossings of an axis that are said in a line


def curves(tables: Tables) -> list[Block]:
    """Return a figure of every numeric axis, the crossings, and a tornado of every requirement."""
    frame, crossings, bars = (METRICS[name](tables) for name in ("curves", "crossings", "tornado"))
    found: list[Block] = [Text(said, "The limit is reached at:")] if (said := _crossings(crossings)) else []
    for number, axis in enumerate(dict.fromkeys(frame.axis), 1):
        drawn = figure(tables, "curves", axis, axis=axis.replace("_", " "))
        found.append(drawn._replace(name=f"curves-{number}"))
    if len(crossings):
        found.append(stated("crossings", crossings))
    for number, name in enumerate(dict.fromkeys(bars.requirement), 1):
        drawn = figure(tables, "tornado", name, requirement=name)
        found.append(drawn._replace(name=f"tornado-{number}"))
    return found


def _crossings(frame: pd.DataFrame) -> str:
    """Say where curves of linear covariance (else of runs) reach their limits, of axes with few crossings."""
    said = []
    for _, rows in frame.groupby(["axis", "requirement"], sort=False) if len(frame) else ():
        rows = rows[rows.by == rows.by.iloc[0]]
        if len(rows) <= _FEW:
            one = rows.iloc[0]
            at = ", ".join(
                f"{row.crossing:.3g} {row.axis_unit}".strip() + f" ({row.case})" * bool(row.case)
                for row in rows.itertuples()
            )
            said.append(f"{one.axis.replace('_', ' ')}: {at} ({one.requirement}, {one.limit:g} {one.unit})")
    return "; ".join(said) + "." * bool(said)


def pareto(tables: Tables) -> list[Block]:
    """Return the cheapest case that meets everything, the cases with their totals, and the front."""
    frame = METRICS["pareto"](tables)
    if frame.empty:
        return []
    known = {"cost": "cost", "mass": "mass_kg"}
    order = ranked(frame, [name for name, column in known.items() if frame[column].notna().all()])
    best = order.iloc[0]
    found: list[Block] = []
    lead = "Cheapest that meets all requirements:" if best.meets else "No case meets all requirements. Cheapest:"
    for one in (best, *_shown_to_meet(order)):
        found.append(
            Text(f"{one.case} (cost {one.cost:g}, {one.mass_kg:g} kg; error over limit {one.error_ratio:.2g}).", lead)
        )
        lead = "Its runs leave it undecided. Cheapest whose verdict is met:"
    return [*found, Text(note("pareto")), stated("pareto", order), figure(tables, "pareto")]


def _shown_to_meet(order: pd.DataFrame) -> Iterator[Any]:
    """Yield the first case whose verdict is met, where the first that meets all by its estimate is undecided."""
    if order.meets.iloc[0] and order.verdict.iloc[0] == "undecided":
        yield from order[order.verdict == "met"].head(1).itertuples()
