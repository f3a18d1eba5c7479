"""The signals over a flight: satellites in view and tracked, their C/N0, channels, delays and latency."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.patches import Patch

from lvnav_trade.metrics.basics.select import final_event, flight_events, pick
from lvnav_trade.metrics.signals import in_view, recovery
from lvnav_trade.plots.style import GREY, PALETTE, canvas, drawing, event_key, legend_below, over_time, panel, scale_up
from lvnav_trade.store.read import Tables

_FAINT = "#c4c9d1"
_MARKERS = "os^Dv<>p*h"  # by number of antenna
# State, what the legend says, look; the last for whatever is none of the others.
_STATES = (
    ("track", "tracked", {"color": PALETTE[0]}),
    ("acquire", "acquired, not yet measured", {"color": PALETTE[5]}),
    ("search", "searched for", {"color": PALETTE[4]}),
    ("lost", "lost", {"color": PALETTE[1], "markerfacecolor": "none"}),
    ("", "not tracked", {"color": _FAINT}),
)
# Height of a bar and its look: heights tell states apart where there is no colour.
_LOOKS: dict[str, tuple[float, dict[str, Any]]] = {
    "track": (0.8, {"facecolor": PALETTE[0]}),
    "acquire": (0.6, {"facecolor": PALETTE[5], "edgecolor": "black", "linewidth": 0.3}),
    "search": (0.42, {"facecolor": PALETTE[4], "edgecolor": "white", "hatch": "////", "linewidth": 0.0}),
    "lost": (0.14, {"facecolor": PALETTE[1]}),
}
# Marker of why tracking ended.
_REASONS = {"dynamics": "v", "weak signal": "o", "no antenna": "X", "fault": "s", "out of view": ">"}
LAYERS = ("troposphere", "ionosphere")
_LEAST = 1e-3  # metres: less is not drawn where an axis is logarithmic


@drawing
def satellites(tables: Tables, case: str) -> Figure:
    """Draw how many satellites are tracked and above the horizontal, and C/N0 where there is a link budget."""
    rows = pick(in_view(tables), case=tables.labels[case])
    mine = pick(tables.satellites, case=case)
    linked = bool(mine.cn0_db_hz.notna().any())
    figure, grid = canvas(1 + linked, 1, 2.9 - 0.5 * linked, sharex=True)
    axes = grid[0, 0]
    axes.step(rows.t_s, rows.above_count, where="post", color=GREY, ls="--", label="above the local horizontal")
    axes.step(rows.t_s, rows.tracked_count, where="post", color=PALETTE[0], label="tracked")
    axes.axhline(4, color=PALETTE[1], linewidth=0.8, ls=":", label="four: a receiver's own solution")
    axes.yaxis.get_major_locator().set_params(integer=True)
    most = rows[["above_count", "tracked_count"]].to_numpy().max()
    axes.set(ylim=(0, max(5, most + 1)), ylabel="satellites (number)")
    if linked:
        _carrier(grid[1, 0], mine, tables.cases.set_index("case").loc[case])
    over_time(grid[:, 0], tables, case)
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def _carrier(axes: Any, rows: pd.DataFrame, case: pd.Series) -> None:
    times = pd.Index(np.sort(rows.t_s.unique()))
    for number, (_, one) in enumerate(rows.groupby("satellite")):
        line = one.set_index("t_s").reindex(times)
        measured = line.tracked.eq(True)
        for shown, colour, label in (
            (~measured, _FAINT, "not tracked"),
            (measured, PALETTE[5], "each satellite tracked"),
        ):
            axes.plot(times, line.cn0_db_hz.where(shown), lw=0.7, color=colour, label=None if number else label)
    median = rows[rows.tracked].groupby("t_s").cn0_db_hz.median().reindex(times)
    axes.plot(times, median, color="black", lw=1.9, label="median of those tracked")
    found, kept = (case.acquire_above_db_hz, "found above", "--"), (case.track_above_db_hz, "kept above", ":")
    for value, name, dashes in (found, kept):
        if value == value:
            axes.axhline(value, color=PALETTE[1], lw=1.0, ls=dashes, label=f"{name} {value:g} dB-Hz")
    axes.set_ylabel("C/N0 (dB-Hz)")


@drawing
def sky(tables: Tables, case: str) -> Figure:
    """Draw azimuth and elevation of the satellites at lift-off, in faults that take satellites, and at the end.

    Where no fault takes satellites half way stands in their place. The marker tells the antenna that hears a satellite
    best, the colour what its channel does; the thick circle is the local horizontal, below which a vehicle high up
    tracks satellites too.
    """
    rows = pick(tables.satellites, case=case)
    times = np.sort(rows.t_s.unique())
    wanted = _moments(tables, case, rows)
    antennas = sorted(rows.antenna_number.dropna().unique())
    lowest = np.degrees(min(0.0, float(rows.elevation_rad[rows.tracked].min()) if rows.tracked.any() else 0.0))
    shown = []
    figure, grid = canvas(1, len(wanted), 3.5 if len(wanted) < 4 else 3.0, subplot_kw={"projection": "polar"})
    for axes, (name, moment) in zip(grid[0], wanted, strict=True):
        t = times[int(np.argmin(np.abs(times - moment)))]
        shown.append(rows[(rows.t_s == t) & ((rows.elevation_rad > 0) | rows.tracked)])
        _one_sky(axes, shown[-1], antennas, 90.0 + 15.0 * np.ceil(-lowest / 15.0))
        axes.set_title(f"{name}\n{t:.0f} s", pad=12, fontsize=8.5)
        axes.set_xlabel("azimuth, elevation (deg)", fontsize=7)
    _key(figure, grid[0, 0], pd.concat(shown), antennas)
    return figure


def _moments(tables: Tables, case: str, rows: pd.DataFrame) -> list[tuple[str, float]]:
    """Return (name, time) of three skies: a fault is shown a second before its end, two faults at most."""
    last = final_event(tables, case)
    end = float(flight_events(tables, case).set_index("event").t_s.get(last, rows.t_s.max()))
    frame = pick(recovery(tables), case=tables.labels[case])
    within = [
        (fault.fault.replace("_", " "), max(fault.t_start_s, fault.t_end_s - 1.0))
        for fault in frame[frame.lost_count > 0].itertuples()
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
    axes.set(ylim=(0, edge), yticks=[30, 60, 90], yticklabels=["60", "30", "0"])
    axes.tick_params(labelsize=6.5)


def _by_state(rows: pd.DataFrame) -> list[tuple[str, dict[str, Any], pd.DataFrame]]:
    """Return name, look and rows of each group; a channel that waits for its signal counts as not tracked."""
    state = rows.state.where(rows.tracked | (rows.state != "track"), "")
    state = state.where(state.isin([name for name, _, _ in _STATES]), "")
    return [(label, style, rows[state == name]) for name, label, style in _STATES if (state == name).any()]


def _key(figure: Figure, axes: Any, rows: pd.DataFrame, antennas: list[int]) -> None:
    for label, style, _ in _by_state(rows):
        axes.plot([], [], "o", ms=5, label=label, **style)
    if len(antennas) > 1:
        for marker, antenna in zip(_MARKERS * len(antennas), antennas, strict=False):
            axes.plot([], [], marker, ms=5, color=GREY, markerfacecolor="none", label=f"antenna {antenna:.0f}")
    legend_below(figure, axes, columns=5)


@drawing
def timeline(tables: Tables, case: str) -> Figure:
    """Draw a bar for every satellite that ever has a channel: searched for, acquired, tracked, lost, and why.

    From the receiver's transitions; without a model of channels from the stored skies, tracked or not.
    """
    rows, changes = pick(tables.satellites, case=case), pick(tables.transitions, case=case)
    bars = _from_changes(changes, float(rows.t_s.max())) if len(changes) else _from_rows(rows)
    names = sorted(bars.satellite.unique())
    figure, axes = panel(1.1 + 0.185 * max(4, len(names)))
    for (name, state), group in bars.groupby(["satellite", "state"], sort=False):
        height, style = _LOOKS[str(state)]
        spans = list(zip(group.t_s, group.t_end_s - group.t_s, strict=True))
        axes.broken_barh(spans, (names.index(name) - height / 2, height), **style)
    _mark_losses(axes, changes, names)
    axes.set_yticks(range(len(names)), names, fontsize=7)
    axes.grid(axis="y", visible=False)
    axes.set(ylim=(len(names) - 0.4, -0.6), xlim=(rows.t_s.min(), rows.t_s.max()), ylabel="satellite")
    over_time([axes], tables, case, margin=0.0)
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
        ends = np.minimum(at[np.append(first[1:], len(at)) - 1] + 1, len(times) - 1)
        found += [(name, "track", start, stop) for start, stop in zip(times[at[first]], times[ends], strict=True)]
    return pd.DataFrame(found, columns=["satellite", "state", "t_s", "t_end_s"])


def _mark_losses(axes: Any, changes: pd.DataFrame, names: list[str]) -> None:
    for reason, group in pick(changes, from_state="track").groupby("reason", sort=False):
        style = {"marker": _REASONS.get(str(reason), "P"), "ms": 4.5, "color": "black", "mfc": "white", "mew": 0.8}
        places = [names.index(name) for name in group.satellite]
        axes.plot(group.t_s, places, ls="none", label=f"tracking ends: {reason}", clip_on=False, zorder=4, **style)


def layers_of(rows: pd.DataFrame) -> list[str]:
    """Return the layers that delay, or are corrected for, in rows of the table `satellites`."""
    return [layer for layer in LAYERS if (rows[[f"{layer}_m", f"{layer}_left_m"]].abs() >= _LEAST).any(axis=None)]


@drawing
def delays(tables: Tables, case: str) -> Figure:
    """Draw the true delay of every satellite tracked, and below it what the filter's correction leaves of it."""
    rows = pick(tables.satellites, case=case)
    layers = layers_of(rows) or list(LAYERS[:1])
    figure, grid = canvas(2, len(layers), 2.3, sharex=True)
    for panels, layer in zip(grid.T, layers, strict=True):
        true, left = panels
        _lines(true, rows, f"{layer}_m", PALETTE[0])
        _lines(left, rows, f"{layer}_left_m", PALETTE[1])
        drawn = rows[f"{layer}_m"][rows[f"{layer}_m"] >= _LEAST]
        scale_up(true.yaxis, drawn)
        if true.get_yscale() == "log":
            true.set_ylim(bottom=0.7 * drawn.min())
        left.axhline(0.0, color="black", lw=0.7)
        true.set_ylabel(f"{layer}, true\ndelay (m)")
        left.set_ylabel(f"{layer}, left by\nthe correction (m)")
        over_time(panels, tables, case, numbers=len(layers) > 1)
    legend_below(figure, grid[0, 0])
    if len(layers) > 1:
        figure.legends[0].set_title(event_key(pick(tables.events, case=case)), FontProperties(size=7.5))
        figure.legends[0].get_title().set_color(GREY)
    return figure


def _lines(axes: Any, rows: pd.DataFrame, column: str, colour: str) -> None:
    times = pd.Index(np.sort(rows.t_s.unique()))
    for number, (_, one) in enumerate(rows.groupby("satellite")):
        label = "each satellite tracked" if number == 0 else None
        axes.plot(times, one.set_index("t_s")[column].reindex(times), color=colour, lw=0.6, alpha=0.6, label=label)
    axes.plot(times, rows.groupby("t_s")[column].median().reindex(times), color="black", lw=1.7, label="their median")


@drawing
def latency(tables: Tables, case: str) -> Figure:
    """Draw how old measurements are when the filter takes them for present."""
    rows = pick(tables.satellites, case=case).drop_duplicates("t_s")
    figure, ax = panel(2.3)
    age = rows.latency_s * 1e3
    ax.step(rows.t_s, age, where="post", color=PALETTE[0])
    ax.set(ylim=(0.0, max(1.0, 1.15 * float(age.max()))), ylabel="age of the\nmeasurements (ms)")
    over_time([ax], tables, case)
    return figure
