"""Sections on choice: curves over numeric axes with crossings, tornado, cost against performance."""

from typing import Any

import pandas as pd

from lvnav_trade.report.blocks import Block, Text, figure, stated
from lvnav_trade.report.escape import note
from lvnav_trade.report.sentences import say
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.resources import ranked
from lvnav_trade.results.tables.read import Tables

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
    axes = []
    for _, rows in frame.groupby(["axis", "requirement"], sort=False) if len(frame) else ():
        rows = rows[rows.by == rows.by.iloc[0]]
        if len(rows) <= _FEW:
            one = rows.iloc[0]
            at = [
                {"value": f"{row.crossing:.3g} {row.axis_unit}".strip(), "case": row.case} for row in rows.itertuples()
            ]
            limit = f"{one.limit:g} {one.unit}"
            axes.append({"axis": one.axis, "requirement": one.requirement, "limit": limit, "at": at})
    return say("crossings", axes=axes)


def pareto(tables: Tables) -> list[Block]:
    """Return the cheapest case that meets everything, the cases with their totals, and the front."""
    frame = METRICS["pareto"](tables)
    if frame.empty:
        return []
    known = {"cost": "cost", "mass": "mass_kg"}
    order = ranked(frame, [name for name, column in known.items() if frame[column].notna().all()])
    best = order.iloc[0]
    lead = (
        "Cheapest that meets all requirements:"
        if best.meets
        else "No design is shown to meet all requirements. Cheapest:"
    )
    found: list[Block] = [Text(_priced(best), lead)]
    cheaper = order[(order.verdict == "undecided") & (order.error_ratio <= 1.0) & (order.cost < best.cost)]
    if best.meets and len(cheaper):
        found.append(Text(_priced(cheaper.iloc[0]), "Cheaper, but its runs leave it undecided:"))
    return [*found, Text(note("pareto")), stated("pareto", order), figure(tables, "pareto")]


def _priced(one: Any) -> str:
    """Return a case with its cost, mass and largest error over its limit."""
    return f"{one.case} (cost {one.cost:g}, {one.mass_kg:g} kg; error over limit {one.error_ratio:.2g})."
