"""Figures as PNG and SVG, drawn by matplotlib: for Markdown reports and slides."""

import io
import logging
from collections.abc import Mapping, Sequence
from typing import Any

from lvnav_trade.report.figures.backend import mpl  # before anything else of matplotlib

# isort: split
import numpy as np
from joblib import Parallel, delayed
from joblib.externals.loky.process_executor import TerminatedWorkerError
from matplotlib.axis import Axis, YAxis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure as Drawing
from matplotlib.font_manager import FontProperties
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from PIL import Image

from lvnav_trade.report.figures.figure import GREY, SHADE, Figure, Mark, Panel

_LOG = logging.getLogger("lvnav_trade.report.figures")
# Inches: the text width of an A4 page.
WIDTH = 7.4
COLOURS = 96
"""Number of colours in a picture, far apart. Line art has no visible loss, not even in the colour of a line that is
only in the legend, at a third of the file size.
"""
_EXACT = 24  # most frequent colours, which are exact: a grey shade should not turn pink
# A margin up to the first value applies to abscissas only; that of ordinates is then the second
_NARROW, _ABOVE = 0.02, 0.05
_OVER_AREAS = 1.3  # matplotlib draws areas at 1 and lines at 2
_HANDLE, _LETTER = 0.55, 0.058  # inches: legend handle with its padding, and a letter of 8 points
_COLUMNS = 4  # largest number of legend columns
# Ticks in less than a decade, closer from row to row; the closest, 0.9 and 1, have room for their labels.
_CLOSE = (
    (1.0, 2.0, 5.0),
    (1.0, 1.5, 2.0, 3.0, 5.0, 7.0),
    (1.0, 1.1, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0),
)
_FEW_DECADES = 4
_LOOK: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.titlesize": 8.5,
    "axes.labelsize": 8.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e5e7eb",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "lines.linewidth": 1.3,
    "figure.dpi": 130,
    "savefig.dpi": 130,
    "svg.hashsalt": "lvnav_trade",
}


def files(figures: Mapping[str, Figure], formats: Sequence[str] = ("png",), jobs: int = -1) -> dict[str, bytes]:
    """Return the content of figure files by name, `NAME.FORMAT`.

    Worker processes draw them; if one dies, this process draws them.

    Parameters
    ----------
    figures : mapping
        Figures by name.
    formats : sequence of str
        png, svg.
    jobs : int
        Number of worker processes; -1 for all cores.
    """
    names = [(name, file_format) for name in figures for file_format in formats]
    arguments = [(figures[name], file_format) for name, file_format in names]
    n_jobs = min(jobs, len(names)) if names else 1
    try:
        workers = Parallel(n_jobs=n_jobs, max_nbytes=None)
        contents = workers(delayed(figure_bytes)(*pair) for pair in arguments)
    except TerminatedWorkerError:
        _LOG.warning("a worker process died (out of memory?); the figures are drawn one by one")
        contents = [figure_bytes(*pair) for pair in arguments]
    return {f"{name}.{file_format}": content for (name, file_format), content in zip(names, contents, strict=True)}


def figure_bytes(figure: Figure, ending: str) -> bytes:
    """Return a figure as a file without a date: a small PNG with few colours, or SVG."""
    buffer = io.BytesIO()
    with mpl.rc_context(_LOOK):
        drawing = matplotlib_figure(figure)
        if ending == "svg":
            drawing.savefig(buffer, format="svg", metadata={"Date": None})
            return buffer.getvalue()
        canvas: Any = FigureCanvasAgg(drawing)
        canvas.draw()  # savefig would draw twice, for the layout and for the picture
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
    _few_colours(image).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()


