"""Sections on design spaces: influence of the axes, best designs, nearest misses, and curves along an axis."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import Floats
from lvnav_trade.report.blocks import Block, DesignExplorer, Details, Text, figure, stated
from lvnav_trade.report.escape import data_json, note
from lvnav_trade.report.sentences import say
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.design_space import (
    ALL,
    OVERCONFIDENT,
    axes_of,
    axis_label,
    counts_of,
    errors_of,
    interval,
    is_numeric,
    overconfident,
    people_of,
    possible,
    range_text,
)
from lvnav_trade.results.evaluation.designs import requirement_columns
from lvnav_trade.results.evaluation.resources import dominating, ranked
from lvnav_trade.results.evaluation.tornado import limit_of, value_of
from lvnav_trade.results.tables.read import Tables

_ROWS = 20
_EXACT = ", with its exact 95 % interval"
_SUMMED = ("error_ratio", "velocity_m_per_s", "position_m", "attitude_rad", "nees_per_state_ratio", "cost")
_WORDS = ("met", "violated", "other")
_NAMES = {"error_ratio": "error over limit", "nees_per_state_ratio": "NEES per state"}


def space(tables: Tables) -> list[Block]:
    """Return the sections on a design space; empty if the results store every case in full."""
    if not tables.has_designs:
        return []
    frame = possible(tables)
    blocks: list[Block] = [Text(line) for line in _lead(tables, frame) if line]
    effects, swings = METRICS["effects"](tables), METRICS["swings"](tables)
    within = ", with its 95 % interval" if tables.is_sampled else ""
    for number, name in enumerate(dict.fromkeys(effects.requirement), 1):
        drawn = figure(tables, "effects", name, requirement=name, interval=within)
        blocks.append(drawn._replace(name=f"effects-{number}"))
        if name in set(swings.requirement):
            limit = "; dashed: the limit" if np.isfinite(limit_of(tables, name)) else ""
            drawn = figure(tables, "swings", name, requirement=name, interval=within, limit=limit)
            blocks.append(drawn._replace(name=f"swings-{number}"))
    if len(METRICS["regions"](tables)):
        blocks.append(figure(tables, "regions", interval=within))
    blocks.append(DesignExplorer(data_json(_explorer(tables, frame))))
    blocks += _rows(tables, frame)
    if len(effects):
        rows = effects.assign(axis=effects.axis.map(axis_label))
        tables_of_axes = [stated("effects", _without_intervals(tables, rows, "low"))]
        if len(swings):
            tables_of_axes.append(stated("swings", _without_intervals(tables, _ends(tables, swings), "low")))
        blocks.append(Details(note("effects_title"), [Text(note("effects")), *tables_of_axes]))
    regions = METRICS["regions"](tables)
    if len(regions):
        rows = _without_intervals(tables, _for_people(tables, regions), "share_low")
        blocks.append(Details(note("regions_title"), [stated("regions", rows, interval=_EXACT * tables.is_sampled)]))
    return [*blocks, Text(_whole(tables)), *_analysed_whole(tables, frame)]


def _without_intervals(tables: Tables, frame: pd.DataFrame, low: str) -> pd.DataFrame:
    """Return a table without its interval columns, unless the designs are random samples."""
    return frame if tables.is_sampled else frame.drop(columns=[low, low.replace("low", "high")])


def _ends(tables: Tables, swings: pd.DataFrame) -> pd.DataFrame:
    """Return the errors at the ends of the axes in display units."""
    columns = errors_of(tables, possible(tables))
    units = [people_of(tables, columns[name]) for name in swings.requirement]
    factor = np.array([factor for _, factor in units])
    return pd.DataFrame(
        {
            "requirement": swings.requirement,
            "axis": swings.axis.map(axis_label),
            "end": [value_of(tables, row) for row in swings.itertuples()],
            "error": swings.error_si * factor,
            "low": swings.low_si * factor,
            "high": swings.high_si * factor,
            "unit": [unit for unit, _ in units],
        }
    )


def _analysed_whole(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the designs that were analysed in full, with their labels in the other sections."""
    rows = frame[frame.case.isin(tables.labels)]
    if rows.empty:
        return []
    labelled = _shown(tables, rows).assign(label=[tables.labels[case] for case in rows.case])
    return [stated("space_labels", labelled)]


