"""The vehicle's motion: the flight; rate and acceleration, raw and filtered; observability; nozzle and envelopes."""

import textwrap
from collections.abc import Mapping, Sequence

import numpy as np

from lvnav_trade.metrics import METRICS
from lvnav_trade.metrics.basics.select import NAVIGATION, flight_events, history_of, lincov_rms, pick
from lvnav_trade.metrics.errors.covariances import is_position_bias
from lvnav_trade.metrics.numbers import cases_of
from lvnav_trade.metrics.published import short_names
from lvnav_trade.plots.figure import GREY, Figure, canvas, named_ticks, panel
from lvnav_trade.plots.style import PALETTE, drawing, line_of, over_time
from lvnav_trade.store.read import Tables

G = 9.80665
_AXES = ("pitch", "yaw")


@drawing
def trajectory(tables: Tables, case: str) -> Figure:
    """Draw altitude, speed, specific force over time, and the ground track, of a case (its digest)."""
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
    """Draw the errors of the raw sample and of the estimate, rate or acceleration, an axis below the other, 1 sigma."""
    named = dict.fromkeys(tables.outputs[tables.outputs.quantity == quantity].axis)
    axes_names = [axis for axis in named if axis != "3d"]
    unit, factor = tables.people[quantity, axes_names[0]]
    figure, grid = canvas(len(axes_names), 1, 1.95, sharex=True)
    for ax, axis in zip(grid[:, 0], axes_names, strict=True):
        both = (history_of(tables, case, name, axis) for name in (f"raw_{quantity}", quantity))
        raw, estimate = (rows[rows.t_s > rows.t_s.min()] for rows in both)  # before the first there is no sample
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
def ignition(tables: Tables, case: str) -> Figure:
    """Draw the formal sigma of filtered over raw, roll rate and acceleration along x, around lift-off."""
    figure, ax = panel(2.6)
    for number, (quantity, axis) in enumerate((("acceleration", "x"), ("acceleration", "z"), ("rate", "pitch"))):
        filtered, raw = (history_of(tables, case, name, axis) for name in (quantity, f"corrected_{quantity}"))
        near = filtered.t_s.between(-5.0, 15.0).to_numpy()
        ratio = filtered.lincov_formal_si.to_numpy() / raw.lincov_formal_si.to_numpy()
        ax.plot(filtered.t_s[near], ratio[near], marker="o", ms=3, color=PALETTE[number], label=f"{quantity} {axis}")
    ax.axhline(1.0, color=GREY, lw=0.8)
    ax.set(
        ylim=(0.0, 1.1),
        xlabel="time since lift-off (s)",
        ylabel="sigma, filtered over raw\n(bias estimated on both sides)",
    )
    return figure


