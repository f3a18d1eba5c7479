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
        labelled_marks = [mark for mark in panel.marks if mark.label]
        lines = [mark for mark in labelled_marks if mark.mark_type == "line" and mark.style.get("ls") != "none"]
        if len(lines) > 1:
            _widen(panel, lines)
    return figure


def _widen(panel: Panel, lines: list[Mark]) -> None:
    """Widen the lines of a panel, given in the order of drawing, that later lines cover."""
    heights = [_heights(panel, mark.data["y"]) for mark in lines]
    all_heights = np.concatenate(heights)
    finite_heights = all_heights[np.isfinite(all_heights)]
    if not len(finite_heights):
        return
    range_of_heights = np.ptp(finite_heights)
    if range_of_heights == 0.0:
        return
    tolerance = _SAME * float(range_of_heights)
    for number, mark in enumerate(lines):
        n_above = 0
        for k in range(number + 1, len(lines)):
            if _is_solid(lines[k]) and _covers(mark, lines[k], heights[number], heights[k], tolerance):
                n_above += 1
        if n_above:
            width = float(mark.style.get("lw", _WIDTH))
            mark.style["lw"] = min(width + _STEP * n_above, _WIDEST)


def _heights(panel: Panel, y: Floats) -> Floats:
    """Return ordinates as drawn: their logarithm on a logarithmic axis."""
    if panel.axes.get("yscale") != "log":
        return y
    return np.log(np.where(y > 0.0, y, np.nan))


def _is_solid(mark: Mark) -> bool:
    return mark.style.get("ls", "-") == "-"


def _covers(lower: Mark, upper: Mark, lower_y: Floats, upper_y: Floats, tolerance: float) -> bool:
    """Return whether a line covers a sufficient fraction of another; False for lines over different abscissas.

    lower_y, upper_y : (n,). Ordinates on the scale of the panel.
    tolerance : distance of the ordinates below which a point is covered
    """
    if not np.array_equal(lower.data["x"], upper.data["x"]):
        return False
    finite = np.isfinite(lower_y) & np.isfinite(upper_y)
    if not finite.any():
        return False
    distance = np.abs(lower_y - upper_y)[finite]
    return bool(np.mean(distance < tolerance) >= _PART)
