"""Results of tests for faults: false alarms, detection, isolation, recovery, with exact intervals."""

import math
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.probability import success_bounds
from lvnav_trade.metrics.basics.select import SAME_TIME, at_time, final_event, flight_events, history_of, once, pick
from lvnav_trade.metrics.convergence import converged
from lvnav_trade.records import Floats
from lvnav_trade.store.read import Tables

CONFIDENCE = 0.975  # of either bound: both hold with 95 %
EPISODE = 5  # epochs from the first decision on within which a fault is to be isolated
TIMES = 3.0  # the root mean square of the case without the fault: an error that is smaller has recovered
ISOLATED, IN_PART, WRONG = "isolated", "isolated in part", "wrong isolation"

_CHANNEL = ("range_bias", "degraded_noise", "wild_samples", "cycle_slip", "frozen_output", "invalid_output")
_CLOCK = ("clock_jump", "clock_drift")
_UNIT = ("gyro_", "accel_", "dead_axis", "dropped_samples", "satellite_outage", "antenna_failure", "jamming")
_COLUMNS = [
    "case",
    "fault",
    "outcome",
    "run_count",
    "outcome_count",
    "share_ratio",
    "low_ratio",
    "high_ratio",
    "median_s",
    "lincov_s",
]


def expected(fault: str) -> str:
    """Return what a filter should isolate of a fault, by the name of its row among the events; empty where no test of
    ranges can tell.
    """
    kind = fault.split()[0]
    if kind in _CLOCK:
        return "clock"
    return "channel" if kind in _CHANNEL else "inertial" if kind.startswith(_UNIT) else ""


class AppliedFaults(NamedTuple):
    """The faults of a case: names, start of the first (s; infinite without any), what is to be isolated, and the
    satellites that are affected singly (none: of these nothing is known).
    """

    names: str
    start: float
    kinds: frozenset[str]
    satellites: frozenset[str]


def applied_faults(tables: Tables, case: str) -> AppliedFaults:
    """Return what fails in a case."""
    faults = pick(tables.events, case=case, kind="fault").sort_values("t_s", kind="stable")
    if faults.empty:
        return AppliedFaults("", np.inf, frozenset(), frozenset())
    kinds = frozenset(filter(None, map(expected, faults.event)))
    satellites = frozenset(" ".join(faults.satellites.fillna("")).split())
    return AppliedFaults(", ".join(faults.event), float(faults.t_s.iloc[0]), kinds, satellites)


def outcomes(decisions: pd.DataFrame, faults: AppliedFaults) -> pd.Series:
    """Return what the decisions of each run amount to, by its number.

    Isolated: everything that is to be isolated is named, every affected satellite is excluded, and nothing else; wrong
    isolation: something else is named, or a sound satellite excluded; isolated in part: neither.
    """
    return decisions.groupby("run_number").apply(_outcome, faults, include_groups=False)


def _outcome(rows: pd.DataFrame, faults: AppliedFaults) -> str:
    # one of several inertial units that is excluded is the inertial failure itself, a separation names its satellite
    kinds = set(rows.isolated.replace({"unit": "inertial", "separation": "channel"}))
    satellites = {name.split()[0] for name in rows.channel[rows.isolated != "unit"].dropna() if name}
    any_may_be = "channel" in faults.kinds and not faults.satellites
    if kinds - faults.kinds or (satellites - faults.satellites and not any_may_be):
        return WRONG
    return ISOLATED if kinds == faults.kinds and faults.satellites <= satellites else IN_PART


def share(count: int, runs: int) -> tuple[float, float, float]:
    """Return a share of runs and its 95 % interval (Clopper and Pearson)."""
    low, high = success_bounds(runs, runs - count, CONFIDENCE)
    return count / runs, low, high


def rate(tables: Tables, case: str, metric: str, during: tuple[float, float]) -> tuple[Floats, float]:
    """Return whether each run (1 or 0), and linear covariance on the mean, has the outcome that a rate counts, by its
    decisions from a first to a last time (s).

    false_alarm_rate, detection_rate: any decision; isolation_rate: isolated; wrong_isolation_rate.
    """
    runs = pick(tables.runs, case=case).run_number.unique()
    found = [
        _counted(
            rows[rows.t_s.between(during[0] - SAME_TIME, during[1] + SAME_TIME)], applied_faults(tables, case), metric
        )
        for rows in (pick(tables.integrity, case=case), pick(tables.nominal_integrity, case=case))
    ]
    return np.isin(np.sort(runs), list(found[0])).astype(float), float(len(found[1]) > 0)


