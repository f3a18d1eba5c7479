"""Figure of the value of a statement along one of the axes."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from lvnav_studies.evaluate import bounds, locus
from lvnav_trade.api.figures import PALETTE, Figure, level_sizes, line_of, mark_levels, panel, widen_covered
from lvnav_trade.api.measures import NUMBERS, Tables


def bound(tables: Tables, statement: Mapping[str, Any]) -> Figure:
    """Draw the value of a statement over its axis, by formal sigma, true error and runs, with its bounds as lines."""
    figure, ax = panel(3.0)
    runs = 1
    columns = (*(statement.get("tested_by") or NUMBERS), "true")
    for number, (open_levels, values) in enumerate(locus(tables, statement)):
        names = [level for level, _ in values]
        sizes, unit_of_axis = level_sizes(names)
        runs = max([runs, *(value.runs for _, value in values)])
        for column, style in (("formal", ":"), ("true", "-"), ("monte_carlo", "--")):
            y = [getattr(value, column) for _, value in values]
            if column in columns and np.isfinite(y).any():
                label = column.replace("_", " ")
                if open_levels:
                    label = f"{open_levels}: {label}"
                colour = line_of(number)["color"]
                ax.plot(sizes, y, marker="o", ms=3.5, label=label, color=colour, ls=style)
        mark_levels(ax, sizes, names, unit_of_axis)
    for limit in bounds(statement, runs):
        if np.isfinite(limit):
            ax.axhline(limit, color=PALETTE[1], lw=1.2, label="bound")
    unit = str(statement.get("unit") or "-")
    axis_label = str(statement["along"]).replace("_", " ")
    if unit_of_axis:
        axis_label = f"{axis_label} ({unit_of_axis})"
    ax.set(
        xlabel=axis_label,
        ylabel=f"{statement['value']} ({unit})",
    )
    widen_covered(figure)
    return figure
