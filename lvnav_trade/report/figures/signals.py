"""Figures of the signals over a flight: satellites in view and tracked, C/N0, channels, delays and latency."""

from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.report.figures.figure import GREY, Figure, Panel, canvas, named_ticks, panel
from lvnav_trade.report.figures.style import PALETTE, drawing, over_time, scale_up
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.satellite_tracking import counted
from lvnav_trade.results.statistics.select import final_event, flight_events, pick
from lvnav_trade.results.tables.read import Tables

_FAINT = "#c4c9d1"
_MARKERS = "os^Dv<>p*h"  # marker by antenna number
# State, legend entry, style; the last entry is for all other states.
_STATES = (
    ("track", "tracked", {"color": PALETTE[0]}),
    ("acquire", "acquired, not yet measured", {"color": PALETTE[5]}),
    ("search", "searched for", {"color": PALETTE[4]}),
    ("lost", "lost", {"color": PALETTE[1], "mfc": "none"}),
    ("", "not tracked", {"color": _FAINT}),
)
# Height of a bar and its style: heights distinguish states in prints without colour.
_LOOKS: dict[str, tuple[float, dict[str, Any]]] = {
    "track": (0.8, {"color": PALETTE[0]}),
    "acquire": (0.6, {"color": PALETTE[5], "ec": "black", "lw": 0.3}),
    "search": (0.42, {"color": PALETTE[4], "ec": "white", "hatch": "////", "lw": 0.0}),
    "lost": (0.14, {"color": PALETTE[1]}),
}
# Marker by the reason for the end of tracking.
_REASONS = {"dynamics": "v", "weak signal": "o", "no antenna": "X", "fault": "s", "out of view": ">"}
LAYERS = ("troposphere", "ionosphere")
_LEAST = 1e-3  # m, smallest value drawn on a logarithmic axis


@drawing
def satellites(tables: Tables, case: str) -> Figure:
    """Draw the numbers of satellites tracked and above the horizontal, and C/N0 with a link budget."""
    case_rows = pick(tables.satellites, case=case)
    rows = counted(case_rows)
    linked = bool(case_rows.cn0_db_hz.notna().any())
    figure, grid = canvas(1 + linked, 1, 2.9 - 0.5 * linked, sharex=True)
    axes = grid[0, 0]
    axes.step(rows.t_s, rows.above_count, color=GREY, ls="--", label="above the local horizontal")
    axes.step(rows.t_s, rows.tracked_count, color=PALETTE[0], label="tracked")
    axes.axhline(4, color=PALETTE[1], lw=0.8, ls=":", label="four: a receiver's own solution")
    most = rows[["above_count", "tracked_count"]].to_numpy().max()
    top = int(max(5, most + 1))
    step = 1 if top <= 6 else 2 if top <= 14 else 5
    axes.set(ylim=(0.0, float(top)), ylabel="satellites (number)")
    axes.set(yticks=[(float(count), str(count)) for count in range(0, top + 1, step)])
    if linked:
        _carrier(grid[1, 0], case_rows, tables.cases.set_index("case").loc[case])
    over_time(grid[:, 0], tables, case)
    return figure


def _carrier(axes: Panel, rows: pd.DataFrame, case: pd.Series) -> None:
    times = pd.Index(np.sort(rows.t_s.unique()))
    for number, (_, satellite_rows) in enumerate(rows.groupby("satellite")):
        line = satellite_rows.set_index("t_s").reindex(times)
        measured = line.tracked.eq(True)
        for level, colour, label in (
            (~measured, _FAINT, "not tracked"),
            (measured, PALETTE[5], "each satellite tracked"),
        ):
            style = {"label": None if number else label, "group": label}
            axes.plot(times, line.cn0_db_hz.where(level), lw=0.7, color=colour, **style)
    median = rows[rows.tracked].groupby("t_s").cn0_db_hz.median().reindex(times)
    axes.plot(times, median, color="black", lw=1.9, label="median of those tracked")
    acquire_level, track_level = (
        (case.acquire_above_db_hz, "found above", "--"),
        (case.track_above_db_hz, "kept above", ":"),
    )
    for value, name, dashes in (acquire_level, track_level):
        if value == value:
            axes.axhline(value, color=PALETTE[1], lw=1.0, ls=dashes, label=f"{name} {value:g} dB-Hz")
    axes.set(ylabel="C/N0 (dB-Hz)")


@drawing
def sky(tables: Tables, case: str) -> Figure:
    """Draw azimuth and elevation of the satellites at lift-off, during faults that affect satellites, and at the end.

    Without such a fault, the middle of the flight takes its place. The marker identifies the antenna with the strongest
    signal, the colour the state of the channel. The thick circle is the local horizontal; at high altitude a vehicle
    also tracks satellites below it.
    """
    rows = pick(tables.satellites, case=case)
    times = np.sort(rows.t_s.unique())
    moments = _moments(tables, case, rows)
    antennas = sorted(rows.antenna_number.dropna().unique())
    lowest = np.degrees(min(0.0, float(rows.elevation_rad[rows.tracked].min()) if rows.tracked.any() else 0.0))
    drawn = []
    figure, grid = canvas(1, len(moments), 3.0 if len(moments) < 4 else 2.6)
    for axes, (name, moment) in zip(grid[0], moments, strict=True):
        t = times[int(np.argmin(np.abs(times - moment)))]
        drawn.append(rows[(rows.t_s == t) & ((rows.elevation_rad > 0) | rows.tracked)])
        _one_sky(axes, drawn[-1], antennas, 90.0 + 15.0 * np.ceil(-lowest / 15.0))
        axes.set(title=f"{name}\n{t:.0f} s", xlabel="azimuth, elevation (deg)")
    _key(grid[0, 0], pd.concat(drawn), antennas)
    return figure


def _moments(tables: Tables, case: str, rows: pd.DataFrame) -> list[tuple[str, float]]:
    """Return (name, time) of three sky plots; at most two faults, each a second before its end."""
    last = final_event(tables, case)
    end = float(flight_events(tables, case).set_index("event").t_s.get(last, rows.t_s.max()))
    frame = pick(METRICS["recovery"](tables), case=tables.labels[case])
    within = [
        (fault.fault.replace("_", " "), max(fault.t_start_s, fault.t_end_s - 1.0))
        for fault in frame[frame.lost_count > 0].itertuples()
    ]
    return [("lift-off", 0.0), *(within[:2] or [("half way", end / 2)]), (last.replace("_", " ") or "end", end)]


def _one_sky(axes: Panel, rows: pd.DataFrame, antennas: list[int], edge: float) -> None:
    """Draw a sky plot, north up and east to the right; the distance from the centre is the zenith angle."""
    turn = np.linspace(0.0, 2.0 * np.pi, 121)
    for distance in (30.0, 60.0, 90.0):
        style = {"color": GREY, "lw": 1.1} if distance == 90.0 else {"color": _FAINT, "lw": 0.6}
        axes.plot(distance * np.sin(turn), distance * np.cos(turn), **style)
    for azimuth in np.radians([0.0, 90.0, 180.0, 270.0]):
        axes.plot([0.0, edge * np.sin(azimuth)], [0.0, edge * np.cos(azimuth)], color=_FAINT, lw=0.6)
    axes.text(0.0, [-31.0, -61.0], ["60", "30"], color=GREY, ha="center", va="top")
    axes.text([0.0, edge, 0.0, -edge], [edge, 0.0, -edge, 0.0], ["N", "E", "S", "W"], ha="center")
    for marker, antenna in zip(_MARKERS * len(antennas), antennas, strict=False):
        for _, style, group in _by_state(rows[rows.antenna_number == antenna]):
            axes.plot(*_place(group), ls="none", marker=marker, ms=5, **style)
    east, north = _place(rows)
    axes.text(east + 3.0, north + 3.0, rows.satellite, ha="left", va="bottom")
    reach = -1.08 * edge, 1.08 * edge
    axes.set(xlim=reach, ylim=reach, xticks=[], yticks=[], equal=True, grid=False)


def _place(rows: pd.DataFrame) -> tuple[Any, Any]:
    distance = 90.0 - np.degrees(rows.elevation_rad)
    return distance * np.sin(rows.azimuth_rad), distance * np.cos(rows.azimuth_rad)


def _by_state(rows: pd.DataFrame) -> list[tuple[str, dict[str, Any], pd.DataFrame]]:
    """Return name, style and rows of each group; a channel waiting for its signal counts as not tracked."""
    state = rows.state.where(rows.tracked | (rows.state != "track"), "")
    state = state.where(state.isin([name for name, _, _ in _STATES]), "")
    return [(label, style, rows[state == name]) for name, label, style in _STATES if (state == name).any()]


def _key(axes: Panel, rows: pd.DataFrame, antennas: list[int]) -> None:
    for label, style, _ in _by_state(rows):
        axes.plot([], [], ls="none", marker="o", ms=5, label=label, **style)
    if len(antennas) > 1:
        for marker, antenna in zip(_MARKERS * len(antennas), antennas, strict=False):
            style = {"ls": "none", "marker": marker, "ms": 5, "color": GREY, "mfc": "none"}
            axes.plot([], [], label=f"antenna {antenna:.0f}", **style)


