"""Figures as data: panels with marks, axes and events, rendered by `raster.py` (PNG, SVG) and `browser.py` (HTML).

The methods of a `Panel` and their keywords are those of matplotlib's axes. Each method adds one `Mark` of one of six
kinds to the panel. Both renderers draw any method that adds a mark of these kinds.
"""

import re
from collections.abc import Iterable, Sequence
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import Floats

GREY = "#6b7280"
SHADE = "#9ca3af"
_SCALES = {"log": "log", "root": "quadratic"}  # word in the axis label for a scale that is not linear
_IN_BRACKETS = re.compile(r"\((?P<unit>[^(),;]*)[^()]*\)")
_AXES = {*"xlabel ylabel title xlim ylim xscale yscale xticks yticks equal grid margin".split()}  # noqa: SIM905
_ROOM = 0.02  # width of the number of an event, as a fraction of the width of a panel
_SEPARATOR = " · "  # of the events in a key
_KEY_LENGTH = 105  # characters across an A4 page
# Arrays of a mark with coordinates along each axis
_COORDINATES = {"x": ("x", "x0", "x1"), "y": ("y", "low", "high", "y0", "y1")}


class Mark(NamedTuple):
    """An element of a panel.

    mark_type : type of the element, which determines its data
        line : x, y; marker, step and dashes in the style
        band : x, low, high
        boxes : x0, x1, y0, y1 of rectangles; infinite at the edge of the panel
        limit : at, for a straight line across the panel; of "x" or "y" in the style
        text : x, y, texts; with style["x_part"] or style["y_part"] the coordinate is a fraction of the axis
        cells : x and y edges, values as a 2-D array
    style : keywords of matplotlib: color, ls, lw, alpha, marker, ms, mfc, hatch, ec
    """

    mark_type: str
    data: dict[str, Any]
    style: dict[str, Any]
    label: str = ""


class Events(NamedTuple):
    """Events and faults of a flight."""

    points: tuple[tuple[str, float], ...]  # events: name, time (s)
    faults: tuple[tuple[str, float, float], ...]  # faults: name, start and end (s)

    def groups(self, low: float, high: float, columns: int = 1) -> list[tuple[float, str]]:
        """Return time (s) and number of the events between two times; close events have a common label, as "3-5".

        low, high : s. The two times.
        columns : number of panels side by side, each with a fraction of the width
        """
        least_distance = _ROOM * columns * (high - low)
        groups: list[tuple[float, list[int]]] = []  # time of the first event, numbers of all events
        for number, (_, t) in enumerate(self.points, start=1):
            if not low <= t <= high:
                continue
            if not groups or t - groups[-1][0] >= least_distance:
                groups.append((t, []))
            groups[-1][1].append(number)
        labels = []
        for t, numbers in groups:
            first = numbers[0]
            last = numbers[-1]
            label = str(first) if first == last else f"{first}-{last}"
            labels.append((t, label))
        return labels

    def key(self) -> str:
        """Return the key to the numbers of the events, in lines that fit the width of a page."""
        entries = []
        for number, (name, _) in enumerate(self.points, start=1):
            event_name = name.replace("_", " ")
            entries.append(f"{number} {event_name}")
        faults = self._fault_names()
        if faults:
            entries += wrap(f"shaded: {faults}", _KEY_LENGTH)
        lines: list[str] = []
        for entry in entries:
            if lines and len(lines[-1]) + len(_SEPARATOR) + len(entry) <= _KEY_LENGTH:
                lines[-1] += _SEPARATOR + entry
            else:
                lines.append(entry)
        return "\n".join(lines)

    def _fault_names(self) -> str:
        """Return the faults in words, with the numbers of faults of the same type: "outage 1 2, jamming"."""
        names = dict.fromkeys(name.replace("_", " ") for name, _, _ in self.faults)
        numbers_of_type: dict[str, list[str]] = {}
        for name in names:
            fault_type, _, number = name.rpartition(" ")
            numbers_of_type.setdefault(fault_type, []).append(number)
        texts = []
        for fault_type, numbers in numbers_of_type.items():
            number_list = " ".join(numbers)
            texts.append(f"{fault_type} {number_list}".strip())
        return ", ".join(texts)


