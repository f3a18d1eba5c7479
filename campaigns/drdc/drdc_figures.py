"""What a model of the vehicle improves, phase by phase and reading by reading, and what the filtered rate is worth."""

import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise, product
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.api.figures import (
    GREY,
    PALETTE,
    SHADE,
    Figure,
    canvas,
    line_of,
    named_ticks,
    over_time,
    panel,
    widen_covered,
)
from lvnav_trade.api.input import error_axes, name_suggestion, quoted
from lvnav_trade.api.measures import FRAMES, NAVIGATION, Tables, cases_of, evaluate_single, history_of, pick
from lvnav_trade.api.pages import Block, FigureEntry, StudySection, Text, table, words

COLUMNS = ["during", "error", "case", "stated_percent", "raw_percent", "unbiased_percent"]
_AXES = ("pitch", "yaw")
_RAW, _UNBIASED = "raw_", "corrected_"
_SIDE_BY_SIDE = 6  # cases that a table holds next to each other
_BEFORE, _AFTER = 1.0, 2.0  # s, for which the filter takes a change of phase to last (section 2.3.2)
_CHANGE = re.compile(r"stage(\d+)_(ignition|cutoff|separation)")
_READINGS = (
    "By how much the filter's own sigma is below the sample's, in every interpretation of its noise. The sample "
    "includes its bias, by our reading of the publication; without bias it is the sample less its estimated bias."
)


def interpretation_frame(tables: Tables) -> pd.DataFrame:
    """Return improvements by phase, error and case, where the campaign's references hold estimates against raw samples.

    case is what sets a case apart from the others that are held so. stated_percent: what is stated of that case, NaN
    where nothing is. raw_percent: the filter's own sigma against that of the sample as it is, which is charged with its
    bias. unbiased_percent: against the sample less its estimated bias. Empty where nothing is held so.
    """
    stated = {
        (str(one["during"]), str(one["metric"]), case): float(one["value"])
        for one in tables.campaign.get("references") or ()
        if str(one.get("than") or "").startswith(_RAW)
        for case in cases_of(tables, one.get("case") or {}, ())
    }
    phases, metrics, cases = ([*dict.fromkeys(names)] for names in (zip(*stated, strict=True) if stated else ((),) * 3))
    names, rows = short_names(tables, cases), []
    for during, metric, case in product(phases, metrics, cases):
        below = [_below(tables, case, metric, during, prefix) for prefix in (_RAW, _UNBIASED)]
        known = stated.get((during, metric, case), np.nan)
        rows.append((during, metric.replace("_error_", " "), names[case], known, *below))
    return pd.DataFrame(rows, columns=COLUMNS)


def _below(tables: Tables, case: str, metric: str, during: str, prefix: str) -> float:
    asked: Mapping[str, Any] = {"metric": metric, "during": during, "statistic": "formal"}
    unit = "deg/h" if metric.startswith("rate") else "mg"
    estimate, sample = (
        evaluate_single(tables, case, {**asked, "metric": name}, unit).value for name in (metric, prefix + metric)
    )
    return 100.0 * (1.0 - estimate / sample)


def short_names(tables: Tables, cases: Sequence[str]) -> dict[str, str]:
    """Return by case, of those given, the levels of the axes that set them apart."""
    first = tables.levels[cases[0]] if cases else {}
    differ = [axis for axis in first if len({tables.levels[case].get(axis) for case in cases}) > 1]
    return {case: ", ".join(tables.levels[case][axis] for axis in differ) or tables.labels[case] for case in cases}


def interpretations_table(tables: Tables) -> list[Block]:
    """Return improvements of all cases that references hold against raw samples, side by side; nothing without any, or
    of more cases than a page has room for; nothing without runs, or where the vehicle is under control.
    """
    if len(tables.nozzle_travel) or not tables.cases.run_count.any():
        return []
    frame = interpretation_frame(tables)
    if frame.empty or frame.case.nunique() > _SIDE_BY_SIDE:
        return []
    keys = ["error", "during"]
    found = frame[keys].drop_duplicates().reset_index(drop=True)
    each, cases = pd.MultiIndex.from_frame(found), frame.case.unique()
    for heading, column in (
        ("{}: stated (%)", "stated_percent"),
        ("{}: ours (%)", "raw_percent"),
        ("both sides without bias, {} (%)", "unbiased_percent"),
    ):
        for case in cases:
            mine = frame[frame.case == case].set_index(keys)[column]
            found[heading.format(case)] = mine.reindex(each).to_numpy()
    found["during"] = words(found.during)
    return [Text(_READINGS), table(found, "Readings of one datasheet side by side.")]


