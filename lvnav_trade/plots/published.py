"""Published numbers in pictures: all ratios at once, a single flight among ours, a metric over a setting."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from lvnav_trade.metrics.published.published import cases_of, name_of, ours
from lvnav_trade.plots.style import GREY, PALETTE, canvas, legend_below, line_of, look, scale_up
from lvnav_trade.store import Tables, load
from lvnav_trade.units import parse

_DRAWN = 0.02, 50.0
"""Ratios that are drawn where they are; one beyond is an arrow at the end of the axis."""


def ratios(references: pd.DataFrame) -> Figure:
    """Draw ours over published of every number, with its band; those outside stand out.

    A ratio below 0.02 or above 50 is an arrow at that end.
    """
    frame = references[references.ratio.notna() & (references.ratio > 0)].reset_index(drop=True)
    alone = (frame["item"] != "") & ~frame["item"].duplicated(keep=False)
    names = [row.item if alone[row.Index] else f"{row.item or row.metric}: {row.case}" for row in frame.itertuples()]
    place = np.arange(len(frame))
    low, high, ratio = (column.clip(*_DRAWN) for column in (frame.band_low, frame.band_high, frame.ratio))
    with look():
        figure, grid = canvas(1, 1, 1.1 + 0.17 * len(frame))
        ax = grid[0, 0]
        ax.hlines(place, low, high, color="#9ca3af", lw=5, alpha=0.6, label="band")
        for inside, colour, marker in ((True, PALETTE[0], "o"), (False, PALETTE[1], "D")):
            chosen = (frame.in_band == inside).to_numpy()
            label = "in band" if inside else "out of band"
            for end, sign in ((0.0, marker), (-1.0, "<"), (1.0, ">")):
                here = chosen & (np.sign(frame.ratio - ratio) == end).to_numpy()
                ax.plot(ratio[here], place[here], sign, color=colour, ms=4.5, label="" if end else label)
        ax.axvline(1.0, color=GREY, lw=0.8)
        _ratio_axis(ax)
        ax.set_yticks(place, [_short(name) for name in names], fontsize=6.5)
        ax.set_ylim(len(frame) - 0.4, -0.6)
        ax.grid(axis="y", visible=False)
        ax.set_xlabel("ours / published (-)")
        ax.set_ylabel("item")
        legend_below(figure, ax)
    return figure


def _ratio_axis(ax: Any) -> None:
    """Make the horizontal axis one of ratios: logarithmic, with plain numbers."""
    ax.set_xscale("log")
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())


def _short(name: str, most: int = 62) -> str:
    return name if len(name) <= most else name[: most - 3] + "..."


def spread(results: Path | str | Tables, references: Sequence[Mapping[str, Any]]) -> Figure | None:
    """Draw every published number of a single flight among the same of our flights, each by itself; None without any.

    Box: half of our flights, whiskers: 90 % of them; all over the published number.
    """
    tables = load(results)
    rows = []
    for published in references:
        for case in cases_of(tables, published.get("case") or {}) if published.get("single") else ():
            found = ours(tables, case, published, str(published["unit"])).runs / float(published["value"])
            found = found[np.isfinite(found)]
            if len(found) > 1:
                name = f"{published.get('item') or name_of(published)}: {tables.labels[case]}"
                rows.append((_short(name), found, published.get("band") or (0.5, 2.0)))
    if not rows:
        return None
    with look():
        figure, grid = canvas(1, 1, 1.1 + 0.22 * len(rows))
        ax = grid[0, 0]
        for place, (_, found, band) in enumerate(rows):
            first = place == 0
            q = np.quantile(found, [0.05, 0.25, 0.5, 0.75, 0.95])
            bounds = (max(band[0], 0.02), band[1])
            ax.hlines(place, *bounds, color="#9ca3af", lw=9, alpha=0.35, label="band" if first else None)
            ax.hlines(place, q[0], q[4], color=PALETTE[0], lw=1.2, label="90 % of our flights" if first else None)
            ax.hlines(place, q[1], q[3], color=PALETTE[0], lw=5, label="half of them" if first else None)
            ax.plot(q[2], place, "|", color="white", ms=7, mew=1.6)
        ax.axvline(1.0, color=PALETTE[1], lw=1.6, label="published, one flight")
        _ratio_axis(ax)
        ax.set_yticks(range(len(rows)), [name for name, _, _ in rows], fontsize=6.5)
        ax.set_ylim(len(rows) - 0.4, -0.6)
        ax.grid(axis="y", visible=False)
        ax.set_xlabel("our flights, each by itself / published (-)")
        ax.set_ylabel("item")
        legend_below(figure, ax)
    return figure


def locus(
    results: Path | str | Tables,
    axis: str,
    stated: Mapping[str, Any],
    unit: str,
    published: float | None = None,
    band: tuple[float, float] = (0.5, 2.0),
    cases: Sequence[Mapping[str, str]] = (),
) -> Figure:
    """Draw a metric over the levels of an axis, with the published value and its band as lines.

    axis: name of the axis in the labels of cases; stated: metric, at or during, statistic; one line for each choice of
    the other axes; cases: those drawn, all if empty.
    """
    tables = load(results)
    chosen = {case for wanted in cases for case in cases_of(tables, wanted)} or set(tables.labels)
    rows = []
    for row in tables.cases[tables.cases.case.isin(chosen)].itertuples():
        levels = json.loads(row.axes)
        if axis in levels:
            others = ", ".join(f"{name}={level}" for name, level in levels.items() if name != axis and level != "base")
            rows.append((levels[axis], others, ours(tables, row.case, stated, unit).value))
    if {level for level, _, _ in rows} > {"base"}:  # one at a time: of the base only a word is known, not its place
        rows = [row for row in rows if row[0] != "base"]
    frame = pd.DataFrame(rows, columns=["level", "others", "value"])
    names = list(dict.fromkeys(frame.level))
    sizes, kind = _sizes(names)
    with look():
        figure, grid = canvas(1, 1, 3.0)
        ax = grid[0, 0]
        for number, (others, group) in enumerate(frame.groupby("others", sort=False)):
            x = [sizes[names.index(level)] for level in group.level]
            ax.plot(x, group.value, marker="o", ms=4, label=str(others) or "ours", **line_of(number))
        if published is not None:
            ax.axhline(published, color="black", lw=1.1, label="published")
            ax.axhspan(published * band[0], published * band[1], color="#9ca3af", alpha=0.25, lw=0, label="band")
        if kind is None:
            ax.set_xticks(sizes, names)
        else:
            scale_up(ax.xaxis, sizes, from_zero=False)
        scale_up(ax.yaxis, [*frame.value, *([published] if published else [])])
        ax.set_xlabel(axis.replace("_", " ") + (f" ({kind})" if kind else ""))
        ax.set_ylabel(f"{name_of(stated).replace('_', ' ')}\n({unit})".replace(", ", ",\n"))
        legend_below(figure, ax, columns=2)
    return figure


def _sizes(names: Sequence[str]) -> tuple[list[float], str | None]:
    """Return where the levels of an axis stand, and their unit: their own numbers where all have one unit."""
    parts = [name.strip().partition(" ") for name in names]
    try:
        numbers = [float(number) for number, _, _ in parts]
    except ValueError:
        return [float(k) for k in range(len(names))], None
    spelled = list(dict.fromkeys(unit for (_, _, unit), number in zip(parts, numbers, strict=True) if number or unit))
    if len(spelled) > 1:
        try:
            numbers = [parse(f"{number} {unit or spelled[0]}", spelled[0]) for number, _, unit in parts]
        except ValueError:
            return [float(k) for k in range(len(names))], None
    return numbers, spelled[0] if spelled and spelled[0] else "-"
