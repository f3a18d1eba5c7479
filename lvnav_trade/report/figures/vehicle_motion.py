"""Figures of the vehicle's motion and of its IMUs."""

import math

import numpy as np
import pandas as pd

from lvnav_trade.report.figures.figure import GREY, Figure, canvas, panel
from lvnav_trade.report.figures.style import PALETTE, drawing, line_of, over_time
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.covariances import is_position_bias
from lvnav_trade.results.statistics.select import flight_events, history_of, lincov_rms, pick
from lvnav_trade.results.tables.read import Tables

G = 9.80665
_AXES = ("pitch", "yaw")


@drawing
def trajectory(tables: Tables, case: str) -> Figure:
    """Draw altitude, speed, specific force over time, and the ground track of a case (its digest)."""
    rows = pick(tables.reference, case=case)
    figure, grid = canvas(2, 2, 2.7)
    altitude, speed, force, track = grid.ravel()
    altitude.plot(rows.t_s, rows.altitude_m / 1e3, color=PALETTE[0])
    speed.plot(rows.t_s, rows.ground_speed_m_per_s / 1e3, color=PALETTE[0], label="relative to the ground")
    speed.plot(rows.t_s, rows.inertial_speed_m_per_s / 1e3, color=PALETTE[1], ls="--", label="inertial")
    force.plot(rows.t_s, rows.specific_force_m_per_s2 / G, color=PALETTE[0])
    for axes, label in ((altitude, "altitude (km)"), (speed, "speed (km/s)"), (force, "specific force (g)")):
        axes.set(ylabel=label)
        over_time([axes], tables, case)
    longitude, latitude = np.degrees(np.unwrap(rows.longitude_rad)), np.degrees(rows.latitude_rad)
    track.plot(longitude, latitude, color=PALETTE[0])
    at = [int(np.argmin(np.abs(rows.t_s.to_numpy() - t))) for t in flight_events(tables, case).t_s]
    track.plot(longitude[at], latitude.to_numpy()[at], ls="none", marker="o", ms=3, color=GREY)
    track.set(xlabel="longitude (deg east)", ylabel="geodetic latitude (deg north)")
    track.set(title="ground track, events as dots", margin=0.1)
    return figure


@drawing
def motion(tables: Tables, case: str, quantity: str) -> Figure:
    """Draw one sigma of the errors of raw sample and estimate, of rate or acceleration, one panel for each axis."""
    axes = dict.fromkeys(tables.outputs[tables.outputs.quantity == quantity].axis)
    axes_names = [axis for axis in axes if axis != "3d"]
    unit, factor = tables.people[quantity, axes_names[0]]
    figure, grid = canvas(len(axes_names), 1, 1.95, sharex=True)
    for ax, axis in zip(grid[:, 0], axes_names, strict=True):
        histories = (history_of(tables, case, name, axis) for name in (f"raw_{quantity}", quantity))
        # At the first time there is no sample yet
        raw, estimate = (rows[rows.t_s > rows.t_s.min()] for rows in histories)
        runs = int(estimate.run_count.iloc[0])
        if runs:
            for rows, name, colour in ((raw, "raw", PALETTE[1]), (estimate, "filtered", PALETTE[0])):
                label = f"{name}, RMS of {runs} runs"
                ax.plot(rows.t_s, rows.rms_si * factor, color=colour, lw=2.6, alpha=0.45, label=label)
        ax.plot(raw.t_s, raw.lincov_formal_si * factor, color=PALETTE[1], label="raw, formal")
        ax.plot(estimate.t_s, estimate.lincov_formal_si * factor, color="black", label="filtered, formal")
        ax.plot(estimate.t_s, lincov_rms(estimate) * factor, color=PALETTE[2], ls="--", label="filtered, LinCov true")
        ax.set(ylabel=f"{axis}\n({unit}, 1 sigma)", ylim=(0.0, 1.6 * float(raw.lincov_formal_si.max()) * factor))
    over_time(grid[:, 0], tables, case)
    return figure


@drawing
def singular(tables: Tables, case: str) -> Figure:
    """Draw the singular values of the observability matrix by segment; a position against its bias is highlighted."""
    rows = pick(tables.observability, case=case)
    figure, ax = panel(3.2)
    middle, reach = 0.5 * (rows.t_s + rows.t_end_s), 0.45 * (rows.t_end_s - rows.t_s)
    bias = np.array([is_position_bias(text) for text in rows.direction], dtype=bool)
    for chosen, colour, label in (
        (~bias, PALETTE[0], "all other directions"),
        (bias, PALETTE[1], "position against its bias"),
    ):
        first, last = (middle - reach)[chosen], (middle + reach)[chosen]
        ax.hlines(rows.singular_ratio[chosen], first, last, color=colour, lw=1.6, label=label)
    ax.axhline(float(rows.tolerance_ratio.iloc[0]), color=GREY, ls=":", label="tolerance of the rank with information")
    ax.set(yscale="log", xlabel="time since lift-off (s)", ylabel="singular value (-)")
    return figure