@drawing
def timeline(tables: Tables, case: str) -> Figure:
    """Draw the channel states of every satellite over time: search, acquisition, tracking, loss and its reason.

    The data are the transitions of the receiver; without a channel model they are the stored skies, tracked or not.
    """
    rows, changes = pick(tables.satellites, case=case), pick(tables.transitions, case=case)
    bars = _from_changes(changes, float(rows.t_s.max())) if len(changes) else _from_rows(rows)
    names = sorted(bars.satellite.unique())
    figure, axes = panel(1.1 + 0.185 * max(4, len(names)))
    for state, (_, style) in _LOOKS.items():
        if (bars.state == state).any():
            axes.boxes([], [], [], [], label=state, **style)
    for (name, state), group in bars.groupby(["satellite", "state"], sort=False):
        height, style = _LOOKS[str(state)]
        middle = names.index(name)
        axes.boxes(group.t_s, group.t_end_s, middle - height / 2, middle + height / 2, **style)
    _mark_losses(axes, changes, names)
    axes.set(ylim=(len(names) - 0.4, -0.6), yticks=named_ticks(names), ylabel="satellite", grid=False)
    axes.set(xlim=(float(rows.t_s.min()), float(rows.t_s.max())))
    over_time([axes], tables, case, margin=0.0)
    return figure


def _from_changes(changes: pd.DataFrame, end: float) -> pd.DataFrame:
    """Return satellite, state, t_s, t_end_s of every interval in which a channel is not idle."""
    until = changes.groupby("satellite").t_s.shift(-1).fillna(end)
    bars = changes.assign(state=changes.to_state, t_end_s=until)[["satellite", "state", "t_s", "t_end_s"]]
    return bars[bars.state.isin(list(_LOOKS))]


def _from_rows(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the intervals in which a satellite is tracked; each ends at the first stored sky without it."""
    times = np.sort(rows.t_s.unique())
    intervals = []
    for name, satellite_rows in rows[rows.tracked].groupby("satellite"):
        at = np.searchsorted(times, satellite_rows.t_s.to_numpy())
        first = np.flatnonzero(np.diff(at, prepend=-2) > 1)
        ends = np.minimum(at[np.append(first[1:], len(at)) - 1] + 1, len(times) - 1)
        intervals += [(name, "track", start, stop) for start, stop in zip(times[at[first]], times[ends], strict=True)]
    return pd.DataFrame(intervals, columns=["satellite", "state", "t_s", "t_end_s"])


def _mark_losses(axes: Panel, changes: pd.DataFrame, names: list[str]) -> None:
    for reason, group in pick(changes, from_state="track").groupby("reason", sort=False):
        style = {"marker": _REASONS.get(str(reason), "P"), "ms": 4.5, "color": "black", "mfc": "white"}
        places = [names.index(name) for name in group.satellite]
        axes.plot(group.t_s, places, ls="none", label=f"tracking ends: {reason}", **style)


def layers_of(rows: pd.DataFrame) -> list[str]:
    """Return the atmospheric layers with a delay or a correction in rows of the table `satellites`."""
    return [layer for layer in LAYERS if (rows[[f"{layer}_m", f"{layer}_left_m"]].abs() >= _LEAST).any(axis=None)]


@drawing
def delays(tables: Tables, case: str) -> Figure:
    """Draw the true delay of every tracked satellite, and the residual delay after the filter's correction."""
    rows = pick(tables.satellites, case=case)
    layers = layers_of(rows) or list(LAYERS[:1])
    figure, grid = canvas(2, len(layers), 2.3, sharex=True)
    for panels, layer in zip(grid.T, layers, strict=True):
        true, residual = panels
        _lines(true, rows, f"{layer}_m", PALETTE[0])
        _lines(residual, rows, f"{layer}_left_m", PALETTE[1])
        drawn = rows[f"{layer}_m"][rows[f"{layer}_m"] >= _LEAST]
        scale_up(true, "y", drawn)
        if true.axes.get("yscale") == "log":
            true.set(ylim=0.7 * float(drawn.min()))
        residual.axhline(0.0, color="black", lw=0.7)
        true.set(ylabel=f"{layer}, true\ndelay (m)")
        residual.set(ylabel=f"{layer}, residual\nafter correction (m)")
        over_time(panels, tables, case)
    return figure


def _lines(axes: Panel, rows: pd.DataFrame, column: str, colour: str) -> None:
    times = pd.Index(np.sort(rows.t_s.unique()))
    for number, (_, satellite_rows) in enumerate(rows.groupby("satellite")):
        style = {"label": None if number else "each satellite tracked", "group": "each satellite tracked"}
        axes.plot(
            times, satellite_rows.set_index("t_s")[column].reindex(times), color=colour, lw=0.6, alpha=0.6, **style
        )
    axes.plot(times, rows.groupby("t_s")[column].median().reindex(times), color="black", lw=1.7, label="their median")


@drawing
def latency(tables: Tables, case: str) -> Figure:
    """Draw the age of measurements that the filter processes as current."""
    rows = pick(tables.satellites, case=case).drop_duplicates("t_s")
    figure, ax = panel(2.3)
    age = rows.latency_s * 1e3
    ax.step(rows.t_s, age, color=PALETTE[0])
    ax.set(ylim=(0.0, max(1.0, 1.15 * float(age.max()))), ylabel="age of the\nmeasurements (ms)")
    over_time([ax], tables, case)
    return figure
