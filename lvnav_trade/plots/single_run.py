"""One flight: the error of an inertial system, what a filter estimates of it, and what is left."""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from lvnav_trade.plots.style import GREY, PALETTE, canvas, look

_UNITS = {"velocity": "m/s", "position": "m"}


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
                above, below = grid[2 * row, column], grid[2 * row + 1, column]
                above.plot(table.t_s, table[f"{name}_true"], color=PALETTE[1], label="error of the inertial system")
                above.plot(table.t_s, table[f"{name}_estimated"], color="black", ls="--", lw=1.0, label="estimated")
                below.plot(table.t_s, table[f"{name}_left"], color=PALETTE[0], lw=0.9, label="left in the aided output")
                below.axhline(0.0, color=GREY, lw=0.5)
                above.set_title(f"{kind}, {name.removeprefix(f'{kind}_')}", fontsize=8)
                above.set_ylabel(_UNITS[kind])
                below.set_ylabel(f"left ({_UNITS[kind]})")
        for ax in grid[-1]:
            ax.set_xlabel("time since lift-off (s)")
        handles, labels = zip(
            *(pair for ax in grid[:2, 0] for pair in zip(*ax.get_legend_handles_labels(), strict=True)), strict=True
        )
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure
