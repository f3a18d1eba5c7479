"""The instantaneous impact point: its trace on the map with the corridor, its error over time, the last ellipse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from lvnav_trade.metrics.mechanics import mission
from lvnav_trade.metrics.mission.corridor import corridor_of
from lvnav_trade.metrics.mission.impact import ellipse
from lvnav_trade.metrics.mission.impact import impact as impact_points
from lvnav_trade.plots.orbit import outline_of
from lvnav_trade.plots.style import GREY, PALETTE, canvas, look, mark_events, scale_up
from lvnav_trade.store import Tables, load

_SEEN = 0.03
"""Part of the map's width that the largest ellipse fills."""
_DRAWN = 14
"""Ellipses on the map, at most."""


def impact(results: Path | str | Tables, case: str) -> Figure:
    """Draw the trace of the point of impact with ellipses and corridor, three sigma over time, and the last event's.

    Ellipses on the map are drawn so many times larger that one sees them; the title says how many.
    """
    tables = load(results)
    rows = impact_points(tables, case)
    if rows.empty:
        return _nothing()
    with look():
        figure, grid = canvas(2, 2, 2.9)
        space = grid[0, 0].get_gridspec()
        for ax in grid[0]:
            ax.remove()
        chart = figure.add_subplot(space[0, :])
        _chart(chart, tables, case, rows)
        _sizes(grid[1, 0], tables, case, rows)
        _last(grid[1, 1], tables, case, rows)
    return figure


def _nothing() -> Figure:
    with look():
        figure, grid = canvas(1, 1, 1.6)
        ax = grid[0, 0]
        ax.text(0.5, 0.5, "no point of impact in the stored flight", transform=ax.transAxes, ha="center", color=GREY)
        ax.set_xlabel("longitude (deg east)")
        ax.set_ylabel("geodetic latitude\n(deg north)")
    return figure


def _chart(ax: Any, tables: Tables, case: str, rows: pd.DataFrame) -> None:
    flown = tables.reference[(tables.reference.case == case) & (tables.reference.t_s >= 0.0)]
    track = np.degrees(np.unwrap(flown.longitude_rad))
    longitude = np.degrees(np.unwrap(np.radians(rows.longitude_deg)))
    longitude += 360.0 * np.round((track[0] - longitude[0]) / 360.0)
    ax.plot(track, np.degrees(flown.latitude_rad), color=GREY, lw=0.9, label="ground track")
    ax.plot(longitude, rows.latitude_deg, color=PALETTE[0], label="point of impact")
    ax.plot(longitude[rows.event != ""], rows.latitude_deg[rows.event != ""], "o", ms=3, color=PALETTE[0])
    width = max(float(np.ptp(longitude)), float(np.ptp(rows.latitude_deg)), 0.1)
    times = _magnification(float(rows.major_3sigma_km.max()), width)
    chosen = np.unique(np.linspace(0, len(rows) - 1, _DRAWN).astype(int))
    for number, k in enumerate(chosen):
        row = rows.iloc[k]
        latitude, along = ellipse(row, 3.0 * times)
        shift = longitude[k] - row.longitude_deg
        ax.plot(along + shift, latitude, color=PALETTE[1], lw=0.9, label=None if number else "3 sigma, LinCov")
    corridor = corridor_of(tables)
    if corridor is not None:
        corners = np.degrees(corridor.corners)
        corners[:, 1] += 360.0 * np.round((longitude.mean() - corners[:, 1].mean()) / 360.0)
        ax.add_patch(Polygon(corners[:, ::-1], fill=False, ec=PALETTE[2], lw=1.2, label="corridor"))
        ax.autoscale_view()
    ax.set_title(f"{tables.labels[case]}" + (f"; ellipses {times:g} times as large" if times > 1 else ""), fontsize=8.5)
    ax.set_xlabel("longitude (deg east)")
    ax.set_ylabel("geodetic latitude\n(deg north)")
    ax.margins(0.06)
    ax.legend(loc="best", fontsize=7.5)


def _magnification(major_km: float, width_deg: float) -> float:
    """Return the power of ten, at least 1, that makes an ellipse of this semi-axis visible."""
    wanted = _SEEN * width_deg * 111.0 / max(major_km, 1e-9)
    return float(10.0 ** max(0, np.floor(np.log10(wanted))))


def _sizes(ax: Any, tables: Tables, case: str, rows: pd.DataFrame) -> None:
    for name, colour in (("down", PALETTE[0]), ("cross", PALETTE[1])):
        ax.plot(rows.t_s, 3.0 * rows[f"{name}_sigma_km"], color=colour, label=f"{name}-range, LinCov")
        ax.plot(rows.t_s, 3.0 * rows[f"{name}_filter_sigma_km"], color=colour, ls=":", lw=1.0)
        flown = rows[rows.runs > 1]
        if len(flown):
            ax.plot(flown.t_s, 3.0 * flown[f"mc_{name}_sigma_km"], "o", ms=3.5, mfc="none", color=colour)
    scale_up(ax.yaxis, 3.0 * pd.concat([rows.down_sigma_km, rows.cross_sigma_km]))
    ax.set_xlabel("time since lift-off (s)")
    ax.set_ylabel("error of the point\nof impact (km, 3 sigma)")
    ax.margins(x=0.03)
    mark_events(ax, tables.events[tables.events.case == case], names=False)
    ax.legend(loc="best", fontsize=7, title="dots: runs; dotted: filter's own", title_fontsize=7)


def _last(ax: Any, tables: Tables, case: str, rows: pd.DataFrame) -> None:
    """Draw the ellipse of the last event that has a point of impact, with the runs."""
    named = rows[rows.event != ""]
    row: Any = (named if len(named) else rows).iloc[-1]
    state = next(s for s in mission.states(tables, case) if s.event == row.event and abs(s.t - row.t_s) < 1e-6)
    if row.event and row.runs > 1:
        error, failed = mission.run_errors(tables, case, state)
        off = mission.impact_errors(state, error[~failed]) * 1e-3
        ax.plot(off[:, 1], off[:, 0], ".", ms=2.5, color=PALETTE[0], label="runs")
    mixed = row.correlation * row.down_sigma_km * row.cross_sigma_km
    spread = np.array([[row.cross_sigma_km**2, mixed], [mixed, row.down_sigma_km**2]])
    outline = outline_of(spread) + np.array([row.cross_bias_km, row.down_bias_km])
    ax.plot(*outline.T, color=PALETTE[1], ls="--", label="LinCov, 3 sigma")
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlabel("cross-range error (km)")
    ax.set_ylabel("down-range error (km)")
    ax.set_title(f"{row.event.replace('_', ' ') or 'last'}, {row.t_s:.0f} s", fontsize=8.5)
    ax.margins(0.08)
    ax.legend(loc="upper left", fontsize=7)