def _lead(tables: Tables, frame: pd.DataFrame) -> list[str]:
    """Return the number of designs that meet all requirements, that of designs with an inconsistent filter among them,
    and the number of infeasible designs.
    """
    about = tables.manifest.get("space") or {}
    n_met = int((frame.verdict == "met").sum()) if "verdict" in frame else 0
    impossible = {str(reason): int(count) for reason, count in (about.get("impossible") or {}).items()}
    lines = [
        say(
            "space",
            designs=int(about.get("designs", len(tables.designs))),
            possible=len(frame),
            met=n_met,
            undescribed=int((frame.verdict == "not applicable").sum()) if "verdict" in frame else 0,
            share=interval(n_met, len(frame)) if tables.is_sampled and len(frame) else None,
            requirements=len(tables.campaign.get("requirements") or ()),
            which=counts_of(tables, frame),
        )
    ]
    if "nees_per_state_ratio" in frame:
        good = frame[frame.verdict == "met"] if n_met else frame
        doubtful = overconfident(good)
        lines.append(say("space_filters", doubtful=doubtful, whole=len(good), is_met=n_met > 0, limit=OVERCONFIDENT))
    lines.append(say("impossible", reasons=impossible) if impossible else "")
    return lines


def _whole(tables: Tables) -> str:
    """Return a sentence on the designs that the other sections show."""
    about = (tables.manifest.get("space") or {}).get("whole") or {}
    card = tables.campaign.get("monte_carlo") or {}
    sections = (tables.campaign.get("report") or {}).get("sections") or ["space"]
    return say(
        "space_whole",
        where="below" if sections[0] == "space" else "",
        cases=len(tables.cases),
        why={str(name): int(about[name]) for name in sorted(about, key=lambda name: (name != "best", name))},
        runs=int(card.get("runs", 0)),
        is_most=bool(card.get("stop")),
    )


