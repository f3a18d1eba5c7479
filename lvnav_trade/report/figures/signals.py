"""Figures of the signals over a flight: satellites in view and tracked, C/N0, channels, delays and latency."""

from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.report.figures.figure import GREY, Figure, Panel, canvas, named_ticks, panel
from lvnav_trade.report.figures.style import PALETTE, drawing, over_time, scale_up
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.satellite_tracking import satellite_counts
from lvnav_trade.results.statistics.select import final_event, flight_events, pick
from lvnav_trade.results.tables.read import Tables

_FAINT = "#c4c9d1"
_MARKERS = "os^Dv<>p*h"  # marker by antenna number
_SKY_MOST_FAULTS = 2
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
    counts = satellite_counts(case_rows)
    has_link_budget = bool(case_rows.cn0_db_hz.notna().any())
    figure, grid = canvas(1 + has_link_budget, 1, 2.4 if has_link_budget else 2.9, sharex=True)
    ax = grid[0, 0]
    ax.step(counts.t_s, counts.above_count, color=GREY, ls="--", label="above the local horizontal")
    ax.step(counts.t_s, counts.tracked_count, color=PALETTE[0], label="tracked")
    ax.axhline(
        4,
        color=PALETTE[1],
        lw=0.8,
        ls=":",
        label="four: a receiver's own solution",
    )
    largest = counts[["above_count", "tracked_count"]].to_numpy().max()
    top = int(max(5, largest + 1))
    if top <= 6:
        step = 1
    elif top <= 14:
        step = 2
    else:
        step = 5
    ticks = [(float(count), str(count)) for count in range(0, top + 1, step)]
    ax.set(ylim=(0.0, float(top)), yticks=ticks, ylabel="satellites (number)")
    if has_link_budget:
        _draw_carrier(grid[1, 0], case_rows, tables.cases.set_index("case").loc[case])
    over_time(grid[:, 0], tables, case)
    return figure


def _draw_carrier(ax: Panel, rows: pd.DataFrame, case: pd.Series) -> None:
    """Draw C/N0 of every satellite with the median of those tracked and the thresholds of the receiver.

    rows : rows of the table `satellites`
    case : row of the table `cases`
    """
    times = pd.Index(np.sort(rows.t_s.unique()))
    for number, (_, satellite_rows) in enumerate(rows.groupby("satellite")):
        line = satellite_rows.set_index("t_s").reindex(times)
        is_tracked = line.tracked.eq(True)
        for selection, colour, label in (
            (~is_tracked, _FAINT, "not tracked"),
            (is_tracked, PALETTE[5], "each satellite tracked"),
        ):
            ax.plot(
                times,
                line.cn0_db_hz.where(selection),
                lw=0.7,
                color=colour,
                label=label if number == 0 else None,
                group=label,
            )
    median = rows[rows.tracked].groupby("t_s").cn0_db_hz.median().reindex(times)
    ax.plot(times, median, color="black", lw=1.9, label="median of those tracked")
    for threshold, name, dashes in (
        (case.acquire_above_db_hz, "found above", "--"),
        (case.track_above_db_hz, "kept above", ":"),
    ):
        if not np.isnan(threshold):
            ax.axhline(
                threshold,
                color=PALETTE[1],
                lw=1.0,
                ls=dashes,
                label=f"{name} {threshold:g} dB-Hz",
            )
    ax.set(ylabel="C/N0 (dB-Hz)")


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
    if rows.tracked.any():
        lowest_rad = min(0.0, float(rows.elevation_rad[rows.tracked].min()))
    else:
        lowest_rad = 0.0
    edge = 90.0 + 15.0 * np.ceil(-np.degrees(lowest_rad) / 15.0)
    skies = []
    height = 3.0 if len(moments) < 4 else 2.6
    figure, grid = canvas(1, len(moments), height)
    for ax, (name, moment) in zip(grid[0], moments, strict=True):
        nearest = int(np.argmin(np.abs(times - moment)))
        t = times[nearest]
        is_visible = (rows.elevation_rad > 0) | rows.tracked
        visible_rows = rows[(rows.t_s == t) & is_visible]
        _draw_sky(ax, visible_rows, antennas, edge)
        ax.set(title=f"{name}\n{t:.0f} s", xlabel="azimuth, elevation (deg)")
        skies.append(visible_rows)
    _draw_key(grid[0, 0], pd.concat(skies), antennas)
    return figure


def _moments(tables: Tables, case: str, rows: pd.DataFrame) -> list[tuple[str, float]]:
    """Return (name, time) of three sky plots; at most two faults, each a second before its end."""
    last = final_event(tables, case)
    event_times = flight_events(tables, case).set_index("event").t_s
    end = float(event_times.get(last, rows.t_s.max()))
    recovery = pick(METRICS["recovery"](tables), case=tables.labels[case])
    harmful_faults = recovery[recovery.lost_count > 0]
    fault_moments = []
    for fault in harmful_faults.head(_SKY_MOST_FAULTS).itertuples():
        name = fault.fault.replace("_", " ")
        moment = max(fault.t_start_s, fault.t_end_s - 1.0)
        fault_moments.append((name, moment))
    if not fault_moments:
        fault_moments = [("half way", end / 2)]
    last_name = last.replace("_", " ") or "end"
    return [("lift-off", 0.0), *fault_moments, (last_name, end)]


