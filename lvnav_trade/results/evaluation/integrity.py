"""Results of tests for faults: false alarms, detection, isolation, recovery, with exact intervals."""

import math
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.evaluation.convergence import converged
from lvnav_trade.results.statistics.probability import success_bounds
from lvnav_trade.results.statistics.select import SAME_TIME, at_time, final_event, flight_events, history_of, once, pick
from lvnav_trade.results.tables.read import Tables

CONFIDENCE = 0.975  # of each one-sided bound; both together 95 %
EPISODE = 5  # epochs after the first decision within which a fault is to be isolated
TIMES = 3.0  # an error has recovered below this multiple of the RMS error of the case without the fault
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
    """Return what a filter should isolate for a fault (named as in the table `events`): channel, clock or inertial.

    It is empty if no test of ranges can detect the fault.
    """
    kind = fault.split()[0]
    if kind in _CLOCK:
        return "clock"
    return "channel" if kind in _CHANNEL else "inertial" if kind.startswith(_UNIT) else ""


class AppliedFaults(NamedTuple):
    """Faults of a case."""

    names: str  # of all faults, separated by commas
    start: float  # start of the first fault, s; infinite without faults
    kinds: frozenset[str]  # to be isolated: channel, clock, inertial
    satellites: frozenset[str]  # affected individually; empty if not known


def applied_faults(tables: Tables, case: str) -> AppliedFaults:
    """Return the faults of a case."""
    faults = pick(tables.events, case=case, kind="fault").sort_values("t_s", kind="stable")
    if faults.empty:
        return AppliedFaults("", np.inf, frozenset(), frozenset())
    kinds = frozenset(filter(None, map(expected, faults.event)))
    satellites = frozenset(" ".join(faults.satellites.fillna("")).split())
    return AppliedFaults(", ".join(faults.event), float(faults.t_s.iloc[0]), kinds, satellites)


def outcomes(decisions: pd.DataFrame, faults: AppliedFaults) -> pd.Series:
    """Return the outcome of the decisions of each run, by number of the run.

    Isolated: all faults and no others are named, and all affected satellites and no others are excluded. Wrong
    isolation: another fault is named, or a healthy satellite excluded. Isolated in part: neither.
    """
    return decisions.groupby("run_number").apply(_outcome, faults, include_groups=False)


def _outcome(rows: pd.DataFrame, faults: AppliedFaults) -> str:
    # excluding one of several IMUs isolates the inertial fault; an alarm of solution separation names a satellite
    kinds = set(rows.isolated_element.replace({"unit": "inertial", "separation": "channel"}))
    satellites = {name.split()[0] for name in rows.channel[rows.isolated_element != "unit"].dropna() if name}
    any_may_be = "channel" in faults.kinds and not faults.satellites
    if kinds - faults.kinds or (satellites - faults.satellites and not any_may_be):
        return WRONG
    return ISOLATED if kinds == faults.kinds and faults.satellites <= satellites else IN_PART


def share(count: int, runs: int) -> tuple[float, float, float]:
    """Return a fraction of runs and its 95 % interval (Clopper and Pearson)."""
    low, high = success_bounds(runs, runs - count, CONFIDENCE)
    return count / runs, low, high