def events_of(rows: pd.DataFrame) -> Events:
    """Return the events of a case from its rows of the table `events`."""
    event_rows = rows[rows.kind == "event"].sort_values(["t_s", "event"], kind="stable")
    fault_rows = rows[rows.kind == "fault"]
    times = map(float, event_rows.t_s)
    starts = map(float, fault_rows.t_s)
    ends = map(float, fault_rows.t_end_s)
    return Events(
        points=tuple(zip(event_rows.event, times, strict=True)),
        faults=tuple(zip(fault_rows.event, starts, ends, strict=True)),
    )


class Panel:
    """Axes of a figure with their marks, in the order of drawing."""

    def __init__(self) -> None:
        """Create an empty panel with linear axes."""
        self.marks: list[Mark] = []
        self.axes: dict[str, Any] = {}
        self.spans: dict[str, tuple[float, float]] = {}  # by axis, smallest and largest value for choosing its scale
        self.events: Events | None = None

    @property
    def has_opaque_areas(self) -> bool:
        """Whether opaque areas are drawn; faults are then shaded above them, and darker."""
        return any(mark.mark_type in ("band", "boxes") and "alpha" not in mark.style for mark in self.marks)

    def set(self, **axes: Any) -> None:
        """Set properties of the axes.

        Parameters
        ----------
        **axes
            Labels (xlabel, ylabel, title), limits (xlim, ylim; a single number is the lower limit), scales (xscale,
            yscale: linear, log, root), ticks (xticks, yticks: pairs of position and text), `equal` scales, `grid`
            lines, `margin`.

        Raises
        ------
        TypeError
            A property is unknown.
        """
        unknown_names = set(axes) - _AXES
        if unknown_names:
            raise TypeError(f"a panel has no {', '.join(sorted(unknown_names))}")
        for side in {"xlim", "ylim"} & set(axes):
            axes[side] = axes[side] if isinstance(axes[side], tuple) else (axes[side], None)
        self.axes |= axes

    def label(self, side: str) -> str:
        """Return the label of an axis ("x" or "y"), with the scale after the unit if it is not linear."""
        text = str(self.axes.get(f"{side}label", ""))
        scale = _SCALES.get(str(self.axes.get(f"{side}scale")), "")
        if not text or not scale:
            return text
        brackets = list(_IN_BRACKETS.finditer(text))
        if not brackets:
            return f"{text} ({scale})"
        unit_end = brackets[-1].end("unit")
        return f"{text[:unit_end]}, {scale}{text[unit_end:]}"

    def _add(self, mark_type: str, data: dict[str, Any], style: dict[str, Any]) -> None:
        label = str(style.pop("label", None) or "")
        self.marks.append(Mark(mark_type, data, style, label))

    def plot(self, x: Any, y: Any, **style: Any) -> None:
        """Draw a line, with or without markers, or markers alone if ls is "none"."""
        self._add("line", {"x": _floats(x), "y": _floats(y)}, style)

    def step(self, x: Any, y: Any, **style: Any) -> None:
        """Draw a line of steps: each value is constant until the next."""
        self.plot(x, y, step=True, **style)

    def fill_between(self, x: Any, low: Any, high: Any, **style: Any) -> None:
        """Shade the area between two lines; with step=True between lines of steps."""
        x, low, high = np.broadcast_arrays(_floats(x), _floats(low), _floats(high))
        self._add("band", {"x": x, "low": low, "high": high}, {"lw": 0.0, **style})

    def boxes(self, x0: Any, x1: Any, y0: Any, y1: Any, **style: Any) -> None:
        """Draw rectangles; an infinite side is the edge of the panel."""
        x0, x1, y0, y1 = _equal_lengths(x0, x1, y0, y1)
        self._add("boxes", {"x0": x0, "x1": x1, "y0": y0, "y1": y1}, {"lw": 0.0, **style})

    def axvspan(self, low: float, high: float, **style: Any) -> None:
        """Shade the panel between two abscissas."""
        self.boxes(low, high, -np.inf, np.inf, **style)

    def axhspan(self, low: float, high: float, **style: Any) -> None:
        """Shade the panel between two ordinates."""
        self.boxes(-np.inf, np.inf, low, high, **style)

    def bar(self, x: Any, height: Any, width: float, **style: Any) -> None:
        """Draw bars from zero up, centred at x."""
        x = _floats(x)
        height = _floats(height)
        low = x - 0.5 * width
        high = x + 0.5 * width
        self.boxes(low, high, 0.0, height, **style)

    def barh(self, y: Any, length: Any, height: float, **style: Any) -> None:
        """Draw bars from zero to the right, centred at y."""
        y = _floats(y)
        length = _floats(length)
        low = y - 0.5 * height
        high = y + 0.5 * height
        self.boxes(0.0, length, low, high, **style)

    def axhline(self, y: float, **style: Any) -> None:
        """Draw a straight line at an ordinate."""
        self._add("limit", {"at": float(y)}, {"axis": "y", **style})

    def axvline(self, x: float, **style: Any) -> None:
        """Draw a straight line at an abscissa."""
        self._add("limit", {"at": float(x)}, {"axis": "x", **style})

    def hlines(self, y: Any, low: Any, high: Any, **style: Any) -> None:
        """Draw horizontal pieces of lines, as one line with gaps."""
        y, low, high = _equal_lengths(y, low, high)
        gap = np.full(y.shape, np.nan)
        abscissas = np.stack([low, high, gap], axis=1)
        ordinates = np.stack([y, y, gap], axis=1)
        self.plot(abscissas.ravel(), ordinates.ravel(), **style)

    def vlines(self, x: Any, low: Any, high: Any, **style: Any) -> None:
        """Draw vertical pieces of lines, as one line with gaps."""
        x, low, high = _equal_lengths(x, low, high)
        gap = np.full(x.shape, np.nan)
        abscissas = np.stack([x, x, gap], axis=1)
        ordinates = np.stack([low, high, gap], axis=1)
        self.plot(abscissas.ravel(), ordinates.ravel(), **style)

    def text(self, x: Any, y: Any, texts: str | Iterable[str], **style: Any) -> None:
        """Write texts at positions.

        x_part, y_part in the style : whether the coordinate is a fraction of the axis
        """
        labels = [texts] if isinstance(texts, str) else list(texts)
        x = np.broadcast_to(_floats(x), len(labels))
        y = np.broadcast_to(_floats(y), len(labels))
        self._add("text", {"x": x, "y": y, "texts": labels}, style)

    def cells(self, x: Any, y: Any, values: Any, scale: tuple[float, float], **style: Any) -> None:
        """Colour cells between edges by their values, on a logarithmic colour scale; a label adds a colour bar.

        x, y : edges of the columns and rows of cells
        values : (n_row, n_column)
        scale : smallest and largest value of the colour scale
        """
        data = {
            "x": _floats(x),
            "y": _floats(y),
            "values": np.asarray(values, dtype=float),
            "scale": scale,
        }
        self._add("cells", data, style)


