"""Sections on design spaces: influence of the axes, best designs, nearest misses, and curves along an axis."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import Floats
from lvnav_trade.report.blocks import Block, DesignExplorer, Details, Text, figure, formatted_table
from lvnav_trade.report.escape import data_json, note
from lvnav_trade.report.sentences import say
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.design_space import (
    ALL,
    OVERCONFIDENT,
    axes_of,
    axis_label,
    display_unit,
    errors_of,
    interval,
    is_numeric,
    met_counts,
    overconfident,
    possible,
    range_text,
)
from lvnav_trade.results.evaluation.designs import requirement_columns
from lvnav_trade.results.evaluation.resources import dominating, sort_by_preference
from lvnav_trade.results.evaluation.tornado import limit_of, value_of
from lvnav_trade.results.tables.read import Tables

_ROWS = 20
_EXACT = ", with its exact 95 % interval"
_RESULT_COLUMNS = ("error_ratio", "velocity_m_per_s", "position_m", "attitude_rad", "nees_per_state_ratio", "cost")
_VERDICTS = ("met", "violated", "other")
_NAMES = {"error_ratio": "error over limit", "nees_per_state_ratio": "NEES per state"}
_FEW = 6  # up to this number of crossings, each is named in the sentence


def space(tables: Tables) -> list[Block]:
    """Return the sections on a design space; empty if the results store every case in full."""
    if not tables.has_designs:
        return []
    frame = possible(tables)
    blocks: list[Block] = [Text(line) for line in _lead(tables, frame) if line]
    blocks += _influence_pictures(tables)
    blocks.append(DesignExplorer(data_json(_explorer(tables, frame))))
    blocks += _design_tables(tables, frame)
    blocks += _influence_tables(tables)
    blocks.append(Text(_full_analysis_sentence(tables)))
    blocks += _analysed_designs(tables, frame)
    return blocks


def _influence_pictures(tables: Tables) -> list[Block]:
    """Return the figures of the influence of the axes, for every requirement, and of the shares of good designs."""
    swings = METRICS["swings"](tables)
    interval_text = ", with its 95 % interval" if tables.is_sampled else ""
    blocks: list[Block] = []
    for number, name in enumerate(dict.fromkeys(METRICS["effects"](tables).requirement), 1):
        picture = figure(tables, "effects", name, requirement=name, interval=interval_text)
        blocks.append(picture._replace(name=f"effects-{number}"))
        if name in set(swings.requirement):
            limit_text = "; dashed: the limit" if np.isfinite(limit_of(tables, name)) else ""
            picture = figure(tables, "swings", name, requirement=name, interval=interval_text, limit=limit_text)
            blocks.append(picture._replace(name=f"swings-{number}"))
    if len(METRICS["regions"](tables)):
        blocks.append(figure(tables, "regions", interval=interval_text))
    return blocks


def _influence_tables(tables: Tables) -> list[Block]:
    """Return the tables of the influence of the axes, and of the shares of good designs, shown on demand."""
    blocks: list[Block] = []
    effects = METRICS["effects"](tables)
    swings = METRICS["swings"](tables)
    regions = METRICS["regions"](tables)
    if len(effects):
        rows = effects.assign(axis=effects.axis.map(axis_label))
        details = [Text(note("effects")), formatted_table("effects", _without_intervals(tables, rows, "low"))]
        if len(swings):
            details.append(formatted_table("swings", _without_intervals(tables, _ends(tables, swings), "low")))
        blocks.append(Details(note("effects_title"), details))
    if len(regions):
        rows = _without_intervals(tables, _region_rows(tables, regions), "share_low")
        shares = formatted_table("regions", rows, interval=_EXACT if tables.is_sampled else "")
        blocks.append(Details(note("regions_title"), [shares]))
    return blocks


def _without_intervals(tables: Tables, frame: pd.DataFrame, low: str) -> pd.DataFrame:
    """Return a table without its interval columns, unless the designs are random samples.

    low : column of the lower bound; the column of the upper bound has "high" in place of "low"
    """
    if tables.is_sampled:
        return frame
    return frame.drop(columns=[low, low.replace("low", "high")])


def _ends(tables: Tables, swings: pd.DataFrame) -> pd.DataFrame:
    """Return the errors at the ends of the axes in display units."""
    columns = errors_of(tables, possible(tables))
    units = [display_unit(tables, columns[name]) for name in swings.requirement]
    factors = np.array([factor for _, factor in units])
    return pd.DataFrame(
        {
            "requirement": swings.requirement,
            "axis": swings.axis.map(axis_label),
            "end": [value_of(tables, row) for row in swings.itertuples()],
            "error": swings.error_si * factors,
            "low": swings.low_si * factors,
            "high": swings.high_si * factors,
            "unit": [unit for unit, _ in units],
        }
    )


def _analysed_designs(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the designs that were analysed in full, with their labels in the other sections."""
    rows = frame[frame.case.isin(tables.labels)]
    if rows.empty:
        return []
    labels = [tables.labels[case] for case in rows.case]
    return [formatted_table("space_labels", _display_rows(tables, rows).assign(label=labels))]