def _counted(rows: pd.DataFrame, faults: AppliedFaults, metric: str) -> pd.Index:
    """Return the runs that have the outcome."""
    if rows.empty or metric in ("false_alarm_rate", "detection_rate"):
        return pd.Index(rows.run_number.unique())
    found = outcomes(rows, faults)
    return found.index[found == (ISOLATED if metric == "isolation_rate" else WRONG)]


@once
def integrity(tables: Tables) -> pd.DataFrame:
    """Return, for each case in which faults are tested for, shares of its runs with exact 95 % intervals.

    Columns: case, fault, outcome, run_count, outcome_count, share_ratio, low_ratio, high_ratio, median_s after the
    fault began, lincov_s: the same of linear covariance, which decides on the mean. Outcomes: false alarm (a decision
    before the fault, or in a flight without one), detected, isolated, isolated in part, wrong isolation (by the
    decisions within five epochs from the first one on, see `outcomes`), missed, recovered (position and velocity below
    three times the root mean square of the case without the fault at every event from then on, where the campaign has
    that case).
    """
    found: list[tuple[Any, ...]] = []
    chosen = tables.cases[tables.cases.integrity.eq(True) & (tables.cases.run_count > 0)]
    for case in chosen.itertuples():
        faults, runs = applied_faults(tables, case.case), int(case.run_count)
        rows, nominal = (
            _episodes(pick(table, case=case.case), faults, _interval(tables, case.case))
            for table in (tables.integrity, tables.nominal_integrity)
        )
        every = pick(tables.integrity, case=case.case)
        alarms = every[every.t_s < faults.start - SAME_TIME].run_number.nunique()
        counted = [("false alarm", alarms, np.nan, np.nan)]
        if faults.names:
            counted += _found(rows, nominal, faults, runs) + _recovered(tables, case.case, faults)
        found += [(case.label, faults.names, name, runs, n, *share(n, runs), t, own) for name, n, t, own in counted]
    return pd.DataFrame(found, columns=_COLUMNS)


def _interval(tables: Tables, case: str) -> float:
    t = np.unique(pick(tables.innovations, case=case).t_s)
    return float(np.median(np.diff(t))) if len(t) > 1 else 1.0


def _episodes(rows: pd.DataFrame, faults: AppliedFaults, interval: float) -> pd.DataFrame:
    """Return the decisions of each run within some epochs from its first one after the fault began."""
    after = rows[rows.t_s >= faults.start - SAME_TIME]
    since = after.t_s - after.groupby("run_number").t_s.transform("min")
    return after[since < (EPISODE - 0.5) * interval]


def _found(
    rows: pd.DataFrame, nominal: pd.DataFrame, faults: AppliedFaults, runs: int
) -> list[tuple[str, int, float, float]]:
    """Return outcome, count, median time and that of linear covariance: detected, how isolated, missed."""
    first, own = (one.groupby("run_number").t_s.min() - faults.start for one in (rows, nominal))
    how, nominally = (outcomes(one, faults) if len(one) else pd.Series(dtype=object) for one in (rows, nominal))
    parts = [
        (
            name,
            int((how == name).sum()),
            float(first.loc[how.index[how == name]].median()),
            float(own.loc[mine].median()),
        )
        for name in (ISOLATED, IN_PART, WRONG)
        for mine in (nominally.index[nominally == name],)
    ]
    detected = ("detected", len(first), float(first.median()), float(own.median()))
    return [detected, *parts, ("missed", runs - len(first), np.nan, np.nan)]


def _recovered(tables: Tables, case: str, faults: AppliedFaults) -> list[tuple[str, int, float, float]]:
    """Return how many runs recover, and when; nothing where no case is alike but for the fault, or without events."""
    other = without_fault(tables, case)
    end = flight_events(tables, case).set_index("event").t_s.get(final_event(tables, case), -np.inf)
    if not other or end <= faults.start:
        return []
    both = [
        converged(tables, case, quantity, (faults.start, float(end)), f"{TIMES:g} rms", other)
        for quantity in ("position", "velocity")
    ]
    known = [one for one in both if one is not None]
    if len(known) < 2:
        return []
    times, done = np.max([one.times for one in known], axis=0), np.all([one.done for one in known], axis=0)
    median = float(np.median(times[done])) if done.any() else np.nan
    own = max(one.expected for one in known) if all(one.expected_done for one in known) else np.nan
    return [("recovered", int(done.sum()), median, own)]


