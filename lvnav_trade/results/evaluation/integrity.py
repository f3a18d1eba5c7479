"""Results of tests for faults: false alarms, detection, isolation, recovery, with exact intervals."""

import math
from typing import NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.evaluation.convergence import convergence_times
from lvnav_trade.results.statistics.probability import success_bounds
from lvnav_trade.results.statistics.select import (
    SAME_TIME,
    at_time,
    cache_result,
    final_event,
    flight_events,
    history_of,
    pick,
)
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


def expected_element(fault: str) -> str:
    """Return the element that a filter should isolate for a fault (named as in `events`): channel, clock or inertial.

    It is empty if no test of ranges can detect the fault.
    """
    name = fault.split()[0]
    if name in _CLOCK:
        return "clock"
    if name in _CHANNEL:
        return "channel"
    return "inertial" if name.startswith(_UNIT) else ""


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
    names = ", ".join(faults.event)
    start = float(faults.t_s.iloc[0])
    kinds = frozenset(filter(None, map(expected_element, faults.event)))
    satellite_names = " ".join(faults.satellites.fillna(""))
    satellites = frozenset(satellite_names.split())
    return AppliedFaults(names, start, kinds, satellites)


def outcomes(decisions: pd.DataFrame, faults: AppliedFaults) -> pd.Series:
    """Return the outcome of the decisions of each run, by number of the run.

    Isolated: all faults and no others are named, and all affected satellites and no others are excluded. Wrong
    isolation: another fault is named, or a healthy satellite excluded. Isolated in part: neither.

    Parameters
    ----------
    decisions : pandas.DataFrame
        Rows of the table `integrity` of some runs.
    faults : AppliedFaults
        Faults of the case.
    """
    return decisions.groupby("run_number").apply(_outcome, faults, include_groups=False)


def _outcome(rows: pd.DataFrame, faults: AppliedFaults) -> str:
    # excluding one of several IMUs isolates the inertial fault; an alarm of solution separation names a satellite
    kinds = set(rows.isolated_element.replace({"unit": "inertial", "separation": "channel"}))
    channels = rows.channel[rows.isolated_element != "unit"].dropna()
    satellites = {name.split()[0] for name in channels if name}
    satellites_are_known = "channel" not in faults.kinds or bool(faults.satellites)
    has_excluded_healthy = satellites_are_known and bool(satellites - faults.satellites)
    if kinds - faults.kinds or has_excluded_healthy:
        return WRONG
    if kinds == faults.kinds and faults.satellites <= satellites:
        return ISOLATED
    return IN_PART


def share(count: int, runs: int) -> tuple[float, float, float]:
    """Return a fraction of runs and its 95 % interval (Clopper and Pearson).

    Parameters
    ----------
    count, runs : int
        Number of runs with an outcome, and number of all runs.

    Returns
    -------
    float, float, float
        Fraction, lower and upper bound.
    """
    low, high = success_bounds(runs, runs - count, CONFIDENCE)
    return count / runs, low, high


def rate(tables: Tables, case: str, metric: str, phase_times: tuple[float, float]) -> tuple[Floats, float]:
    """Return the runs with the outcome that a rate counts, from the decisions between two times (s).

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    metric : str
        false_alarm_rate or detection_rate (any decision), isolation_rate, wrong_isolation_rate.
    phase_times : (float, float)
        First and last time (s).

    Returns
    -------
    (n_run,) array, float
        1 for each run with the outcome, else 0; the same for linear covariance, which decides on the mean.
    """
    faults = applied_faults(tables, case)
    first = phase_times[0] - SAME_TIME
    last = phase_times[1] + SAME_TIME
    rows = pick(tables.integrity, case=case)
    rows = rows[rows.t_s.between(first, last)]
    counted_runs = _counted_runs(rows, faults, metric)
    nominal_rows = pick(tables.nominal_integrity, case=case)
    nominal_rows = nominal_rows[nominal_rows.t_s.between(first, last)]
    nominal_runs = _counted_runs(nominal_rows, faults, metric)
    runs = np.sort(pick(tables.runs, case=case).run_number.unique())
    has_outcome = np.isin(runs, list(counted_runs))
    return has_outcome.astype(float), float(len(nominal_runs) > 0)


