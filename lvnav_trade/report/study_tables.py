"""Tables of a campaign of a study: requirements, mode logic, coverage, paired cases, integrity."""

from collections.abc import Callable, Sequence
from functools import partial

import pandas as pd

from lvnav_trade.report.blocks import Block, Text, formatted_table, table_section
from lvnav_trade.report.diagnostics import error_bound, fault_test_benefit, rates
from lvnav_trade.report.escape import note
from lvnav_trade.report.evidence import logic_tables
from lvnav_trade.results.evaluation.coverage import coverage
from lvnav_trade.results.evaluation.rms import paired_levels
from lvnav_trade.results.requirements.requirements import verdict_texts
from lvnav_trade.results.tables.read import Tables

_MANY = 12  # cases; with more, the table of coverage has the last event only


def study_tables(tables: Tables, names: Sequence[str], axis: str) -> list[Block]:
    """Return the requested tables of a campaign, in a fixed order.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    names : sequence of str
        Names among requirements, logic, coverage, paired, error_bound, integrity, tested_errors.
    axis : str
        Axis whose levels are compared in the table `paired`.
    """
    builders: dict[str, Callable[[Tables], list[Block]]] = {
        "requirements": _requirements,
        "logic": logic_tables,
        "coverage": _coverage,
        "paired": partial(_paired_differences, axis=axis),
        "error_bound": error_bound,
        "integrity": rates,
        "tested_errors": fault_test_benefit,
    }
    blocks = []
    for name, build_table in builders.items():
        if name in names:
            blocks += build_table(tables)
    return blocks


@table_section("requirements")
def _requirements(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    confidence = frame.confidence.iloc[0]
    n_met = int((frame.verdict == "met").sum())
    text = (
        f"{n_met} of {len(frame)} cells pass: at least {_probabilities(frame)} of flights "
        f"within the limit, at a confidence of {100 * confidence:g} %."
    )
    verdicts = {"met": "pass", "violated": "fail", "undecided": "undecided"}
    rows = verdict_texts(frame).assign(
        verdict=frame.verdict.map(verdicts),
        beyond=frame.failures.astype(str) + " of " + frame.runs.astype(str),
    )
    return [Text(text), formatted_table("study_requirements", rows)]


def _probabilities(frame: pd.DataFrame) -> str:
    """Return the required probabilities in percent, each with its requirements if they differ."""
    by_probability = frame.groupby("probability", sort=True).requirement.unique()
    if len(by_probability) == 1:
        return f"{100 * by_probability.index[0]:g} %"
    return " or ".join(f"{100 * p:g} % ({', '.join(names)})" for p, names in by_probability.items())


def _coverage(tables: Tables) -> list[Block]:
    frame = coverage(tables)
    if frame.empty:
        return []
    events = _spaced_events(frame)
    if len(tables.labels) > _MANY:
        events = events[:1]
    frame = frame[frame.event.isin(events)]
    ratios = ["inside_ratio", "all_inside_ratio", "low_ratio", "high_ratio"]
    percents = {name: 100.0 * frame[name] for name in ratios}
    frame = frame.assign(**percents)
    return [Text(note("coverage")), formatted_table("coverage", frame)]


def _spaced_events(frame: pd.DataFrame) -> list[str]:
    """Return events at least an eighth of the flight apart, starting from injection (or from the last event)."""
    times = frame.drop_duplicates("event").set_index("event").t_s
    times = times.sort_values(ascending=False, kind="stable")
    last = "injection" if "injection" in times.index else str(times.index[0])
    least_distance = (times.max() - times.min()) / 8.0
    event_names = [last]
    for name, t in times.items():
        if all(abs(t - times[event]) >= least_distance for event in event_names):
            event_names.append(str(name))
    return event_names


def _paired_differences(tables: Tables, axis: str) -> list[Block]:
    frame = paired_levels(tables, axis)
    if frame.empty:
        return []
    rows = frame[frame.event.isin(_shown_events(frame))]
    return [Text(note("paired")), formatted_table("paired", rows, axis=axis)]


def _shown_events(frame: pd.DataFrame) -> list[str]:
    """Return the events at which paired differences are shown: first, last, and each change by a factor of two."""
    worst = frame.groupby("event", sort=False).difference_ratio.max()
    selection = [worst.index[0]]
    level = float(worst.iloc[0])
    for name, value in worst.items():
        if value > 2.0 * level or value < 0.5 * level:
            selection.append(name)
            level = float(value)
    selection.append(worst.index[-1])
    distinct_events = dict.fromkeys(selection)
    return [str(name) for name in distinct_events]
