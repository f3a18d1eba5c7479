"""Figures of a study: ratios to published numbers, published single flights, a metric over a setting, process noise."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.quantities.units import parse
from lvnav_trade.report.figures.figure import GREY, SHADE, Figure, Panel, canvas, named_ticks, panel
from lvnav_trade.report.figures.style import PALETTE, drawing, line_of, scale_up
from lvnav_trade.results.evaluate import name_of
from lvnav_trade.results.evaluation.pooled_cases import axes_of, cases_of, evaluate_single, label_of
from lvnav_trade.results.evaluation.published import at_an_edge
from lvnav_trade.results.requirements.limit_crossings import BASE, base_level
from lvnav_trade.results.tables.read import Tables

_DRAWN = 0.02, 50.0  # limits of the axis of ratios; ratios beyond are drawn as arrows at its ends
_AT_AN_EDGE = "in band, published flight outside our runs"
_FLOWN = "used in the study"
_ERRORS = (("attitude", "rad", 1e3, "mrad"), ("velocity", "m_per_s", 1.0, "m/s"), ("position", "m", 1.0, "m"))


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
    lacks = (frame.ratio.isna() | (frame.ratio <= 0.0)).to_numpy()
    alone = (frame["item"] != "") & ~frame["item"].duplicated(keep=False)
    names = [row.item if alone[row.Index] else f"{row.item or row.metric}: {row.case}" for row in frame.itertuples()]
    place = np.arange(len(frame))
    clipped = frame.ratio.mask(lacks, _DRAWN[0])
    low, high, ratio = (column.clip(*_DRAWN) for column in (frame.band_low, frame.band_high, clipped))
    figure, ax = panel(1.1 + 0.17 * len(frame))
    ax.hlines(place, low, high, color=SHADE, lw=5, alpha=0.6, label="band")
    _ratio_marks(ax, frame[~lacks], clipped[~lacks], ratio[~lacks])
    if lacks.any():
        style = {"ls": "none", "marker": "x", "color": "black", "ms": 4.5, "label": "no number of ours, or other sign"}
        ax.plot(ratio[lacks], place[lacks], **style)
    ax.axvline(1.0, color=GREY, lw=0.8)
    _ratio_axes(ax, names, "ours / published (-)")
    return figure


def _ratio_marks(ax: Panel, rows: pd.DataFrame, clipped: pd.Series, ratio: pd.Series) -> None:
    """Draw ratios by their verdict, with arrows for ratios outside the axis; the ordinate is the index of the row.

    clipped : ratios with those outside the axis moved to its ends
    """
    inside, edge = rows.in_band.astype(bool), at_an_edge(rows)
    kinds = [
        (inside & ~edge, "in band", {"color": PALETTE[0], "marker": "o"}),
        (inside & edge, _AT_AN_EDGE, {"color": PALETTE[1], "marker": "D", "mfc": "white"}),
        (~inside, "out of band", {"color": PALETTE[1], "marker": "D"}),
    ]
    for chosen, label, look in kinds:
        if label == _AT_AN_EDGE and not chosen.any():
            continue
        for end, arrow in ((0.0, None), (-1.0, "<"), (1.0, ">")):
            here = chosen & (np.sign(clipped - ratio) == end)
            if end == 0.0 or here.any():
                style = look | ({"marker": arrow} if arrow else {"label": label})
                ax.plot(ratio[here], ratio.index[here], ls="none", ms=4.5, **style)


def _ratio_axes(ax: Panel, names: Sequence[str], label: str) -> None:
    """Make the horizontal axis logarithmic, for ratios, and label the items from the top down."""
    short = [name if len(name) <= 62 else name[:59] + "..." for name in names]
    ax.set(xscale="log", ylim=(len(names) - 0.4, -0.6), yticks=named_ticks(short), grid=False)
    ax.set(xlabel=label, ylabel="item")


@drawing
def spread(tables: Tables, references: Sequence[Mapping[str, Any]]) -> Figure | None:
    """Draw every published number of a single flight with the distribution of the runs; None if there is none.

    The box contains half of the runs, the whiskers 90 %. All values are ratios to the published number.
    """
    rows = []
    for published in references:
        pool = axes_of(published)
        for case in cases_of(tables, published.get("case") or {}, pool) if published.get("single") else ():
            run_ratios = evaluate_single(tables, case, published, str(published["unit"])).runs / float(
                published["value"]
            )
            run_ratios = run_ratios[np.isfinite(run_ratios)]
            if len(run_ratios) > 1:
                name = f"{published.get('item') or name_of(published)}: {label_of(tables, case, pool)}"
                rows.append((name, run_ratios, published.get("band") or (0.5, 2.0)))
    if not rows:
        return None
    figure, ax = panel(1.1 + 0.22 * len(rows))
    for place, (_, run_ratios, band) in enumerate(rows):
        q = np.quantile(run_ratios, [0.05, 0.25, 0.5, 0.75, 0.95])
        for low, high, label, style in (
            (max(band[0], 0.02), band[1], "band", {"color": SHADE, "lw": 9, "alpha": 0.35}),
            (q[0], q[4], "90 % of our runs", {"color": PALETTE[0], "lw": 1.2}),
            (q[1], q[3], "50 % of our runs", {"color": PALETTE[0], "lw": 5}),
        ):
            ax.hlines(place, low, high, label=label if place == 0 else None, **style)
        ax.plot([q[2]], [place], ls="none", marker="|", color="white", ms=7)
    ax.axvline(1.0, color=PALETTE[1], lw=1.6, label="published, one flight")
    _ratio_axes(ax, [name for name, _, _ in rows], "our runs, each divided by published (-)")
    return figure


@drawing
def locus(
    tables: Tables,
    axis: str,
    stated: Mapping[str, Any],
    unit: str,
    published: PublishedValue | None = None,
    cases: Sequence[Mapping[str, str]] = (),
    varied: str = "",
    flown: str = "",
) -> Figure:
    """Draw a metric over the levels of an axis, one line for each combination of the other axes.

    Parameters
    ----------
    axis : str
        Name of the axis in the labels of cases.
    stated : mapping
        Statement: metric, `at` or `during`, statistic.
    unit : str
        Unit of the metric.
    published : PublishedValue, optional
        Published value, drawn as a line with its band.
    cases : sequence of mapping
        Levels of the cases to draw; all if empty.
    varied : str
        Quantity that the axis varies, for the label; the name of the axis if empty.
    flown : str
        Level that the study uses, marked by a ring; the level of the base if empty.
    """
    chosen = {case for wanted in cases for case in cases_of(tables, wanted, ())} or set(tables.labels)
    rows = []
    for case, levels in tables.levels.items():
        if case in chosen and axis in levels:
            others = ", ".join(f"{name}={level}" for name, level in levels.items() if name != axis and level != "base")
            rows.append((levels[axis], others, evaluate_single(tables, case, stated, unit).value))
    frame = pd.DataFrame(rows, columns=["level", "others", "value"])
    if set(frame.level) > {BASE}:  # in a design one_at_a_time, the level of the base is a word
        frame = frame[frame.level != BASE]
    names = list(dict.fromkeys(frame.level))
    sizes, kind = level_sizes(names)
    frame = frame.assign(x=[sizes[names.index(level)] for level in frame.level])
    mine = _flown(tables, axis, flown, frame, lambda case: evaluate_single(tables, case, stated, unit).value)
    figure, ax = panel(3.0)
    mark_levels(ax, [*sizes, *mine.x], names, kind)
    points = pd.concat([frame, mine[mine.level == BASE]]).sort_values("x", kind="stable") if kind else frame
    points = points[_placed(ax, points)]
    for number, others in enumerate(dict.fromkeys(frame.others)):
        group = points[points.others == others]
        ax.plot(group.x, group.value, marker="o", ms=4, label=str(others) or "ours", **line_of(number))
    if published is not None:
        low, high = (edge * published.value for edge in published.band)
        ax.axhline(published.value, color="black", lw=1.1, label="published")
        ax.axhspan(low, high, color=SHADE, alpha=0.25, label="band")
    scale_up(ax, "y", [*frame.value, *mine.value, *([published.value] if published else [])])
    _rings(ax, mine, kind)
    ax.set(
        xlabel=(varied or axis.replace("_", " ")) + (f" ({kind})" if kind else ""),
        ylabel=f"{name_of(stated).replace('_', ' ')}\n({unit})".replace(", ", ",\n"),
    )
    return figure


def _flown(
    tables: Tables, axis: str, flown: str, frame: pd.DataFrame, value_of: Callable[[str], float]
) -> pd.DataFrame:
    """Return the points of the level that the study uses, or of the base if this is a case of its own."""
    base = base_level(tables, axis)
    level = flown or base.label
    if (frame.level == level).any():
        return frame[frame.level == level]
    case = next((case for case, levels in tables.levels.items() if set(levels.values()) == {BASE}), None)
    kinds = dict.fromkeys(frame.level)
    sizes, level_unit = level_sizes([*kinds, f"{base.number!r} {base.unit}".strip()])
    if flown or case is None or level_unit is None or not np.isfinite(base.number):
        return frame[:0]
    return pd.DataFrame([{"level": BASE, "others": "", "value": value_of(case), "x": sizes[-1]}])


def _rings(ax: Panel, points: pd.DataFrame, kind: str | None) -> None:
    """Draw rings around points; a point at zero on a logarithmic axis becomes a dotted line."""
    is_placed = _placed(ax, points)
    if is_placed.any():
        look = {"ls": "none", "marker": "o", "ms": 9, "mfc": "none", "color": "black"}
        ax.plot(points.x[is_placed], points.value[is_placed], label=_FLOWN, **look)
    for value in points.value[~is_placed]:
        ax.axhline(value, color="black", ls=":", lw=1.1, label=f"{_FLOWN} (0{f' {kind}' if kind else ''})")


def _placed(ax: Panel, rows: pd.DataFrame) -> Any:
    """Return whether each row has a place on the horizontal axis."""
    return (rows.x > 0.0) | (ax.axes.get("xscale") != "log")


def mark_levels(ax: Panel, sizes: Sequence[float], names: Sequence[str], kind: str | None) -> None:
    """Set the ticks of an axis of levels: by name unless they are numbers in one unit; `kind`: this unit or None."""
    if kind is None:
        ax.set(xticks=list(zip(sizes, map(str, names), strict=False)))  # further sizes are those of the base
    else:
        scale_up(ax, "x", sizes, from_zero=False)


def level_sizes(names: Sequence[str]) -> tuple[list[float], str | None]:
    """Return the positions (n,) of the levels of an axis and their unit.

    The positions are the numbers of the levels if these have the same dimension; otherwise 0, 1, 2, ... and None.
    """
    parts = [name.strip().partition(" ") for name in names]
    try:
        numbers = [float(number) for number, _, _ in parts]
        spelled = dict.fromkeys(unit for (_, _, unit), number in zip(parts, numbers, strict=True) if number or unit)
        first = next(iter(spelled), "")
        if len(spelled) > 1:
            numbers = [parse(f"{number} {unit or first}", first) for number, _, unit in parts]
    except ValueError:
        return [float(k) for k in range(len(names))], None
    return numbers, first or "-"


def steps(table: pd.DataFrame, phases: Sequence[tuple[str, float, float]] = ()) -> Figure:
    """Draw the error of unaided runs, and the error per step that the filter's transition does not predict.

    table : one sigma per axis, from `campaign.derived.steps_table`
    phases : name, start and end (s), marked by lines
    """
    figure, grid = canvas(3, 1, 1.7)
    for ax, (name, unit, factor, label) in zip(grid[:, 0], _ERRORS, strict=True):
        for column, text, style in (
            (f"{name}_error_{unit}", "error itself", {"color": PALETTE[1], "ls": "--"}),
            (f"{name}_missed_{unit}", "error of the transition in a step", {"color": PALETTE[0]}),
            (
                f"{name}_missed_mean_{unit}",
                "mean error of the transition, norm",
                {"color": "black", "lw": 0.8, "ls": ":"},
            ),
        ):
            ax.plot(table.t_s, factor * table[column].where(table[column] > 0.0), label=text, **style)
        for _, start, _ in phases:
            ax.axvline(start, color=GREY, lw=0.5)
        ax.set(yscale="log", ylabel=f"{name}, one sigma\n({label})", margin=0.0)
    grid[-1, 0].set(xlabel="time since lift-off (s)")
    return figure