def _counted_runs(rows: pd.DataFrame, faults: AppliedFaults, metric: str) -> pd.Index:
    """Return the numbers of the runs with the outcome that a rate counts.

    Parameters
    ----------
    rows : pandas.DataFrame
        Rows of the table `integrity`.
    faults : AppliedFaults
        Faults of the case.
    metric : str
        Name of the rate, such as isolation_rate.
    """
    if rows.empty or metric in ("false_alarm_rate", "detection_rate"):
        return pd.Index(rows.run_number.unique())
    outcome = outcomes(rows, faults)
    return outcome.index[outcome == (ISOLATED if metric == "isolation_rate" else WRONG)]


@cache_result
def integrity(tables: Tables) -> pd.DataFrame:
    """Return the outcomes of the tests for faults as fractions of the runs, with exact 95 % intervals.

    median_s: median time of the outcome after the start of the fault. lincov_s: this time by linear covariance, which
    decides on the mean.

    Outcomes: false alarm: a decision before the fault, or in a case without fault. detected. isolated, isolated in
    part, wrong isolation: by the decisions within five epochs from the first, see `outcomes`. missed. recovered:
    position and velocity are below three times the RMS error of the case without the fault at every later event, if the
    campaign has that case.
    """
    rows = []
    tested_cases = tables.cases[tables.cases.integrity.eq(True) & (tables.cases.run_count > 0)]
    for case in tested_cases.itertuples():
        faults = applied_faults(tables, case.case)
        runs = int(case.run_count)
        alarms = pick(tables.integrity, case=case.case)
        false_alarms = alarms[alarms.t_s < faults.start - SAME_TIME].run_number.nunique()
        counts = [_OutcomeCount("false alarm", false_alarms, np.nan, np.nan)]
        if faults.names:
            counts += _fault_outcomes(tables, case.case, faults, runs)
            counts += _recovered_runs(tables, case.case, faults)
        for outcome in counts:
            ratio, low, high = share(outcome.runs, runs)
            row = {
                "case": case.label,
                "fault": faults.names,
                "outcome": outcome.name,
                "run_count": runs,
                "outcome_count": outcome.runs,
                "share_ratio": ratio,
                "low_ratio": low,
                "high_ratio": high,
                "median_s": outcome.median,
                "lincov_s": outcome.lincov,
            }
            rows.append(row)
    return pd.DataFrame(rows, columns=_COLUMNS)


class _OutcomeCount(NamedTuple):
    """Number of runs with an outcome; times in s after the start of the fault."""

    name: str  # outcome
    runs: int  # number of runs
    median: float  # median time of the outcome
    lincov: float  # its time by linear covariance


def _epoch_interval(tables: Tables, case: str) -> float:
    """Return the median interval (s) between the epochs of a case."""
    t = np.unique(pick(tables.innovations, case=case).t_s)
    if len(t) > 1:
        return float(np.median(np.diff(t)))
    return 1.0


def _episodes(rows: pd.DataFrame, faults: AppliedFaults, interval: float) -> pd.DataFrame:
    """Return the decisions of each run in its first epochs with a decision after the start of the fault.

    Parameters
    ----------
    rows : pandas.DataFrame
        Rows of the table `integrity`.
    faults : AppliedFaults
        Faults of the case.
    interval : float
        Interval between epochs (s); the decisions within `EPISODE` epochs are returned.
    """
    fault_rows = rows[rows.t_s >= faults.start - SAME_TIME]
    elapsed_time = fault_rows.t_s - fault_rows.groupby("run_number").t_s.transform("min")
    return fault_rows[elapsed_time < (EPISODE - 0.5) * interval]


