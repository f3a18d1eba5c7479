"""Figures of the vehicle's motion and of its IMUs."""

import math

import numpy as np
import pandas as pd

from lvnav_trade.report.figures.figure import GREY, Figure, Panel, canvas, panel
from lvnav_trade.report.figures.style import PALETTE, drawing, line_of, over_time
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.covariances import is_position_bias
from lvnav_trade.results.statistics.select import flight_events, history_of, lincov_rms, pick
from lvnav_trade.results.tables.read import Tables

G = 9.80665
_AXES = ("pitch", "yaw")
# Value, its envelope, label of the axis
_TURNING = (
    (
        "angular_acceleration_rad_per_s2",
        "angular_acceleration_envelope_rad_per_s2",
        "angular acceleration\nin pitch (rad/s²)",
    ),
    ("jerk_m_per_s3", "jerk_envelope_m_per_s3", "jerk along z (m/s³)"),
)
# Dashes and markers of lines with different settings. Large open and small filled markers take turns, so that equal
# curves remain distinguishable.
_SWEEP_STYLES = (
    {"ls": "-", "marker": "o", "ms": 7.0},
    {"ls": "-", "marker": "s", "ms": 3.5},
    {"ls": ":", "marker": "^", "ms": 7.0},
    {"ls": "--", "marker": "D", "ms": 3.5},
)


@drawing
def trajectory(tables: Tables, case: str) -> Figure:
    """Draw altitude, speed, specific force over time, and the ground track of a case (its digest)."""
    rows = pick(tables.reference, case=case)
    figure, grid = canvas(2, 2, 2.7)
    altitude, speed, force, track = grid.ravel()
    altitude.plot(rows.t_s, rows.altitude_m / 1e3, color=PALETTE[0])
    altitude.set(ylabel="altitude (km)")
    speed.plot(rows.t_s, rows.ground_speed_m_per_s / 1e3, color=PALETTE[0], label="relative to the ground")
    speed.plot(rows.t_s, rows.inertial_speed_m_per_s / 1e3, color=PALETTE[1], ls="--", label="inertial")
    speed.set(ylabel="speed (km/s)")
    force.plot(rows.t_s, rows.specific_force_m_per_s2 / G, color=PALETTE[0])
    force.set(ylabel="specific force (g)")
    for ax in (altitude, speed, force):
        over_time([ax], tables, case)

    longitude = np.degrees(np.unwrap(rows.longitude_rad))
    latitude = np.degrees(rows.latitude_rad).to_numpy()
    times = rows.t_s.to_numpy()
    event_times = flight_events(tables, case).t_s
    event_rows = [int(np.argmin(np.abs(times - t))) for t in event_times]
    track.plot(longitude, latitude, color=PALETTE[0])
    track.plot(
        longitude[event_rows],
        latitude[event_rows],
        ls="none",
        marker="o",
        ms=3,
        color=GREY,
    )
    track.set(
        xlabel="longitude (deg east)",
        ylabel="geodetic latitude (deg north)",
        title="ground track, events as dots",
        margin=0.1,
    )
    return figure


@drawing
def motion(tables: Tables, case: str, quantity: str) -> Figure:
    """Draw one sigma of the errors of raw sample and estimate, of rate or acceleration, one panel for each axis."""
    outputs = tables.outputs[tables.outputs.quantity == quantity]
    axes_names = [axis for axis in dict.fromkeys(outputs.axis) if axis != "3d"]
    unit, factor = tables.display_units[quantity, axes_names[0]]
    figure, grid = canvas(len(axes_names), 1, 1.95, sharex=True)
    for ax, axis in zip(grid[:, 0], axes_names, strict=True):
        raw = history_of(tables, case, f"raw_{quantity}", axis)
        estimate = history_of(tables, case, quantity, axis)
        # At the first time there is no sample yet
        has_sample = raw.t_s > raw.t_s.min()
        has_estimate = estimate.t_s > estimate.t_s.min()
        raw = raw[has_sample]
        estimate = estimate[has_estimate]

        _draw_raw_and_filtered(ax, raw, estimate, factor)
        largest = float(raw.lincov_formal_si.max()) * factor
        top = 1.6 * largest
        ax.set(ylabel=f"{axis}\n({unit}, 1 sigma)", ylim=(0.0, top))
    over_time(grid[:, 0], tables, case)
    return figure


