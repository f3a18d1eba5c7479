"""The error per step of a filter's transition over the flight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from lvnav_trade.plots.style import PALETTE, canvas, legend_below, look

_ROWS = (
    ("attitude", "rad", 1e3, "mrad"),
    ("velocity", "m_per_s", 1.0, "m/s"),
    ("position", "m", 1.0, "m"),
)


def steps(table: pd.DataFrame, phases: Sequence[tuple[str, float, float]] = ()) -> Figure:
    """Draw the unaided error and what the transition misses of it per step, one sigma per axis, logarithmic.

    table as of campaign.estimate.steps_table; phases: name, start and end s, marked by lines.
    """
    with look():
        figure, grid = canvas(3, 1, 1.7)
        for ax, (name, unit, factor, label) in zip(grid[:, 0], _ROWS, strict=True):
            error, missed = table[f"{name}_error_{unit}"], table[f"{name}_missed_{unit}"]
            drawn = missed.where(missed > 0.0, np.nan)
            mean = table[f"{name}_missed_mean_{unit}"]
            ax.plot(
                table.t_s, factor * error.where(error > 0.0, np.nan), color=PALETTE[1], ls="--", label="error itself"
            )
            ax.plot(table.t_s, factor * drawn, color=PALETTE[0], label="missed by the transition in a step")
            ax.plot(table.t_s, factor * mean.where(mean > 0.0, np.nan), color="black", lw=0.8, ls=":",
                    label="mean of what is missed, norm")  # fmt: skip
            for _, start, _ in phases:
                ax.axvline(start, color="0.6", lw=0.5)
            ax.set_yscale("log")
            ax.set_ylabel(f"{name}, one sigma\n({label})")
            ax.set_xlim(table.t_s.min(), table.t_s.max())
        grid[-1, 0].set_xlabel("time since lift-off (s)")
        legend_below(figure, grid[-1, 0])
    return figure
