"""A figure as data: panels with marks, axes and events. Its renderers are `raster.py` (PNG, SVG) and `browser.py`.

Verbs of a `Panel` and their keywords are those of matplotlib's axes. A verb adds one `Mark`, of one of six kinds, to
the panel. A new verb that makes a mark of these kinds is drawn by both renderers.
"""

import re
from collections.abc import Iterable, Sequence
from itertools import pairwise
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.records import Floats

GREY = "#6b7280"
SHADE = "#9ca3af"
_SCALES = {"log": "log", "root": "quadratic"}  # what a label says of an axis that is not linear
_IN_BRACKETS = re.compile(r"\((?P<unit>[^(),;]*)[^()]*\)")
_AXES = {*"xlabel ylabel title xlim ylim xscale yscale xticks yticks equal grid margin".split()}  # noqa: SIM905
_ROOM = 0.02  # part of the width of a panel that the number of an event needs
_APART, _KEY_LENGTH = " · ", 105  # between events of a key; letters that the width of an A4 page has room for


class Mark(NamedTuple):
    """Something drawn in a panel.

    kind : what its data are
        line : x, y; marker, step and dashes in the style
        band : x, low, high
        boxes : x0, x1, y0, y1 of rectangles; infinite at the edge of the panel
        limit : at, for a straight line across the panel; of "x" or "y" in the style
        text : x, y, texts; in parts of the axis where style["x_part"] or style["y_part"] says so
        cells : x and y edges, values as a 2-D array
    style : keywords of matplotlib: color, ls, lw, alpha, marker, ms, mfc, hatch, ec
    """

    kind: str
    data: dict[str, Any]
    style: dict[str, Any]
    label: str = ""


class Events(NamedTuple):
    """Events and faults of a flight: names and times; names, start and end."""

    points: tuple[tuple[str, float], ...]
    faults: tuple[tuple[str, float, float], ...]

    def groups(self, low: float, high: float, columns: int = 1) -> list[tuple[float, str]]:
        """Return time and number, or numbers, of the events within limits; close ones share a label."""
        shown = [(k, t) for k, (_, t) in enumerate(self.points, 1) if low <= t <= high]
        firsts: list[int] = []
        for index, (_, t) in enumerate(shown):
            if not firsts or t - shown[firsts[-1]][1] >= _ROOM * columns * (high - low):
                firsts.append(index)
        found = []
        for first, after in pairwise([*firsts, len(shown)]):
            (start, t), (end, _) = shown[first], shown[after - 1]
            found.append((t, str(start) if start == end else f"{start}-{end}"))
        return found

    def key(self) -> str:
        """Return what the numbers stand for, in lines of similar length that a page has room for."""
        names = [f"{number} {name.replace('_', ' ')}" for number, (name, _) in enumerate(self.points, start=1)]
        kinds: dict[str, list[str]] = {}  # numbers of the faults by kind
        for name in dict.fromkeys(name.replace("_", " ") for name, _, _ in self.faults):
            kind, _, number = name.rpartition(" ")
            kinds.setdefault(kind, []).append(number)
        faults = ", ".join(f"{kind} {' '.join(numbers)}".strip() for kind, numbers in kinds.items())
        names += wrap(f"shaded: {faults}", _KEY_LENGTH) if faults else []
        lines: list[str] = []
        for name in names:
            if lines and len(lines[-1]) + len(_APART) + len(name) <= _KEY_LENGTH:
                lines[-1] += _APART + name
            else:
                lines.append(name)
        return "\n".join(lines)


def events_of(rows: pd.DataFrame) -> Events:
    """Return the events of a case from its rows of the table `events`."""
    points = rows[rows.kind == "event"].sort_values(["t_s", "event"], kind="stable")
    faults = rows[rows.kind == "fault"]
    return Events(
        tuple(zip(points.event, map(float, points.t_s), strict=True)),
        tuple(zip(faults.event, map(float, faults.t_s), map(float, faults.t_end_s), strict=True)),
    )


