"""The sky over a flight: satellites in view and tracked with their C/N0, and where they stand at given times."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from lvnav_trade.metrics.basics.select import final_event, flight_events
from lvnav_trade.metrics.signals.satellites import in_view
from lvnav_trade.metrics.signals.tracking import recovery
from lvnav_trade.plots.style import GREY, PALETTE, canvas, legend_below, look, mark_events
from lvnav_trade.store import Tables, load

_FAINT = "#c4c9d1"
_MARKERS = "os^Dv<>p*h"
"""By number of antenna."""
_STATES = (
    ("track", "tracked", {"color": PALETTE[0]}),
    ("acquire", "acquired, not yet measured", {"color": PALETTE[5]}),
    ("search", "searched for", {"color": PALETTE[4]}),
    ("lost", "lost", {"color": PALETTE[1], "markerfacecolor": "none"}),
    ("", "not tracked", {"color": _FAINT}),
)
"""State, what the legend says, look; the last for whatever is none of the others."""


def satellites(results: Path | str | Tables, case: str) -> Figure:
    """Draw how many satellites are tracked and above the horizontal, and C/N0 where there is a link budget."""
    tables = load(results)
    rows = in_view(tables)
    rows = rows[rows.case == tables.labels[case]]
    mine = tables.satellites[tables.satellites.case == case]
    linked = bool(mine.cn0_db_hz.notna().any())
    events = tables.events[tables.events.case == case]
    with look():
        figure, grid = canvas(1 + linked, 1, 2.9 - 0.5 * linked, sharex=True)
        axes = grid[0, 0]
        axes.step(rows.t_s, rows.above_count, where="post", color=GREY, ls="--", label="above the local horizontal")
        axes.step(rows.t_s, rows.tracked_count, where="post", color=PALETTE[0], label="tracked")
        axes.axhline(4, color=PALETTE[1], linewidth=0.8, ls=":", label="four: a receiver's own solution")
        axes.set_ylim(0, max(5, rows[["above_count", "tracked_count"]].to_numpy().max() + 1))
        axes.yaxis.get_major_locator().set_params(integer=True)
        axes.set_ylabel("satellites (number)")
        if linked:
            _carrier(grid[1, 0], mine, tables.cases.set_index("case").loc[case])
        for number, panel in enumerate(grid[:, 0]):
            panel.margins(x=0.01)
            mark_events(panel, events, names=number == 0)
        grid[-1, 0].set_xlabel("time since lift-off (s)")
        figure.legend(loc="outside lower center", ncols=3)
    return figure


def _carrier(axes: Any, rows: pd.DataFrame, case: pd.Series) -> None:
    """Draw C/N0 of each satellite, of those tracked darker, their median, and the receiver's thresholds."""
    times = pd.Index(np.sort(rows.t_s.unique()))
    for number, (_, one) in enumerate(rows.groupby("satellite")):
        line = one.set_index("t_s").reindex(times)
        measured = line.tracked.eq(True)
        for shown, style in (
            (line.cn0_db_hz.where(~measured), {"color": _FAINT, "label": "not tracked"}),
            (line.cn0_db_hz.where(measured), {"color": PALETTE[5], "label": "each satellite tracked"}),
        ):
            axes.plot(times, shown, lw=0.7, **(style if number == 0 else {**style, "label": None}))
    median = rows[rows.tracked].groupby("t_s").cn0_db_hz.median().reindex(times)
    axes.plot(times, median, color="black", lw=1.9, label="median of those tracked")
    for value, name, dashes in (
        (case.acquire_above_db_hz, "found above", "--"),
        (case.track_above_db_hz, "kept above", ":"),
    ):
        if value == value:
            axes.axhline(value, color=PALETTE[1], lw=1.0, ls=dashes, label=f"{name} {value:g} dB-Hz")
    axes.set_ylabel("C/N0 (dB-Hz)")