def _lead(tables: Tables, frame: pd.DataFrame) -> list[str]:
    """Return the number of designs that meet all requirements, that of designs with an inconsistent filter among them,
    and the number of infeasible designs.
    """
    space_manifest = tables.manifest.get("space") or {}
    verdicts = frame.verdict if "verdict" in frame else pd.Series(dtype=object)
    n_met = int((verdicts == "met").sum())
    share = interval(n_met, len(frame)) if tables.is_sampled and len(frame) else None
    lines = [
        say(
            "space",
            designs=int(space_manifest.get("designs", len(tables.designs))),
            possible=len(frame),
            met=n_met,
            undescribed=int((verdicts == "not applicable").sum()),
            share=share,
            requirements=len(tables.campaign.get("requirements") or ()),
            which=met_counts(tables, frame),
        )
    ]
    if "nees_per_state_ratio" in frame:
        designs = frame[frame.verdict == "met"] if n_met else frame
        lines.append(
            say(
                "space_filters",
                doubtful=overconfident(designs),
                whole=len(designs),
                is_met=n_met > 0,
                limit=OVERCONFIDENT,
            )
        )
    impossible_counts = {str(reason): int(count) for reason, count in (space_manifest.get("impossible") or {}).items()}
    if impossible_counts:
        lines.append(say("impossible", reasons=impossible_counts))
    return lines


def _full_analysis_sentence(tables: Tables) -> str:
    """Return a sentence on the designs that the other sections show."""
    counts = (tables.manifest.get("space") or {}).get("whole") or {}
    monte_carlo = tables.campaign.get("monte_carlo") or {}
    sections = (tables.campaign.get("report") or {}).get("sections") or ["space"]
    reasons = sorted(counts, key=lambda reason: (reason != "best", reason))
    return say(
        "space_whole",
        where="below" if sections[0] == "space" else "",
        cases=len(tables.cases),
        why={str(reason): int(counts[reason]) for reason in reasons},
        runs=int(monte_carlo.get("runs", 0)),
        is_most=bool(monte_carlo.get("stop")),
    )