class Panel:
    """Axes of a figure and what is drawn in them, in the order in which it was added."""

    def __init__(self) -> None:
        """Begin empty, with linear axes."""
        self.marks: list[Mark] = []
        self.axes: dict[str, Any] = {}
        self.spans: dict[str, tuple[float, float]] = {}  # least and largest value that a side's scale is chosen by
        self.events: Events | None = None

    @property
    def filled(self) -> bool:
        """Whether areas that hide what is below them are drawn: faults are shaded over these, and darker."""
        return any(mark.kind in ("band", "boxes") and "alpha" not in mark.style for mark in self.marks)

    def set(self, **axes: Any) -> None:
        """State labels (xlabel, ylabel, title), limits (xlim, ylim; a number is the lower one), scales (xscale, yscale:
        linear, log, root), ticks (xticks, yticks: pairs of place and text), `equal` scales or `grid` lines.
        """
        unknown = set(axes) - _AXES
        if unknown:
            raise TypeError(f"a panel has no {', '.join(sorted(unknown))}")
        for side in {"xlim", "ylim"} & set(axes):
            axes[side] = axes[side] if isinstance(axes[side], tuple) else (axes[side], None)
        self.axes |= axes

    def label(self, side: str) -> str:
        """Return the label of an axis ("x" or "y"), which names the scale beside the unit where it is not linear."""
        text, scale = str(self.axes.get(f"{side}label", "")), _SCALES.get(str(self.axes.get(f"{side}scale")), "")
        if not text or not scale:
            return text
        found = list(_IN_BRACKETS.finditer(text))
        if not found:
            return f"{text} ({scale})"
        at = found[-1].end("unit")
        return f"{text[:at]}, {scale}{text[at:]}"

    def _add(self, kind: str, data: dict[str, Any], style: dict[str, Any]) -> None:
        label = str(style.pop("label", None) or "")
        self.marks.append(Mark(kind, data, style, label))

    def plot(self, x: Any, y: Any, **style: Any) -> None:
        """Draw a line, with markers or, where ls is "none", markers alone."""
        self._add("line", {"x": _floats(x), "y": _floats(y)}, style)

    def step(self, x: Any, y: Any, **style: Any) -> None:
        """Draw a line of steps: a value holds until the next."""
        self.plot(x, y, step=True, **style)

    def fill_between(self, x: Any, low: Any, high: Any, **style: Any) -> None:
        """Shade what lies between two lines; step=True: of steps."""
        x, low, high = np.broadcast_arrays(_floats(x), _floats(low), _floats(high))
        self._add("band", {"x": x, "low": low, "high": high}, {"lw": 0.0, **style})

    def boxes(self, x0: Any, x1: Any, y0: Any, y1: Any, **style: Any) -> None:
        """Draw rectangles; an infinite side is the edge of the panel."""
        sides = np.broadcast_arrays(*map(np.atleast_1d, map(_floats, (x0, x1, y0, y1))))
        self._add("boxes", dict(zip(("x0", "x1", "y0", "y1"), sides, strict=True)), {"lw": 0.0, **style})

    def axvspan(self, low: float, high: float, **style: Any) -> None:
        """Shade the panel between two abscissas."""
        self.boxes(low, high, -np.inf, np.inf, **style)

    def axhspan(self, low: float, high: float, **style: Any) -> None:
        """Shade the panel between two ordinates."""
        self.boxes(-np.inf, np.inf, low, high, **style)

    def bar(self, x: Any, height: Any, width: float, **style: Any) -> None:
        """Draw bars from zero up, centred at x."""
        x, height = _floats(x), _floats(height)
        self.boxes(x - 0.5 * width, x + 0.5 * width, 0.0, height, **style)

    def barh(self, y: Any, length: Any, height: float, **style: Any) -> None:
        """Draw bars from zero to the right, centred at y."""
        y, length = _floats(y), _floats(length)
        self.boxes(0.0, length, y - 0.5 * height, y + 0.5 * height, **style)

    def axhline(self, y: float, **style: Any) -> None:
        """Draw a straight line at an ordinate."""
        self._add("limit", {"at": float(y)}, {"axis": "y", **style})

    def axvline(self, x: float, **style: Any) -> None:
        """Draw a straight line at an abscissa."""
        self._add("limit", {"at": float(x)}, {"axis": "x", **style})

    def hlines(self, y: Any, low: Any, high: Any, **style: Any) -> None:
        """Draw horizontal pieces of lines, as one line with gaps."""
        y, low, high = np.broadcast_arrays(*map(np.atleast_1d, map(_floats, (y, low, high))))
        gap = np.full(y.shape, np.nan)
        self.plot(np.stack([low, high, gap], axis=1).ravel(), np.stack([y, y, gap], axis=1).ravel(), **style)

    def vlines(self, x: Any, low: Any, high: Any, **style: Any) -> None:
        """Draw vertical pieces of lines, as one line with gaps."""
        x, low, high = np.broadcast_arrays(*map(np.atleast_1d, map(_floats, (x, low, high))))
        gap = np.full(x.shape, np.nan)
        self.plot(np.stack([x, x, gap], axis=1).ravel(), np.stack([low, high, gap], axis=1).ravel(), **style)

    def text(self, x: Any, y: Any, texts: str | Iterable[str], **style: Any) -> None:
        """Write texts at places; x_part, y_part: these coordinates are parts of the axis."""
        named = [texts] if isinstance(texts, str) else list(texts)
        x, y = (np.broadcast_to(_floats(place), len(named)) for place in (x, y))
        self._add("text", {"x": x, "y": y, "texts": named}, style)

    def cells(self, x: Any, y: Any, values: Any, scale: tuple[float, float], **style: Any) -> None:
        """Colour cells between edges by their values, on a logarithmic scale of colours; a label asks for its key."""
        data = {"x": _floats(x), "y": _floats(y), "values": np.asarray(values, dtype=float), "scale": scale}
        self._add("cells", data, style)