@drawing
def apart(tables: Tables, cases: Sequence[Mapping[str, str]], axes: Mapping[str, str] | None = None) -> Figure:
    """Draw by how many percent the true sigma of navigation errors is smaller in each case than in the one named after
    it: cases stand in pairs, a panel each; linear covariance, from lift-off on. axes: by quantity, in place of 3d.
    """
    chosen = {quantity: (axes or {}).get(quantity, "3d") for quantity in NAVIGATION}
    named = [cases_of(tables, asked)[0] for asked in cases]
    figure, grid = canvas(len(named) // 2, 1, 2.0, sharex=True, sharey=True)
    low, high = 0.0, 1e-6
    for ax, first, second in zip(grid[:, 0], named[::2], named[1::2], strict=True):
        for k, (quantity, axis) in enumerate(chosen.items()):
            one, other = (history_of(tables, case, quantity, axis) for case in (first, second))
            sigma = one.lincov_true_si.to_numpy() / other.lincov_true_si.to_numpy()
            flown = (one.t_s >= 0.0).to_numpy()
            smaller = 100.0 * (1.0 - sigma[flown])
            low, high = min(low, float(np.nanmin(smaller))), max(high, float(np.nanmax(smaller)))
            ax.plot(
                one.t_s[flown], smaller, color=PALETTE[k], label=f"{quantity}, {axis.upper() if axis == '3d' else axis}"
            )
        ax.axhline(0.0, color=GREY, lw=0.8)
        words = f"{tables.labels[first]}, against {tables.labels[second]}"
        ax.text(0.5, 0.9, words, x_part=True, y_part=True, ha="center", color=GREY)  # numbers of events stand above
        ax.set(ylabel="sigma smaller\nby (%)")
        over_time([ax], tables, first, label="")
    for ax in grid[:, 0]:
        ax.set(ylim=(low - 0.1 * (high - low), high + 0.4 * (high - low)))
    grid[-1, 0].set(xlabel="time since lift-off (s); lines: events")
    return figure


@drawing
def interpretations(tables: Tables) -> Figure:
    """Draw by how much the estimates lie below the raw samples in every case that references hold so, phase by phase:
    against the sample as it is, and without bias on either side; what is stated as marks.
    """
    frame = METRICS["interpretations"](tables)
    phases, errors, cases = (list(dict.fromkeys(frame[name])) for name in ("during", "error", "case"))
    bars = [(case, column) for column in ("raw_percent", "unbiased_percent") for case in cases]
    width, place = 0.8 / len(bars), np.arange(len(errors))
    figure, grid = canvas(len(phases), 1, 2.3, sharex=True)
    for ax, phase in zip(grid[:, 0], phases, strict=True):
        for number, (case, column) in enumerate(bars):
            rows = pick(frame, during=phase, case=case).set_index("error").loc[errors]
            x = place + (number - 0.5 * (len(bars) - 1)) * width
            raw = column == "raw_percent"
            style = (
                {"alpha": 0.95, "label": case} if raw else {"alpha": 0.45, "label": f"{case}, both sides without bias"}
            )
            ax.bar(x, rows[column], 0.92 * width, color=PALETTE[number % len(cases)], **style)
            if raw:
                label = "stated" if number == 0 else None
                ax.plot(x, rows.stated_percent, ls="none", marker="_", color="black", ms=11, label=label)
        ax.set(title=phase.replace("_", " "), ylabel="sigma below\nthe sample's (%)", ylim=(0.0, 100.0))
        ax.set(grid=False, xticks=named_ticks(errors))
    grid[-1, 0].set(xlabel="error")
    return figure


@drawing
def singular(tables: Tables, case: str) -> Figure:
    """Draw the singular values of what each stretch tells; those of a position against its bias stand out."""
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
    """Draw the nozzle's movement so far by what feeds the controller: mean of the runs, and all of them as a band."""
    rows = pick(tables.movement, case=case)
    figure, grid = canvas(1, 2, 2.9, sharey=True)
    for axes, axis in zip(grid[0], _AXES, strict=True):
        for number, feed in enumerate(dict.fromkeys(rows.feed)):
            one, style = pick(rows, feed=feed, axis=axis), line_of(number)
            low, high = np.degrees(one.low_rad), np.degrees(one.high_rad)
            axes.fill_between(one.t_s, low, high, color=style["color"], alpha=0.25)
            axes.plot(one.t_s, np.degrees(one.mean_rad), lw=1.4, label=f"{feed} rate", **style)
        axes.boxes([], [], [], [], color=GREY, alpha=0.25, label="shaded: all runs, from the least to the largest")
        axes.set(title=axis, ylim=0.0)
        over_time([axes], tables, case, label="time since lift-off (s); lines: events")
    grid[0, 0].set(ylabel="total nozzle movement (deg)")
    return figure


@drawing
def sweep(tables: Tables, band: tuple[float, float] | None = None) -> Figure:
    """Draw by how much less the nozzle moves with the filtered rate over the rate gain, with intervals of paired runs,
    for every other setting of the cases; a band (%) that is asked for shaded.
    """
    found = METRICS["nozzle"](tables)
    found = found[(found.burn == "flight") & found.less_percent.notna()]
    lines: dict[str, dict[str, float]] = {}
    for case, levels in tables.levels.items():
        others = ", ".join(level for name, level in levels.items() if name != "rate_gain") or "all"
        lines.setdefault(others, {})[tables.labels[case]] = float(levels.get("rate_gain", 1.0))
    figure, grid = canvas(1, 2, 2.9, sharey=True)
    for axes, axis in zip(grid[0], _AXES, strict=True):
        for number, (name, gains) in enumerate(lines.items()):
            rows = found[(found.axis == axis) & found.case.isin(gains)]
            rows = rows.assign(gain=rows.case.map(gains)).sort_values(["gain", "case"])
            style = {**line_of(number), "label": name, "ls": ("-", "-", ":", "--")[number % 4]}
            style |= {"marker": ("o", "s", "^", "D")[number % 4]}
            axes.vlines(rows.gain, rows.low_percent, rows.high_percent, color=style["color"], lw=1.0)
            style |= {"ms": 7.0, "mfc": "none"} if number % 2 == 0 else {"ms": 3.5, "mfc": style["color"]}  # apart
            axes.plot(rows.gain, rows.less_percent, **style)
        if band is not None:
            axes.axhspan(*band, color=GREY, alpha=0.15, label=f"band: {band[0]:g} to {band[1]:g} %")
        axes.set(title=axis, xlabel="rate gain over that of the card (-)")
    grid[0, 0].set(ylabel="less nozzle movement\nwith the filtered rate (%, 95 %)")
    return figure


@drawing
def worth(tables: Tables, cases: Sequence[Mapping[str, str]] = ()) -> Figure:
    """Draw what feeds the controller is worth, all cases or those asked for: movement of the nozzle with the raw, the
    filtered and the true rate, by how much the filtered one is less, and the attitude's error in burns.
    """
    frame = METRICS["worth"](tables)
    wanted = [case for asked in cases for case in cases_of(tables, asked)] or list(tables.labels)
    names = {tables.labels[case]: name for case, name in short_names(tables, wanted).items()}
    place, feeds = np.arange(len(names)), ("raw", "filtered", "true")
    figure, grid = canvas(2, 2, 2.3, sharex=True, sharey="row")
    top = 1.15 * float(frame[frame.case.isin(names)][[f"{feed}_deg" for feed in feeds]].max().max())  # of both axes
    for (above, below), axis in zip(grid.T, _AXES, strict=True):
        rows = pick(frame, axis=axis).set_index("case").loc[list(names)]
        for number, feed in enumerate(feeds):
            x, colour = place + 0.27 * (number - 1), line_of(number)["color"]
            above.bar(x, rows[f"{feed}_deg"], 0.25, color=colour, label=f"{feed} rate")
            below.bar(x, rows[f"{feed}_error_mrad"], 0.25, color=colour)
        for at_case, row in zip(place, rows.itertuples(), strict=True):
            highest = max(row.raw_deg, row.filtered_deg, row.true_deg)
            above.text(at_case, highest, f"{row.less_percent:.1f} % less", ha="center", va="bottom")
        above.set(title=axis, ylim=(0.0, top))
        labels = [textwrap.fill(name.replace("^2", "²"), 18) for name in names.values()]
        below.set(xlabel="case")
        for axes in (above, below):
            axes.set(xticks=named_ticks(labels), grid=False)
    grid[0, 0].set(ylabel="total nozzle movement (deg)\nin %: less with the filtered rate")
    grid[1, 0].set(ylabel="attitude error in burns\n(mrad, RMS)")
    return figure


@drawing
def turning(tables: Tables, case: str) -> Figure:
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
        axes.set(ylabel=label, margin=0.0)
    grid[1, 0].set(xlabel="time since lift-off (s)")
    return figure
