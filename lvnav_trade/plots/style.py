"""What figures have in common: colours that the colour-blind can tell apart, events of a flight, scales of axes."""

from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.select import pick
from lvnav_trade.plots.figure import GREY, Figure, Panel, events_of, panel
from lvnav_trade.plots.overlap import widen_covered
from lvnav_trade.store.read import Tables, load

# Every figure by name, as `drawing` finds them
PLOTS: dict[str, Callable[..., Any]] = {}
_Options = ParamSpec("_Options")
_Drawn = TypeVar("_Drawn")
# Okabe and Ito's colours, darkest contrasts first; each has dashes of its own for prints in grey, and further cases
# have them in another order.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8C6D31")
DASHES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (6, 1.5, 1, 1.5, 1, 1.5)), (0, (7, 2.5)), (0, (3, 1.2)))
MARKERS = "os^Dv<>p"
_DEEPEST = 1e6  # factor that a logarithmic axis shows at most
_PAUSE = 5.0  # usual steps without a row


def drawing(
    plot: Callable[Concatenate[Tables, _Options], _Drawn],
) -> Callable[Concatenate[Path | str | Tables, _Options], _Drawn]:
    """Put a plot of tables among `PLOTS`; return it so that it takes a results folder too, with no line hidden."""

    @wraps(plot)
    def drawn(results: Path | str | Tables, /, *args: _Options.args, **kwargs: _Options.kwargs) -> _Drawn:
        found = plot(load(results), *args, **kwargs)
        if isinstance(found, Figure):
            widen_covered(found)
        return found

    PLOTS[plot.__name__] = drawn
    return drawn


def line_of(number: int) -> dict[str, Any]:
    """Return colour and dashes of the case of that number; 56 numbers differ."""
    return {"color": PALETTE[number % len(PALETTE)], "ls": DASHES[number % len(DASHES)]}


def over_time(
    panels: Sequence[Panel],
    tables: Tables,
    case: str,
    margin: float = 0.01,
    label: str = "time since lift-off (s)",
) -> None:
    """Mark the events of a case in panels one below the other, and label time below the last."""
    events = events_of(pick(tables.events, case=case))
    for one in panels:
        one.events = events
        one.set(margin=margin)
    panels[-1].set(xlabel=label)


def message(text: str, xlabel: str, ylabel: str) -> Figure:
    """Return a figure that says why there is nothing to draw."""
    figure, ax = panel(1.6)
    ax.text(0.5, 0.5, text, x_part=True, y_part=True, ha="center", color=GREY)
    ax.set(xlabel=xlabel, ylabel=ylabel, xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    return figure


def with_gaps(rows: pd.DataFrame) -> pd.DataFrame:
    """Return rows over time (t_s) with an empty one in every pause, so that a line ends there and begins again."""
    step = rows.t_s.diff()
    pauses = rows[step > _PAUSE * step.median()]
    empty = pd.DataFrame(np.nan, index=pauses.index, columns=rows.columns.difference(["case"]))
    empty["t_s"] = pauses.t_s - 1e-3 * step.median()
    return pd.concat([rows, empty]).sort_values("t_s", kind="stable") if len(pauses) else rows


def scale_up(ax: Panel, side: str, values: Iterable[float], from_zero: bool = True) -> None:
    """Make an axis ("x" or "y") logarithmic where its values span a factor of 30, else begin it at zero."""
    found = [float(value) for value in values if 0.0 < value < np.inf]
    if found:
        ax.spans[side] = min(found), max(found)
    if found and max(found) > 30 * min(found):
        ax.set(**{f"{side}scale": "log"})
    elif from_zero:
        ax.set(**{f"{side}lim": 0.0})


def share_scales(figures: Iterable[Figure]) -> None:
    """Give the ordinates of figures that are compared one scale, and those with one label the same limits.

    The scale is logarithmic where the values of any label span a factor of 30, as of `scale_up`; other axes stay.
    """
    panels = [one for figure in figures for one in figure.panels if "y" in one.spans]
    spans: dict[str, tuple[float, float]] = {}
    for one in panels:
        low, high = one.spans["y"]
        least, most = spans.get(one.label("y"), (np.inf, 0.0))
        spans[one.label("y")] = min(low, least), max(high, most)
    alike = {id(one): spans[one.label("y")] for one in panels}
    logarithmic = any(high > 30 * low for low, high in spans.values())
    for one in panels:
        low, high = alike[id(one)]
        low = max(low, high / _DEEPEST)
        room = (high / low) ** 0.05 if high > low else 1.5
        limits = (low / room, high * room) if logarithmic else (0.0, 1.05 * high)
        one.set(yscale="log" if logarithmic else "linear", ylim=limits)
