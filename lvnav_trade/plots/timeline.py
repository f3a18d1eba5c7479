"""What the channels of the receiver do with every satellite, over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from lvnav_trade.plots.style import PALETTE, canvas, look, mark_events
from lvnav_trade.store import Tables, load

_LOOKS: dict[str, tuple[float, dict[str, Any]]] = {
    "track": (0.8, {"facecolor": PALETTE[0]}),
    "acquire": (0.6, {"facecolor": PALETTE[5], "edgecolor": "black", "linewidth": 0.3}),
    "search": (0.42, {"facecolor": PALETTE[4], "edgecolor": "white", "hatch": "////", "linewidth": 0.0}),
    "lost": (0.14, {"facecolor": PALETTE[1]}),
}
"""Height of a bar and its look: heights tell states apart where there is no colour."""
_REASONS = {
    "dynamics": "v", "weak signal": "o", "no antenna": "X", "fault": "s", "out of view": ">",
}  # fmt: skip
"""Marker of why tracking ended."""


def timeline(results: Path | str | Tables, case: str) -> Figure:
    """Draw a bar for every satellite that ever has a channel: searched for, acquired, tracked, lost, and why.

    From the receiver's transitions; without a model of channels from the stored skies, tracked or not.
    """
    tables = load(results)
    rows = tables.satellites[tables.satellites.case == case]
    changes = tables.transitions[tables.transitions.case == case]
    bars = _from_changes(changes, float(rows.t_s.max())) if len(changes) else _from_rows(rows)
    names = sorted(bars.satellite.unique())
    with look():
        figure, grid = canvas(1, 1, 1.1 + 0.185 * max(4, len(names)))
        axes = grid[0, 0]
        for (name, state), group in bars.groupby(["satellite", "state"], sort=False):
            height, style = _LOOKS[str(state)]
            spans = list(zip(group.t_s, group.t_end_s - group.t_s, strict=True))
            axes.broken_barh(spans, (names.index(name) - height / 2, height), **style)
        _mark_losses(axes, changes, names)
        axes.set_yticks(range(len(names)), names, fontsize=7)
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.grid(axis="y", visible=False)
        axes.set_xlim(rows.t_s.min(), rows.t_s.max())
        axes.set_xlabel("time since lift-off (s)")
        axes.set_ylabel("satellite")
        mark_events(axes, tables.events[tables.events.case == case])
        shown = [state for state in _LOOKS if (bars.state == state).any()]
        handles = [*(Patch(**_LOOKS[state][1], label=state) for state in shown), *axes.get_legend_handles_labels()[0]]
        figure.legend(handles=handles, loc="outside lower center", ncols=5)
    return figure


def _from_changes(changes: pd.DataFrame, end: float) -> pd.DataFrame:
    """Return satellite, state, t_s, t_end_s of every stretch that is not idle."""
    until = changes.groupby("satellite").t_s.shift(-1).fillna(end)
    bars = changes.assign(state=changes.to_state, t_end_s=until)[["satellite", "state", "t_s", "t_end_s"]]
    return bars[bars.state.isin(list(_LOOKS))]


def _from_rows(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the stretches over which a satellite is tracked; each lasts until the first sky without it."""
    times = np.sort(rows.t_s.unique())
    found = []
    for name, one in rows[rows.tracked].groupby("satellite"):
        at = np.searchsorted(times, one.t_s.to_numpy())
        first = np.flatnonzero(np.diff(at, prepend=-2) > 1)
        last = np.append(first[1:], len(at)) - 1
        ends = np.minimum(at[last] + 1, len(times) - 1)
        found += [(name, "track", start, stop) for start, stop in zip(times[at[first]], times[ends], strict=True)]
    return pd.DataFrame(found, columns=["satellite", "state", "t_s", "t_end_s"])


def _mark_losses(axes: Any, changes: pd.DataFrame, names: list[str]) -> None:
    ended = changes[changes.from_state == "track"]
    for reason, group in ended.groupby("reason", sort=False):
        marker = _REASONS.get(str(reason), "P")
        places = [names.index(name) for name in group.satellite]
        axes.plot(
            group.t_s, places, marker, ms=4.5, color="black", markerfacecolor="white", mew=0.8, ls="none",
            label=f"tracking ends: {reason}", clip_on=False, zorder=4,
        )  # fmt: skip