def _fault_outcomes(tables: Tables, case: str, faults: AppliedFaults, runs: int) -> list[_OutcomeCount]:
    """Return the counts of the outcomes detected, isolated (also in part, or wrongly) and missed."""
    interval = _epoch_interval(tables, case)
    case_decisions = pick(tables.integrity, case=case)
    rows = _episodes(case_decisions, faults, interval)
    nominal_decisions = pick(tables.nominal_integrity, case=case)
    nominal_rows = _episodes(nominal_decisions, faults, interval)
    first_decision = rows.groupby("run_number").t_s.min()
    time = first_decision - faults.start
    nominal_first_decision = nominal_rows.groupby("run_number").t_s.min()
    nominal_time = nominal_first_decision - faults.start
    outcome = outcomes(rows, faults) if len(rows) else pd.Series(dtype=object)
    nominal_outcome = outcomes(nominal_rows, faults) if len(nominal_rows) else pd.Series(dtype=object)
    counts = [_OutcomeCount("detected", len(time), float(time.median()), float(nominal_time.median()))]
    for name in (ISOLATED, IN_PART, WRONG):
        run_numbers = outcome.index[outcome == name]
        nominal_numbers = nominal_outcome.index[nominal_outcome == name]
        median = float(time.loc[run_numbers].median())
        nominal_median = float(nominal_time.loc[nominal_numbers].median())
        counts.append(_OutcomeCount(name, len(run_numbers), median, nominal_median))
    counts.append(_OutcomeCount("missed", runs - len(time), np.nan, np.nan))
    return counts


def _recovered_runs(tables: Tables, case: str, faults: AppliedFaults) -> list[_OutcomeCount]:
    """Return the number and median time of runs that recover; empty without a case without the fault, or events."""
    faultless = without_fault(tables, case)
    end = flight_events(tables, case).set_index("event").t_s.get(final_event(tables, case), -np.inf)
    if not faultless or end <= faults.start:
        return []
    phase_times = (faults.start, float(end))
    limit = f"{TIMES:g} rms"
    position = convergence_times(tables, case, "position", phase_times, limit, faultless)
    velocity = convergence_times(tables, case, "velocity", phase_times, limit, faultless)
    if position is None or velocity is None:
        return []
    times = np.maximum(position.times, velocity.times)
    is_recovered = position.has_converged & velocity.has_converged
    has_lincov_recovered = position.has_lincov_converged and velocity.has_lincov_converged
    return [
        _OutcomeCount(
            name="recovered",
            runs=int(is_recovered.sum()),
            median=float(np.median(times[is_recovered])) if is_recovered.any() else np.nan,
            lincov=max(position.lincov_time, velocity.lincov_time) if has_lincov_recovered else np.nan,
        )
    ]


def without_fault(tables: Tables, case: str) -> str:
    """Return the case that differs in one axis only and has no fault; empty if there is none."""
    for candidate in tables.levels:
        if _differs_in_one_axis(tables, case, candidate) and pick(tables.events, case=candidate, kind="fault").empty:
            return candidate
    return ""


def _differs_in_one_axis(tables: Tables, case: str, candidate: str) -> bool:
    """Whether two cases have different levels of one axis only."""
    levels = tables.levels[case]
    candidate_levels = tables.levels[candidate]
    return sum(levels.get(axis) != level for axis, level in candidate_levels.items()) == 1