class Figure(NamedTuple):
    """A figure with panels in a grid."""

    grid: Any  # array of panels, rows x columns
    height: float  # inches of a row, at the width of an A4 page
    options: dict[str, Any]  # sharex, sharey (False, True for all, "row" or "col"), widths of columns, title

    @property
    def panels(self) -> list[Panel]:
        """The panels, row by row; renderers omit empty panels."""
        return list(self.grid.ravel())

    @property
    def key(self) -> str:
        """Key to the numbers of the events, if the figure shows events of one case."""
        for panel in self.panels:
            if panel.events:
                return panel.events.key()
        return ""

    def legend(self) -> list[Mark]:
        """Return one mark for each label, in the order of drawing."""
        by_label: dict[str, Mark] = {}
        for panel in self.panels:
            for mark in panel.marks:
                if mark.label and mark.mark_type != "cells":
                    by_label.setdefault(mark.label, mark)
        return list(by_label.values())


def canvas(rows: int = 1, columns: int = 1, height: float = 2.6, **options: Any) -> tuple[Figure, Any]:
    """Create a figure with a grid of panels, as wide as a page.

    Parameters
    ----------
    rows, columns : int
        Number of rows and columns of panels.
    height : float
        Height of a row (inches).
    **options
        sharex, sharey, widths, title; see `Figure`.

    Returns
    -------
    Figure, numpy.ndarray
        The figure and its panels (rows, columns).
    """
    grid = np.empty((rows, columns), dtype=object)
    for place in np.ndindex(rows, columns):
        grid[place] = Panel()
    return Figure(grid, height, options), grid


