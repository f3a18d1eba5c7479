"""Rate and acceleration of the vehicle: raw and filtered over the flight; what stretches tell of the states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from lvnav_trade.metrics.basics.select import NAVIGATION, lincov_rms
from lvnav_trade.metrics.filter.observed import is_position_bias
from lvnav_trade.metrics.published.interpretations import interpretations as interpretations_frame
from lvnav_trade.metrics.published.published import cases_of
from lvnav_trade.plots.errors import rows_of
from lvnav_trade.plots.style import GREY, PALETTE, canvas, legend_below, look, mark_events
from lvnav_trade.store import Tables, load


def motion(results: Path | str | Tables, case: str, quantity: str) -> Figure:
    """Draw the errors of the raw sample and of the estimate, rate or acceleration, an axis below the other, 1 sigma."""
    tables = load(results)
    named = dict.fromkeys(tables.outputs[tables.outputs.quantity == quantity].axis)
    axes_names = [axis for axis in named if axis != "3d"]
    unit, factor = tables.people[quantity, axes_names[0]]
    with look():
        figure, grid = canvas(len(axes_names), 1, 1.95, sharex=True)
        for number, (ax, axis) in enumerate(zip(grid[:, 0], axes_names, strict=True)):
            both = (rows_of(tables, case, name, axis) for name in (f"raw_{quantity}", quantity))
            raw, estimate = (rows[rows.t_s > rows.t_s.min()] for rows in both)  # before the first there is no sample
            runs = int(estimate.run_count.iloc[0])
            if runs:
                text = f"RMS of {runs} runs"
                ax.plot(raw.t_s, raw.rms_si * factor, color=PALETTE[1], lw=0.7, alpha=0.7, label=f"raw, {text}")
                ax.plot(estimate.t_s, estimate.rms_si * factor, color=PALETTE[0], lw=0.7, alpha=0.7,
                        label=f"filtered, {text}")  # fmt: skip
            ax.plot(raw.t_s, raw.lincov_formal_si * factor, color=PALETTE[1], label="raw, formal")
            ax.plot(estimate.t_s, estimate.lincov_formal_si * factor, color="black", label="filtered, formal")
            true = lincov_rms(estimate) * factor
            ax.plot(estimate.t_s, true, color=PALETTE[2], ls="--", label="filtered, LinCov true")
            ax.set_ylabel(f"{axis}\n({unit}, 1 sigma)")
            ax.set_ylim(0.0, 1.6 * float(raw.lincov_formal_si.max()) * factor)
            ax.margins(x=0.01)
            mark_events(ax, tables.events[tables.events.case == case], names=number == 0)
        grid[-1, 0].set_xlabel("time since lift-off (s)")
        legend_below(figure, grid[0, 0], columns=3)
    return figure


def ignition(results: Path | str | Tables, case: str) -> Figure:
    """Draw the formal sigma of filtered over raw, roll rate and acceleration along x, around lift-off."""
    tables = load(results)
    with look():
        figure, grid = canvas(1, 1, 2.6)
        ax = grid[0, 0]
        for number, (quantity, axis) in enumerate((("acceleration", "x"), ("acceleration", "z"), ("rate", "pitch"))):
            filtered, raw = (rows_of(tables, case, name, axis) for name in (quantity, f"corrected_{quantity}"))
            near = ((filtered.t_s >= -5.0) & (filtered.t_s <= 15.0)).to_numpy()
            ratio = filtered.lincov_formal_si.to_numpy() / raw.lincov_formal_si.to_numpy()
            ax.plot(filtered.t_s[near], ratio[near], "o-", ms=3, color=PALETTE[number], label=f"{quantity} {axis}")
        ax.axhline(1.0, color=GREY, lw=0.8)
        ax.set_ylim(0.0, 1.1)
        ax.set_xlabel("time since lift-off (s)")
        ax.set_ylabel("sigma, filtered over raw\n(bias estimated on both sides)")
        ax.legend(loc="lower right")
    return figure


def apart(results: Path | str | Tables, cases: Sequence[Mapping[str, str]]) -> Figure:
    """Draw by how many percent the true sigma of navigation errors is smaller in each case than in the one named after
    it: cases stand in pairs, a panel each; linear covariance, from lift-off on.
    """
    tables = load(results)
    named = [cases_of(tables, asked)[0] for asked in cases]
    pairs = list(zip(named[::2], named[1::2], strict=True))
    with look():
        figure, grid = canvas(len(pairs), 1, 2.0, sharex=True, sharey=True)
        for ax, (first, second) in zip(grid[:, 0], pairs, strict=True):
            for k, quantity in enumerate(NAVIGATION):
                one, other = (rows_of(tables, case, quantity, "3d") for case in (first, second))
                sigma = one.lincov_true_si.to_numpy() / other.lincov_true_si.to_numpy()
                flown = (one.t_s >= 0.0).to_numpy()
                ax.plot(one.t_s[flown], 100.0 * (1.0 - sigma[flown]), color=PALETTE[k], label=quantity)
            ax.axhline(0.0, color=GREY, lw=0.8)
            ax.set_title(f"{tables.labels[first]}, against {tables.labels[second]}", loc="left", fontsize=7.5)
            ax.set_ylabel("3D sigma smaller\nby (%)")
            ax.margins(x=0.01)
            mark_events(ax, tables.events[tables.events.case == first], names=False)
        grid[-1, 0].set_xlabel("time since lift-off (s); lines: events")
        legend_below(figure, grid[0, 0])
    return figure


def interpretations(results: Path | str | Tables) -> Figure:
    """Draw by how much the estimates lie below the raw samples in every case that references hold so, phase by phase:
    against the sample as it is, and without bias on either side; what is stated as marks.
    """
    frame = interpretations_frame(results)
    phases, errors, cases = (list(dict.fromkeys(frame[name])) for name in ("during", "error", "case"))
    bars = [(case, column) for column in ("raw_percent", "unbiased_percent") for case in cases]
    width, place = 0.8 / len(bars), np.arange(len(errors))
    with look():
        figure, grid = canvas(len(phases), 1, 2.3, sharex=True)
        for ax, phase in zip(grid[:, 0], phases, strict=True):
            for number, (case, column) in enumerate(bars):
                rows = frame[(frame.during == phase) & (frame.case == case)].set_index("error").loc[errors]
                x = place + (number - 0.5 * (len(bars) - 1)) * width
                text = case if column == "raw_percent" else f"{case}, both sides without bias"
                shade = 0.95 if column == "raw_percent" else 0.45
                ax.bar(x, rows[column], 0.92 * width, color=PALETTE[number % len(cases)], alpha=shade, label=text)
                if column == "raw_percent":
                    ax.plot(x, rows.stated_percent, "_", color="black", ms=11, mew=1.6,
                            label="stated" if number == 0 else None)  # fmt: skip
            ax.set_title(phase.replace("_", " "), loc="left")
            ax.set_ylabel("sigma below\nthe sample's (%)")
            ax.set_ylim(0.0, 100.0)
            ax.grid(axis="x", visible=False)
        grid[-1, 0].set_xticks(place, errors)
        grid[-1, 0].set_xlabel("error")
        legend_below(figure, grid[0, 0], columns=2)
    return figure


def singular(results: Path | str | Tables, case: str) -> Figure:
    """Draw the singular values of what each stretch tells; those of a position against its bias stand out."""
    tables = load(results)
    rows = tables.observability[tables.observability.case == case]
    with look():
        figure, grid = canvas(1, 1, 3.2)
        ax = grid[0, 0]
        middle, reach = 0.5 * (rows.t_s + rows.t_end_s), 0.45 * (rows.t_end_s - rows.t_s)
        apart = np.array([is_position_bias(text) for text in rows.direction], dtype=bool)
        for chosen, colour, label in ((~apart, PALETTE[0], "all other directions"),
                                      (apart, PALETTE[1], "position against its bias")):  # fmt: skip
            ax.hlines(rows.singular_ratio[chosen], (middle - reach)[chosen], (middle + reach)[chosen], color=colour,
                      lw=1.6, label=label)  # fmt: skip
        ax.axhline(
            float(rows.tolerance_ratio.iloc[0]), color=GREY, ls=":", label="tolerance of the rank with information"
        )
        ax.set_yscale("log")
        ax.set_xlabel("time since lift-off (s)")
        ax.set_ylabel("singular value (-)")
        legend_below(figure, ax, columns=3)
    return figure