def _draw_sky(ax: Panel, rows: pd.DataFrame, antennas: list[int], edge: float) -> None:
    """Draw a sky plot, north up and east to the right; the distance from the centre is the zenith angle.

    rows : visible satellites at one time
    antennas : numbers of the antennas, each with its marker
    edge : deg. Zenith angle at the edge of the plot.
    """
    _draw_sky_grid(ax, edge)
    markers = _MARKERS * len(antennas)
    for marker, antenna in zip(markers, antennas, strict=False):
        antenna_rows = rows[rows.antenna_number == antenna]
        for _, style, group in _state_groups(antenna_rows):
            east, north = _sky_position(group)
            ax.plot(east, north, ls="none", marker=marker, ms=5, **style)
    east, north = _sky_position(rows)
    ax.text(east + 3.0, north + 3.0, rows.satellite, ha="left", va="bottom")
    limits = (-1.08 * edge, 1.08 * edge)
    ax.set(xlim=limits, ylim=limits, xticks=[], yticks=[], equal=True, grid=False)


def _draw_sky_grid(ax: Panel, edge: float) -> None:
    """Draw circles of elevation and lines of azimuth, with their numbers.

    edge : zenith angle at the edge of the plot (deg)
    """
    azimuth = np.linspace(0.0, 2.0 * np.pi, 121)
    for zenith_angle in (30.0, 60.0, 90.0):
        is_horizontal = zenith_angle == 90.0
        ax.plot(
            zenith_angle * np.sin(azimuth),
            zenith_angle * np.cos(azimuth),
            color=GREY if is_horizontal else _FAINT,
            lw=1.1 if is_horizontal else 0.6,
        )
    for cardinal in np.radians([0.0, 90.0, 180.0, 270.0]):
        east = edge * np.sin(cardinal)
        north = edge * np.cos(cardinal)
        ax.plot([0.0, east], [0.0, north], color=_FAINT, lw=0.6)
    ax.text(0.0, [-31.0, -61.0], ["60", "30"], color=GREY, ha="center", va="top")
    ax.text([0.0, edge, 0.0, -edge], [edge, 0.0, -edge, 0.0], ["N", "E", "S", "W"], ha="center")


def _sky_position(rows: pd.DataFrame) -> tuple[pd.Series, pd.Series]:
    """Return east and north coordinate of satellites in a sky plot (deg)."""
    zenith_angle = 90.0 - np.degrees(rows.elevation_rad)
    return zenith_angle * np.sin(rows.azimuth_rad), zenith_angle * np.cos(rows.azimuth_rad)


def _state_groups(rows: pd.DataFrame) -> list[tuple[str, dict[str, Any], pd.DataFrame]]:
    """Return name, style and rows of each group; a channel waiting for its signal counts as not tracked."""
    is_not_waiting = rows.tracked | (rows.state != "track")
    state = rows.state.where(is_not_waiting, "")
    state = state.where(state.isin([name for name, _, _ in _STATES]), "")
    groups = []
    for name, label, style in _STATES:
        in_state = state == name
        if in_state.any():
            groups.append((label, style, rows[in_state]))
    return groups


def _draw_key(ax: Panel, rows: pd.DataFrame, antennas: list[int]) -> None:
    """Add the entries of the legend: the states of channels, and the antennas if there are several."""
    for label, style, _ in _state_groups(rows):
        ax.plot([], [], ls="none", marker="o", ms=5, label=label, **style)
    if len(antennas) < 2:
        return
    for marker, antenna in zip(_MARKERS * len(antennas), antennas, strict=False):
        ax.plot(
            [],
            [],
            ls="none",
            marker=marker,
            ms=5,
            color=GREY,
            mfc="none",
            label=f"antenna {antenna:.0f}",
        )


@drawing
def timeline(tables: Tables, case: str) -> Figure:
    """Draw the channel states of every satellite over time: search, acquisition, tracking, loss and its reason.

    The data are the transitions of the receiver; without a channel model they are the stored skies, tracked or not.
    """
    rows = pick(tables.satellites, case=case)
    changes = pick(tables.transitions, case=case)
    start = float(rows.t_s.min())
    end = float(rows.t_s.max())
    bars = _channel_intervals(changes, end) if len(changes) else _tracking_intervals(rows)
    names = sorted(bars.satellite.unique())
    figure, ax = panel(1.1 + 0.185 * max(4, len(names)))
    for state, (_, style) in _LOOKS.items():  # entries of the legend
        if (bars.state == state).any():
            ax.boxes([], [], [], [], label=state, **style)
    for (name, state), group in bars.groupby(["satellite", "state"], sort=False):
        height, style = _LOOKS[str(state)]
        middle = names.index(name)
        bottom = middle - height / 2
        top = middle + height / 2
        ax.boxes(group.t_s, group.t_end_s, bottom, top, **style)
    _mark_losses(ax, changes, names)
    ax.set(
        xlim=(start, end),
        ylim=(len(names) - 0.4, -0.6),
        yticks=named_ticks(names),
        ylabel="satellite",
        grid=False,
    )
    over_time([ax], tables, case, margin=0.0)
    return figure


