"""Detailed sections of the report: flight, errors, consistency, agreement, published numbers, satellites, delays."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.report.blocks import (
    Block,
    Details,
    Table,
    Text,
    figure,
    figures,
    formatted_table,
    number,
    percent,
    table,
    table_section,
    words,
)
from lvnav_trade.report.escape import note
from lvnav_trade.report.selection import (
    chosen_cases,
    distinct_cases,
    first_cases,
    key_cases_and_quantities,
    omission_note,
)
from lvnav_trade.report.validity import filter_verdict
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.covariances import by_case
from lvnav_trade.results.metric import event_or_phase
from lvnav_trade.results.requirements.improvements import ABOVE_ONLY
from lvnav_trade.results.requirements.requirements import verdict_texts
from lvnav_trade.results.statistics.select import final_event, flight_events, history_of
from lvnav_trade.results.tables.read import Tables

_FACT_UNITS = (
    ("gee_m", "_m", "km", 1e-3),
    ("_m_per_s", "_m_per_s", "m/s", 1.0),
    ("_m_s", "_m_s", "m/s", 1.0),
    ("_rad", "_rad", "deg", 57.29577951308232),
    ("_pa", "_pa", "kPa", 1e-3),
    ("_m", "_m", "m", 1.0),
    ("_g", "_g", "g", 1.0),
    ("_kg", "_kg", "kg", 1.0),
    ("_s", "_s", "s", 1.0),
)
"""End of a fact's name, the SI unit in it, display unit, factor from the one to the other."""
_FEW = 3  # up to this number of cases, the table of errors has every event
NAVIGATION = ("position", "velocity", "attitude")
_ORIGIN = (  # entries of the manifest with the origin of the results
    "campaign",
    "seed",
    "campaign_digest",
    "tool",
    "code_digest",
    "commit",
    "python",
    "numpy",
    "numba",
    "scipy",
    "pyarrow",
    "system",
    "cpu",
    "created",
)