def _draw_raw_and_filtered(ax: Panel, raw: pd.DataFrame, estimate: pd.DataFrame, factor: float) -> None:
    """Draw the errors of raw sample and estimate along one axis, of the runs and by linear covariance.

    raw, estimate : rows of the table `history`
    factor : from SI to the unit of the figure
    """
    n_runs = int(estimate.run_count.iloc[0])
    if n_runs:
        for rows, name, colour in ((raw, "raw", PALETTE[1]), (estimate, "filtered", PALETTE[0])):
            ax.plot(
                rows.t_s,
                rows.rms_si * factor,
                color=colour,
                lw=2.6,
                alpha=0.45,
                label=f"{name}, RMS of {n_runs} runs",
            )
    ax.plot(raw.t_s, raw.lincov_formal_si * factor, color=PALETTE[1], label="raw, formal")
    ax.plot(estimate.t_s, estimate.lincov_formal_si * factor, color="black", label="filtered, formal")
    ax.plot(estimate.t_s, lincov_rms(estimate) * factor, color=PALETTE[2], ls="--", label="filtered, LinCov true")


@drawing
def singular(tables: Tables, case: str) -> Figure:
    """Draw the singular values of the observability matrix by segment; a position against its bias is highlighted."""
    rows = pick(tables.observability, case=case)
    figure, ax = panel(3.2)
    middle = 0.5 * (rows.t_s + rows.t_end_s)
    half_length = 0.45 * (rows.t_end_s - rows.t_s)  # with a gap between the segments
    is_bias = np.array([is_position_bias(text) for text in rows.direction], dtype=bool)
    for selection, colour, label in (
        (~is_bias, PALETTE[0], "all other directions"),
        (is_bias, PALETTE[1], "position against its bias"),
    ):
        ax.hlines(
            rows.singular_ratio[selection],
            (middle - half_length)[selection],
            (middle + half_length)[selection],
            color=colour,
            lw=1.6,
            label=label,
        )
    tolerance = float(rows.tolerance_ratio.iloc[0])
    ax.axhline(tolerance, color=GREY, ls=":", label="tolerance of the rank with information")
    ax.set(yscale="log", xlabel="time since lift-off (s)", ylabel="singular value (-)")
    return figure


@drawing
def movement(tables: Tables, case: str) -> Figure:
    """Draw the accumulated nozzle movement by input of the controller: mean of the runs, and their range as a band."""
    rows = pick(tables.nozzle_travel_history, case=case)
    figure, grid = canvas(1, 2, 2.9, sharey=True)
    for ax, axis in zip(grid[0], _AXES, strict=True):
        for number, rate_source in enumerate(dict.fromkeys(rows.controller_rate)):
            axis_rows = pick(rows, controller_rate=rate_source, axis=axis)
            style = line_of(number)
            ax.fill_between(
                axis_rows.t_s,
                np.degrees(axis_rows.minimum_rad),
                np.degrees(axis_rows.maximum_rad),
                color=style["color"],
                alpha=0.25,
            )
            mean = np.degrees(axis_rows.mean_rad)
            ax.plot(axis_rows.t_s, mean, lw=1.4, label=f"{rate_source} rate", **style)
        ax.boxes([], [], [], [], color=GREY, alpha=0.25, label="shaded: all runs, from the least to the largest")
        ax.set(title=axis, ylim=0.0)
        over_time([ax], tables, case, label="time since lift-off (s); lines: events")
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
    gains_by_setting = _rate_gains(tables)
    figure, grid = canvas(1, 2, 2.9, sharey=True)
    for ax, axis in zip(grid[0], _AXES, strict=True):
        for number, (setting, gains) in enumerate(gains_by_setting.items()):
            rows = nozzle[(nozzle.axis == axis) & nozzle.case.isin(gains)]
            rows = rows.assign(gain=rows.case.map(gains)).sort_values(["gain", "case"])
            colour = line_of(number)["color"]
            ax.vlines(rows.gain, rows.low_percent, rows.high_percent, color=colour, lw=1.0)
            ax.plot(
                rows.gain,
                rows.reduction_percent,
                color=colour,
                mfc="none" if number % 2 == 0 else colour,
                label=setting,
                **_SWEEP_STYLES[number % len(_SWEEP_STYLES)],
            )
        if band is not None:
            low, high = band
            label = f"band: {low:g} to {high:g} %"
            ax.axhspan(low, high, color=GREY, alpha=0.15, label=label)
        ax.set(title=axis, xlabel="rate gain over that of the card (-)")
    grid[0, 0].set(ylabel="reduction of nozzle movement\nwith the filtered rate (%, 95 %)")
    return figure


def _rate_gains(tables: Tables) -> dict[str, dict[str, float]]:
    """Return the rate gain of each case by label, by the levels of the other axes."""
    gains: dict[str, dict[str, float]] = {}
    for case, levels in tables.levels.items():
        other_levels = [level for axis, level in levels.items() if axis != "rate_gain"]
        setting = ", ".join(other_levels) or "all"
        label = tables.labels[case]
        gain = float(levels.get("rate_gain", 1.0))
        gains.setdefault(setting, {})[label] = gain
    return gains