def rate(tables: Tables, case: str, metric: str, during: tuple[float, float]) -> tuple[Floats, float]:
    """Return the runs with the outcome that a rate counts, from the decisions between two times (s).

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    metric : str
        false_alarm_rate or detection_rate (any decision), isolation_rate, wrong_isolation_rate.
    during : (float, float)
        First and last time (s).

    Returns
    -------
    (n_run,) array, float
        1 for each run with the outcome, else 0; the same for linear covariance, which decides on the mean.
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
    """Return the numbers of the runs with the outcome that a rate counts."""
    if rows.empty or metric in ("false_alarm_rate", "detection_rate"):
        return pd.Index(rows.run_number.unique())
    found = outcomes(rows, faults)
    return found.index[found == (ISOLATED if metric == "isolation_rate" else WRONG)]


@once
def integrity(tables: Tables) -> pd.DataFrame:
    """Return the outcomes of the tests for faults as fractions of the runs, with exact 95 % intervals.

    median_s: median time of the outcome after the start of the fault. lincov_s: this time by linear covariance, which
    decides on the mean.

    Outcomes: false alarm: a decision before the fault, or in a case without fault. detected. isolated, isolated in
    part, wrong isolation: by the decisions within five epochs from the first, see `outcomes`. missed. recovered:
    position and velocity are below three times the RMS error of the case without the fault at every later event, if the
    campaign has that case.
    """
    found: list[tuple[Any, ...]] = []
    chosen = tables.cases[tables.cases.integrity.eq(True) & (tables.cases.run_count > 0)]
    for case in chosen.itertuples():
        faults, runs = applied_faults(tables, case.case), int(case.run_count)
        rows, nominal = (
            _episodes(pick(table, case=case.case), faults, _interval(tables, case.case))
            for table in (tables.integrity, tables.nominal_integrity)
        )
        of_case = pick(tables.integrity, case=case.case)
        alarms = of_case[of_case.t_s < faults.start - SAME_TIME].run_number.nunique()
        counted = [("false alarm", alarms, np.nan, np.nan)]
        if faults.names:
            counted += _found(rows, nominal, faults, runs) + _recovered(tables, case.case, faults)
        found += [(case.label, faults.names, name, runs, n, *share(n, runs), t, own) for name, n, t, own in counted]
    return pd.DataFrame(found, columns=_COLUMNS)


def _interval(tables: Tables, case: str) -> float:
    t = np.unique(pick(tables.innovations, case=case).t_s)
    return float(np.median(np.diff(t))) if len(t) > 1 else 1.0


def _episodes(rows: pd.DataFrame, faults: AppliedFaults, interval: float) -> pd.DataFrame:
    """Return the decisions of each run within `EPISODE` epochs from its first decision after the start of the fault."""
    after = rows[rows.t_s >= faults.start - SAME_TIME]
    since = after.t_s - after.groupby("run_number").t_s.transform("min")
    return after[since < (EPISODE - 0.5) * interval]


def _found(
    rows: pd.DataFrame, nominal: pd.DataFrame, faults: AppliedFaults, runs: int
) -> list[tuple[str, int, float, float]]:
    """Return outcome, count, median time and time by linear covariance: detected, isolated, missed."""
    first, nominal_first = (each.groupby("run_number").t_s.min() - faults.start for each in (rows, nominal))
    by_run, nominal_outcome = (
        outcomes(each, faults) if len(each) else pd.Series(dtype=object) for each in (rows, nominal)
    )
    isolation = [
        (
            name,
            int((by_run == name).sum()),
            float(first.loc[by_run.index[by_run == name]].median()),
            float(nominal_first.loc[nominal_outcome.index[nominal_outcome == name]].median()),
        )
        for name in (ISOLATED, IN_PART, WRONG)
    ]
    detected = ("detected", len(first), float(first.median()), float(nominal_first.median()))
    return [detected, *isolation, ("missed", runs - len(first), np.nan, np.nan)]


def _recovered(tables: Tables, case: str, faults: AppliedFaults) -> list[tuple[str, int, float, float]]:
    """Return the number and median time of runs that recover; empty without a case without the fault, or events."""
    other = without_fault(tables, case)
    end = flight_events(tables, case).set_index("event").t_s.get(final_event(tables, case), -np.inf)
    if not other or end <= faults.start:
        return []
    both = [
        converged(tables, case, quantity, (faults.start, float(end)), f"{TIMES:g} rms", other)
        for quantity in ("position", "velocity")
    ]
    known = [quantity for quantity in both if quantity is not None]
    if len(known) < 2:
        return []
    times = np.max([quantity.times for quantity in known], axis=0)
    done = np.all([quantity.done for quantity in known], axis=0)
    median = float(np.median(times[done])) if done.any() else np.nan
    has_recovered = all(quantity.expected_done for quantity in known)
    by_covariance = max(quantity.expected for quantity in known) if has_recovered else np.nan
    return [("recovered", int(done.sum()), median, by_covariance)]


def without_fault(tables: Tables, case: str) -> str:
    """Return the case that differs in one axis only and has no fault; empty if there is none."""
    of_case = tables.levels[case]
    for other, levels in tables.levels.items():
        differing = [axis for axis, level in levels.items() if of_case.get(axis) != level]
        if len(differing) == 1 and pick(tables.events, case=other, kind="fault").empty:
            return other
    return ""


def decisions(tables: Tables) -> pd.DataFrame:
    """Return the decisions of the tests for faults over time, with the number of runs that make each decision.

    isolated_element: channel, clock, inertial, unit (one of several IMUs) or separation. satellites: satellites that
    are excluded or named by an alarm of solution separation, or the IMU. run_count, run_ratio: number and fraction of
    runs with this decision at the epoch. lincov: whether linear covariance makes it too.
    """
    keys = ["case", "t_s", "isolated_element", "satellites"]
    if tables.integrity.empty and tables.nominal_integrity.empty:
        return pd.DataFrame(columns=[*keys, "run_count", "run_ratio", "lincov"])
    counted, nominal = (
        _by_epoch(table).groupby(keys, sort=False).size() for table in (tables.integrity, tables.nominal_integrity)
    )
    frame = pd.DataFrame({"run_count": counted, "lincov": nominal}).fillna(0)
    frame = frame.assign(lincov=frame.lincov > 0)
    frame = frame.reset_index().sort_values(["t_s", "isolated_element", "satellites"], kind="stable")
    runs = frame.case.map(tables.cases.set_index("case").run_count)
    frame = frame.assign(run_count=frame.run_count.astype(int), run_ratio=frame.run_count / runs.where(runs > 0))
    order = {case: place for place, case in enumerate(tables.labels)}
    frame = frame.sort_values("case", key=lambda case: case.map(order), kind="stable").reset_index(drop=True)
    return frame.assign(case=frame.case.map(tables.labels), lincov=frame.lincov.astype(bool))


def _by_epoch(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row per run and epoch with a decision, with its satellites as one text."""
    names = rows.channel.fillna("")
    named = rows.assign(satellites=names.where(rows.isolated_element == "unit", names.str.split(" ").str[0].fillna("")))
    named = named.drop_duplicates(["case", "run_number", "t_s", "isolated_element", "satellites"])
    named = named.sort_values(["case", "run_number", "t_s", "satellites"], kind="stable")
    keys = ["case", "run_number", "t_s", "isolated_element"]
    return named.groupby(keys, sort=False).satellites.agg(lambda names: " ".join(filter(None, names))).reset_index()


