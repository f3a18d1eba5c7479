"""Wider lines where other lines of a panel cover them, so that each line is visible."""

import numpy as np

from lvnav_trade.quantities.records import Floats
from lvnav_trade.report.figures.figure import Figure, Mark, Panel

_SAME = 0.006  # fraction of the panel's height within which a line covers another
_PART = 0.25  # smallest fraction of covered points for which a line is widened
_WIDTH, _STEP, _WIDEST = 1.5, 2.0, 8.0  # points: width of a line, step for every line above it, largest width


def widen_covered(figure: Figure) -> Figure:
    """Widen each labelled line by one step for each solid labelled line that covers it."""
    for panel in figure.panels:
        lines = [mark for mark in panel.marks if mark.label and mark.kind == "line" and mark.style.get("ls") != "none"]
        if len(lines) > 1:
            _widen(panel, lines)
    return figure


def _widen(panel: Panel, lines: list[Mark]) -> None:
    heights = [_heights(panel, mark.data["y"]) for mark in lines]
    ordinates = np.concatenate([each[np.isfinite(each)] for each in heights])
    if not len(ordinates) or np.ptp(ordinates) == 0.0:
        return
    near = _SAME * float(np.ptp(ordinates))
    for number, mark in enumerate(lines):
        above = sum(
            _solid(upper) and _covers(mark, upper, heights[number], heights[k], near)
            for k, upper in enumerate(lines[number + 1 :], number + 1)
        )
        if above:
            mark.style["lw"] = min(float(mark.style.get("lw", _WIDTH)) + _STEP * above, _WIDEST)


def _heights(panel: Panel, y: Floats) -> Floats:
    """Return ordinates as drawn: their logarithm on a logarithmic axis."""
    if panel.axes.get("yscale") != "log":
        return y
    return np.log(np.where(y > 0.0, y, np.nan))


def _solid(mark: Mark) -> bool:
    return mark.style.get("ls", "-") == "-"


def _covers(lower: Mark, upper: Mark, y: Floats, other: Floats, near: float) -> bool:
    """Return whether a line covers a sufficient fraction of another; False for lines over different abscissas."""
    if not np.array_equal(lower.data["x"], upper.data["x"]):
        return False
    finite = np.isfinite(y) & np.isfinite(other)
    return bool(finite.any() and np.mean(np.abs(y - other)[finite] < near) >= _PART)