@drawing
def movement(tables: Tables, case: str) -> Figure:
    """Draw the accumulated nozzle movement by input of the controller: mean of the runs, and their range as a band."""
    rows = pick(tables.nozzle_travel_history, case=case)
    figure, grid = canvas(1, 2, 2.9, sharey=True)
    for axes, axis in zip(grid[0], _AXES, strict=True):
        for number, feed in enumerate(dict.fromkeys(rows.controller_rate)):
            axis_rows, style = pick(rows, controller_rate=feed, axis=axis), line_of(number)
            low, high = np.degrees(axis_rows.minimum_rad), np.degrees(axis_rows.maximum_rad)
            axes.fill_between(axis_rows.t_s, low, high, color=style["color"], alpha=0.25)
            axes.plot(axis_rows.t_s, np.degrees(axis_rows.mean_rad), lw=1.4, label=f"{feed} rate", **style)
        axes.boxes([], [], [], [], color=GREY, alpha=0.25, label="shaded: all runs, from the least to the largest")
        axes.set(title=axis, ylim=0.0)
        over_time([axes], tables, case, label="time since lift-off (s); lines: events")
    grid[0, 0].set(ylabel="total nozzle movement (deg)")
    return figure


@drawing
def sweep(tables: Tables, band: tuple[float, float] | None = None) -> Figure:
    """Draw the reduction of nozzle movement with the filtered rate over the rate gain, for every other setting.

    Intervals are those of paired runs.

    band : required reduction (%), shaded
    """
    nozzle = METRICS["nozzle_travel"](tables)
    nozzle = nozzle[(nozzle.burn == "flight") & nozzle.reduction_percent.notna()]
    lines: dict[str, dict[str, float]] = {}
    for case, levels in tables.levels.items():
        other_levels = ", ".join(level for name, level in levels.items() if name != "rate_gain") or "all"
        lines.setdefault(other_levels, {})[tables.labels[case]] = float(levels.get("rate_gain", 1.0))
    figure, grid = canvas(1, 2, 2.9, sharey=True)
    for axes, axis in zip(grid[0], _AXES, strict=True):
        for number, (name, gains) in enumerate(lines.items()):
            rows = nozzle[(nozzle.axis == axis) & nozzle.case.isin(gains)]
            rows = rows.assign(gain=rows.case.map(gains)).sort_values(["gain", "case"])
            style = {**line_of(number), "label": name, "ls": ("-", "-", ":", "--")[number % 4]}
            style |= {"marker": ("o", "s", "^", "D")[number % 4]}
            axes.vlines(rows.gain, rows.low_percent, rows.high_percent, color=style["color"], lw=1.0)
            # large open and small filled markers: equal curves remain distinguishable
            style |= {"ms": 7.0, "mfc": "none"} if number % 2 == 0 else {"ms": 3.5, "mfc": style["color"]}
            axes.plot(rows.gain, rows.reduction_percent, **style)
        if band is not None:
            axes.axhspan(*band, color=GREY, alpha=0.15, label=f"band: {band[0]:g} to {band[1]:g} %")
        axes.set(title=axis, xlabel="rate gain over that of the card (-)")
    grid[0, 0].set(ylabel="reduction of nozzle movement\nwith the filtered rate (%, 95 %)")
    return figure


@drawing
def turning(tables: Tables, case: str) -> Figure:
    """Draw angular acceleration and lateral jerk of one run in pitch, with their envelopes, over the first seconds."""
    rows = pick(tables.motion_history, case=case, axis="pitch")
    figure, grid = canvas(2, 1, 2.4, sharex=True)
    for axes, value, bound, label in (
        (
            grid[0, 0],
            "angular_acceleration_rad_per_s2",
            "angular_acceleration_envelope_rad_per_s2",
            "angular acceleration\nin pitch (rad/s²)",
        ),
        (grid[1, 0], "jerk_m_per_s3", "jerk_envelope_m_per_s3", "jerk along z (m/s³)"),
    ):
        axes.plot(rows.t_s, rows[value], lw=0.5, color=PALETTE[0], label="true")
        axes.plot(rows.t_s, rows[bound], lw=1.2, color=PALETTE[1], label="envelope of the filter, 1 sigma")
        axes.plot(rows.t_s, -rows[bound], lw=1.2, color=PALETTE[1])
        axes.set(ylabel=label, margin=0.0)
    grid[1, 0].set(xlabel="time since lift-off (s)")
    return figure