class Figure(NamedTuple):
    """Panels in a grid (an array of objects, rows x columns) and how they stand.

    height: inches of a row at the width of an A4 page. options: sharex, sharey (False, True for all, "row" or "col"),
    widths (ratios of the columns), title (above all panels).
    """

    grid: Any
    height: float
    options: dict[str, Any]

    @property
    def panels(self) -> list[Panel]:
        """The panels, row by row; those without anything are left out by the renderers."""
        return list(self.grid.ravel())

    @property
    def key(self) -> str:
        """What the numbers of its events stand for; those of one case alone."""
        return next((panel.events.key() for panel in self.panels if panel.events), "")

    def legend(self) -> list[Mark]:
        """Return one mark for each label, in the order in which they were added."""
        found: dict[str, Mark] = {}
        for panel in self.panels:
            for mark in panel.marks:
                if mark.label and mark.kind != "cells":
                    found.setdefault(mark.label, mark)
        return list(found.values())


def canvas(rows: int = 1, columns: int = 1, height: float = 2.6, **options: Any) -> tuple[Figure, Any]:
    """Return a figure of the page's width with rows x columns panels, and these; `height` inches per row.

    options: sharex, sharey, widths, title (see `Figure`).
    """
    grid = np.empty((rows, columns), dtype=object)
    for place in np.ndindex(rows, columns):
        grid[place] = Panel()
    return Figure(grid, height, options), grid


def panel(height: float, **options: Any) -> tuple[Figure, Panel]:
    """Return a figure of one panel, and the panel."""
    figure, grid = canvas(1, 1, height, **options)
    return figure, grid[0, 0]


def unit_of(label: str) -> str:
    """Return the unit that the label of an axis states in its last brackets; empty for a dimensionless number."""
    found = [match["unit"].strip() for match in _IN_BRACKETS.finditer(label)]
    return "" if not found or found[-1] in ("-", "number") else found[-1]


def alt_text(panel: Panel) -> str:
    """Return what a panel shows in words: its axes with the range of what is drawn, and the names in its legend."""
    parts = [one_line(panel.axes.get("title", ""))]
    for side, name in (("y", "ordinate"), ("x", "abscissa")):
        text = one_line(panel.label(side)) or ("time since lift-off (s)" if panel.events and side == "x" else "")
        ends = _range_of(panel, side)
        if text:
            parts.append(f"{name}: {text}" + (f" from {ends[0]:.4g} to {ends[1]:.4g}" if ends else ""))
    names = list(dict.fromkeys(one_line(mark.label) for mark in panel.marks if mark.label))
    parts.append(f"shown: {', '.join(names)}" if names else "")
    return "; ".join(part for part in parts if part)


def one_line(text: Any) -> str:
    """Return a text without line breaks."""
    return " ".join(str(text).split())


def _range_of(panel: Panel, side: str) -> tuple[float, float] | None:
    names = {"x": ("x", "x0", "x1"), "y": ("y", "low", "high", "y0", "y1")}[side]
    drawn = [mark.data[name] for mark in panel.marks if mark.kind != "text" for name in names if name in mark.data]
    values = np.concatenate([np.ravel(each) for each in drawn]) if drawn else np.empty(0)
    values = values[np.isfinite(values)]
    if panel.axes.get(f"{side}scale") == "root":
        values = np.sqrt(np.maximum(values, 0.0))
    return (float(values.min()), float(values.max())) if values.size else None


def _floats(values: Any) -> Floats:
    return np.asarray(values, dtype=float)


def named_ticks(names: Sequence[str], first: float = 0.0) -> list[tuple[float, str]]:
    """Return ticks for named places, one apart."""
    return [(first + k, str(name)) for k, name in enumerate(names)]