def panel(height: float, **options: Any) -> tuple[Figure, Panel]:
    """Create a figure with one panel of a height (inches); return both."""
    figure, grid = canvas(1, 1, height, **options)
    return figure, grid[0, 0]


def unit_of(label: str) -> str:
    """Return the unit in the last parentheses of the label of an axis; empty for a dimensionless number."""
    units = [match["unit"].strip() for match in _IN_BRACKETS.finditer(label)]
    if not units or units[-1] in ("-", "number"):
        return ""
    return units[-1]


def alt_text(panel: Panel) -> str:
    """Return the description of a panel for screen readers: axes with the range of the data, names in the legend."""
    phrases = [one_line(panel.axes.get("title", ""))]
    for side, name in (("y", "ordinate"), ("x", "abscissa")):
        label = one_line(panel.label(side))
        if not label and panel.events and side == "x":  # only the lowest panel of a column has a label
            label = "time since lift-off (s)"
        limits = _data_range(panel, side)
        if label and limits:
            low, high = limits
            phrases.append(f"{name}: {label} from {low:.4g} to {high:.4g}")
        elif label:
            phrases.append(f"{name}: {label}")
    names = dict.fromkeys(one_line(mark.label) for mark in panel.marks if mark.label)
    if names:
        phrases.append(f"shown: {', '.join(names)}")
    return "; ".join(phrase for phrase in phrases if phrase)


def one_line(text: Any) -> str:
    """Return a text without line breaks."""
    return " ".join(str(text).split())


def _data_range(panel: Panel, side: str) -> tuple[float, float] | None:
    """Return the smallest and the largest coordinate of all marks along an axis; None without data."""
    coordinates = [np.empty(0)]
    for mark in panel.marks:
        if mark.mark_type != "text":
            coordinates += [np.ravel(mark.data[name]) for name in _COORDINATES[side] if name in mark.data]
    values = np.concatenate(coordinates)
    values = values[np.isfinite(values)]
    if not values.size:
        return None
    if panel.axes.get(f"{side}scale") == "root":
        values = np.sqrt(np.maximum(values, 0.0))
    return float(values.min()), float(values.max())


def _floats(values: Any) -> Floats:
    return np.asarray(values, dtype=float)


def _equal_lengths(*values: Any) -> list[Floats]:
    """Return numbers and arrays as arrays of one common length."""
    arrays = [np.atleast_1d(_floats(value)) for value in values]
    return list(np.broadcast_arrays(*arrays))


def named_ticks(names: Sequence[str], first: float = 0.0) -> list[tuple[float, str]]:
    """Return ticks with names at positions `first`, first + 1, ..."""
    return [(first + k, str(name)) for k, name in enumerate(names)]
