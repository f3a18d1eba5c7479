"""Section on numeric axes: curves with their limits and crossings; tornado of axes that are varied alone."""

from lvnav_trade.metrics import METRICS
from lvnav_trade.report.blocks import Block, figure, stated
from lvnav_trade.store.read import Tables


def curves(tables: Tables) -> list[Block]:
    """Return a figure of every numeric axis, the crossings, and a tornado of every requirement."""
    frame, crossings, bars = (METRICS[name](tables) for name in ("curves", "crossings", "tornado"))
    found: list[Block] = []
    for number, axis in enumerate(dict.fromkeys(frame.axis), 1):
        drawn = figure(tables, "curves", axis, axis=axis.replace("_", " "))
        found.append(drawn._replace(name=f"curves-{number}"))
    if len(crossings):
        found.append(stated("crossings", crossings))
    for number, name in enumerate(dict.fromkeys(bars.requirement), 1):
        drawn = figure(tables, "tornado", name, requirement=name)
        found.append(drawn._replace(name=f"tornado-{number}"))
    return found