def _few_colours(image: Image.Image) -> Image.Image:
    """Return a picture with `COLOURS` colours; the most frequent colours (shaded areas, grids) are exact."""
    palette_image = image.quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    indices = np.asarray(palette_image).ravel()
    pixels = np.asarray(image).reshape(-1, 3).astype(np.uint32)
    red, green, blue = np.moveaxis(pixels, 1, 0)
    colours = (red << 16) | (green << 8) | blue
    distinct, counts = np.unique(colours, return_counts=True)
    most_frequent = distinct[np.argsort(-counts, kind="stable")][:_EXACT]

    palette = np.array(palette_image.getpalette()).reshape(-1, 3)
    exact: set[int] = set()
    for colour in most_frequent:
        place = int(indices[np.argmax(colours == colour)])
        if place not in exact:  # of colours that were merged, the most frequent
            palette[place] = colour >> 16, (colour >> 8) & 255, colour & 255
            exact.add(place)
    palette_image.putpalette(palette.ravel().tolist())
    return palette_image


@mpl.rc_context(_LOOK)
def matplotlib_figure(figure: Figure) -> Drawing:
    """Return a figure of matplotlib that is not registered with pyplot."""
    options = dict(figure.options)
    title = options.pop("title", "")
    widths = options.pop("widths", None)
    rows, columns = figure.grid.shape
    drawing = Drawing(figsize=(WIDTH, figure.height * rows), layout="constrained")
    grid = drawing.subplots(rows, columns, squeeze=False, width_ratios=widths, **options)
    for axes, panel in zip(grid.ravel(), figure.panels, strict=True):
        if panel.marks:
            _fill(drawing, axes, panel)
        else:
            axes.set_axis_off()
    for axes, panel in zip(grid.ravel(), figure.panels, strict=True):  # after the marks of all that share an axis
        _set_limits(axes, panel)
    for (row, column), panel in np.ndenumerate(figure.grid):
        is_top = all(upper_panel.events is None for upper_panel in figure.grid[:row, column])
        _mark_events(grid[row, column], panel, columns, is_top)
    if title:
        drawing.suptitle(title, fontsize=9)
    _draw_legend(drawing, figure)
    return drawing


def _set_limits(axes: Any, panel: Panel) -> None:
    """Set the limits and the ticks that the panel prescribes."""
    for side in ("x", "y"):
        low, high = panel.axes.get(f"{side}lim", (None, None))
        if low is not None or high is not None:
            axes.set(**{f"{side}lim": (low, high)})
        ticks = panel.axes.get(f"{side}ticks")
        if ticks is not None:
            set_ticks = getattr(axes, f"set_{side}ticks")
            positions = [position for position, _ in ticks]
            labels = [label for _, label in ticks]
            set_ticks(positions, labels, fontsize=7.0)


def _fill(figure: Drawing, axes: Any, panel: Panel) -> None:
    state = panel.axes
    margin = state.get("margin", 0.02)
    axes.margins(margin, margin if margin > _NARROW else _ABOVE)
    _scale(axes, "x", state.get("xscale"))
    _scale(axes, "y", state.get("yscale"))
    for mark in panel.marks:
        _DRAW[mark.mark_type](figure, axes, mark)
    for side in ("x", "y"):
        low, high = state.get(f"{side}lim", (None, None))
        if low is not None and high is None:  # the margin above the data is a fraction of the visible range
            axes.update_datalim([(low, low)], updatex=side == "x", updatey=side == "y")
    axes.set(xlabel=panel.label("x"), ylabel=panel.label("y"), title=state.get("title", ""))
    if state.get("grid") is False:
        axes.grid(visible=False)
    if state.get("equal"):
        axes.set_aspect("equal", adjustable="box" if "xlim" in state else "datalim")


def _scale(axes: Any, side: str, scale: str | None) -> None:
    """Set the scale of an axis, with its ticks."""
    axis = getattr(axes, f"{side}axis")
    if scale == "log":
        axes.set(**{f"{side}scale": "log"})
        axis.set_major_locator(_Decades())
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    elif scale == "root":
        axes.set_yscale("function", functions=(_root, np.square))
        axes.minorticks_off()
    elif not isinstance(axis.get_major_locator(), FixedLocator):  # not fixed by a panel that shares this axis
        axis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]))
        axes.ticklabel_format(axis=side, style="sci", scilimits=(-3, 4))


