"""Tables of a study: verdicts, mode logic, coverage, paired differences, process noise, other missions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.metrics import METRICS
from lvnav_trade.metrics.errors.coverage import coverage
from lvnav_trade.metrics.errors.paired_levels import paired_levels
from lvnav_trade.metrics.published.published import cases_of, ours
from lvnav_trade.report.blocks import Block, Text, number, table
from lvnav_trade.report.diagnostics import error_bound
from lvnav_trade.report.reception import logic_tables
from lvnav_trade.store import Tables


def study_tables(tables: Tables, wanted: Sequence[str], axis: str) -> list[Block]:
    """Return the tables wanted: requirements, logic, coverage, paired (of the levels of `axis`), error_bound."""
    blocks: list[Block] = []
    if "requirements" in wanted:
        blocks += _requirements(tables)
    if "logic" in wanted:
        blocks += logic_tables(tables)
    if "coverage" in wanted:
        blocks += _coverage(tables)
    if "paired" in wanted:
        blocks += _paired(tables, axis)
    if "error_bound" in wanted:
        blocks += error_bound(tables)
    return blocks


def _requirements(tables: Tables) -> list[Block]:
    frame = METRICS["requirements"](tables)
    if frame.empty:
        return []
    said = {"met": "pass", "violated": "fail", "undecided": "undecided"}
    shown = pd.DataFrame(
        {
            "case": frame.case,
            "requirement": frame.requirement,
            "verdict": frame.verdict.map(said),
            "quantile": frame.estimate,
            "limit": frame.limit,
            "beyond": frame.failures.astype(str) + " of " + frame.runs.astype(str),
        }
    )
    part, sure = frame.probability.iloc[0], frame.confidence.iloc[0]
    passed = int((frame.verdict == "met").sum())
    text = (
        f"{passed} of {len(frame)} cells pass: at least {100 * part:g} % of flights within the limit, at a confidence "
        f"of {100 * sure:g} %."
    )
    return [Text(text), table(shown, "Verdict by case; quantile: what that part of our flights stays below.")]


def _coverage(tables: Tables) -> list[Block]:
    frame = coverage(tables)
    if frame.empty:
        return []
    frame = frame[frame.event.isin(_spaced(frame))]
    shown = pd.DataFrame(
        {
            "case": frame.case,
            "event": frame.event.str.replace("_", " "),
            "error": frame.quantity,
            "runs": frame.run_count,
            "axes within (%)": (100.0 * frame.inside_ratio).map(lambda part: f"{part:.2f}"),
            "runs with all axes within (%)": (100.0 * frame.all_inside_ratio).map(lambda part: f"{part:.2f}"),
            "95 %": (100.0 * frame.low_ratio).map(lambda part: f"{part:.2f}")
            + " to "
            + (100.0 * frame.high_ratio).map(lambda part: f"{part:.2f}"),
            "honest": frame.honest,
        }
    )
    note = (
        "Within three of the filter's own sigmas; a Gaussian as wide as the filter says has 99.73 % of axes and "
        "99.19 % of runs within. Honest: the interval of the latter reaches that."
    )
    return [Text(note), table(shown, "Coverage of three sigmas.")]


def _spaced(frame: pd.DataFrame) -> list[str]:
    """Return events that are an eighth of the flight apart from each other, the last one among them."""
    times = frame.drop_duplicates("event").set_index("event").t_s.sort_values(ascending=False, kind="stable")
    last = str(times.index[0]) if "injection" not in times.index else "injection"
    kept, room = [last], (times.max() - times.min()) / 8.0
    for name, t in times.items():
        if all(abs(t - times[other]) >= room for other in kept):
            kept.append(str(name))
    return kept


def _paired(tables: Tables, axis: str) -> list[Block]:
    frame = paired_levels(tables, axis)
    if frame.empty:
        return []
    last = frame[frame.event.isin(_shown_events(frame))]
    shown = pd.DataFrame(
        {
            "case": last.case,
            "levels": last.levels,
            "event": last.event.str.replace("_", " "),
            "error": last.quantity,
            "unit": last.unit,
            "first": last.first_rms,
            "second": last.second_rms,
            "apart": last.difference_rms,
            "apart / error (-)": last.difference_ratio,
        }
    )
    note = "First, second: RMS error (3D) of the two levels; apart: RMS of the difference of their errors, run by run."
    return [Text(note), table(shown, f"Two levels of {axis} on the same draws.")]


def _shown_events(frame: pd.DataFrame) -> list[str]:
    """Return the events at which parting is shown: the first, the last, and where it grows by a factor of two."""
    worst = frame.groupby("event", sort=False).difference_ratio.max()
    shown, level = [worst.index[0]], float(worst.iloc[0])
    for name, value in worst.items():
        if value > 2.0 * level or value < 0.5 * level:
            shown.append(name)
            level = float(value)
    return [str(name) for name in dict.fromkeys([*shown, worst.index[-1]])]


def missions_table(tables: Tables, flown: Sequence[Mapping[str, Any]]) -> list[Block]:
    """Return flown missions in the layout of their publication, and where each lies among our flights."""
    if not flown:
        return []
    rows: dict[str, dict[str, str]] = {}
    for one in flown:
        name, _, what = (part.strip() for part in str(one["item"]).partition(","))
        head = f"{what} ({one['unit']})"
        rows.setdefault(name, {"mission": name})[head] = number(float(one["value"]))
        case = next(iter(cases_of(tables, one.get("case") or {})), None)
        found = np.empty(0) if case is None else ours(tables, case, one, str(one["unit"])).runs
        below = f"{100 * float(np.mean(found < float(one['value']))):.0f}" if len(found) else "–"
        rows[name][f"ours below it, {what} (%)"] = below
        if len(found):
            root = float(np.sqrt(np.mean(found**2)))
            for label, value in (
                ("ours, RMS", root),
                *((f"ours, {q} %", float(np.quantile(found, q / 100))) for q in (50, 95)),
            ):
                rows.setdefault(f"~{label}", {"mission": label})[head] = number(value)
    ordered = [rows[name] for name in sorted(rows, key=lambda name: name.startswith("~"))]
    return [
        table(pd.DataFrame(ordered).fillna("–"), "Flown missions (sizes of the published differences) and our flights.")
    ]


def noise_table(found: Any, step: float) -> Block:
    """Return the densities of an estimate (campaign.estimate) over the whole flight and by phase, in the units of
    people; step: its length in s.
    """
    every = [("whole flight", found.whole), *((name, noise) for name, _, _, noise in found.phases)]
    shown = pd.DataFrame(
        {
            "phase": [name.replace("_", " ") for name, _ in every],
            "attitude (deg/sqrt(h))": [math.degrees(noise.attitude) * 60.0 for _, noise in every],
            "velocity (m/s/sqrt(s))": [noise.velocity for _, noise in every],
            "position (m/sqrt(s))": [noise.position for _, noise in every],
        }
    )
    return table(shown, f"Process noise of an ensemble, steps of {step:g} s.")