def sky(results: Path | str | Tables, case: str) -> Figure:
    """Draw azimuth and elevation of the satellites at lift-off, in faults that take satellites, and at the end.

    Where no fault takes satellites half way stands in their place. The marker tells the antenna that hears a satellite
    best, the colour what its channel does; the thick circle is the local horizontal, below which a vehicle high up
    tracks satellites too.
    """
    tables = load(results)
    rows = tables.satellites[tables.satellites.case == case]
    times = np.sort(rows.t_s.unique())
    wanted = _moments(tables, case, rows)
    antennas = sorted(rows.antenna_number.dropna().unique())
    lowest = np.degrees(min(0.0, float(rows.elevation_rad[rows.tracked].min()) if rows.tracked.any() else 0.0))
    shown = []
    with look():
        figure, grid = canvas(1, len(wanted), 3.5 if len(wanted) < 4 else 3.0, subplot_kw={"projection": "polar"})
        for axes, (name, moment) in zip(grid[0], wanted, strict=True):
            t = times[int(np.argmin(np.abs(times - moment)))]
            now = rows[(rows.t_s == t) & ((rows.elevation_rad > 0) | rows.tracked)]
            _one_sky(axes, now, antennas, 90.0 + 15.0 * np.ceil(-lowest / 15.0))
            shown.append(now)
            axes.set_title(f"{name}\n{t:.0f} s", pad=12, fontsize=8.5)
            axes.set_xlabel("azimuth, elevation (deg)", fontsize=7)
        _key(figure, grid[0, 0], pd.concat(shown), antennas)
    return figure


def _moments(tables: Tables, case: str, rows: pd.DataFrame) -> list[tuple[str, float]]:
    """Return (name, time) of three skies: a fault is shown a second before its end, two faults at most."""
    events = flight_events(tables, case).set_index("event").t_s
    last = final_event(tables, case)
    end = float(events.get(last, rows.t_s.max()))
    frame = recovery(tables)
    harmful = frame[(frame.case == tables.labels[case]) & (frame.lost_count > 0)]
    within = [
        (fault.fault.replace("_", " "), max(fault.t_start_s, fault.t_end_s - 1.0)) for fault in harmful.itertuples()
    ]
    return [("lift-off", 0.0), *(within[:2] or [("half way", end / 2)]), (last.replace("_", " ") or "end", end)]


def _one_sky(axes: Any, rows: pd.DataFrame, antennas: list[int], edge: float) -> None:
    for marker, antenna in zip(_MARKERS * len(antennas), antennas, strict=False):
        for _, style, group in _by_state(rows[rows.antenna_number == antenna]):
            axes.plot(group.azimuth_rad, 90.0 - np.degrees(group.elevation_rad), marker, ms=5, **style)
    for row in rows.itertuples():
        place = (row.azimuth_rad, 90.0 - np.degrees(row.elevation_rad))
        axes.annotate(row.satellite, place, xytext=(4, 3), textcoords="offset points", fontsize=6)
    axes.plot(np.linspace(0.0, 2.0 * np.pi, 181), np.full(181, 90.0), color=GREY, lw=1.1)
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    axes.set_ylim(0, edge)
    rings = [30, 60, 90]
    axes.set_yticks(rings, [f"{90 - ring}" for ring in rings])
    axes.tick_params(labelsize=6.5)


def _by_state(rows: pd.DataFrame) -> list[tuple[str, dict[str, Any], pd.DataFrame]]:
    """Return name, look and rows of each group; a channel that waits for its signal counts as not tracked."""
    state = rows.state.where(rows.tracked | (rows.state != "track"), "")
    state = state.where(state.isin([name for name, _, _ in _STATES]), "")
    return [(label, style, rows[state == name]) for name, label, style in _STATES if (state == name).any()]


def _key(figure: Figure, axes: Any, rows: pd.DataFrame, antennas: list[int]) -> None:
    """Explain colours and, of several antennas, markers, in one legend below."""
    for label, style, _ in _by_state(rows):
        axes.plot([], [], "o", ms=5, label=label, **style)
    if len(antennas) > 1:
        for marker, antenna in zip(_MARKERS * len(antennas), antennas, strict=False):
            axes.plot([], [], marker, ms=5, color=GREY, markerfacecolor="none", label=f"antenna {antenna:.0f}")
    legend_below(figure, axes, columns=5)
