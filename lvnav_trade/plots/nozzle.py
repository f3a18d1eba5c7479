"""The turning launcher: nozzle movement by what feeds the controller; angular acceleration and jerk in envelopes."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from lvnav_trade.metrics.published.interpretations import short_names
from lvnav_trade.metrics.published.published import cases_of
from lvnav_trade.metrics.vehicle.nozzle import nozzle
from lvnav_trade.metrics.vehicle.nozzle import worth as worth_of
from lvnav_trade.plots.style import GREY, PALETTE, canvas, legend_below, line_of, look, mark_events
from lvnav_trade.store import Tables, load

Floats = NDArray[np.float64]

_AXES = ("pitch", "yaw")


def movement(results: Path | str | Tables, case: str) -> Figure:
    """Draw the nozzle's movement so far by what feeds the controller: mean of the runs, and all of them as a band."""
    tables = load(results)
    rows = tables.movement[tables.movement.case == case]
    with look():
        figure, grid = canvas(1, 2, 2.9, sharey=True)
        for axes, axis in zip(grid.ravel(), _AXES, strict=True):
            for number, feed in enumerate(dict.fromkeys(rows.feed)):
                one, style = rows[(rows.feed == feed) & (rows.axis == axis)], line_of(number)
                low, high = np.degrees(one.low_rad), np.degrees(one.high_rad)
                axes.fill_between(one.t_s, low, high, color=style["color"], alpha=0.25, linewidth=0)
                axes.plot(one.t_s, np.degrees(one.mean_rad), lw=1.4, label=f"{feed} rate", **style)
            axes.set_title(axis)
            axes.set_xlabel("time since lift-off (s); lines: events")
            axes.margins(x=0.01)
            mark_events(axes, tables.events[tables.events.case == case], names=False)
        grid[0, 0].set_ylim(0.0)
        grid[0, 0].set_ylabel("total nozzle movement (deg)")
        legend_below(figure, grid[0, 0])
    return figure


def sweep(results: Path | str | Tables) -> Figure:
    """Draw by how much less the nozzle moves with the filtered rate over the rate gain, with intervals of paired runs,
    for every other setting of the cases; the band of what is published shaded.
    """
    tables = load(results)
    found = nozzle(tables)
    found = found[(found.burn == "flight") & found.less_percent.notna()]
    lines: dict[str, list[tuple[float, str]]] = {}
    for case in tables.cases.itertuples():
        levels = json.loads(case.axes)
        factor = float(levels.pop("rate_gain", 1.0))
        lines.setdefault(", ".join(levels.values()) or "all", []).append((factor, tables.labels[case.case]))
    with look():
        figure, grid = canvas(1, 2, 2.9, sharey=True)
        for axes, axis in zip(grid.ravel(), _AXES, strict=True):
            for number, (name, points) in enumerate(lines.items()):
                rows = [(factor, row) for factor, label in sorted(points)
                        for row in found[(found.case == label) & (found.axis == axis)].itertuples()]  # fmt: skip
                values = np.array([row.less_percent for _, row in rows])
                reach = np.array([[row.less_percent - row.low_percent, row.high_percent - row.less_percent]
                                  for _, row in rows]).T  # fmt: skip
                style = {**line_of(number), "label": name, "linestyle": ("-", "-", ":", "--")[number % 4]}
                mark = ("o", "s", "^", "D")[number % 4]
                size, face = (7.0, "none") if number % 2 == 0 else (3.5, style["color"])  # equal ones stay apart
                axes.errorbar(
                    [factor for factor, _ in rows], values, yerr=reach, marker=mark, ms=size, mfc=face, **style
                )
            axes.axhspan(50.0, 85.0, color=GREY, alpha=0.15, lw=0)
            axes.set_title(axis)
            axes.set_xlabel("rate gain over that of the card (-)")
        grid[0, 0].set_ylabel("less nozzle movement\nwith the filtered rate (%, 95 %)")
        legend_below(figure, grid[0, 0], columns=2)
    return figure


def worth(results: Path | str | Tables, cases: Sequence[Mapping[str, str]] = ()) -> Figure:
    """Draw what feeds the controller is worth, all cases or those asked for: movement of the nozzle with the raw, the
    filtered and the true rate, by how much the filtered one is less, and the attitude's error in burns.
    """
    tables = load(results)
    frame = worth_of(tables)
    wanted = [case for asked in cases for case in cases_of(tables, asked)] or list(tables.labels)
    names = {tables.labels[case]: name for case, name in short_names(tables, wanted).items()}
    place = np.arange(len(names))
    with look():
        figure, grid = canvas(2, 2, 2.3, sharex=True, sharey="row")
        for column, axis in enumerate(_AXES):
            rows = frame[frame.axis == axis].set_index("case").loc[list(names)]
            for number, feed in enumerate(("raw", "filtered", "true")):
                x = place + 0.27 * (number - 1)
                colour = line_of(number)["color"]
                grid[0, column].bar(x, rows[f"{feed}_deg"], 0.25, color=colour, label=f"{feed} rate")
                grid[1, column].bar(x, rows[f"{feed}_error_mrad"], 0.25, color=colour)
            for at_case, row in zip(place, rows.itertuples(), strict=True):
                text, at = f"{row.less_percent:.1f} % less", (at_case, row.raw_deg)
                grid[0, column].annotate(text, at, (0, 3), textcoords="offset points", ha="center", fontsize=7)
            grid[0, column].margins(y=0.12)
            grid[0, column].set_title(axis)
            labels = [textwrap.fill(name.replace("^2", "²"), 18) for name in names.values()]
            grid[1, column].set_xticks(place, labels, fontsize=8.5 if len(names) < 4 else 7.0)
            grid[1, column].set_xlabel("case")
            for axes in grid[:, column]:
                axes.grid(axis="x", visible=False)
        grid[0, 0].set_ylabel("total nozzle movement (deg)\nin %: less with the filtered rate")
        grid[1, 0].set_ylabel("attitude error in burns\n(mrad, RMS)")
        legend_below(figure, grid[0, 0])
    return figure


def envelopes(results: Path | str | Tables, case: str) -> Figure:
    """Draw angular acceleration and lateral jerk of one run, pitch, in their envelopes over the first seconds."""
    tables = load(results)
    rows = tables.motion[(tables.motion.case == case) & (tables.motion.axis == "pitch")]
    with look():
        figure, grid = canvas(2, 1, 2.4, sharex=True)
        named = (
            (
                grid[0, 0],
                rows.turning_rad_per_s2,
                rows.turning_bound_rad_per_s2,
                "angular acceleration\nin pitch (rad/s²)",
            ),
            (grid[1, 0], rows.jerk_m_per_s3, rows.jerk_bound_m_per_s3, "jerk along z (m/s³)"),
        )
        for axes, value, bound, label in named:
            axes.plot(rows.t_s, value, lw=0.5, color=PALETTE[0], label="true")
            axes.plot(rows.t_s, bound, lw=1.2, color=PALETTE[1], label="envelope, 1 sigma of what the filter expects")
            axes.plot(rows.t_s, -bound, lw=1.2, color=PALETTE[1])
            axes.set_ylabel(label)
            axes.margins(x=0.0)
        grid[0, 0].legend(loc="upper right")
        grid[1, 0].set_xlabel("time since lift-off (s)")
    return figure
