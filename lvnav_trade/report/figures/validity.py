"""Where linear covariance holds: the result of the spot check over the two axes of a campaign."""

import numpy as np
import pandas as pd

from lvnav_trade.report.figures.figure import Figure, named_ticks, panel
from lvnav_trade.report.figures.style import drawing
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.tables.read import Tables

_WORST = 100.0  # larger ratios have its colour
_DARK = 15.0  # above it the colour asks for white letters


def is_a_grid(tables: Tables) -> bool:
    """Whether every pair of the levels of just two axes is one case."""
    levels = pd.DataFrame(tables.levels).T
    return levels.shape[1] == 2 and len(levels) > 3 and len(levels) == int(levels.nunique().prod())


@drawing
def validity(tables: Tables) -> Figure:
    """Draw for every case of a grid of two axes the ratio of RMS to linear covariance that is furthest from one.

    A cross marks the cases that the spot check does not confirm, a dash those that linear covariance does not describe.
    """
    frame = METRICS["spot_check"](tables)
    sizes = frame[frame.unit != ""]
    # infinite where a run failed
    furthest = np.exp(np.abs(np.log(sizes.ratio.clip(1.0 / _WORST, _WORST)))).groupby(sizes.case).max()
    refuted = frame.verdict.eq("disagree").groupby(frame.case).any()
    outside = frame.verdict.eq("not applicable").groupby(frame.case).any()
    levels = pd.DataFrame(tables.levels).T
    (across, columns), (down, rows) = ((name, list(dict.fromkeys(levels[name]))) for name in levels)
    image, marks = np.full((len(rows), len(columns)), np.nan), {}
    for case, label in tables.labels.items():
        at = rows.index(levels.loc[case, down]), columns.index(levels.loc[case, across])
        image[at] = furthest.get(label, np.nan)
        marks[at] = "–" if outside.get(label, False) else "✗" if refuted.get(label, False) else ""
    figure, ax = panel(1.3 + 0.32 * len(rows))
    label = "furthest ratio of RMS\nto linear covariance (-)"
    across_edges, down_edges = (np.arange(count + 1) for count in image.T.shape)
    ax.cells(across_edges, down_edges, image, (1.0, _WORST), cmap="YlOrBr", label=label)
    for (row, column), mark in marks.items():
        ratio = image[row, column]
        size = "" if np.isnan(ratio) else f"> {_WORST:g}" if ratio >= _WORST else f"{ratio:.2g}"
        colour = "white" if ratio > _DARK else "black"
        ax.text(column + 0.5, row + 0.5, f"{mark} {size}".strip(), ha="center", color=colour)
    ax.set(xticks=named_ticks(columns, 0.5), xlabel=across.replace("_", " "), xlim=(0.0, float(len(columns))))
    ax.set(yticks=named_ticks(rows, 0.5), ylabel=down.replace("_", " "), ylim=(0.0, float(len(rows))), grid=False)
    return figure
