"""Tables of a study: verdicts, mode logic, coverage, paired differences, process noise, other missions."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.metrics.errors.coverage import coverage, paired_levels
from lvnav_trade.metrics.published.published import cases_of, ours
from lvnav_trade.report.blocks import Block, Text, number, table, words
from lvnav_trade.report.diagnostics import error_bound
from lvnav_trade.report.escape import note
from lvnav_trade.report.reception import logic_tables
from lvnav_trade.report.sections import of, stated
from lvnav_trade.store import Tables


def study_tables(tables: Tables, wanted: Sequence[str], axis: str) -> list[Block]:
    """Return the tables wanted: requirements, logic, coverage, paired (of the levels of `axis`), error_bound."""
    made: dict[str, Callable[[Tables], list[Block]]] = {
        "requirements": _requirements,
        "logic": logic_tables,
        "coverage": _coverage,
        "paired": partial(_paired, axis=axis),
        "error_bound": error_bound,
    }
    return [block for name, make in made.items() if name in wanted for block in make(tables)]


@of("requirements")
def _requirements(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    said = {"met": "pass", "violated": "fail", "undecided": "undecided"}
    beyond = frame.failures.astype(str) + " of " + frame.runs.astype(str)
    part, sure = frame.probability.iloc[0], frame.confidence.iloc[0]
    text = (
        f"{int((frame.verdict == 'met').sum())} of {len(frame)} cells pass: at least {100 * part:g} % of flights "
        f"within the limit, at a confidence of {100 * sure:g} %."
    )
    frame = frame.assign(verdict=frame.verdict.map(said), beyond=beyond)
    return [
        Text(text),
        stated("study_requirements", frame),
    ]


def _coverage(tables: Tables) -> list[Block]:
    frame = coverage(tables)
    if frame.empty:
        return []
    ratios = ["inside_ratio", "all_inside_ratio", "low_ratio", "high_ratio"]
    frame = frame[frame.event.isin(_spaced(frame))].assign(**{name: 100.0 * frame[name] for name in ratios})
    return [Text(note("coverage")), stated("coverage", frame)]


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
    return [Text(note("paired")), stated("paired", last, axis=axis)]


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
    published: dict[str, dict[str, str]] = {}
    compared: dict[str, dict[str, str]] = {}
    for one in flown:
        name, _, what = (part.strip() for part in str(one["item"]).partition(","))
        head, value = f"{what} ({one['unit']})", float(one["value"])
        case = next(iter(cases_of(tables, one.get("case") or {})), None)
        found = np.empty(0) if case is None else ours(tables, case, one, str(one["unit"])).runs
        below = f"{100 * float(np.mean(found < value)):.0f}" if len(found) else "–"
        row = published.setdefault(name, {"mission": name})
        row |= {head: number(value), f"ours below it, {what} (%)": below}
        if len(found):
            sizes = (np.sqrt(np.mean(found**2)), *np.quantile(found, [0.5, 0.95]))
            for label, size in zip(("ours, RMS", "ours, 50 %", "ours, 95 %"), sizes, strict=True):
                compared.setdefault(label, {"mission": label})[head] = number(size)
    rows = [*published.values(), *compared.values()]
    caption = "Flown missions (sizes of the published differences) and our flights."
    return [table(pd.DataFrame(rows).fillna("–"), caption)] if rows else []


def noise_table(found: Any, step: float) -> Block:
    """Return the densities of an estimate (campaign.estimate) over the whole flight and by phase, in the units of
    people; step: its length in s.
    """
    every = [("whole flight", found.whole), *((name, noise) for name, _, _, noise in found.phases)]
    rows = [(words(name), math.degrees(noise.attitude) * 60.0, noise.velocity, noise.position) for name, noise in every]
    return stated("process_noise", pd.DataFrame(rows), step=f"{step:g}")
