"""Flown missions among our flights: the distribution of an error, with every published flight marked in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from lvnav_trade.metrics.published.published import cases_of, ours
from lvnav_trade.plots.style import PALETTE, canvas, legend_below, line_of, look
from lvnav_trade.store import Tables, load


def missions(results: Path | str | Tables, flown: Sequence[Mapping[str, Any]]) -> Figure | None:
    """Draw which part of our flights has an error below so much, a panel for every metric, and each flown mission's own
    as a line; None without missions or runs. Items are named 'MISSION, WHAT'.
    """
    tables = load(results)
    metrics = list(dict.fromkeys(one["metric"] for one in flown))
    names = list(dict.fromkeys(str(one["item"]).partition(",")[0] for one in flown))
    panels = []
    for metric in metrics:
        mine = [one for one in flown if one["metric"] == metric]
        case = next(iter(cases_of(tables, mine[0].get("case") or {})), None)
        found = np.empty(0) if case is None else ours(tables, case, mine[0], str(mine[0]["unit"])).runs
        if len(found) < 2:
            return None
        panels.append((metric, mine, np.sort(found[np.isfinite(found)])))
    if not panels:
        return None
    with look():
        figure, grid = canvas(1, len(panels), 2.6, sharey=True)
        for ax, (metric, mine, found) in zip(grid[0], panels, strict=True):
            part = 100.0 * np.arange(1, len(found) + 1) / len(found)
            ax.step(found, part, where="post", color="black", lw=1.2, label=f"our {len(found)} flights")
            for one in mine:
                name = str(one["item"]).partition(",")[0]
                style = line_of(names.index(name))
                ax.axvline(
                    float(one["value"]), lw=1.3, label=name, **{k: style[k] for k in ("color", "ls") if k in style}
                )
            rms = float(np.sqrt(np.mean(found**2)))
            ax.axvline(rms, color=PALETTE[0], lw=3.5, alpha=0.3, label="our RMS")
            ax.set_xlim(0.0, max(found[int(0.995 * (len(found) - 1))], 1.1 * max(float(one["value"]) for one in mine)))
            ax.set_ylim(0.0, 100.0)
            ax.set_xlabel(f"|{metric.replace('_', ' ')}| ({mine[0]['unit']})")
        grid[0, 0].set_ylabel("flights below (%)")
        legend_below(figure, grid[0, 0])
    return figure