def fault_test_errors(tables: Tables) -> pd.DataFrame:
    """Return the benefit of the tests for faults: RMS errors at the last event with the tests and without.

    The case without tests differs in one axis only. The errors are those of the runs, or of linear covariance without
    runs.
    """
    rows, tested = [], tables.cases.set_index("case").integrity.eq(True)
    for case, label in tables.labels.items():
        other = _alike(tables, case, tested) if tested[case] else ""
        event = final_event(tables, case)
        for quantity in ("position", "velocity", "attitude") if other else ():
            unit, factor = tables.people[quantity, "3d"]
            without, with_tests = (_at_event(tables, each, event, quantity) * factor for each in (other, case))
            head = (label, applied_faults(tables, case).names, event, f"{quantity}_error", unit)
            rows.append((*head, without, with_tests, with_tests / without if without > 0.0 else np.nan))
    names = ["case", "fault", "event", "metric", "unit", "without", "with_tests", "ratio"]
    return pd.DataFrame(rows, columns=names)


def _alike(tables: Tables, case: str, tested: pd.Series) -> str:
    """Return the case without tests that differs in one axis only; empty if there is none."""
    of_case = tables.levels[case]
    for other, levels in tables.levels.items():
        if not tested[other] and sum(of_case.get(axis) != level for axis, level in levels.items()) == 1:
            same = applied_faults(tables, other)[:2] == applied_faults(tables, case)[:2]
            if same:
                return other
    return ""


def _at_event(tables: Tables, case: str, event: str, quantity: str) -> float:
    t = float(pick(tables.events, case=case, event=event).t_s.iloc[0])
    row = at_time(history_of(tables, case, quantity, "3d"), t)
    return float(row.rms_si) if row.run_count else math.hypot(row.lincov_true_si, row.lincov_mean_si)