def _root(y: Any) -> Any:
    return np.sqrt(np.maximum(y, 0.0))


class _Decades(LogLocator):
    """Ticks at decades.

    Within less than four decades, ticks are also at 2 and 5, if there is room; within less than one decade they are
    closer.
    """

    def tick_values(self, vmin: float, vmax: float) -> Any:
        """Return the ticks between two limits."""
        low, high = sorted((vmin, vmax))
        if 0 < low < high < 10 * low:
            return within_a_decade(low, high)
        self.set_params(subs=(1.0, 2.0, 5.0) if self._has_room(low, high) else (1.0,))
        return super().tick_values(vmin, vmax)

    def _has_room(self, low: float, high: float) -> bool:
        """Return whether numbers at 1, 2 and 5 in each decade do not overlap."""
        if low <= 0 or np.floor(np.log10(high)) - np.ceil(np.log10(low)) >= _FEW_DECADES - 1:
            return False
        room = self.axis.get_tick_space() if isinstance(self.axis, Axis) else _FEW_DECADES
        if isinstance(self.axis, YAxis):
            room *= 2  # matplotlib counts a blank line between two numbers
        n_ticks = 3.0 * np.log10(high / low)
        return bool(n_ticks <= max(3, room))


def within_a_decade(low: float, high: float) -> list[float]:
    """Return at least four ticks of a logarithmic axis that spans less than a decade, as few as possible."""
    power = 10.0 ** np.floor(np.log10(low))
    for multiples in _CLOSE:
        candidates = [multiple * scale for scale in (power, 10.0 * power) for multiple in multiples]
        ticks = [tick for tick in map(_six_digits, candidates) if low <= tick <= high]
        if len(ticks) >= 4:
            return ticks
    linear_ticks = MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)
    return [_six_digits(tick) for tick in linear_ticks]


def _six_digits(value: float) -> float:
    return float(f"{value:.6g}")


def _mark_style(mark: Mark, *names: str) -> dict[str, Any]:
    """Return the style of a mark that is set under these names, and its label."""
    look = {name: mark.style[name] for name in names if name in mark.style}
    look["label"] = mark.label or None
    return look


def _line(_: Drawing, axes: Any, mark: Mark) -> None:
    style = _mark_style(mark, "color", "ls", "lw", "alpha", "marker", "ms", "mfc")
    if mark.style.get("step"):
        style["drawstyle"] = "steps-post"
    if "every" in mark.style:
        style["markevery"] = mark.style["every"]
    if style.get("color") == "white":  # so that the legend shows it too
        outline_width = float(mark.style.get("lw", 1.3)) + 1.5
        style["path_effects"] = [withStroke(linewidth=outline_width, foreground="black")]
    axes.plot(mark.data["x"], mark.data["y"], **style)


def _band(_: Drawing, axes: Any, mark: Mark) -> None:
    x, low, high = mark.data["x"], mark.data["low"], mark.data["high"]
    step = "post" if mark.style.get("step") else None
    axes.fill_between(x, low, high, step=step, **_area(mark))


def _area(mark: Mark) -> dict[str, Any]:
    """Return the style of an area for matplotlib."""
    style = _mark_style(mark, "alpha", "hatch", "lw")
    style["facecolor"] = mark.style.get("color", SHADE)
    style["edgecolor"] = mark.style.get("ec", "none")
    return style


def _boxes(_: Drawing, axes: Any, mark: Mark) -> None:
    x0, x1, y0, y1 = (mark.data[name] for name in ("x0", "x1", "y0", "y1"))
    style = _area(mark)
    if not x0.size:
        axes.fill_between([], [], [], **style)
    elif np.isinf(x0).any():
        for low, high in zip(y0, y1, strict=True):
            axes.axhspan(low, high, zorder=0, **style)
    elif np.isinf(y0).any():
        for low, high in zip(x0, x1, strict=True):
            axes.axvspan(low, high, zorder=0, **style)
    else:
        axes.bar(x0, y1 - y0, x1 - x0, y0, align="edge", **style)


