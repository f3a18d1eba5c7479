"""Figures of a study: ratios to published numbers, published single flights, a metric over a setting, process noise."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import parse
from lvnav_trade.report.figures.figure import GREY, SHADE, Figure, Panel, canvas, named_ticks, panel
from lvnav_trade.report.figures.style import PALETTE, drawing, line_of, scale_up
from lvnav_trade.results.evaluate import name_of
from lvnav_trade.results.evaluation.pooled_cases import axes_of, cases_of, evaluate_single, label_of
from lvnav_trade.results.evaluation.published import is_at_edge
from lvnav_trade.results.requirements.limit_crossings import BASE, base_level
from lvnav_trade.results.tables.read import Tables

_RATIO_LIMITS = 0.02, 50.0  # of the axis of ratios; ratios beyond are drawn as arrows at its ends
_AT_AN_EDGE = "in band, published flight outside our runs"
_STUDY_LEVEL = "used in the study"
# Error, SI unit in the names of columns, factor to the display unit, display unit
_ERRORS = (
    ("attitude", "rad", 1e3, "mrad"),
    ("velocity", "m_per_s", 1.0, "m/s"),
    ("position", "m", 1.0, "m"),
)
_LONGEST_NAME = 62  # characters of an item on the axis of ratios


class PublishedValue(NamedTuple):
    """A published number."""

    value: float  # in the unit of the figure
    band: tuple[float, float] = (0.5, 2.0)  # band of agreement, as ratios to the value


def ratios(references: pd.DataFrame) -> Figure:
    """Draw the ratio of the result to every published number, with its band.

    Ratios outside their band are marked, and so are published single flights that are unlikely among the runs. A ratio
    below 0.02 or above 50 is an arrow at the end of the axis. A missing result, or one of opposite sign, is a cross.
    """
    frame = references[references.published.notna()].reset_index(drop=True)
    is_missing = (frame.ratio.isna() | (frame.ratio <= 0.0)).to_numpy()
    places = np.arange(len(frame))
    ratio = frame.ratio.mask(is_missing, _RATIO_LIMITS[0])
    clipped_ratio = ratio.clip(*_RATIO_LIMITS)
    figure, ax = panel(1.1 + 0.17 * len(frame))
    ax.hlines(
        places,
        frame.band_low.clip(*_RATIO_LIMITS),
        frame.band_high.clip(*_RATIO_LIMITS),
        color=SHADE,
        lw=5,
        alpha=0.6,
        label="band",
    )
    is_given = ~is_missing
    _ratio_marks(ax, frame[is_given], ratio[is_given], clipped_ratio[is_given])
    if is_missing.any():
        ax.plot(
            clipped_ratio[is_missing],
            places[is_missing],
            ls="none",
            marker="x",
            color="black",
            ms=4.5,
            label="no number of ours, or other sign",
        )
    ax.axvline(1.0, color=GREY, lw=0.8)
    _ratio_axes(ax, _item_names(frame), "ours / published (-)")
    return figure


def _item_names(frame: pd.DataFrame) -> list[str]:
    """Return the name of every row: its item, followed by the case if rows share the item."""
    is_unique = (frame["item"] != "") & ~frame["item"].duplicated(keep=False)
    names = []
    for row in frame.itertuples():
        name = row.item or row.metric
        names.append(name if is_unique[row.Index] else f"{name}: {row.case}")
    return names


def _ratio_marks(ax: Panel, rows: pd.DataFrame, ratio: pd.Series, clipped_ratio: pd.Series) -> None:
    """Draw ratios by their verdict, with arrows for ratios outside the axis; the ordinate is the index of the row.

    clipped_ratio : ratios with those outside the axis moved to its ends
    """
    is_in_band = rows.in_band.astype(bool)
    is_near_edge = is_at_edge(rows)
    verdicts: list[tuple[pd.Series, str, dict[str, Any]]] = [
        (is_in_band & ~is_near_edge, "in band", {"color": PALETTE[0], "marker": "o"}),
        (is_in_band & is_near_edge, _AT_AN_EDGE, {"color": PALETTE[1], "marker": "D", "mfc": "white"}),
        (~is_in_band, "out of band", {"color": PALETTE[1], "marker": "D"}),
    ]
    for selection, label, style in verdicts:
        if label == _AT_AN_EDGE and not selection.any():
            continue
        # Drawn even if it is empty, for the legend
        ratios_on_axis = clipped_ratio[selection & (clipped_ratio == ratio)]
        ax.plot(ratios_on_axis, ratios_on_axis.index, ls="none", ms=4.5, **style, label=label)
        for is_off_axis, arrow in ((ratio < clipped_ratio, "<"), (ratio > clipped_ratio, ">")):
            ratios_off_axis = clipped_ratio[selection & is_off_axis]
            if len(ratios_off_axis):
                arrow_style = {**style, "marker": arrow}
                ax.plot(ratios_off_axis, ratios_off_axis.index, ls="none", ms=4.5, **arrow_style)


def _ratio_axes(ax: Panel, names: Sequence[str], label: str) -> None:
    """Make the horizontal axis logarithmic, for ratios, and label the items from the top down."""
    short_names = []
    for name in names:
        if len(name) > _LONGEST_NAME:
            name = name[: _LONGEST_NAME - 3] + "..."
        short_names.append(name)
    ax.set(
        xscale="log",
        xlabel=label,
        ylim=(len(names) - 0.4, -0.6),
        yticks=named_ticks(short_names),
        ylabel="item",
        grid=False,
    )


class _RunRatios(NamedTuple):
    """Results of the runs for a published number.

    name : Item and case.
    ratios : (n_run,). Results over the published number.
    band : Band of agreement, as ratios.
    """

    name: str
    ratios: Floats
    band: tuple[float, float]


@drawing
def spread(tables: Tables, references: Sequence[Mapping[str, Any]]) -> Figure | None:
    """Draw every published number of a single flight with the distribution of the runs; None if there is none.

    The box contains half of the runs, the whiskers 90 %. All values are ratios to the published number.
    """
    rows = _single_flights(tables, references)
    if not rows:
        return None
    figure, ax = panel(1.1 + 0.22 * len(rows))
    for place, row in enumerate(rows):
        q05, q25, q50, q75, q95 = np.quantile(row.ratios, [0.05, 0.25, 0.5, 0.75, 0.95])
        band_low, band_high = row.band
        is_first = place == 0
        for low, high, label, style in (
            (max(band_low, 0.02), band_high, "band", {"color": SHADE, "lw": 9, "alpha": 0.35}),
            (q05, q95, "90 % of our runs", {"color": PALETTE[0], "lw": 1.2}),
            (q25, q75, "50 % of our runs", {"color": PALETTE[0], "lw": 5}),
        ):
            legend_entry = label if is_first else None
            ax.hlines(place, low, high, label=legend_entry, **style)
        ax.plot([q50], [place], ls="none", marker="|", color="white", ms=7)
    ax.axvline(1.0, color=PALETTE[1], lw=1.6, label="published, one flight")
    _ratio_axes(ax, [row.name for row in rows], "our runs, each divided by published (-)")
    return figure


def _single_flights(tables: Tables, references: Sequence[Mapping[str, Any]]) -> list[_RunRatios]:
    """Return the results of the runs, by case, for every published number that is of a single flight."""
    rows = []
    for reference in references:
        if not reference.get("single"):
            continue
        pool = axes_of(reference)
        for case in cases_of(tables, reference.get("case") or {}, pool):
            runs = evaluate_single(tables, case, reference, str(reference["unit"])).runs
            run_ratios = runs / float(reference["value"])
            run_ratios = run_ratios[np.isfinite(run_ratios)]
            if len(run_ratios) > 1:
                item = reference.get("item") or name_of(reference)
                name = f"{item}: {label_of(tables, case, pool)}"
                rows.append(_RunRatios(name, run_ratios, reference.get("band") or (0.5, 2.0)))
    return rows


@drawing
def locus(
    tables: Tables,
    axis: str,
    statement: Mapping[str, Any],
    unit: str,
    published: PublishedValue | None = None,
    cases: Sequence[Mapping[str, str]] = (),
    varied: str = "",
    study_level: str = "",
) -> Figure:
    """Draw a metric over the levels of an axis, one line for each combination of the other axes.

    Parameters
    ----------
    axis : str
        Name of the axis in the labels of cases.
    statement : mapping
        Statement: metric, `at` or `during`, statistic.
    unit : str
        Unit of the metric.
    published : PublishedValue, optional
        Published value, drawn as a line with its band.
    cases : sequence of mapping
        Levels of the cases to draw; all if empty.
    varied : str
        Quantity that the axis varies, for the label; the name of the axis if empty.
    study_level : str
        Level that the study uses, marked by a ring; the level of the base if empty.
    """

    def value_of(case: str) -> float:
        return evaluate_single(tables, case, statement, unit).value

    frame = _axis_points(tables, axis, cases, value_of)
    names = list(dict.fromkeys(frame.level))
    sizes, level_unit = level_sizes(names)
    frame = frame.assign(x=[sizes[names.index(level)] for level in frame.level])
    study_points = _study_points(tables, axis, study_level, frame, value_of)
    figure, ax = panel(3.0)
    mark_levels(ax, [*sizes, *study_points.x], names, level_unit)
    points = frame
    if level_unit:
        points = pd.concat([frame, study_points[study_points.level == BASE]]).sort_values("x", kind="stable")
    points = points[_is_on_axis(ax, points)]
    for number, other_levels in enumerate(dict.fromkeys(frame.others)):
        group = points[points.others == other_levels]
        ax.plot(group.x, group.value, marker="o", ms=4, label=str(other_levels) or "ours", **line_of(number))
    values = [*frame.value, *study_points.value]
    if published is not None:
        low, high = (edge * published.value for edge in published.band)
        ax.axhline(published.value, color="black", lw=1.1, label="published")
        ax.axhspan(low, high, color=SHADE, alpha=0.25, label="band")
        values.append(published.value)
    scale_up(ax, "y", values)
    _rings(ax, study_points, level_unit)
    quantity = varied or axis.replace("_", " ")
    metric = name_of(statement).replace("_", " ")
    ax.set(xlabel=f"{quantity} ({level_unit})" if level_unit else quantity)
    ax.set(ylabel=f"{metric}\n({unit})".replace(", ", ",\n"))
    return figure


def _axis_points(
    tables: Tables, axis: str, cases: Sequence[Mapping[str, str]], value_of: Callable[[str], float]
) -> pd.DataFrame:
    """Return the cases of an axis: level, levels of the other axes (others), and value.

    axis : name of the axis
    cases : levels of the selected cases; all cases if empty
    value_of : function that returns the metric of a case by its digest
    """
    selection = {case for levels in cases for case in cases_of(tables, levels, ())}
    selection = selection or set(tables.labels)
    rows = []
    for case, levels in tables.levels.items():
        if case in selection and axis in levels:
            other_levels = []
            for name, level in levels.items():
                if name != axis and level != "base":
                    other_levels.append(f"{name}={level}")
            setting = ", ".join(other_levels)
            rows.append((levels[axis], setting, value_of(case)))
    frame = pd.DataFrame(rows, columns=["level", "others", "value"])
    if set(frame.level) > {BASE}:  # in a design one_at_a_time, the level of the base is a word
        frame = frame[frame.level != BASE]
    return frame


def _study_points(
    tables: Tables, axis: str, level: str, frame: pd.DataFrame, value_of: Callable[[str], float]
) -> pd.DataFrame:
    """Return the points of the level that the study uses, or of the base if this is a separate case.

    level : level that the study uses; that of the base if empty
    frame : points of the axis, from `_axis_points`
    value_of : function that returns the metric of a case by its digest
    """
    base = base_level(tables, axis)
    used_level = level or base.label
    is_used = frame.level == used_level
    if is_used.any():
        return frame[is_used]
    base_cases = [case for case, levels in tables.levels.items() if set(levels.values()) == {BASE}]
    base_text = f"{base.number!r} {base.unit}".strip()
    distinct_levels = dict.fromkeys(frame.level)
    sizes, level_unit = level_sizes([*distinct_levels, base_text])
    if level or not base_cases or level_unit is None or not np.isfinite(base.number):
        return frame[:0]
    point = {"level": BASE, "others": "", "value": value_of(base_cases[0]), "x": sizes[-1]}
    return pd.DataFrame([point])


def _rings(ax: Panel, points: pd.DataFrame, level_unit: str | None) -> None:
    """Draw rings around points; a point at zero on a logarithmic axis becomes a dotted line."""
    is_placed = _is_on_axis(ax, points)
    if is_placed.any():
        ax.plot(
            points.x[is_placed],
            points.value[is_placed],
            ls="none",
            marker="o",
            ms=9,
            mfc="none",
            color="black",
            label=_STUDY_LEVEL,
        )
    zero = f"0 {level_unit}" if level_unit else "0"
    for value in points.value[~is_placed]:
        ax.axhline(value, color="black", ls=":", lw=1.1, label=f"{_STUDY_LEVEL} ({zero})")


def _is_on_axis(ax: Panel, rows: pd.DataFrame) -> Any:
    """Return whether each row has a place on the horizontal axis."""
    return (rows.x > 0.0) | (ax.axes.get("xscale") != "log")


def mark_levels(ax: Panel, sizes: Sequence[float], names: Sequence[str], level_unit: str | None) -> None:
    """Set the ticks of an axis of levels: by name unless they are numbers in one unit.

    sizes, names : positions and names of the levels
    level_unit : common unit of the levels; None: named levels
    """
    if level_unit is None:
        ax.set(xticks=list(zip(sizes, map(str, names), strict=False)))  # further sizes are those of the base
    else:
        scale_up(ax, "x", sizes, from_zero=False)


def level_sizes(names: Sequence[str]) -> tuple[list[float], str | None]:
    """Return the positions (n,) of the levels of an axis and their unit.

    The positions are the numbers of the levels if these have the same dimension; otherwise 0, 1, 2, ... and None.
    """
    split_names = [name.strip().partition(" ") for name in names]
    try:
        numbers = [float(number) for number, _, _ in split_names]
        units = [unit for _, _, unit in split_names]
        # A zero without a unit belongs to any dimension
        levels = list(zip(numbers, units, strict=True))
        distinct_units = dict.fromkeys(unit for number, unit in levels if number or unit)
        first_unit = next(iter(distinct_units), "")
        if len(distinct_units) > 1:
            texts = [f"{number} {unit or first_unit}" for number, unit in levels]
            numbers = [parse(text, first_unit) for text in texts]
    except ValueError:
        return [float(k) for k in range(len(names))], None
    return numbers, first_unit or "-"


def steps(table: pd.DataFrame, phases: Sequence[tuple[str, float, float]] = ()) -> Figure:
    """Draw the error of unaided runs, and the error per step that the filter's transition does not predict.

    table : one sigma per axis, from `campaign.derived.steps_table`
    phases : name, start and end (s), marked by lines
    """
    figure, grid = canvas(3, 1, 1.7)
    for ax, (name, unit, factor, label) in zip(grid[:, 0], _ERRORS, strict=True):
        for suffix, legend_entry, style in (
            ("error", "error itself", {"color": PALETTE[1], "ls": "--"}),
            ("missed", "error of the transition in a step", {"color": PALETTE[0]}),
            ("missed_mean", "mean error of the transition, norm", {"color": "black", "lw": 0.8, "ls": ":"}),
        ):
            error = table[f"{name}_{suffix}_{unit}"]
            positive_error = factor * error.where(error > 0.0)
            ax.plot(table.t_s, positive_error, label=legend_entry, **style)
        for _, start, _ in phases:
            ax.axvline(start, color=GREY, lw=0.5)
        ax.set(yscale="log", ylabel=f"{name}, one sigma\n({label})", margin=0.0)
    grid[-1, 0].set(xlabel="time since lift-off (s)")
    return figure
