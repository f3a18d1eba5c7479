"""The turning launcher: nozzle movement by what feeds the controller; angular acceleration and jerk in envelopes."""

import json
import textwrap
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from lvnav_trade.metrics.basics.select import pick
from lvnav_trade.metrics.published.published import cases_of
from lvnav_trade.metrics.published.references import short_names
from lvnav_trade.metrics.vehicle import nozzle
from lvnav_trade.metrics.vehicle import worth as worth_of
from lvnav_trade.plots.style import GREY, PALETTE, canvas, drawing, legend_below, line_of, over_time
from lvnav_trade.store import Tables

_AXES = ("pitch", "yaw")


@drawing
def movement(tables: Tables, case: str) -> Figure:
    """Draw the nozzle's movement so far by what feeds the controller: mean of the runs, and all of them as a band."""
    rows = pick(tables.movement, case=case)
    figure, grid = canvas(1, 2, 2.9, sharey=True)
    for axes, axis in zip(grid[0], _AXES, strict=True):
        for number, feed in enumerate(dict.fromkeys(rows.feed)):
            one, style = pick(rows, feed=feed, axis=axis), line_of(number)
            low, high = np.degrees(one.low_rad), np.degrees(one.high_rad)
            axes.fill_between(one.t_s, low, high, color=style["color"], alpha=0.25, linewidth=0)
            axes.plot(one.t_s, np.degrees(one.mean_rad), lw=1.4, label=f"{feed} rate", **style)
        axes.set_title(axis)
        over_time([axes], tables, case, names=False, label="time since lift-off (s); lines: events")
    grid[0, 0].set(ylim=0.0, ylabel="total nozzle movement (deg)")
    return legend_below(figure, grid[0, 0])


@drawing
def sweep(tables: Tables) -> Figure:
    """Draw by how much less the nozzle moves with the filtered rate over the rate gain, with intervals of paired runs,
    for every other setting of the cases; the band of what is published shaded.
    """
    found = nozzle(tables)
    found = found[(found.burn == "flight") & found.less_percent.notna()]
    lines: dict[str, dict[str, float]] = {}
    for case in tables.cases.itertuples():
        levels = json.loads(case.axes)
        gain = float(levels.pop("rate_gain", 1.0))
        lines.setdefault(", ".join(levels.values()) or "all", {})[tables.labels[case.case]] = gain
    figure, grid = canvas(1, 2, 2.9, sharey=True)
    for axes, axis in zip(grid[0], _AXES, strict=True):
        for number, (name, gains) in enumerate(lines.items()):
            rows = found[(found.axis == axis) & found.case.isin(gains)]
            rows = rows.assign(gain=rows.case.map(gains)).sort_values(["gain", "case"])
            reach = [rows.less_percent - rows.low_percent, rows.high_percent - rows.less_percent]
            style = {**line_of(number), "label": name, "linestyle": ("-", "-", ":", "--")[number % 4]}
            style |= {"marker": ("o", "s", "^", "D")[number % 4], "yerr": reach}
            style |= {"ms": 7.0, "mfc": "none"} if number % 2 == 0 else {"ms": 3.5, "mfc": style["color"]}  # apart
            axes.errorbar(rows.gain, rows.less_percent, **style)
        axes.axhspan(50.0, 85.0, color=GREY, alpha=0.15, lw=0)
        axes.set(title=axis, xlabel="rate gain over that of the card (-)")
    grid[0, 0].set_ylabel("less nozzle movement\nwith the filtered rate (%, 95 %)")
    return legend_below(figure, grid[0, 0], columns=2)


@drawing
def worth(tables: Tables, cases: Sequence[Mapping[str, str]] = ()) -> Figure:
    """Draw what feeds the controller is worth, all cases or those asked for: movement of the nozzle with the raw, the
    filtered and the true rate, by how much the filtered one is less, and the attitude's error in burns.
    """
    frame = worth_of(tables)
    wanted = [case for asked in cases for case in cases_of(tables, asked)] or list(tables.labels)
    names = {tables.labels[case]: name for case, name in short_names(tables, wanted).items()}
    place = np.arange(len(names))
    figure, grid = canvas(2, 2, 2.3, sharex=True, sharey="row")
    for (above, below), axis in zip(grid.T, _AXES, strict=True):
        rows = pick(frame, axis=axis).set_index("case").loc[list(names)]
        for number, feed in enumerate(("raw", "filtered", "true")):
            x, colour = place + 0.27 * (number - 1), line_of(number)["color"]
            above.bar(x, rows[f"{feed}_deg"], 0.25, color=colour, label=f"{feed} rate")
            below.bar(x, rows[f"{feed}_error_mrad"], 0.25, color=colour)
        for at_case, row in zip(place, rows.itertuples(), strict=True):
            text, at = f"{row.less_percent:.1f} % less", (at_case, row.raw_deg)
            above.annotate(text, at, (0, 3), textcoords="offset points", ha="center", fontsize=7)
        above.margins(y=0.12)
        above.set_title(axis)
        labels = [textwrap.fill(name.replace("^2", "²"), 18) for name in names.values()]
        below.set_xticks(place, labels, fontsize=8.5 if len(names) < 4 else 7.0)
        below.set_xlabel("case")
        for axes in (above, below):
            axes.grid(axis="x", visible=False)
    grid[0, 0].set_ylabel("total nozzle movement (deg)\nin %: less with the filtered rate")
    grid[1, 0].set_ylabel("attitude error in burns\n(mrad, RMS)")
    return legend_below(figure, grid[0, 0])


@drawing
def envelopes(tables: Tables, case: str) -> Figure:
    """Draw angular acceleration and lateral jerk of one run, pitch, in their envelopes over the first seconds."""
    rows = pick(tables.motion, case=case, axis="pitch")
    figure, grid = canvas(2, 1, 2.4, sharex=True)
    for axes, value, bound, label in (
        (grid[0, 0], "turning_rad_per_s2", "turning_bound_rad_per_s2", "angular acceleration\nin pitch (rad/s²)"),
        (grid[1, 0], "jerk_m_per_s3", "jerk_bound_m_per_s3", "jerk along z (m/s³)"),
    ):
        axes.plot(rows.t_s, rows[value], lw=0.5, color=PALETTE[0], label="true")
        axes.plot(rows.t_s, rows[bound], lw=1.2, color=PALETTE[1], label="envelope, 1 sigma of what the filter expects")
        axes.plot(rows.t_s, -rows[bound], lw=1.2, color=PALETTE[1])
        axes.set_ylabel(label)
        axes.margins(x=0.0)
    grid[0, 0].legend(loc="upper right")
    grid[1, 0].set_xlabel("time since lift-off (s)")
    return figure