def apart_faults(figure: FigureEntry, question: StudySection) -> Iterator[tuple[str, str]]:
    """Yield the axes of an entry that its campaign does not have."""
    known = error_axes(question.campaign)
    for quantity, axis in figure.settings.get("axes", {}).items():
        if quantity not in known:
            yield "settings.axes", f"no quantity {quoted(quantity)}{name_suggestion(quantity, known)}"
        elif axis not in (*known[quantity], "3d"):
            yield f"settings.axes.{quantity}", f"no axis {quoted(axis)}{name_suggestion(axis, known[quantity])}"


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
    widen_covered(figure)
    return figure


def phases_of(tables: Tables, case: str) -> pd.DataFrame:
    """Return the phases of a flight from lift-off on, by the events of the case.

    row: what the phase is one of (motors, atmosphere, filter). phase: its name. t_s, t_end_s: begin and end. A change
    of phase, as the filter takes it, lasts from a second before lift-off, an ignition, a cut-off or a separation to
    two seconds after.
    """
    times = pick(tables.events, case=case, kind="event").set_index("event").t_s
    changes = [float(t) for name, t in times.items() if name == "liftoff" or _CHANGE.match(str(name))]
    ignitions = {"1": float(times.liftoff)} | {
        found[1]: float(t)
        for name, t in times.items()
        if (found := _CHANGE.match(str(name))) and found[2] == "ignition"
    }
    burns = [(begin, float(times[f"stage{number}_cutoff"])) for number, begin in sorted(ignitions.items())]
    fairing, end = float(times.fairing_separation), burns[-1][1]
    rows = [("motors", "boost", begin, cutoff) for begin, cutoff in burns]
    rows += [("motors", "coast", cutoff, begin) for (_, cutoff), (begin, _) in pairwise(burns)]
    rows += [("atmosphere", "endoatmospheric", float(times.liftoff), fairing)]
    rows += [("atmosphere", "exoatmospheric", fairing, end)]
    rows += [("filter", "change of phase", t - _BEFORE, t + _AFTER) for t in changes]
    return pd.DataFrame(rows, columns=["row", "phase", "t_s", "t_end_s"])


def phases(tables: Tables, case: str) -> Figure:
    """Draw the phases of a flight over time: burns and coasts, with the fairing and without, changes of phase."""
    frame = phases_of(tables, case)
    figure, ax = panel(2.2)
    names, colours = list(frame.row.unique()), (PALETTE[0], SHADE, *PALETTE[1:])
    by_phase = dict(zip(frame.phase.unique(), colours, strict=False))
    for (row, phase), group in frame.groupby(["row", "phase"], sort=False):
        middle = names.index(str(row))
        ax.boxes(group.t_s, group.t_end_s, middle - 0.35, middle + 0.35, color=by_phase[phase], label=phase)
    ax.set(ylim=(len(names) - 0.5, -0.5), yticks=named_ticks(names), grid=False)
    ax.set(xlim=(float(frame.t_s.min()) - 5.0, float(frame.t_end_s.max()) + 5.0))
    over_time([ax], tables, case, margin=0.0)
    return figure


def apart(tables: Tables, cases: Sequence[Mapping[str, str]], axes: Mapping[str, str] | None = None) -> Figure:
    """Draw by how many percent the true sigma of navigation errors is smaller in each case than in the one named after
    it: cases stand in pairs, a panel each; linear covariance, from lift-off on. axes: by quantity, in place of 3d.
    """
    chosen = {quantity: (axes or {}).get(quantity, "3d") for quantity in NAVIGATION}
    named = [cases_of(tables, asked, ())[0] for asked in cases]
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
    widen_covered(figure)
    return figure


def interpretations(tables: Tables) -> Figure:
    """Draw by how much the estimates lie below the raw samples in every case that references hold so, phase by phase:
    against the sample as it is, and without bias on either side; what is stated as marks.
    """
    frame = interpretation_frame(tables)
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
    widen_covered(figure)
    return figure


def worth(tables: Tables, cases: Sequence[Mapping[str, str]] = ()) -> Figure:
    """Draw what feeds the controller is worth, all cases or those asked for: movement of the nozzle with the raw, the
    filtered and the true rate, by how much the filtered one is less, and the attitude's error in burns.
    """
    frame = FRAMES["rate_filter_benefit"](tables)
    wanted = [case for asked in cases for case in cases_of(tables, asked, ())] or list(tables.labels)
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
            above.text(at_case, highest, f"{row.reduction_percent:.1f} % less", ha="center", va="bottom")
        above.set(title=axis, ylim=(0.0, top))
        labels = [textwrap.fill(name.replace("^2", "²"), 18) for name in names.values()]
        below.set(xlabel="case")
        for axes in (above, below):
            axes.set(xticks=named_ticks(labels), grid=False)
    grid[0, 0].set(ylabel="total nozzle movement (deg)\nin %: less with the filtered rate")
    grid[1, 0].set(ylabel="attitude error in burns\n(mrad, RMS)")
    widen_covered(figure)
    return figure
