"""Common style of figures: colours distinguishable for the colour-blind, events of a flight, scales of axes."""

from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
import pandas as pd

from lvnav_trade.report.figures.figure import GREY, Figure, Panel, events_of, panel
from lvnav_trade.report.figures.overlap import widen_covered
from lvnav_trade.results.statistics.select import pick
from lvnav_trade.results.tables.read import Tables, load

# All figures by name, registered by `drawing`
PLOTS: dict[str, Callable[..., Any]] = {}
_Options = ParamSpec("_Options")
_FigureT = TypeVar("_FigureT")
# Colours of Okabe and Ito, strongest contrasts first. Each has its own dashes for grey prints; further cases combine
# colours and dashes in another order.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8C6D31")
DASHES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (6, 1.5, 1, 1.5, 1, 1.5)), (0, (7, 2.5)), (0, (3, 1.2)))
MARKERS = "os^Dv<>p"
_DEEPEST = 1e6  # largest range of a logarithmic axis
_PAUSE = 5.0  # number of usual steps without data that makes a gap
_LOGARITHMIC = 30  # ratio of the largest to the smallest value from which an axis is logarithmic


def drawing(
    plot: Callable[Concatenate[Tables, _Options], _FigureT],
) -> Callable[Concatenate[Path | str | Tables, _Options], _FigureT]:
    """Register a figure in `PLOTS`; its function then accepts a folder of results too, and widens hidden lines."""

    @wraps(plot)
    def draw(results: Path | str | Tables, /, *args: _Options.args, **kwargs: _Options.kwargs) -> _FigureT:
        figure = plot(load(results), *args, **kwargs)
        if isinstance(figure, Figure):
            widen_covered(figure)
        return figure

    PLOTS[plot.__name__] = draw
    return draw


def line_of(number: int) -> dict[str, Any]:
    """Return colour and dashes of a case by its number; the first 56 are different."""
    colour = PALETTE[number % len(PALETTE)]
    dashes = DASHES[number % len(DASHES)]
    return {"color": colour, "ls": dashes}


def over_time(
    panels: Sequence[Panel],
    tables: Tables,
    case: str,
    margin: float = 0.01,
    label: str = "time since lift-off (s)",
) -> None:
    """Mark the events of a case in a column of panels, and label the time axis of the last.

    margin : margin of the panels, see `Panel.set`
    """
    events = events_of(pick(tables.events, case=case))
    for ax in panels:
        ax.events = events
        ax.set(margin=margin)
    panels[-1].set(xlabel=label)


def message(text: str, xlabel: str, ylabel: str) -> Figure:
    """Return a figure with a message in place of data, with labelled axes."""
    figure, ax = panel(1.6)
    ax.text(0.5, 0.5, text, x_part=True, y_part=True, ha="center", color=GREY)
    ax.set(xlabel=xlabel, ylabel=ylabel, xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    return figure


def with_gaps(rows: pd.DataFrame) -> pd.DataFrame:
    """Return rows over time (t_s) with an empty row in every pause, so that lines are interrupted there."""
    step = rows.t_s.diff()
    usual_step = step.median()
    pauses = rows[step > _PAUSE * usual_step]
    if not len(pauses):
        return rows
    columns = rows.columns.difference(["case"])
    empty = pd.DataFrame(np.nan, index=pauses.index, columns=columns)
    empty["t_s"] = pauses.t_s - 1e-3 * usual_step
    return pd.concat([rows, empty]).sort_values("t_s", kind="stable")


def scale_up(ax: Panel, side: str, values: Iterable[float], from_zero: bool = True) -> None:
    """Make an axis logarithmic if its values span a factor of 30, otherwise begin it at zero.

    side : "x" or "y"
    values : all drawn values, in display units
    from_zero : whether a linear axis begins at zero
    """
    positive_values = [float(value) for value in values if 0.0 < value < np.inf]
    is_logarithmic = False
    if positive_values:
        low = min(positive_values)
        high = max(positive_values)
        ax.spans[side] = low, high
        is_logarithmic = high > _LOGARITHMIC * low
    if is_logarithmic:
        ax.set(**{f"{side}scale": "log"})
    elif from_zero:
        ax.set(**{f"{side}lim": 0.0})


def share_scales(figures: Iterable[Figure]) -> None:
    """Give the ordinates of several figures the same scale, and ordinates with equal labels the same limits.

    The scale is logarithmic if the values of any label span a factor of 30, as in `scale_up`. Panels whose scale was
    not chosen by `scale_up` are unchanged.
    """
    panels = [ax for figure in figures for ax in figure.panels if "y" in ax.spans]
    spans = _label_spans(panels)
    # Labels are read before any scale changes, because the label of a logarithmic axis names its scale
    panel_spans = [spans[ax.label("y")] for ax in panels]
    is_logarithmic = any(high > _LOGARITHMIC * low for low, high in spans.values())
    for ax, (low, high) in zip(panels, panel_spans, strict=True):
        if is_logarithmic:
            low = max(low, high / _DEEPEST)
            margin_factor = (high / low) ** 0.05 if high > low else 1.5
            ax.set(yscale="log", ylim=(low / margin_factor, high * margin_factor))
        else:
            ax.set(yscale="linear", ylim=(0.0, 1.05 * high))


def _label_spans(panels: Iterable[Panel]) -> dict[str, tuple[float, float]]:
    """Return the smallest and the largest ordinate of all panels with the same label, by label."""
    spans: dict[str, tuple[float, float]] = {}
    for ax in panels:
        label = ax.label("y")
        low, high = ax.spans["y"]
        lowest, highest = spans.get(label, (np.inf, 0.0))
        lowest = min(low, lowest)
        highest = max(high, highest)
        spans[label] = (lowest, highest)
    return spans
