"""One look for all figures: sizes for a printed page, colours that the colour-blind can tell apart, marks of events."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from itertools import pairwise
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from lvnav_trade.metrics.basics.select import pick
from lvnav_trade.records import Floats
from lvnav_trade.store.read import Tables, load

# Every figure by name, as `drawing` finds them
PLOTS: dict[str, Callable[..., Any]] = {}
_Options = ParamSpec("_Options")
_Drawn = TypeVar("_Drawn")
# Inches: the text width of an A4 page.
WIDTH = 7.4
# Okabe and Ito's colours, darkest contrasts first; further cases repeat them with other dashes.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8C6D31")
DASHES = ("-", "--", "-.", ":")
GREY = "#6b7280"
_HANDLE, _LETTER = 0.55, 0.058  # inches of a legend's line with what is around it, and of a letter of 8 points
_SLANTED = 0.042  # inches across the page of a slanted letter of an event's name
_PAUSE = 5.0  # usual steps without a row
_APART, _KEY_LENGTH = "   ", 105  # between events of a key; letters of 7.5 points that the page's width has room for

_LOOK: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.titlesize": 9.0,
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


@contextmanager
def look() -> Iterator[None]:
    """Fill and save figures in one look; as a decorator too."""
    with mpl.rc_context(_LOOK):
        yield


@look()
def canvas(rows: int = 1, columns: int = 1, height: float = 2.6, **kwargs: Any) -> tuple[Figure, Any]:
    """Return a figure of the page's width with rows x columns axes (always a 2-D array), `height` inches per row.

    It is not registered with pyplot: nothing piles up, and threads may draw.
    """
    figure = Figure(figsize=(WIDTH, height * rows), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **kwargs)


def panel(height: float) -> tuple[Figure, Any]:
    """Return a figure of one panel, and its axes."""
    figure, grid = canvas(1, 1, height)
    return figure, grid[0, 0]


def drawing(
    plot: Callable[Concatenate[Tables, _Options], _Drawn],
) -> Callable[Concatenate[Path | str | Tables, _Options], _Drawn]:
    """Put a plot of tables among `PLOTS`; return it so that it takes a results folder too and draws in one look."""

    @wraps(plot)
    @look()
    def drawn(results: Path | str | Tables, /, *args: _Options.args, **kwargs: _Options.kwargs) -> _Drawn:
        return plot(load(results), *args, **kwargs)

    PLOTS[plot.__name__] = drawn
    return drawn


def line_of(number: int) -> dict[str, Any]:
    """Return colour and dashes of the case of that number."""
    return {"color": PALETTE[number % len(PALETTE)], "linestyle": DASHES[(number // len(PALETTE)) % len(DASHES)]}


def mark_events(axes: Axes, events: pd.DataFrame, names: bool = True, numbers: bool = False) -> None:
    """Draw events as thin vertical lines and shade faults, those of a moment as thick lines; names stand at the top.

    Close events share a name. events: rows of the table `events` of one case; numbers: where panels are narrow,
    numbers stand in place of names (their key: `event_key`).
    """
    low, high = axes.get_xlim()
    place = axes.get_subplotspec()
    room = 0.032 * (place.get_gridspec().ncols if place is not None and numbers else 1) * (high - low)
    for fault in events[events.kind == "fault"].itertuples():
        if fault.t_end_s > fault.t_s:
            axes.axvspan(fault.t_s, fault.t_end_s, color="#9ca3af", alpha=0.25, linewidth=0, zorder=0)
        else:
            axes.axvline(fault.t_s, color=GREY, alpha=0.7, linewidth=2.4, linestyle=(0, (1.2, 0.8)), zorder=1.4)
    flown = _flown(events)
    flown = flown[flown.t_s.between(low, high)]
    for t in flown.t_s.unique():
        axes.axvline(t, color=GREY, linewidth=0.7, zorder=1.5)
    if names:
        groups = _groups(flown.t_s.to_numpy(), room)
        starts = [(float(flown.t_s.iloc[first]) - low) / (high - low) for first, _ in groups]
        leftward = _leftward(starts)
        if numbers:
            texts = [str(i + 1) if i == j else f"{i + 1}-{j + 1}" for i, j in groups]
        else:
            inches = starts and axes.get_position().width * WIDTH
            texts = _apart(
                [list(flown.event.iloc[i : j + 1]) for i, j in groups], np.multiply(starts, inches), leftward
            )
        for (first, _), text, left in zip(groups, texts, leftward, strict=True):
            _name(axes, float(flown.t_s.iloc[first]), text, numbers, left)


def over_time(
    panels: Sequence[Axes],
    tables: Tables,
    case: str,
    margin: float = 0.01,
    names: bool = True,
    numbers: bool = False,
    label: str = "time since lift-off (s)",
) -> None:
    """Mark the events of a case in panels one below the other, named above the first, and label time below the last."""
    for number, axes in enumerate(panels):
        axes.margins(x=margin)
        mark_events(axes, pick(tables.events, case=case), names=names and number == 0, numbers=numbers)
    panels[-1].set_xlabel(label)


def message(text: str, xlabel: str, ylabel: str) -> Figure:
    """Return a figure that says why there is nothing to draw."""
    figure, ax = panel(1.6)
    ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", color=GREY)
    ax.set(xlabel=xlabel, ylabel=ylabel)
    return figure


def event_key(events: pd.DataFrame) -> str:
    """Return what the numbers of `mark_events` stand for, in lines of similar length that a figure has room for."""
    names = [f"{number} {name.replace('_', ' ')}" for number, name in enumerate(_flown(events).event, start=1)]
    ends = np.cumsum([len(name) + len(_APART) for name in names])
    count = max(1 + (len(names) > 6), math.ceil(ends[-1] / _KEY_LENGTH)) if names else 0
    line = np.minimum((ends - 1) * count // ends[-1], count - 1) if names else ends
    return "\n".join(_APART.join(np.array(names)[line == number]) for number in range(count))


def _flown(events: pd.DataFrame) -> pd.DataFrame:
    return events[events.kind == "event"].sort_values(["t_s", "event"], kind="stable")


def _groups(t: Floats, room: float) -> list[tuple[int, int]]:
    """Return (first, last) of each group of events that are closer than `room` to its first."""
    firsts: list[int] = []
    for index, time in enumerate(t):
        if not firsts or time - t[firsts[-1]] >= room:
            firsts.append(index)
    return [(first, after - 1) for first, after in pairwise([*firsts, len(t)])]


def _leftward(starts: list[float]) -> list[bool]:
    """Return which names lean to the left: where the last stands near the right edge, all after the widest gap of the
    right half, so that no two lean towards each other where they are close. starts: parts of the axis.
    """
    if not starts or starts[-1] <= 0.85:
        return [False] * len(starts)
    gaps = [(start - before, start) for before, start in zip([0.5, *starts], starts, strict=False) if start > 0.5]
    turn = max(gaps)[1]
    return [start >= turn for start in starts]


def _apart(groups: list[list[str]], places: Floats, leftward: list[bool]) -> list[str]:
    """Return the names of groups of events at places (inches); where two that lean towards each other would meet, each
    names the first of its group.
    """
    texts = [", ".join(names) if len(names) <= 2 else f"{names[0]} ... {names[-1]}" for names in groups]
    if True not in leftward or leftward[0]:
        return texts
    turn = leftward.index(True)
    if _SLANTED * (len(texts[turn - 1]) + len(texts[turn])) > places[turn] - places[turn - 1]:
        for k in (turn - 1, turn):
            texts[k] = groups[k][0] + (" ..." if len(groups[k]) > 1 else "")
    return texts


def _name(axes: Axes, t: float, name: str, upright: bool, leftward: bool) -> None:
    """Write a name at the top; near the right edge it leans to the left, so that it needs no room beside the axes."""
    leans = (0, "center", 0.0), (-38, "right", -1.5), (38, "left", 1.5)
    rotation, side, shift = leans[0 if upright else 1 if leftward else 2]
    axes.annotate(
        name.replace("_", " "),
        (t, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(shift, 2),
        textcoords="offset points",
        fontsize=6.5,
        color=GREY,
        va="bottom",
        annotation_clip=False,
        rotation=rotation,
        ha=side,
    )


def legend_below(figure: Figure, axes: Axes, columns: int = 4) -> Figure:
    """Return the figure with one legend for all axes below, where it hides nothing, in as many columns as have room."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=_fitting(labels, columns))
    return figure