def _rows(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the best designs, the nearest misses and the Pareto front, each with the command for its full analysis."""
    if "error_ratio" not in frame or not frame.error_ratio.notna().any():
        return []
    compliant = frame[frame.verdict == "met"]
    misses = frame[(frame.verdict != "met") & frame.error_ratio.notna()]
    cheap = [name for name in ("cost", "mass_kg") if name in frame and frame[name].nunique() > 1]
    best = compliant.sort_values([*cheap[:1], "error_ratio"], kind="stable").head(_ROWS)
    missed = misses.sort_values("error_ratio", kind="stable").head(_ROWS)
    blocks: list[Block] = []
    if len(best):
        order = f"by {cheap[0].partition('_')[0]}, then error" if cheap else "by error"
        blocks.append(stated("space_best", _shown(tables, best), order=order))
    if len(missed):
        missed_table = stated("space_missed", _shown(tables, missed))
        blocks.append(Details(note("missed_title"), [missed_table]) if len(best) else missed_table)
    if cheap and len(compliant):
        values = compliant[[*cheap, "error_ratio"]].to_numpy(dtype=float)
        front = compliant[[dominating(values, k) < 0 for k in range(len(compliant))]].sort_values(
            cheap[0], kind="stable"
        )
        blocks.append(Details(note("front_title"), [stated("space_front", _shown(tables, front.head(_ROWS)))]))
    return blocks


def _shown(tables: Tables, frame: pd.DataFrame) -> pd.DataFrame:
    """Return designs for display: levels in the units of the campaign, errors, cost, command."""
    rows = pd.DataFrame(index=frame.index)
    rows["design"] = [_levels(tables, row) for _, row in frame[axes_of(frame)].iterrows()]
    for name in _SUMMED:
        rows[name] = frame[name] * people_of(tables, name)[1] if name in frame else np.nan
    rows["limiting_requirement"] = frame.limiting_requirement
    rows["command"] = [f"{_command(tables)} --case {case}" for case in frame.case]
    return rows


def _levels(tables: Tables, row: pd.Series) -> str:
    parts = []
    for column, value in row.items():
        text = range_text(tables, str(column), value, value) if isinstance(value, float) else str(value)
        parts.append(f"{axis_label(str(column))} {text}")
    return ", ".join(parts)


def _command(tables: Tables) -> str:
    """Return the command that runs the campaign, with its path as the user typed it or else with its name."""
    words = [str(word) for word in tables.manifest.get("command") or ()]
    campaign = words[1] if len(words) > 1 and words[0] == "run" else f"{tables.manifest.get('campaign')}.yaml"
    return f"lvnav-trade run {campaign}"


def _for_people(tables: Tables, regions: pd.DataFrame) -> pd.DataFrame:
    """Return shares by part of an axis, with the ends of each part in the units of the campaign."""
    rows = regions[regions.requirement == ALL]
    parts = [str(row.level) or range_text(tables, str(row.axis), row.low, row.high) for row in rows.itertuples()]
    return rows.assign(axis=rows.axis.map(axis_label), part=parts)


def _explorer(tables: Tables, frame: pd.DataFrame) -> dict[str, Any]:
    """Return the data of the interactive scatter plot and of the parallel axes, as arrays in single precision."""
    columns = [_column(tables, frame, name) for name in axes_of(frame)]
    errors = [requirement_columns(requirement)[0] for requirement in tables.campaign.get("requirements") or ()]
    for name in dict.fromkeys(
        ["velocity_m_per_s", "position_m", *errors, "error_ratio", "nees_per_state_ratio", "cost"]
    ):
        if name in frame and frame[name].notna().any() and (name != "cost" or frame[name].nunique() > 1):
            columns.append(_column(tables, frame, name))
    words = {word: k for k, word in enumerate(_WORDS)}
    verdict = (
        frame.verdict.map(lambda word: words.get(word, len(words) - 1)) if "verdict" in frame else [0] * len(frame)
    )
    n_axis = len(axes_of(frame))
    effects = METRICS["effects"](tables).dropna(subset="rank_correlation")
    deciding = next(iter(frame.limiting_requirement.mode()), "") if "limiting_requirement" in frame else ""
    effects = effects[effects.requirement == deciding] if deciding else effects
    strongest = str(effects.axis[effects.first_order.idxmax()]) if len(effects) else ""
    return {
        "count": len(frame),
        "columns": columns,
        "cases": list(frame.case),
        "command": _command(tables),
        "verdicts": [int(k) for k in verdict],
        "words": list(_WORDS),
        "x": axes_of(frame).index(strongest) if strongest else 0,
        "y": min(n_axis, len(columns) - 1),
    }


def _column(tables: Tables, frame: pd.DataFrame, name: str) -> dict[str, Any]:
    if not is_numeric(frame, name):
        levels = list(dict.fromkeys(frame[name]))
        numbers = frame[name].map({level: k for k, level in enumerate(levels)}).to_numpy(dtype=float)
        return {"name": axis_label(name), "unit": "", "levels": levels, "values": _packed(numbers)}
    unit, factor = people_of(tables, name)
    values = frame[name].to_numpy(dtype=float) * factor
    unit = "" if name in _NAMES or unit == "dimensionless" else unit
    return {"name": _NAMES.get(name, axis_label(name)), "unit": unit, "values": _packed(values)}


def _packed(values: Floats) -> str:
    return base64.b64encode(values.astype("<f4").tobytes()).decode()


_FEW = 6  # up to this number of crossings, each is named in the sentence


def curves(tables: Tables) -> list[Block]:
    """Return a figure of every numeric axis, the crossings of the limits, and a tornado plot of every requirement."""
    frame, crossings, bars = (METRICS[name](tables) for name in ("curves", "crossings", "tornado"))
    blocks: list[Block] = [Text(sentence, "The limit is reached at:")] if (sentence := _crossings(crossings)) else []
    for number, axis in enumerate(dict.fromkeys(frame.axis), 1):
        drawn = figure(tables, "curves", axis, axis=axis.replace("_", " "))
        blocks.append(drawn._replace(name=f"curves-{number}"))
    if len(crossings):
        blocks.append(stated("crossings", crossings))
    for number, name in enumerate(dict.fromkeys(bars.requirement), 1):
        drawn = figure(tables, "tornado", name, requirement=name)
        blocks.append(drawn._replace(name=f"tornado-{number}"))
    return blocks


def _crossings(frame: pd.DataFrame) -> str:
    """Return where the curves reach their limits, for axes with few crossings.

    The curves are those of linear covariance, or of the runs if there are none.
    """
    axes = []
    for _, rows in frame.groupby(["axis", "requirement"], sort=False) if len(frame) else ():
        rows = rows[rows.by == rows.by.iloc[0]]
        if len(rows) <= _FEW:
            crossing = rows.iloc[0]
            at = [
                {"value": f"{row.crossing:.3g} {row.axis_unit}".strip(), "case": row.case} for row in rows.itertuples()
            ]
            limit = f"{crossing.limit:g} {crossing.unit}"
            axes.append({"axis": crossing.axis, "requirement": crossing.requirement, "limit": limit, "at": at})
    return say("crossings", axes=axes)


def pareto(tables: Tables) -> list[Block]:
    """Return the cheapest compliant case, the cases with their totals, and the Pareto front."""
    frame = METRICS["pareto"](tables)
    if frame.empty:
        return []
    columns_of_total = {"cost": "cost", "mass": "mass_kg"}
    order = ranked(frame, [name for name, column in columns_of_total.items() if frame[column].notna().all()])
    best = order.iloc[0]
    lead = (
        "Cheapest that meets all requirements:"
        if best.meets
        else "No design is shown to meet all requirements. Cheapest:"
    )
    blocks: list[Block] = [Text(_priced(best), lead)]
    cheaper = order[(order.verdict == "undecided") & (order.error_ratio <= 1.0) & (order.cost < best.cost)]
    if best.meets and len(cheaper):
        blocks.append(Text(_priced(cheaper.iloc[0]), "Cheaper, but its runs leave it undecided:"))
    return [*blocks, Text(note("pareto")), stated("pareto", order), figure(tables, "pareto")]


def _priced(one: Any) -> str:
    """Return a case with its cost, its mass and its largest ratio of error to limit."""
    return f"{one.case} (cost {one.cost:g}, {one.mass_kg:g} kg; error over limit {one.error_ratio:.2g})."
