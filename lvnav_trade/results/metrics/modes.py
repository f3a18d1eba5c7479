"""Metrics of a filter's mode logic in a phase: time of entry, share of runs, duration, number of transitions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from lvnav_trade.quantities.records import MODES, Floats
from lvnav_trade.results.metric import MEAN, MEDIAN, NOT_IN_FLIGHT, Metric, MetricValue, dimension_message, scale_of

if TYPE_CHECKING:
    import pandas as pd

    from lvnav_trade.results.tables.read import Tables

ENTRY_TIME, ENTRY_SHARE, DURATION, CHANGES = "mode_entry_time", "mode_entry_share", "mode_duration", "mode_changes"
_NO_LOGIC = "no runs, or a filter without a logic"


@dataclass(frozen=True)
class ModeNumber(Metric):
    """A number of every run, whose median over the runs is reported."""

    average: ClassVar[str] = MEDIAN
    names_mode: ClassVar[bool] = True

    def faults(self, statement: Any) -> Iterator[str]:
        """Yield input errors: the metric needs a mode and a phase, and a duration has no transitions to select."""
        if statement.during is None or statement.mode is None or statement.statistic != "rms":
            yield f"{self.name} is of a mode in a phase; give during and mode, and no statistic"
        if self.name == DURATION and (statement.reason or statement.number > 1):
            yield "reason and number choose changes; mode_duration is of all of the phase"

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the median over the runs; linear covariance does not give it."""
        if not has_logic(tables, case):
            return MetricValue(remark=_NO_LOGIC)
        numbers = mode_numbers(tables, case, statement)
        scale = scale_of(unit, self.unit)
        if scale is None:
            return MetricValue(remark=dimension_message(unit))
        if not np.all(np.isfinite(numbers)):
            return MetricValue(remark=NOT_IN_FLIGHT)
        return MetricValue(monte_carlo=float(np.median(numbers)) / scale, remark=spread_text(numbers / scale))

    def label(self, statement: Mapping[str, Any]) -> str:
        """Return the label, such as ``2. aiding entry_time (data again), liftoff to injection``."""
        ordinal = ""
        if int(statement.get("number") or 1) > 1:
            ordinal = f"{statement['number']}. "
        reason = f" ({statement['reason']})" if statement.get("reason") else ""
        name = self.name.replace("mode", f"{ordinal}{statement['mode']}", 1)
        return f"{name}{reason}, {statement['during']}"


@dataclass(frozen=True)
class ModeShare(ModeNumber):
    """Share of runs that enter a mode."""

    average: ClassVar[str] = MEAN

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the share of runs that enter the mode."""
        if not has_logic(tables, case):
            return MetricValue(remark=_NO_LOGIC)
        has_entered = mode_numbers(tables, case, statement)
        return MetricValue(
            monte_carlo=float(has_entered.mean()),
            runs=has_entered,
            is_root=False,
            is_share=True,
        )


def has_logic(tables: Tables, case: str) -> bool:
    """Whether the filter of a case has mode logic, and the results have runs."""
    from lvnav_trade.results.tables.read import pick

    filter_has_logic = bool(pick(tables.cases, case=case).logic.eq(True).any())
    return filter_has_logic and not pick(tables.runs, case=case).empty


def mode_numbers(tables: Tables, case: str, statement: Mapping[str, Any]) -> Floats:
    """Return the number of every run (n_run,) for a metric of modes.

    Entry time: s from the start of the phase to the n-th transition into the mode; the length of the phase if there is
    none. Entry share: 1 if the transition occurs, else 0. Duration: s in the mode. Changes: number of transitions into
    the mode. If the statement gives a reason, only transitions with this reason count.
    """
    from lvnav_trade.results.statistics.select import phase, pick

    first, last = phase(tables, case, str(statement["during"]))
    runs = np.sort(pick(tables.runs, case=case).run_number.unique())
    transitions = pick(tables.mode_transitions, case=case)
    transitions = transitions.sort_values(["run_number", "t_s"], kind="stable")
    metric = str(statement["metric"])
    if metric == DURATION:
        mode = str(statement["mode"])
        durations = []
        for run in runs:
            run_transitions = transitions[transitions.run_number == run]
            durations.append(_duration(run_transitions, mode, first, last))
        return np.array(durations)

    entries = _entries(transitions, statement, first, last)
    counts = entries.groupby("run_number").size().reindex(runs, fill_value=0)
    if metric == CHANGES:
        return counts.to_numpy(dtype=float)
    ordinal = int(statement.get("number") or 1)
    if metric == ENTRY_SHARE:
        return (counts >= ordinal).to_numpy(dtype=float)
    is_nth = entries.groupby("run_number").cumcount() == ordinal - 1
    entry_times = entries[is_nth].set_index("run_number").t_s
    return (entry_times.reindex(runs, fill_value=last) - first).to_numpy(dtype=float)


def _entries(transitions: pd.DataFrame, statement: Mapping[str, Any], first: float, last: float) -> pd.DataFrame:
    """Return the transitions into a mode between two times (s), with the reason of a statement if it gives one."""
    from lvnav_trade.results.statistics.select import SAME_TIME, pick

    entries = pick(transitions, to_mode=str(statement["mode"]))
    if statement.get("reason"):
        entries = pick(entries, reason=str(statement["reason"]))
    return entries[entries.t_s.between(first - SAME_TIME, last + SAME_TIME)]


def _duration(transitions: pd.DataFrame, mode: str, first: float, last: float) -> float:
    """Return the time (s) that a run spends in a mode between two times; before its first transition it is in
    `MODES[0]`.
    """
    modes = np.array([MODES[0], *transitions.to_mode])
    edges = np.clip([-np.inf, *transitions.t_s, np.inf], first, last)
    return float(np.diff(edges)[modes == mode].sum())


def spread_text(numbers: Floats) -> str:
    """Return the range of the numbers of the runs in words."""
    if np.ptp(numbers) == 0.0:
        return f"the same in all {len(numbers)} runs"
    return f"median of {len(numbers)} runs, {min(numbers):.4g} to {max(numbers):.4g}"


METRICS: tuple[Metric, ...] = (
    ModeNumber(ENTRY_TIME, "s", "time from the start of a phase until the filter's logic enters a mode"),
    ModeShare(ENTRY_SHARE, "-", "fraction of runs in which the mode logic enters a mode"),
    ModeNumber(DURATION, "s", "time that the filter's logic is in a mode"),
    ModeNumber(CHANGES, "-", "number of changes into a mode"),
)
