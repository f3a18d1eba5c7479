"""The flight and the sky over it: trajectory, satellites in view, sky plot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from lvnav_trade.metrics.satellites import in_view
from lvnav_trade.metrics.select import final_event, flight_events
from lvnav_trade.plots.style import GREY, PALETTE, canvas, event_key, look, mark_events
from lvnav_trade.store import Tables, load

G = 9.80665


def trajectory(results: Path | str | Tables, case: str) -> Figure:
    """Draw altitude, speed, specific force over time, and the ground track, of a case (its digest)."""
    tables = load(results)
    rows = tables.reference[tables.reference.case == case]
    events = tables.events[tables.events.case == case]
    with look():
        figure, grid = canvas(2, 2, 2.7)
        altitude, speed, force, track = grid.ravel()
        altitude.plot(rows.t_s, rows.altitude_m / 1e3, color=PALETTE[0])
        altitude.set_ylabel("altitude (km)")
        speed.plot(rows.t_s, rows.ground_speed_m_per_s / 1e3, color=PALETTE[0], label="relative to the ground")
        speed.plot(rows.t_s, rows.inertial_speed_m_per_s / 1e3, color=PALETTE[1], ls="--", label="inertial")
        speed.set_ylabel("speed (km/s)")
        speed.legend(loc="upper left")
        force.plot(rows.t_s, rows.specific_force_m_per_s2 / G, color=PALETTE[0])
        force.set_ylabel("specific force (g)")
        for number, axes in enumerate((altitude, speed, force)):
            axes.set_xlabel("time since lift-off (s)")
            axes.margins(x=0.01)
            mark_events(axes, events, names=number < 3, numbers=True)
        _ground_track(track, rows, flight_events(tables, case))
        figure.supxlabel(event_key(events), fontsize=7.5, color=GREY)
    return figure


def _ground_track(ax: Any, rows: pd.DataFrame, events: pd.DataFrame) -> None:
    longitude, latitude = np.degrees(np.unwrap(rows.longitude_rad)), np.degrees(rows.latitude_rad)
    ax.plot(longitude, latitude, color=PALETTE[0])
    at = [int(np.argmin(np.abs(rows.t_s.to_numpy() - t))) for t in events.t_s]
    ax.plot(longitude[at], latitude.to_numpy()[at], "o", ms=3, color=GREY)
    ax.set_xlabel("longitude (deg east)")
    ax.set_ylabel("geodetic latitude (deg north)")
    ax.set_title("ground track, events as dots")
    ax.margins(0.1)


def satellites(results: Path | str | Tables, case: str) -> Figure:
    """Draw the number of satellites tracked and above the horizon over time."""
    tables = load(results)
    rows = in_view(tables)
    rows = rows[rows.case == tables.labels[case]]
    with look():
        figure, grid = canvas(1, 1, 2.9)
        axes = grid[0, 0]
        axes.step(rows.t_s, rows.above_count, where="post", color=GREY, ls="--", label="above the horizon")
        axes.step(rows.t_s, rows.tracked_count, where="post", color=PALETTE[0], label="tracked")
        axes.axhline(4, color=PALETTE[1], linewidth=0.8, ls=":", label="four: a receiver's own solution")
        axes.set_ylim(0, max(5, rows.above_count.max() + 1))
        axes.yaxis.get_major_locator().set_params(integer=True)
        axes.set_xlabel("time since lift-off (s)")
        axes.set_ylabel("satellites (number)")
        axes.margins(x=0.01)
        mark_events(axes, tables.events[tables.events.case == case])
        figure.legend(loc="outside lower center", ncols=3)
    return figure


def sky(results: Path | str | Tables, case: str) -> Figure:
    """Draw azimuth and elevation of the satellites at lift-off, half way, and at injection."""
    tables = load(results)
    rows = tables.satellites[tables.satellites.case == case]
    events = flight_events(tables, case).set_index("event").t_s
    end = float(events.get(final_event(tables, case), rows.t_s.max()))
    with look():
        figure, grid = canvas(1, 3, 3.1, subplot_kw={"projection": "polar"})
        for axes, name, wanted in zip(grid[0], ("lift-off", "half way", "injection"), (0.0, end / 2, end), strict=True):
            t = rows.t_s.iloc[int(np.argmin(np.abs(rows.t_s.to_numpy() - wanted)))]
            _one_sky(axes, rows[(rows.t_s == t) & (rows.elevation_rad > 0)])
            axes.set_title(f"{name}, {t:.0f} s", pad=12)
            axes.set_xlabel("azimuth, elevation (deg)", fontsize=7)
        figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _one_sky(ax: Any, rows: pd.DataFrame) -> None:
    for tracked, style, label in (
        (True, {"color": PALETTE[0]}, "tracked"),
        (False, {"color": "#c4c9d1"}, "not tracked"),
    ):
        group = rows[rows.tracked == tracked]
        height = 90.0 - np.degrees(group.elevation_rad)
        ax.plot(group.azimuth_rad, height, "o", ms=5, label=label, **style)
        for azimuth, radius, name in zip(group.azimuth_rad, height, group.satellite, strict=True):
            ax.annotate(name, (azimuth, radius), xytext=(4, 3), textcoords="offset points", fontsize=6)
    ax.set_theta_zero_location("N")
    ax.set_theta_direction(-1)
    ax.set_ylim(0, 90)
    ax.set_yticks([0, 30, 60, 90], ["90", "60", "30", ""])
    ax.tick_params(labelsize=6.5)
