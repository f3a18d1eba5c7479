"""Figures as JSON that `report/templates/figures.js` draws in a browser; arrays in single precision, each once."""

import base64
import json
from typing import Any

import numpy as np

from lvnav_trade.quantities.records import Floats
from lvnav_trade.report.figures.figure import Figure, Mark, Panel, alt_text, unit_of

MOST_POINTS = 1500
"""Largest number of points of a line; a longer line is reduced to the extremes of segments of equal length."""
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
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=False, default=float, allow_nan=False)
    for letter in "<>&\u2028\u2029":  # the JSON is within a script element
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return text


def _panel(panel: Panel, arrays: dict[bytes, int]) -> dict[str, Any]:
    events = panel.events and {"points": panel.events.points, "faults": panel.events.faults}
    limits: dict[str, Any] = {
        side: [None if at is None or not np.isfinite(at) else float(at) for at in panel.axes[side]]
        for side in ("xlim", "ylim")
        if side in panel.axes
    }
    marks = [_mark(mark, arrays) for mark in panel.marks if mark.kind != "limit" or np.isfinite(mark.data["at"])]
    units = {f"{side}unit": unit_of(panel.axes.get(f"{side}label", "")) for side in ("x", "y")}
    labels = {f"{side}label": label for side in ("x", "y") if (label := panel.label(side))}
    over_time = panel.events is not None
    if over_time:  # only the lowest panel of a column has a label
        units["xunit"], labels["xname"] = "s", "t"
    words = {"alt": alt_text(panel), "linked": over_time}
    return {
        **panel.axes,
        **limits,
        **units,
        **labels,
        **words,
        "events": events,
        "marks": marks,
        "filled": panel.filled,
    }


def _mark(mark: Mark, arrays: dict[bytes, int]) -> dict[str, Any]:
    """Return a mark with its arrays replaced by their indices in `arrays`."""
    encoded = {name: mark.style[name] for name in _STYLES if name in mark.style}
    dashes = mark.style.get("ls", "-")
    encoded["ls"] = _DASHES.get(dashes) if isinstance(dashes, str) else [2.0 * length for length in dashes[1]]
    if mark.style.get("hatch"):
        encoded["hatch"] = True
    content = mark.data if mark.kind not in ("line", "band") else _thinned(mark.data)
    for name, values in content.items():
        if isinstance(values, np.ndarray):
            packed = np.asarray(values, dtype="<f4").tobytes()
            encoded[name] = arrays.setdefault(packed, len(arrays))
            if values.ndim == 2:
                encoded["shape"] = values.shape
        else:
            encoded[name] = values
    return {"kind": mark.kind, "label": mark.label, **encoded}


def _thinned(data: dict[str, Floats]) -> dict[str, Floats]:
    """Return lines over one abscissa with at most `MOST_POINTS` points each, without loss of their extremes."""
    x = data["x"]
    if x.size <= MOST_POINTS or not (np.diff(x) >= 0.0).all():
        return data
    selected = [np.array([0, x.size - 1])]
    for values in (values for name, values in data.items() if name != "x"):
        for block in np.array_split(np.arange(x.size), MOST_POINTS // (2 * (len(data) - 1))):
            here = values[block]
            if np.isfinite(here).any():
                selected.append(block[[np.nanargmin(here), np.nanargmax(here)]])
            selected.append(block[np.isnan(here)][:1])
    chosen = np.unique(np.concatenate(selected))
    return {name: values[chosen] for name, values in data.items()}