_DEG_H, _MG = math.degrees(3600.0), 1e3 / 9.80665  # factors from rad/s and m/s^2
_PARTS = (
    ("white_noise", "white noise", ":"),
    ("bias_instability", "bias instability", "--"),
    ("random_walk", "random walk", "-."),
)


@drawing
def allan(tables: Tables, case: str) -> Figure:
    """Draw the Allan deviation of every sensor of a case.

    Dots are a simulated log; lines are the deviation of the card and its contributions.
    """
    rows = pick(METRICS["allan"](tables), case=tables.labels[case])
    sensors = list(dict.fromkeys(rows.sensor))
    figure, grid = canvas(-(-len(sensors) // 2), 2, 2.7)
    for axes, sensor in zip(grid.ravel(), sensors, strict=False):
        sensor_rows = rows[rows.sensor == sensor]
        axes.set(xscale="log", yscale="log", xlabel="averaging time (s)")
        axes.plot(sensor_rows.tau_s, sensor_rows.card, color=PALETTE[0], label="card")
        for name, label, dashes in _PARTS:
            if (sensor_rows[name] > 0.0).any():
                axes.plot(sensor_rows.tau_s, sensor_rows[name], color=GREY, lw=0.8, ls=dashes, label=label)
        axes.plot(
            sensor_rows.tau_s,
            sensor_rows.simulated,
            ls="none",
            marker="o",
            ms=3,
            color=PALETTE[1],
            label="simulated",
        )
        least = sensor_rows[["card", "simulated"]].to_numpy().min()
        axes.set(ylabel=f"{sensor}\n({sensor_rows.unit.iloc[0]})", ylim=(0.3 * max(least, 1e-30), None))
    return figure


def allan_of_log(curves: pd.DataFrame) -> Figure:
    """Draw the Allan deviation of each axis of a log: dots with a band of 95 % intervals, the fit as a line."""
    sensors = list(dict.fromkeys(curves.sensor))
    figure, grid = canvas(-(-len(sensors) // 3), 3, 2.4)
    for axes, sensor in zip(grid.ravel(), sensors, strict=False):
        sensor_rows = curves[curves.sensor == sensor]
        unit, factor = ("deg/h", _DEG_H) if sensor.startswith("gyro") else ("mg", _MG)
        axes.set(xscale="log", yscale="log", xlabel="averaging time (s)", ylabel=f"{sensor} ({unit})")
        axes.fill_between(
            sensor_rows.tau_s, factor * sensor_rows.low_si, factor * sensor_rows.high_si, color=PALETTE[1], alpha=0.25
        )
        axes.plot(sensor_rows.tau_s, factor * sensor_rows.model_si, color=PALETTE[0], label="fit")
        axes.plot(
            sensor_rows.tau_s,
            factor * sensor_rows.deviation_si,
            ls="none",
            marker="o",
            ms=3,
            color=PALETTE[1],
            label="log, with 95 %",
        )
    return figure


def outages_of_log(outages: pd.DataFrame) -> Figure:
    """Draw the errors at the ends of outages of a recorded log with three sigma of the filter, over the time of the
    end.

    Columns are outage lengths; rows are position and velocity.
    """
    lengths = list(dict.fromkeys(outages.length_s))
    figure, grid = canvas(2, len(lengths), 2.2, sharex="col")
    quantities = (("position", "m"), ("velocity", "m_per_s"))
    for row, (quantity, unit) in enumerate(quantities):
        for column, length in enumerate(lengths):
            axes = grid[row, column]
            for k, (case, case_rows) in enumerate(outages[outages.length_s == length].groupby("case", sort=False)):
                colour = PALETTE[k % len(PALETTE)]
                style = {"ls": "none", "marker": "o", "ms": 3, "color": colour}
                axes.plot(case_rows.end_s, case_rows[f"{quantity}_error_{unit}"], label=str(case), **style)
                axes.plot(case_rows.end_s, case_rows[f"{quantity}_3sigma_{unit}"], ls="--", lw=0.9, color=colour)
            axes.set(ylabel=f"{quantity} error ({unit.replace('_per_', '/')})", margin=0.04)
            axes.set(**({"title": f"{length:g} s withheld"} if row == 0 else {"xlabel": "end of the outage (s)"}))
    return figure