def without_fault(tables: Tables, case: str) -> str:
    """Return the case that differs in one axis alone and has no fault; empty where there is none."""
    mine = tables.levels[case]
    for other, levels in tables.levels.items():
        differing = [axis for axis, level in levels.items() if mine.get(axis) != level]
        if len(differing) == 1 and pick(tables.events, case=other, kind="fault").empty:
            return other
    return ""


def decisions(tables: Tables) -> pd.DataFrame:
    """Return what filters that test for faults decide, and when: of each epoch the runs that isolate the same.

    Columns: case, t_s, isolated (channel, clock, inertial, unit, separation), satellites (that are excluded there, that
    an alarm of separation names, or the inertial unit), run_count, run_ratio, lincov (whether linear covariance decides
    so too).
    """
    keys = ["case", "t_s", "isolated", "satellites"]
    if tables.integrity.empty and tables.nominal_integrity.empty:
        return pd.DataFrame(columns=[*keys, "run_count", "run_ratio", "lincov"])
    counted, nominal = (
        _by_epoch(table).groupby(keys, sort=False).size() for table in (tables.integrity, tables.nominal_integrity)
    )
    frame = pd.DataFrame({"run_count": counted, "lincov": nominal}).fillna(0)
    frame = frame.assign(lincov=frame.lincov > 0)
    frame = frame.reset_index().sort_values(["t_s", "isolated", "satellites"], kind="stable")
    runs = frame.case.map(tables.cases.set_index("case").run_count)
    frame = frame.assign(run_count=frame.run_count.astype(int), run_ratio=frame.run_count / runs.where(runs > 0))
    order = {case: place for place, case in enumerate(tables.labels)}
    frame = frame.sort_values("case", key=lambda case: case.map(order), kind="stable").reset_index(drop=True)
    return frame.assign(case=frame.case.map(tables.labels), lincov=frame.lincov.astype(bool))


def _by_epoch(rows: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each run and epoch with a decision, its satellites in one text."""
    names = rows.channel.fillna("")
    named = rows.assign(satellites=names.where(rows.isolated == "unit", names.str.split(" ").str[0].fillna("")))
    named = named.drop_duplicates(["case", "run_number", "t_s", "isolated", "satellites"])
    named = named.sort_values(["case", "run_number", "t_s", "satellites"], kind="stable")
    keys = ["case", "run_number", "t_s", "isolated"]
    return named.groupby(keys, sort=False).satellites.agg(lambda names: " ".join(filter(None, names))).reset_index()


def tested_errors(tables: Tables) -> pd.DataFrame:
    """Return what the tests are worth: root mean square errors at the last event with them, and of the case that is
    alike but for them.

    Columns: case, fault, event, metric, unit, without, with_tests, ratio. Of the runs, or of linear covariance without.
    """
    rows, tested = [], tables.cases.set_index("case").integrity.eq(True)
    for case, label in tables.labels.items():
        other = _alike(tables, case, tested) if tested[case] else ""
        event = final_event(tables, case)
        for quantity in ("position", "velocity", "attitude") if other else ():
            unit, factor = tables.people[quantity, "3d"]
            without, with_tests = (_at_event(tables, one, event, quantity) * factor for one in (other, case))
            head = (label, applied_faults(tables, case).names, event, f"{quantity}_error", unit)
            rows.append((*head, without, with_tests, with_tests / without if without > 0.0 else np.nan))
    names = ["case", "fault", "event", "metric", "unit", "without", "with_tests", "ratio"]
    return pd.DataFrame(rows, columns=names)


def _alike(tables: Tables, case: str, tested: pd.Series) -> str:
    """Return the case without tests that differs in one axis alone; empty where there is none."""
    mine = tables.levels[case]
    for other, levels in tables.levels.items():
        if not tested[other] and sum(mine.get(axis) != level for axis, level in levels.items()) == 1:
            same = applied_faults(tables, other)[:2] == applied_faults(tables, case)[:2]
            if same:
                return other
    return ""


def _at_event(tables: Tables, case: str, event: str, quantity: str) -> float:
    t = float(pick(tables.events, case=case, event=event).t_s.iloc[0])
    row = at_time(history_of(tables, case, quantity, "3d"), t)
    return float(row.rms_si) if row.run_count else math.hypot(row.lincov_true_si, row.lincov_mean_si)