@drawing
def turning(tables: Tables, case: str) -> Figure:
    """Draw angular acceleration and lateral jerk of one run in pitch, with their envelopes, over the first seconds."""
    rows = pick(tables.motion_history, case=case, axis="pitch")
    figure, grid = canvas(2, 1, 2.4, sharex=True)
    for ax, (value, bound, label) in zip(grid[:, 0], _TURNING, strict=True):
        t = rows.t_s
        envelope = rows[bound]
        ax.plot(t, rows[value], lw=0.5, color=PALETTE[0], label="true")
        ax.plot(t, envelope, lw=1.2, color=PALETTE[1], label="envelope of the filter, 1 sigma")
        ax.plot(t, -envelope, lw=1.2, color=PALETTE[1])
        ax.set(ylabel=label, margin=0.0)
    grid[1, 0].set(xlabel="time since lift-off (s)")
    return figure


# Display units of the sensors of a log, with their factors from rad/s and m/s^2
_GYRO_UNIT = ("deg/h", math.degrees(3600.0))
_ACCELEROMETER_UNIT = ("mg", 1e3 / 9.80665)
# Contribution to the Allan deviation, legend entry, dashes
_CONTRIBUTIONS = (
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
    for ax, sensor in zip(grid.ravel(), sensors, strict=False):
        sensor_rows = rows[rows.sensor == sensor]
        ax.plot(sensor_rows.tau_s, sensor_rows.card, color=PALETTE[0], label="card")
        for name, label, dashes in _CONTRIBUTIONS:
            if (sensor_rows[name] > 0.0).any():
                ax.plot(
                    sensor_rows.tau_s,
                    sensor_rows[name],
                    color=GREY,
                    lw=0.8,
                    ls=dashes,
                    label=label,
                )
        ax.plot(
            sensor_rows.tau_s,
            sensor_rows.simulated,
            ls="none",
            marker="o",
            ms=3,
            color=PALETTE[1],
            label="simulated",
        )
        smallest_deviation = sensor_rows[["card", "simulated"]].to_numpy().min()
        ax.set(
            xscale="log",
            yscale="log",
            xlabel="averaging time (s)",
            ylabel=f"{sensor}\n({sensor_rows.unit.iloc[0]})",
            ylim=(0.3 * max(smallest_deviation, 1e-30), None),
        )
    return figure


def allan_of_log(curves: pd.DataFrame) -> Figure:
    """Draw the Allan deviation of each axis of a log: dots with a band of 95 % intervals, the fit as a line."""
    sensors = list(dict.fromkeys(curves.sensor))
    figure, grid = canvas(-(-len(sensors) // 3), 3, 2.4)
    for ax, sensor in zip(grid.ravel(), sensors, strict=False):
        sensor_rows = curves[curves.sensor == sensor]
        unit, factor = _GYRO_UNIT if sensor.startswith("gyro") else _ACCELEROMETER_UNIT
        ax.set(
            xscale="log",
            yscale="log",
            xlabel="averaging time (s)",
            ylabel=f"{sensor} ({unit})",
        )
        ax.fill_between(
            sensor_rows.tau_s,
            factor * sensor_rows.low_si,
            factor * sensor_rows.high_si,
            color=PALETTE[1],
            alpha=0.25,
        )
        ax.plot(sensor_rows.tau_s, factor * sensor_rows.model_si, color=PALETTE[0], label="fit")
        ax.plot(
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
    for axes, (quantity, unit) in zip(grid, (("position", "m"), ("velocity", "m_per_s")), strict=True):
        for ax, length in zip(axes, lengths, strict=True):
            of_length = outages[outages.length_s == length]
            for number, (case, rows) in enumerate(of_length.groupby("case", sort=False)):
                colour = PALETTE[number % len(PALETTE)]
                error = rows[f"{quantity}_error_{unit}"]
                bound = rows[f"{quantity}_3sigma_{unit}"]
                ax.plot(
                    rows.end_s,
                    error,
                    ls="none",
                    marker="o",
                    ms=3,
                    color=colour,
                    label=str(case),
                )
                ax.plot(rows.end_s, bound, ls="--", lw=0.9, color=colour)
            ax.set(ylabel=f"{quantity} error ({unit.replace('_per_', '/')})", margin=0.04)
    for upper, lower, length in zip(*grid, lengths, strict=True):
        upper.set(title=f"{length:g} s withheld")
        lower.set(xlabel="end of the outage (s)")
    return figure