def decisions(tables: Tables) -> pd.DataFrame:
    """Return the decisions of the tests for faults over time, with the number of runs that make each decision.

    isolated_element: channel, clock, inertial, unit (one of several IMUs) or separation. satellites: satellites that
    are excluded or named by an alarm of solution separation, or the IMU. run_count, run_ratio: number and fraction of
    runs with this decision at the epoch. lincov: whether linear covariance makes it too.
    """
    keys = ["case", "t_s", "isolated_element", "satellites"]
    if tables.integrity.empty and tables.nominal_integrity.empty:
        return pd.DataFrame(columns=[*keys, "run_count", "run_ratio", "lincov"])
    run_decisions = _epoch_decisions(tables.integrity)
    counts = run_decisions.groupby(keys, sort=False).size()
    nominal_decisions = _epoch_decisions(tables.nominal_integrity)
    nominal_counts = nominal_decisions.groupby(keys, sort=False).size()
    frame = pd.DataFrame({"run_count": counts, "lincov": nominal_counts}).fillna(0)
    frame = frame.assign(lincov=frame.lincov > 0)
    frame = frame.reset_index()
    frame = frame.sort_values(["t_s", "isolated_element", "satellites"], kind="stable")
    runs_by_case = tables.cases.set_index("case").run_count
    runs = frame.case.map(runs_by_case)
    run_ratio = frame.run_count / runs.where(runs > 0)
    frame = frame.assign(run_count=frame.run_count.astype(int), run_ratio=run_ratio)
    order = {case: number for number, case in enumerate(tables.labels)}
    frame = frame.sort_values("case", key=lambda case: case.map(order), kind="stable")
    frame = frame.reset_index(drop=True)
    return frame.assign(case=frame.case.map(tables.labels), lincov=frame.lincov.astype(bool))


def _epoch_decisions(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row per run and epoch with a decision, with its satellites as one text."""
    channel = rows.channel.fillna("")
    satellite = channel.str.split(" ").str[0].fillna("")
    satellite_or_imu = channel.where(rows.isolated_element == "unit", satellite)
    rows = rows.assign(satellites=satellite_or_imu)
    rows = rows.drop_duplicates(["case", "run_number", "t_s", "isolated_element", "satellites"])
    rows = rows.sort_values(["case", "run_number", "t_s", "satellites"], kind="stable")
    decisions_of_run = rows.groupby(["case", "run_number", "t_s", "isolated_element"], sort=False)
    return decisions_of_run.satellites.agg(lambda names: " ".join(filter(None, names))).reset_index()


def fault_test_errors(tables: Tables) -> pd.DataFrame:
    """Return the benefit of the tests for faults: RMS errors at the last event with the tests and without.

    The case without tests differs in one axis only. The errors are those of the runs, or of linear covariance without
    runs.
    """
    rows = []
    has_tests = tables.cases.set_index("case").integrity.eq(True)
    for case, label in tables.labels.items():
        untested_case = _untested_case(tables, case, has_tests) if has_tests[case] else ""
        if not untested_case:
            continue
        event = final_event(tables, case)
        for quantity in ("position", "velocity", "attitude"):
            unit, factor = tables.display_units[quantity, "3d"]
            untested_rms = _event_rms(tables, untested_case, event, quantity) * factor
            tested_rms = _event_rms(tables, case, event, quantity) * factor
            row = {
                "case": label,
                "fault": applied_faults(tables, case).names,
                "event": event,
                "metric": f"{quantity}_error",
                "unit": unit,
                "without": untested_rms,
                "with_tests": tested_rms,
                "ratio": tested_rms / untested_rms if untested_rms > 0.0 else np.nan,
            }
            rows.append(row)
    names = ["case", "fault", "event", "metric", "unit", "without", "with_tests", "ratio"]
    return pd.DataFrame(rows, columns=names)


def _untested_case(tables: Tables, case: str, has_tests: pd.Series) -> str:
    """Return the case without tests and with the same faults that differs in one axis only; empty if there is none."""
    faults = applied_faults(tables, case)
    for candidate in tables.levels:
        if has_tests[candidate] or not _differs_in_one_axis(tables, case, candidate):
            continue
        candidate_faults = applied_faults(tables, candidate)
        if (candidate_faults.names, candidate_faults.start) == (faults.names, faults.start):
            return candidate
    return ""


def _event_rms(tables: Tables, case: str, event: str, quantity: str) -> float:
    """Return the RMS of the 3-D error (SI) at an event, of the runs or, without runs, by linear covariance."""
    t = float(pick(tables.events, case=case, event=event).t_s.iloc[0])
    row = at_time(history_of(tables, case, quantity, "3d"), t)
    if row.run_count:
        return float(row.rms_si)
    return math.hypot(row.lincov_true_si, row.lincov_mean_si)
