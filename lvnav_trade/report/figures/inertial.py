"""Inertial units: Allan deviation over the averaging time."""

import math

import pandas as pd

from lvnav_trade.report.figures.figure import GREY, Figure, canvas
from lvnav_trade.report.figures.style import PALETTE, drawing
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.statistics.select import pick
from lvnav_trade.results.tables.read import Tables

_DEG_H, _MG = math.degrees(3600.0), 1e3 / 9.80665  # of rad/s and m/s^2
_PARTS = (("white", "white noise", ":"), ("instability", "bias instability", "--"), ("walk", "random walk", "-."))


@drawing
def allan(tables: Tables, case: str) -> Figure:
    """Draw the Allan deviation of every sensor of a case: of a simulated stream as dots, by its card as a line, and the
    parts of the card.
    """
    rows = pick(METRICS["allan"](tables), case=tables.labels[case])
    sensors = list(dict.fromkeys(rows.sensor))
    figure, grid = canvas(-(-len(sensors) // 2), 2, 2.7)
    for axes, sensor in zip(grid.ravel(), sensors, strict=False):
        one = rows[rows.sensor == sensor]
        axes.set(xscale="log", yscale="log", xlabel="averaging time (s)")
        axes.plot(one.tau_s, one.card, color=PALETTE[0], label="card")
        for name, label, dashes in _PARTS:
            if (one[name] > 0.0).any():
                axes.plot(one.tau_s, one[name], color=GREY, lw=0.8, ls=dashes, label=label)
        axes.plot(one.tau_s, one.stream, ls="none", marker="o", ms=3, color=PALETTE[1], label="simulated stream")
        least = one[["card", "stream"]].to_numpy().min()
        axes.set(ylabel=f"{sensor}\n({one.unit.iloc[0]})", ylim=(0.3 * max(least, 1e-30), None))
    return figure


def allan_of_log(curves: pd.DataFrame) -> Figure:
    """Draw the Allan deviation of each axis of a log as dots with its interval of 95 % as a band, the fit as a line."""
    sensors = list(dict.fromkeys(curves.sensor))
    figure, grid = canvas(-(-len(sensors) // 3), 3, 2.4)
    for axes, sensor in zip(grid.ravel(), sensors, strict=False):
        one = curves[curves.sensor == sensor]
        unit, factor = ("deg/h", _DEG_H) if sensor.startswith("gyro") else ("mg", _MG)
        axes.set(xscale="log", yscale="log", xlabel="averaging time (s)", ylabel=f"{sensor} ({unit})")
        axes.fill_between(one.tau_s, factor * one.low_si, factor * one.high_si, color=PALETTE[1], alpha=0.25)
        axes.plot(one.tau_s, factor * one.model_si, color=PALETTE[0], label="fit")
        axes.plot(
            one.tau_s, factor * one.deviation_si, ls="none", marker="o", ms=3, color=PALETTE[1], label="log, with 95 %"
        )
    return figure


def outages_of_log(outages: pd.DataFrame) -> Figure:
    """Draw the errors at the ends of outages of a recorded log over the time of the end, with the filter's three sigma;
    a column per length, a row each for position and velocity.
    """
    lengths = list(dict.fromkeys(outages.length_s))
    figure, grid = canvas(2, len(lengths), 2.2, sharex="col")
    shown = (("position", "m"), ("velocity", "m_per_s"))
    for row, (quantity, unit) in enumerate(shown):
        for column, length in enumerate(lengths):
            axes = grid[row, column]
            for k, (case, one) in enumerate(outages[outages.length_s == length].groupby("case", sort=False)):
                colour = PALETTE[k % len(PALETTE)]
                style = {"ls": "none", "marker": "o", "ms": 3, "color": colour}
                axes.plot(one.end_s, one[f"{quantity}_error_{unit}"], label=str(case), **style)
                axes.plot(one.end_s, one[f"{quantity}_3sigma_{unit}"], ls="--", lw=0.9, color=colour)
            axes.set(ylabel=f"{quantity} error ({unit.replace('_per_', '/')})", margin=0.04)
            axes.set(**({"title": f"{length:g} s withheld"} if row == 0 else {"xlabel": "end of the outage (s)"}))
    return figure
