"""Figures of a study, from its own tables: one simulated flight, and what a filter's transition misses per step."""

from collections.abc import Sequence

import pandas as pd
from matplotlib.figure import Figure

from lvnav_trade.plots.style import GREY, PALETTE, canvas, legend_below, look

_UNITS = {"velocity": "m/s", "position": "m"}
_ERRORS = (("attitude", "rad", 1e3, "mrad"), ("velocity", "m_per_s", 1.0, "m/s"), ("position", "m", 1.0, "m"))


def single(table: pd.DataFrame) -> Figure:
    """Draw position and velocity axis by axis, the error and its estimate above each other, what is left below; table
    as of campaign.behind.flight_of.
    """
    names = [name.removesuffix("_true") for name in table.columns if name.endswith("_true")]
    kinds = [kind for kind in ("position", "velocity") if any(name.startswith(kind) for name in names)]
    with look():
        figure, grid = canvas(2 * len(kinds), 3, 1.35, sharex=True)
        for row, kind in enumerate(kinds):
            for column, name in enumerate(one for one in names if one.startswith(kind)):
                above, below = grid[2 * row : 2 * row + 2, column]
                above.plot(table.t_s, table[f"{name}_true"], color=PALETTE[1], label="error of the inertial system")
                above.plot(table.t_s, table[f"{name}_estimated"], color="black", ls="--", lw=1.0, label="estimated")
                below.plot(table.t_s, table[f"{name}_left"], color=PALETTE[0], lw=0.9, label="left in the aided output")
                below.axhline(0.0, color=GREY, lw=0.5)
                above.set_title(f"{kind}, {name.removeprefix(f'{kind}_')}", fontsize=8)
                above.set_ylabel(_UNITS[kind])
                below.set_ylabel(f"left ({_UNITS[kind]})")
        for ax in grid[-1]:
            ax.set_xlabel("time since lift-off (s)")
        above, below = (ax.get_legend_handles_labels() for ax in grid[:2, 0])
        figure.legend(above[0] + below[0], above[1] + below[1], loc="outside lower center", ncols=3)
    return figure


def steps(table: pd.DataFrame, phases: Sequence[tuple[str, float, float]] = ()) -> Figure:
    """Draw the unaided error and what the transition misses of it per step, one sigma per axis, logarithmic.

    table as of campaign.estimate.steps_table; phases: name, start and end s, marked by lines.
    """
    with look():
        figure, grid = canvas(3, 1, 1.7)
        for ax, (name, unit, factor, label) in zip(grid[:, 0], _ERRORS, strict=True):
            for column, text, style in (
                (f"{name}_error_{unit}", "error itself", {"color": PALETTE[1], "ls": "--"}),
                (f"{name}_missed_{unit}", "missed by the transition in a step", {"color": PALETTE[0]}),
                (
                    f"{name}_missed_mean_{unit}",
                    "mean of what is missed, norm",
                    {"color": "black", "lw": 0.8, "ls": ":"},
                ),
            ):
                ax.plot(table.t_s, factor * table[column].where(table[column] > 0.0), label=text, **style)
            for _, start, _ in phases:
                ax.axvline(start, color="0.6", lw=0.5)
            ax.set(yscale="log", ylabel=f"{name}, one sigma\n({label})", xlim=(table.t_s.min(), table.t_s.max()))
        grid[-1, 0].set_xlabel("time since lift-off (s)")
        return legend_below(figure, grid[-1, 0])