def _fitting(labels: list[str], most: int) -> int:
    """Return in how many columns a legend has room across the page; it is filled column by column."""
    for count in range(min(most, len(labels)), 1, -1):
        longest = [max(map(len, part)) for part in np.array_split(np.array(labels, dtype=object), count)]
        if sum(_HANDLE + _LETTER * length for length in longest) <= WIDTH:
            return count
    return 1


def with_gaps(rows: pd.DataFrame) -> pd.DataFrame:
    """Return rows over time (t_s) with an empty one in every pause, so that a line ends there and begins again."""
    step = rows.t_s.diff()
    pauses = rows[step > _PAUSE * step.median()]
    empty = pd.DataFrame(np.nan, index=pauses.index, columns=rows.columns.difference(["case"]))
    empty["t_s"] = pauses.t_s - 1e-3 * step.median()
    return pd.concat([rows, empty]).sort_values("t_s", kind="stable") if len(pauses) else rows


def scale_up(axis: Any, values: Iterable[float], from_zero: bool = True) -> None:
    """Make an axis (ax.xaxis or ax.yaxis) logarithmic where its values span a factor of 30, else begin it at zero."""
    found = [value for value in values if value == value and value > 0]
    if found and max(found) > 30 * min(found):
        axis.axes.set(**{f"{axis.axis_name}scale": "log"})
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if max(found) < 300 * min(found) else (1.0,)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    elif from_zero:
        axis.axes.set(**{f"{axis.axis_name}lim": 0})