def _limit(_: Drawing, axes: Any, mark: Mark) -> None:
    line = axes.axhline if mark.style["axis"] == "y" else axes.axvline
    line(mark.data["at"], **_mark_style(mark, "color", "ls", "lw", "alpha"))


def _text(_: Drawing, axes: Any, mark: Mark) -> None:
    style = mark.style
    frames: dict[Any, Any] = {
        (True, True): axes.transAxes,
        (True, None): axes.get_yaxis_transform(),
    }
    is_fraction = style.get("x_part"), style.get("y_part")
    for x, y, text in zip(mark.data["x"], mark.data["y"], mark.data["texts"], strict=True):
        axes.text(
            x,
            y,
            text,
            transform=frames.get(is_fraction, axes.transData),
            fontsize=7.0,
            ha=style.get("ha", "left"),
            va=style.get("va", "center"),
            color=style.get("color", "black"),
        )


def _cells(figure: Drawing, axes: Any, mark: Mark) -> None:
    axes.tick_params(axis="y", length=0)
    values = np.ma.masked_invalid(mark.data["values"])
    norm = LogNorm(*mark.data["scale"])
    cells = axes.pcolormesh(mark.data["x"], mark.data["y"], values, norm=norm, cmap=mark.style["cmap"])
    if mark.label:
        plain = FuncFormatter(lambda value, _: f"{value:g}")
        figure.colorbar(cells, ax=axes, pad=0.09, fraction=0.035, label=mark.label, format=plain)


_DRAW = {"line": _line, "band": _band, "boxes": _boxes, "limit": _limit, "text": _text, "cells": _cells}


def _mark_events(axes: Any, panel: Panel, columns: int, has_numbers: bool) -> None:
    """Draw events as thin lines with numbers at the top, faults as shaded areas, momentary faults as thick lines."""
    if panel.events is None:
        return
    low, high = axes.get_xlim()
    for _, start, end in panel.events.faults:
        if end > start:
            axes.axvspan(
                start,
                end,
                lw=0,
                zorder=_OVER_AREAS,
                color="black" if panel.has_opaque_areas else SHADE,
                alpha=0.18 if panel.has_opaque_areas else 0.25,
            )
        else:
            axes.axvline(start, color=GREY, alpha=0.7, lw=2.4, ls=(0, (1.2, 0.8)), zorder=1.4)
    visible_times = dict.fromkeys(t for _, t in panel.events.points if low <= t <= high)
    for t in visible_times:
        axes.axvline(t, color=GREY, lw=0.7, zorder=1.5)
    if not has_numbers:
        return
    for t, numbers in panel.events.groups(low, high, columns):
        axes.annotate(
            numbers,
            (t, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 2),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=6.5,
            color=GREY,
            annotation_clip=False,
        )


def _draw_legend(drawing: Drawing, figure: Figure) -> None:
    """Draw one legend for all panels below the figure."""
    handles: dict[str, Any] = {}
    for axes in drawing.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    labels = {mark.label for mark in figure.legend()}
    entries = {label: handle for label, handle in handles.items() if label in labels}
    if not entries:
        drawing.supxlabel(figure.key, fontsize=7.0, color=GREY)
        return
    legend = drawing.legend(
        list(entries.values()),
        list(entries),
        loc="outside lower center",
        ncols=_column_count(list(entries), _COLUMNS),
    )
    if figure.key:
        legend.set_title(figure.key, FontProperties(size=7.0))
        legend.get_title().set_color(GREY)


def _column_count(labels: list[str], max_count: int) -> int:
    """Return the number of legend columns that fit across the page; the legend is filled column by column."""
    for count in range(min(max_count, len(labels)), 1, -1):
        columns = np.array_split(np.array(labels, dtype=object), count)
        widths = [_HANDLE + _LETTER * max(map(len, column)) for column in columns]
        if sum(widths) <= WIDTH:
            return count
    return 1