def _design_tables(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the best designs, the nearest misses and the Pareto front, each with the command for its full analysis."""
    if "error_ratio" not in frame or not frame.error_ratio.notna().any():
        return []
    compliant = frame[frame.verdict == "met"]
    misses = frame[(frame.verdict != "met") & frame.error_ratio.notna()]
    totals = [name for name in ("cost", "mass_kg") if name in frame and frame[name].nunique() > 1]
    blocks: list[Block] = []
    if len(compliant):
        ordered_designs = compliant.sort_values([*totals[:1], "error_ratio"], kind="stable")
        best_rows = _display_rows(tables, ordered_designs.head(_ROWS))
        order = "by error"
        if totals:
            order = f"by {totals[0].partition('_')[0]}, then error"
        blocks.append(formatted_table("space_best", best_rows, order=order))
    if len(misses):
        nearest = misses.sort_values("error_ratio", kind="stable").head(_ROWS)
        missed_table = formatted_table("space_missed", _display_rows(tables, nearest))
        if len(compliant):
            blocks.append(Details(note("missed_title"), [missed_table]))
        else:
            blocks.append(missed_table)
    if totals and len(compliant):
        front = _pareto_front(compliant, totals).head(_ROWS)
        front_table = formatted_table("space_front", _display_rows(tables, front))
        blocks.append(Details(note("front_title"), [front_table]))
    return blocks


def _pareto_front(designs: pd.DataFrame, totals: list[str]) -> pd.DataFrame:
    """Return the designs that no other design dominates in totals (cost, mass) and error, by the first total."""
    values = designs[[*totals, "error_ratio"]].to_numpy(dtype=float)
    is_front = [dominating(values, k) < 0 for k in range(len(designs))]
    return designs[is_front].sort_values(totals[0], kind="stable")


def _display_rows(tables: Tables, frame: pd.DataFrame) -> pd.DataFrame:
    """Return designs for display: levels in the units of the campaign, errors, cost, command."""
    rows = pd.DataFrame(index=frame.index)
    rows["design"] = [_levels(tables, row) for _, row in frame[axes_of(frame)].iterrows()]
    for name in _RESULT_COLUMNS:
        rows[name] = np.nan
        if name in frame:
            _, factor = display_unit(tables, name)
            rows[name] = frame[name] * factor
    rows["limiting_requirement"] = frame.limiting_requirement
    command = _command(tables)
    rows["command"] = [f"{command} --case {case}" for case in frame.case]
    return rows


def _levels(tables: Tables, row: pd.Series) -> str:
    """Return the levels of a design as text, in the units of the campaign."""
    level_texts = []
    for column, value in row.items():
        if isinstance(value, float):
            text = range_text(tables, str(column), value, value)
        else:
            text = str(value)
        level_texts.append(f"{axis_label(str(column))} {text}")
    return ", ".join(level_texts)


def _command(tables: Tables) -> str:
    """Return the command that runs the campaign, with its path as the user typed it or else with its name."""
    words = [str(word) for word in tables.manifest.get("command") or ()]
    if len(words) > 1 and words[0] == "run":
        return f"lvnav-trade run {words[1]}"
    return f"lvnav-trade run {tables.manifest.get('campaign')}.yaml"


def _region_rows(tables: Tables, regions: pd.DataFrame) -> pd.DataFrame:
    """Return shares by part of an axis, with the ends of each part in the units of the campaign."""
    rows = regions[regions.requirement == ALL]
    level_texts = [str(row.level) or range_text(tables, str(row.axis), row.low, row.high) for row in rows.itertuples()]
    return rows.assign(axis=rows.axis.map(axis_label), part=level_texts)


def _explorer(tables: Tables, frame: pd.DataFrame) -> dict[str, Any]:
    """Return the data of the interactive scatter plot and of the parallel axes, as arrays in single precision."""
    axes = axes_of(frame)
    columns = [_column(tables, frame, name) for name in [*axes, *_explorer_results(tables, frame)]]
    verdicts = [0] * len(frame)
    if "verdict" in frame:
        verdicts = [_VERDICTS.index(verdict if verdict in _VERDICTS else "other") for verdict in frame.verdict]
    strongest = _strongest_axis(tables, frame)
    return {
        "count": len(frame),
        "columns": columns,
        "cases": list(frame.case),
        "command": _command(tables),
        "verdicts": verdicts,
        "words": list(_VERDICTS),
        "x": axes.index(strongest) if strongest else 0,
        "y": min(len(axes), len(columns) - 1),
    }


def _explorer_results(tables: Tables, frame: pd.DataFrame) -> list[str]:
    """Return the columns of results that the interactive plots offer; cost only if it varies."""
    requirements = tables.campaign.get("requirements") or ()
    errors = [requirement_columns(requirement)[0] for requirement in requirements]
    names = ["velocity_m_per_s", "position_m", *errors, "error_ratio", "nees_per_state_ratio", "cost"]
    results = [name for name in dict.fromkeys(names) if name in frame and frame[name].notna().any()]
    if "cost" in results and frame.cost.nunique() <= 1:
        results.remove("cost")
    return results


def _strongest_axis(tables: Tables, frame: pd.DataFrame) -> str:
    """Return the axis with the largest effect on the limiting requirement of most designs; empty without effects."""
    effects = METRICS["effects"](tables).dropna(subset="rank_correlation")
    if "limiting_requirement" in frame:
        most_frequent = frame.limiting_requirement.mode()
        if len(most_frequent) and most_frequent.iloc[0]:
            effects = effects[effects.requirement == most_frequent.iloc[0]]
    if len(effects):
        return str(effects.axis[effects.first_order.idxmax()])
    return ""


def _column(tables: Tables, frame: pd.DataFrame, name: str) -> dict[str, Any]:
    """Return a column of a table for the interactive plots.

    Returns
    -------
    dict
        `name`, `unit` (empty if dimensionless) and `values`: single precision, little-endian, base64, in display units.
        For a column of words, the values are the indices of its `levels`.
    """
    if not is_numeric(frame, name):
        levels = list(dict.fromkeys(frame[name]))
        indices = {level: k for k, level in enumerate(levels)}
        numbers = frame[name].map(indices).to_numpy(dtype=float)
        return {"name": axis_label(name), "unit": "", "levels": levels, "values": _base64_text(numbers)}
    unit, factor = display_unit(tables, name)
    is_dimensionless = name in _NAMES or unit == "dimensionless"
    return {
        "name": _NAMES.get(name, axis_label(name)),
        "unit": "" if is_dimensionless else unit,
        "values": _base64_text(frame[name].to_numpy(dtype=float) * factor),
    }


def _base64_text(values: Floats) -> str:
    return base64.b64encode(values.astype("<f4").tobytes()).decode()


def curves(tables: Tables) -> list[Block]:
    """Return a figure of every numeric axis, the crossings of the limits, and a tornado plot of every requirement."""
    axes = dict.fromkeys(METRICS["curves"](tables).axis)
    crossings = METRICS["crossings"](tables)
    requirements = dict.fromkeys(METRICS["tornado"](tables).requirement)
    blocks: list[Block] = []
    sentence = _crossings(crossings)
    if sentence:
        blocks.append(Text(sentence, "The limit is reached at:"))
    for number, axis in enumerate(axes, 1):
        picture = figure(tables, "curves", axis, axis=axis.replace("_", " "))
        blocks.append(picture._replace(name=f"curves-{number}"))
    if len(crossings):
        blocks.append(formatted_table("crossings", crossings))
    for number, name in enumerate(requirements, 1):
        picture = figure(tables, "tornado", name, requirement=name)
        blocks.append(picture._replace(name=f"tornado-{number}"))
    return blocks


def _crossings(frame: pd.DataFrame) -> str:
    """Return where the curves reach their limits, for axes with few crossings.

    The curves are those of linear covariance, or of the runs if there are none.
    """
    axes = []
    groups = frame.groupby(["axis", "requirement"], sort=False) if len(frame) else ()
    for (axis, requirement), rows in groups:
        rows = rows[rows.by == rows.by.iloc[0]]
        if len(rows) > _FEW:
            continue
        crossings = []
        for row in rows.itertuples():
            value = f"{row.crossing:.3g} {row.axis_unit}".strip()
            crossings.append({"value": value, "case": row.case})
        axes.append(
            {
                "axis": axis,
                "requirement": requirement,
                "limit": f"{rows.limit.iloc[0]:g} {rows.unit.iloc[0]}",
                "at": crossings,
            }
        )
    return say("crossings", axes=axes)


def pareto(tables: Tables) -> list[Block]:
    """Return the cheapest compliant case, the cases with their totals, and the Pareto front."""
    frame = METRICS["pareto"](tables)
    if frame.empty:
        return []
    complete = [name for name, column in (("cost", "cost"), ("mass", "mass_kg")) if frame[column].notna().all()]
    order = sort_by_preference(frame, complete)
    best = order.iloc[0]
    if best.meets:
        blocks: list[Block] = [Text(_case_with_cost(best), "Cheapest that meets all requirements:")]
        cheaper = order[(order.verdict == "undecided") & (order.error_ratio <= 1.0) & (order.cost < best.cost)]
        if len(cheaper):
            blocks.append(Text(_case_with_cost(cheaper.iloc[0]), "Cheaper, but its runs leave it undecided:"))
    else:
        blocks = [Text(_case_with_cost(best), "No design is shown to meet all requirements. Cheapest:")]
    return [*blocks, Text(note("pareto")), formatted_table("pareto", order), figure(tables, "pareto")]


def _case_with_cost(case: Any) -> str:
    """Return a case with its cost, its mass and its largest ratio of error to limit."""
    return f"{case.case} (cost {case.cost:g}, {case.mass_kg:g} kg; error over limit {case.error_ratio:.2g})."
