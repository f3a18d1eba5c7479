"""Figures as JSON that `report/templates/figures.js` draws in a browser; arrays in single precision, each once."""

import base64
import json
from typing import Any

import numpy as np

from lvnav_trade.quantities.records import Floats
from lvnav_trade.report.figures.figure import Figure, Mark, Panel, alt_text, unit_of

MOST_POINTS = 1500
"""Largest number of points of a line; a longer line is reduced to the extremes of segments of equal length."""
# Lengths of dashes and gaps by the style of matplotlib
_DASHES = {"-": (), "--": (6, 3), ":": (1.5, 2.5), "-.": (7, 3, 1.5, 3)}
_STYLES = (
    "color",
    "alpha",
    "lw",
    "marker",
    "ms",
    "mfc",
    "every",
    "step",
    "axis",
    "ha",
    "va",
    "x_part",
    "y_part",
    "cmap",
    "group",
)


def data_of(figure: Figure) -> str:
    """Return a figure as JSON, safe within a script element."""
    arrays: dict[bytes, int] = {}
    rows, columns = figure.grid.shape
    document = {
        "rows": rows,
        "columns": columns,
        "height": figure.height,
        **figure.options,
        "key": figure.key,
        "panels": [_panel(panel, arrays) for panel in figure.panels],
        "legend": [_mark(mark, {}) for mark in figure.legend()],
    }
    document["arrays"] = [base64.b64encode(content).decode() for content in arrays]
    text = json.dumps(
        document,
        separators=(",", ":"),
        ensure_ascii=False,
        default=float,
        allow_nan=False,
    )
    for letter in "<>&\u2028\u2029":  # the JSON is within a script element
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return text


def _panel(panel: Panel, arrays: dict[bytes, int]) -> dict[str, Any]:
    """Return a panel as data for JSON, with its arrays replaced by their indices in `arrays`."""
    content = dict(panel.axes)
    for side in ("x", "y"):
        if f"{side}lim" in panel.axes:
            limits = panel.axes[f"{side}lim"]
            content[f"{side}lim"] = [_finite_number(limit) for limit in limits]
        content[f"{side}unit"] = unit_of(panel.axes.get(f"{side}label", ""))
        label = panel.label(side)
        if label:
            content[f"{side}label"] = label
    content["events"] = None
    if panel.events is not None:
        content["events"] = {"points": panel.events.points, "faults": panel.events.faults}
        # Only the lowest panel of a column has a label
        content["xunit"] = "s"
        content["xname"] = "t"
    marks = [mark for mark in panel.marks if mark.mark_type != "limit" or np.isfinite(mark.data["at"])]
    return {
        **content,
        "alt": alt_text(panel),
        "linked": panel.events is not None,
        "marks": [_mark(mark, arrays) for mark in marks],
        "filled": panel.has_opaque_areas,
    }


def _finite_number(value: float | None) -> float | None:
    """Return a limit of an axis as a number for JSON, which has no infinity; None for a limit that is not set."""
    if value is not None and np.isfinite(value):
        return float(value)
    return None


def _mark(mark: Mark, arrays: dict[bytes, int]) -> dict[str, Any]:
    """Return a mark with its arrays replaced by their indices in `arrays`."""
    encoded_mark = {name: mark.style[name] for name in _STYLES if name in mark.style}
    dashes = mark.style.get("ls", "-")
    if isinstance(dashes, str):
        encoded_mark["ls"] = _DASHES.get(dashes)
    else:
        encoded_mark["ls"] = [2.0 * length for length in dashes[1]]
    if mark.style.get("hatch"):
        encoded_mark["hatch"] = True
    content = _thin_lines(mark.data) if mark.mark_type in ("line", "band") else mark.data
    for name, values in content.items():
        if isinstance(values, np.ndarray):
            array_bytes = np.asarray(values, dtype="<f4").tobytes()
            encoded_mark[name] = arrays.setdefault(array_bytes, len(arrays))
            if values.ndim == 2:
                encoded_mark["shape"] = values.shape
        else:
            encoded_mark[name] = values
    return {"kind": mark.mark_type, "label": mark.label, **encoded_mark}


def _thin_lines(data: dict[str, Floats]) -> dict[str, Floats]:
    """Return lines over one abscissa with at most `MOST_POINTS` points each, without loss of their extremes."""
    x = data["x"]
    if x.size <= MOST_POINTS:
        return data
    is_ascending = (np.diff(x) >= 0.0).all()
    if not is_ascending:
        return data
    ordinates = [values for name, values in data.items() if name != "x"]
    # Each line contributes two points of every block, its minimum and its maximum
    n_blocks = MOST_POINTS // (2 * len(ordinates))
    indices = [np.array([0, x.size - 1])]
    blocks = np.array_split(np.arange(x.size), n_blocks)
    for block in blocks:
        for values in ordinates:
            indices += _extremes(values, block)
    selection = np.unique(np.concatenate(indices))
    return {name: values[selection] for name, values in data.items()}


def _extremes(values: Floats, block: Any) -> list[Any]:
    """Return the indices of the minimum and the maximum in a block of indices, and of its first NaN (a gap)."""
    block_values = values[block]
    gap = block[np.isnan(block_values)][:1]
    if not np.isfinite(block_values).any():
        return [gap]
    extremes = [np.nanargmin(block_values), np.nanargmax(block_values)]
    return [block[extremes], gap]