def _channel_intervals(changes: pd.DataFrame, end: float) -> pd.DataFrame:
    """Return satellite, state, t_s, t_end_s of every interval in which a channel is not idle."""
    next_change = changes.groupby("satellite").t_s.shift(-1)
    bars = changes.assign(state=changes.to_state, t_end_s=next_change.fillna(end))
    bars = bars[["satellite", "state", "t_s", "t_end_s"]]
    return bars[bars.state.isin(list(_LOOKS))]


def _tracking_intervals(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the intervals in which a satellite is tracked; each ends at the first stored sky without it."""
    times = np.sort(rows.t_s.unique())
    intervals = []
    for name, satellite_rows in rows[rows.tracked].groupby("satellite"):
        epochs = np.searchsorted(times, satellite_rows.t_s.to_numpy())
        # An interval begins where the preceding epoch is missing
        gaps = np.diff(epochs, prepend=-2)
        first_indices = np.flatnonzero(gaps > 1)
        last_indices = np.append(first_indices[1:], len(epochs)) - 1
        starts = epochs[first_indices]
        ends = np.minimum(epochs[last_indices] + 1, len(times) - 1)
        for start, stop in zip(times[starts], times[ends], strict=True):
            intervals.append((name, "track", start, stop))
    return pd.DataFrame(intervals, columns=["satellite", "state", "t_s", "t_end_s"])


def _mark_losses(ax: Panel, changes: pd.DataFrame, names: list[str]) -> None:
    """Mark the ends of tracking by their reason.

    names : satellites, in the order of their heights in the panel
    """
    losses = pick(changes, from_state="track")
    for reason, group in losses.groupby("reason", sort=False):
        ax.plot(
            group.t_s,
            [names.index(name) for name in group.satellite],
            ls="none",
            marker=_REASONS.get(str(reason), "P"),
            ms=4.5,
            color="black",
            mfc="white",
            label=f"tracking ends: {reason}",
        )


def layers_of(rows: pd.DataFrame) -> list[str]:
    """Return the atmospheric layers with a delay or a correction in rows of the table `satellites`."""
    layers = []
    for layer in LAYERS:
        delays = rows[[f"{layer}_m", f"{layer}_left_m"]]
        if (delays.abs() >= _LEAST).any(axis=None):
            layers.append(layer)
    return layers


@drawing
def delays(tables: Tables, case: str) -> Figure:
    """Draw the true delay of every tracked satellite, and the residual delay after the filter's correction."""
    rows = pick(tables.satellites, case=case)
    layers = layers_of(rows) or list(LAYERS[:1])
    figure, grid = canvas(2, len(layers), 2.3, sharex=True)
    for panels, layer in zip(grid.T, layers, strict=True):
        true_panel, residual_panel = panels
        _draw_delays(true_panel, rows, f"{layer}_m", PALETTE[0])
        _draw_delays(residual_panel, rows, f"{layer}_left_m", PALETTE[1])
        true_delays = rows[f"{layer}_m"]
        true_delays = true_delays[true_delays >= _LEAST]
        scale_up(true_panel, "y", true_delays)
        if true_panel.axes.get("yscale") == "log":
            true_panel.set(ylim=0.7 * float(true_delays.min()))
        residual_panel.axhline(0.0, color="black", lw=0.7)
        true_panel.set(ylabel=f"{layer}, true\ndelay (m)")
        residual_panel.set(ylabel=f"{layer}, residual\nafter correction (m)")
        over_time(panels, tables, case)
    return figure


def _draw_delays(ax: Panel, rows: pd.DataFrame, column: str, colour: str) -> None:
    """Draw a delay of every satellite over time, and their median.

    rows : rows of the table `satellites`
    column : column of the delay
    """
    times = pd.Index(np.sort(rows.t_s.unique()))
    label = "each satellite tracked"
    for number, (_, satellite_rows) in enumerate(rows.groupby("satellite")):
        delay = satellite_rows.set_index("t_s")[column].reindex(times)
        ax.plot(
            times,
            delay,
            color=colour,
            lw=0.6,
            alpha=0.6,
            label=label if number == 0 else None,
            group=label,
        )
    median = rows.groupby("t_s")[column].median().reindex(times)
    ax.plot(times, median, color="black", lw=1.7, label="their median")


@drawing
def latency(tables: Tables, case: str) -> Figure:
    """Draw the age of measurements that the filter processes as current."""
    rows = pick(tables.satellites, case=case).drop_duplicates("t_s")
    figure, ax = panel(2.3)
    age = rows.latency_s * 1e3
    top = max(1.0, 1.15 * float(age.max()))
    ax.step(rows.t_s, age, color=PALETTE[0])
    ax.set(ylim=(0.0, top), ylabel="age of the\nmeasurements (ms)")
    over_time([ax], tables, case)
    return figure
