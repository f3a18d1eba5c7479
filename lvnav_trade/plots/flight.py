"""The flight: altitude, speed, specific force, ground track."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from lvnav_trade.metrics.basics.select import flight_events
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
        speed.legend(loc="best")
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
