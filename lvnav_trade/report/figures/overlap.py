"""Lines that lie under others of their panel are drawn wider, so that each of them can be seen."""

import numpy as np

from lvnav_trade.quantities.records import Floats
from lvnav_trade.report.figures.figure import Figure, Mark, Panel

_SAME = 0.006  # part of the panel's height within which two lines cover one another
_PART = 0.25  # part of its points in which a line is covered before it is widened
_WIDTH, _STEP, _WIDEST = 1.5, 2.0, 8.0  # points: of a line, more for every line above it, of any


def widen_covered(figure: Figure) -> Figure:
    """Widen each line with a label by as many steps as solid lines with a label lie over it."""
    for panel in figure.panels:
        lines = [mark for mark in panel.marks if mark.label and mark.kind == "line" and mark.style.get("ls") != "none"]
        if len(lines) > 1:
            _widen(panel, lines)
    return figure


def _widen(panel: Panel, lines: list[Mark]) -> None:
    heights = [_heights(panel, mark.data["y"]) for mark in lines]
    found = np.concatenate([each[np.isfinite(each)] for each in heights])
    if not len(found) or np.ptp(found) == 0.0:
        return
    near = _SAME * float(np.ptp(found))
    for number, mark in enumerate(lines):
        above = sum(
            _solid(other) and _covers(mark, other, heights[number], heights[k], near)
            for k, other in enumerate(lines[number + 1 :], number + 1)
        )
        if above:
            mark.style["lw"] = min(float(mark.style.get("lw", _WIDTH)) + _STEP * above, _WIDEST)


def _heights(panel: Panel, y: Floats) -> Floats:
    """Return ordinates as they stand in the panel."""
    if panel.axes.get("yscale") != "log":
        return y
    return np.log(np.where(y > 0.0, y, np.nan))


def _solid(mark: Mark) -> bool:
    return mark.style.get("ls", "-") == "-"


def _covers(lower: Mark, upper: Mark, y: Floats, other: Floats, near: float) -> bool:
    """Whether a line lies over another one in a good part of it; lines over other abscissas are not compared."""
    if not np.array_equal(lower.data["x"], upper.data["x"]):
        return False
    both = np.isfinite(y) & np.isfinite(other)
    return bool(both.any() and np.mean(np.abs(y - other)[both] < near) >= _PART)