@table_section("requirements", "The campaign states no requirement.")
def requirements(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the table of verdicts with their numbers."""
    text = note("requirements")
    text += ", ∞ where more runs failed." if np.isinf(frame.estimate).any() else "."
    if (tables.campaign.get("monte_carlo") or {}).get("stop"):
        text += " " + note("stopping")
    rows = verdict_texts(frame)
    rows = rows.assign(
        probability=rows.probability.map(percent),
        confidence=rows.confidence.map(percent),
    )
    return [table(rows.rename(columns=words)), Text(text), *_expected_verdicts(tables)]


@table_section("windows")
def windows(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the worst errors in the windows around the events of the requirements."""
    return [formatted_table("windows", frame.assign(by=frame.by.replace("LinCov", "linear covariance")))]


def _expected_verdicts(tables: Tables) -> list[Block]:
    """Return the table of probabilities expected by linear covariance."""
    frame = verdict_texts(METRICS["expected_verdicts"](tables))
    frame = frame.assign(
        expected=expectation(frame),
        required=100.0 * frame.probability,
        estimate=frame.estimate.where(frame.reason != ABOVE_ONLY, "–").replace("", "–"),
        limit=frame.limit.replace("", "–"),
        remark=frame.reason.fillna(""),
    )
    layout = formatted_table("expected", frame if frame.remark.any() else frame.drop(columns="remark"))
    return [layout, Text(note("expected"))]


def expectation(frame: pd.DataFrame) -> pd.Series[Any]:
    """Return the expected share of flights that comply (%); for a phase with an upper bound only, as text."""
    share = 100.0 * frame.expected_probability
    is_bound = frame.reason == ABOVE_ONLY
    if not is_bound.any():
        return share
    texts = share.map(number)
    return texts.where(~is_bound, "at most " + texts)


def trajectory(tables: Tables) -> list[Block]:
    """Return the tables and figures of the trajectory, once for each distinct trajectory."""
    group = distinct_cases(tables, "reference", ["t_s", "altitude_m"], tables.labels)
    all_facts = tables.cases.set_index("case").facts
    blocks: list[Block] = []
    pictures = figures(tables, "trajectory", group)
    for case, picture in zip(group, pictures, strict=True):
        events = tables.events[tables.events.case == case]
        events = events.sort_values("t_s", kind="stable")
        end_times = events.t_end_s.map("{:.2f}".format)
        ends = end_times.where(events.kind == "fault", "")
        blocks += [picture, formatted_table("events", events.assign(ends=ends))]
        facts = json.loads(all_facts[case])
        if facts:
            rows = tuple(fact(name, value) for name, value in facts.items())
            blocks.append(Table(("result of the ascent", "value"), rows, (False, True)))
    return blocks


def fact(name: str, value: float | str) -> tuple[str, str]:
    """Return the name and value of a trajectory fact in display units.

    name : name with its SI unit at the end
    value : number in this unit, or text
    """
    if isinstance(value, str):
        return words(name), value
    for ending, suffix, unit, factor in _FACT_UNITS:
        if name.endswith(ending):
            display_value = value * factor
            return f"{words(name.removesuffix(suffix))} ({unit})", f"{display_value:.5g}"
    return words(name), f"{value:.5g}"


def envelopes(tables: Tables) -> list[Block]:
    """Return the errors of all cases together, then of each case with its covariances, then the table of RMS errors."""
    quantities = [quantity for quantity in NAVIGATION if (quantity, "3d") in tables.display_units]
    key_cases, required_quantities = key_cases_and_quantities(tables)
    blocks: list[Block] = []
    details: list[Block] = []
    for quantity in required_quantities or quantities:
        blocks.append(figure(tables, "comparison", quantity, name="compare"))
    for quantity in quantities:
        if quantity not in required_quantities:
            details.append(figure(tables, "comparison", quantity, name="compare"))

    cases = dict.fromkeys([*key_cases, *chosen_cases(tables)])
    pairs = [(case, quantity) for case in cases for quantity in quantities]
    key_pairs = [(case, quantity) for case, quantity in pairs if case in key_cases and quantity in required_quantities]
    for case, quantity in key_pairs:
        if _has_runs(tables, case, quantity):
            blocks.append(figure(tables, "quantiles", case, quantity))
    for case, quantity in key_pairs:
        blocks.append(figure(tables, "envelope", case, quantity))
    details += omission_note(tables)
    for case, quantity in pairs:
        if (case, quantity) not in key_pairs:
            details.append(figure(tables, "envelope", case, quantity))
    return [
        *blocks,
        Details("Errors of other cases and quantities", details),
        Details("Numbers", [_rms_table(tables, quantities)]),
    ]


def _rms_table(tables: Tables, quantities: Sequence[str]) -> Table:
    """Return the table of 3-D RMS errors at the shown places."""
    frame = METRICS["rms"](tables)
    metrics = [f"{quantity}_error" for quantity in quantities]
    frame = frame[(frame.axis == "3d") & frame.metric.isin(metrics)]
    places = _places(tables)
    is_shown = []
    for case, place in zip(frame.case, frame.phase_or_event, strict=True):
        is_shown.append(place in places[case])
    frame = frame[is_shown]
    metric_names = words(frame.metric)
    place_names = words(frame.phase_or_event)
    frame = frame.assign(metric=metric_names, phase_or_event=place_names)
    return formatted_table("envelopes", frame.drop(columns="axis"))


def _has_runs(tables: Tables, case: str, quantity: str) -> bool:
    """Return whether quantiles of the 3-D error over the runs are stored for a case (digest) and a quantity."""
    return bool(history_of(tables, case, quantity, "3d").q95_si.notna().any())


def _places(tables: Tables) -> dict[str, set[str]]:
    """Return the places that the table of errors shows for each label: the whole flight, and events at distinct times.

    With many cases only the events of requirements and the final event.
    """
    required_events = {event_or_phase(requirement) for requirement in tables.campaign.get("requirements") or ()}
    required_events.add(str((tables.campaign.get("covariance") or {}).get("at") or ""))
    places = {}
    for case, label in tables.labels.items():
        if len(tables.labels) <= _FEW:
            events = set(separate_events(tables, case).event)
        else:
            events = required_events & set(flight_events(tables, case).event)
            events.add(final_event(tables, case))
        places[label] = {"flight", *events}
    return places


def separate_events(tables: Tables, case: str) -> pd.DataFrame:
    """Return the events at distinct times, in order; the final event represents those that coincide with it."""
    events = flight_events(tables, case)
    events = events.assign(last=events.event == final_event(tables, case))
    return events.sort_values(["t_s", "last"], kind="stable").drop_duplicates("t_s", keep="last")


def consistency(tables: Tables) -> list[Block]:
    """Return NEES, NIS and whiteness."""
    frame = METRICS["consistency"](tables)
    frame = frame.assign(inside_ratio=frame.inside_ratio * 100)
    verdicts = METRICS["filter_verdicts"](tables)
    verdicts = verdicts.assign(
        shown=[filter_verdict(row.verdict, row.sigma_ratio) for row in verdicts.itertuples()],
        moment=words(verdicts.moment),
        by=verdicts.by.replace("LinCov", "linear covariance"),
    )
    blocks: list[Block] = [
        Text(note("consistency")),
        formatted_table("filter_verdicts", verdicts),
        formatted_table("consistency", frame),
        *omission_note(tables),
    ]
    cases_without_anees = frame.case[(frame.test == "ANEES") & (frame.time_count == 0)]
    if len(cases_without_anees):
        text = (
            f"No ANEES of {'; '.join(cases_without_anees)}: the filter assumes that a state is known exactly, such as "
            "an extra state whose error the truth does not have. Its covariance has no inverse."
        )
        blocks.append(Text(text))
    for case in chosen_cases(tables):
        blocks.append(figure(tables, "consistency", case))
    return blocks + _whiteness(tables)


@table_section("whiteness")
def _whiteness(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the channel with the largest autocorrelation of each case, and the number of coloured channels."""
    frame = frame.assign(size=frame.largest_ratio.abs())
    cases = frame.groupby("case", sort=False)
    n_channels = cases.size()
    n_coloured = n_channels - cases.white.sum()
    worst = frame.loc[cases["size"].idxmax()].assign(
        channels=n_channels.to_numpy(),
        coloured=n_coloured.to_numpy().astype(int),
    )
    return [formatted_table("whiteness", worst)]


def agreement(tables: Tables) -> list[Block]:
    """Return the verdict of each case and the quantities that disagree."""
    cases = by_case(tables)
    if len(cases):
        alpha = percent(float(cases.alpha_ratio.iloc[0]))
    else:
        alpha = ""
    sources = []
    for row in cases.itertuples():
        source = "–"
        if row.source:
            source = f"{row.source} ({100 * row.share_ratio:.0f} %)"
        sources.append(source)
    innovations = tables.innovations.groupby("case", sort=False)
    false_rejections = innovations.false_rejection_ratio.max() * 100
    rejection_percents = [false_rejections.get(case, 0.0) for case in tables.labels]
    cases = cases.assign(source=sources, rejected=rejection_percents[: len(cases)])
    blocks: list[Block] = [Text(note("agreement", alpha=alpha)), formatted_table("agreement", cases)]
    for row in cases.itertuples():
        if row.reason:
            blocks.append(Text(f"{row.case}: {row.reason}.", "Not applicable."))
    rows = METRICS["agreement"](tables)
    differing = rows[rows.agree == "disagree"].drop(columns="agree")
    if len(differing):
        distance = (differing.ratio - 1.0).abs()
        differing = differing.assign(distance=distance)
        largest_rows = differing.nlargest(12, "distance")
        largest_rows = largest_rows.drop(columns="distance").rename(columns=words)
        blocks.append(table(largest_rows, "Largest disagreements (at most 12)."))
    return blocks + _control_variates(tables)


@table_section("control_variates")
def _control_variates(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    return [formatted_table("controlled", frame, event=words(frame.event.iloc[0])), Text(note("controlled"))]


@table_section("outages", "No fault in any case.")
def outages(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the errors before, during and after every fault."""
    frame = frame.assign(fault=words(frame.fault), metric=words(frame.metric))
    return [formatted_table("outages", frame)]


@table_section("references", "The campaign names no published number.")
def references(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return published numbers next to the computed numbers."""
    inside_count = int(frame.in_band.sum())
    return [
        Text(f"{inside_count} of {len(frame)} numbers are within their band."),
        formatted_table("references", frame),
    ]


def reproduce(tables: Tables) -> list[Block]:
    """Return the commands, the seed, the versions and the digests with which the results can be reproduced."""
    manifest = {**tables.manifest, "seed": tables.campaign.get("seed", tables.manifest.get("seed"))}
    rows = tuple((words(key), str(manifest[key])) for key in _ORIGIN if manifest.get(key))
    return [
        Text(note("reproduce")),
        Text("lvnav-trade run campaign.resolved.yaml --out again\nlvnav-trade report .", block_type="code"),
        Table(("item", "value"), rows, (False, False), "Origin of these results."),
        formatted_table("cases", tables.cases),
    ]


@table_section("stops")
def logic_tables(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the mode logic of the filters in tables: starts, stops, restarts, and transitions by type."""
    ratios = ["started_ratio", "corrected_ratio", "ended_ratio"]
    percents = frame.assign(**{ratio: 100.0 * frame[ratio] for ratio in ratios})
    return [formatted_table("stops", percents), *_changes(tables)]


@table_section("mode_transitions")
def _changes(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    return [formatted_table("logic", frame.assign(run_ratio=100.0 * frame.run_ratio))]


def logic(tables: Tables) -> list[Block]:
    """Return the mode logic of the filters in tables, and figures of the modes over time."""
    cases = tables.cases.case[tables.cases.logic.eq(True)]
    columns = [name for name in tables.mode_transitions.columns if name != "case"]
    group, remark = first_cases(distinct_cases(tables, "mode_transitions", columns, cases))
    return [*logic_tables(tables), *figures(tables, "logic", group), *remark]
