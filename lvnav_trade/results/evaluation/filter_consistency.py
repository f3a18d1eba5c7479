"""Behaviour of a filter: consistency with its errors and innovations, whiteness, mode logic."""

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import stats

from lvnav_trade.quantities.records import MODES, Floats
from lvnav_trade.results.statistics.probability import holm, mean_square_interval
from lvnav_trade.results.statistics.select import NAVIGATION, at_time, flight_events, history_of, pick
from lvnav_trade.results.tables.read import Tables

ALPHA = 0.05
WHITE_ALPHA = 0.01
_LEAST_PAIRS = 100  # smallest number of pairs for a test; a satellite may be in view for a few epochs only
STEPS = 400  # number of times at which the modes of all runs are reported
VERDICT_ALPHA = 0.01
CONSISTENT, OVERCONFIDENT, CONSERVATIVE, UNKNOWN = "consistent", "overconfident", "conservative", "unknown"
_WHITENESS = ["case", "channel", "pair_count", "largest_ratio", "largest_lag_number", "portmanteau_ratio", "p_ratio"]
# Relative deviation of sigma up to which a filter counts as consistent, for any number of runs
TOLERANCE = 0.25
FILTER_VERDICTS = [
    "case",
    "verdict",
    "sigma_ratio",
    "nees_ratio",
    "low_ratio",
    "high_ratio",
    "moment",
    "by",
    "largest_ratio",
    "largest_s",
]


def nees(tables: Tables) -> pd.DataFrame:
    """Return the mean normalised estimation error squared per degree of freedom over time, with 95 % bounds.

    Columns: case, t_s, run_count, anees_ratio (1 for a matched filter), low_ratio, high_ratio, expected_ratio (LinCov),
    inside.
    """
    rows = tables.consistency
    low, high = mean_square_interval(rows.run_count * rows.nees_dof_count, ALPHA)
    mean = rows.nees_mean_ratio / rows.nees_dof_count
    return rows[["case", "t_s", "run_count"]].assign(
        case=rows.case.map(tables.labels),
        anees_ratio=mean,
        low_ratio=low,
        high_ratio=high,
        expected_ratio=rows.expected_nees_ratio / rows.nees_dof_count,
        inside=mean.between(low, high),
    )


def nis(tables: Tables) -> pd.DataFrame:
    """Return the mean normalised innovation squared of accepted measurements over time, with 95 % bounds.

    Columns: case, t_s, measurement_count, rejected_count, raw_ratio (mean of the accepted), anis_ratio (the same over
    its expectation for a matched filter with this gate), low_ratio, high_ratio, expected_ratio (LinCov, with the same
    gate and correction), rejected_ratio (fraction that the gate rejects), false_rejection_ratio (LinCov), inside.
    Epochs without a measurement are omitted.
    """
    rows = tables.innovations
    rows = rows[(rows.measurement_count > 0) | (rows.lincov_measurement_count > 0)]
    gate = rows.case.map(tables.cases.set_index("case").gate_ratio).to_numpy(dtype=float)
    mean, variance = accepted_moments(gate)
    low, high = mean_square_interval(rows.measurement_count * 2.0 * mean**2 / variance, ALPHA)
    raw = rows.nis_sum_ratio / rows.measurement_count.where(rows.measurement_count > 0)
    expected_nis = rows.expected_nis_ratio / rows.lincov_measurement_count.where(rows.lincov_measurement_count > 0)
    expected_mean, _ = accepted_moments(gate / np.sqrt(expected_nis))  # of the innovations that pass the same gate
    total_count = rows.measurement_count + rows.rejected_count
    return rows[["case", "t_s", "measurement_count", "rejected_count"]].assign(
        case=rows.case.map(tables.labels),
        raw_ratio=raw,
        anis_ratio=raw / mean,
        low_ratio=low,
        high_ratio=high,
        expected_ratio=expected_nis * expected_mean / mean,
        rejected_ratio=rows.rejected_count / total_count.where(total_count > 0),
        false_rejection_ratio=rows.false_rejection_ratio,
        inside=(raw / mean).between(low, high),
    )


def accepted_moments(gate: ArrayLike) -> tuple[Floats, Floats]:
    """Return mean and variance of the square of a standard normal that lies within +- gate (NaN: no gate): 1 and 2.

    With F(x; n) the chi-square distribution: the mean is F(g^2; 3) / F(g^2; 1), the mean square 3 F(g^2; 5) / F(g^2;
    1). The gate of the filter tests each scalar measurement.
    """
    square = np.where(np.isnan(gate), np.inf, np.square(gate))
    inside = stats.chi2.cdf(square, 1)
    mean = stats.chi2.cdf(square, 3) / inside
    mean_square = 3.0 * stats.chi2.cdf(square, 5) / inside
    return mean, mean_square - mean**2


def consistency(tables: Tables) -> pd.DataFrame:
    """Return for each case and test (ANEES, ANIS) the time mean, the expectation by LinCov, and the fraction inside.

    Columns: case, test, mean_ratio, expected_ratio, inside_ratio (0.95 is expected of a matched filter), time_count.
    """
    rows = []
    for test, frame, column in (("ANEES", nees(tables), "anees_ratio"), ("ANIS", nis(tables), "anis_ratio")):
        for case, over_time in frame.groupby("case", sort=False):
            inside = over_time.inside[over_time[column].notna()]
            row = {
                "case": case,
                "test": test,
                "mean_ratio": over_time[column].mean(),
                "expected_ratio": over_time.expected_ratio.mean(),
                "inside_ratio": inside.mean() if len(inside) else float("nan"),
                "time_count": len(inside),
            }
            rows.append(row)
    return pd.DataFrame(rows, columns=["case", "test", "mean_ratio", "expected_ratio", "inside_ratio", "time_count"])


def filter_verdicts(tables: Tables) -> pd.DataFrame:
    """Return for each case whether the filter's covariance matches its errors.

    verdict: "consistent", "overconfident", "conservative", or "unknown" without a finite NEES. nees_ratio: NEES per
    degree of freedom, mean over the run; low_ratio, high_ratio: its limits. sigma_ratio: true over assumed sigma, the
    square root of nees_ratio. moment: "run", or the event of a requirement at which NEES is outside its limits although
    the mean over the run is inside. by: "runs", or "LinCov" without runs. largest_ratio, largest_s: largest NEES per
    degree of freedom and its time.

    The limits are the 99 % chi-square limits for the runs at one time, since the times of a run are correlated, and
    they include the relative deviation `TOLERANCE` of sigma. Without runs the expectation by linear covariance is
    compared with this tolerance alone. If the covariance of all states is singular, NEES is replaced by the mean over
    the nine navigation errors of the squared error over the formal variance.
    """
    over_time = nees(tables).groupby("case", sort=False)
    rows = []
    for case, label in tables.labels.items():
        ratios = _nees_over_time(tables, case, over_time.get_group(label))
        rows.append({"case": label, **_filter_verdict(tables, case, ratios)})
    return pd.DataFrame(rows, columns=FILTER_VERDICTS)


def _nees_over_time(tables: Tables, case: str, rows: pd.DataFrame) -> pd.DataFrame:
    """Return NEES per degree of freedom of a case over time, without missing values.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    rows : pandas.DataFrame
        Rows of the case in `nees`.

    Returns
    -------
    pandas.DataFrame
        t_s; value; low and high, the limits of a consistent filter; by, the method.
    """
    has_runs = bool((rows.run_count > 0).any())
    value = rows.anees_ratio if has_runs else rows.expected_ratio
    if np.isfinite(value).any():
        states = pick(tables.consistency, case=case).nees_dof_count.to_numpy()
        low, high = mean_square_interval(rows.run_count.to_numpy() * states, VERDICT_ALPHA)
        frame = rows[["t_s"]].assign(value=value, low=low, high=high)
    else:
        frame = _navigation_nees(tables, case, has_runs)
    return frame[np.isfinite(frame.value)].assign(by="runs" if has_runs else "LinCov")


def _navigation_nees(tables: Tables, case: str, has_runs: bool) -> pd.DataFrame:
    """Return t_s, value, low and high from the mean over the nine navigation errors of mean square over variance."""
    errors = [(quantity, axis) for quantity, axis in tables.display_units if quantity in NAVIGATION and axis != "3d"]
    histories = [history_of(tables, case, quantity, axis) for quantity, axis in errors]
    ratios = []
    for history in histories:
        if has_runs:
            rms_ratio = history.rms_si / history.filter_sigma_si
            ratios.append(rms_ratio.to_numpy() ** 2)
        else:
            mean_square = (history.lincov_true_si**2 + history.lincov_mean_si**2).to_numpy()
            formal_variance = history.lincov_formal_si.to_numpy() ** 2
            ratios.append(mean_square / formal_variance)
    first = histories[0]
    freedom = first.run_count * len(errors)
    low, high = mean_square_interval(freedom, VERDICT_ALPHA)
    nees = np.mean(ratios, axis=0)
    return first[["t_s"]].assign(value=nees, low=low, high=high)


def _filter_verdict(tables: Tables, case: str, rows: pd.DataFrame) -> dict[str, Any]:
    """Return the values of `FILTER_VERDICTS` from the verdict on, from `_nees_over_time`.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    rows : pandas.DataFrame
        NEES per degree of freedom over time.
    """
    if rows.empty:
        return dict.fromkeys(FILTER_VERDICTS[1:], np.nan) | {"verdict": UNKNOWN, "moment": "run", "by": ""}
    low = float(np.fmin(rows.low.mean(), (1.0 + TOLERANCE) ** -2))
    high = float(np.fmax(rows.high.mean(), (1.0 + TOLERANCE) ** 2))
    nees_ratio = float(rows.value.mean())
    moment = "run"
    if low <= nees_ratio <= high:
        for event, ratio in _required_event_nees(tables, case, rows):
            if not low <= ratio <= high:
                nees_ratio = ratio
                moment = event
                break
    if nees_ratio > high:
        verdict = OVERCONFIDENT
    else:
        verdict = CONSERVATIVE if nees_ratio < low else CONSISTENT
    largest = rows.loc[rows.value.idxmax()]
    return {
        "verdict": verdict,
        "sigma_ratio": float(np.sqrt(nees_ratio)),
        "nees_ratio": nees_ratio,
        "low_ratio": low,
        "high_ratio": high,
        "moment": moment,
        "by": str(rows.by.iloc[0]),
        "largest_ratio": float(largest.value),
        "largest_s": float(largest.t_s),
    }


def _required_event_nees(tables: Tables, case: str, rows: pd.DataFrame) -> list[tuple[str, float]]:
    """Return the events of requirements in order of time, with NEES per degree of freedom."""
    requirements = tables.campaign.get("requirements") or ()
    required_events = {str(requirement["at"]) for requirement in requirements if requirement.get("at")}
    event_nees = []
    for event in flight_events(tables, case).itertuples():
        if event.event in required_events:
            nees = float(at_time(rows, event.t_s).value)
            event_nees.append((event.event, nees))
    return event_nees


def autocorrelation(tables: Tables) -> pd.DataFrame:
    """Return the autocorrelation of each channel: case, channel, lag_number, pair_count, autocorrelation_ratio."""
    rows = tables.whiteness
    mean = rows.product_sum_ratio / rows.pair_count.where(rows.pair_count > 0)
    mean_at_zero = mean.where(rows.lag_number == 0)
    mean_square = mean_at_zero.groupby([rows.case, rows.channel], sort=False).transform("max")
    return rows[["case", "channel", "lag_number", "pair_count"]].assign(
        case=rows.case.map(tables.labels),
        autocorrelation_ratio=mean / mean_square,
    )


def whiteness(tables: Tables) -> pd.DataFrame:
    """Return the test of whiteness of the innovations, one row per case and channel.

    pair_count: smallest number of pairs over the lags. largest_ratio, largest_lag_number: autocorrelation of largest
    magnitude and its lag. portmanteau_ratio: sum of n r^2 over lags 1 to 10, chi-square with 10 degrees of freedom for
    white innovations. p_ratio: p-value; p_holm_ratio: adjusted for all channels of the case. white: whether the latter
    is at least 0.01.
    """
    rows = []
    for (case, channel), group in autocorrelation(tables).groupby(["case", "channel"], sort=False):
        lags = group[group.lag_number > 0]
        pairs = lags.pair_count.to_numpy()
        r = lags.autocorrelation_ratio.to_numpy()
        if lags.pair_count.min() < _LEAST_PAIRS or np.isnan(r).any():
            continue
        worst = int(np.argmax(np.abs(r)))
        statistic = float(np.sum(pairs * r**2))
        row = {
            "case": case,
            "channel": channel,
            "pair_count": int(pairs.min()),
            "largest_ratio": float(r[worst]),
            "largest_lag_number": int(lags.lag_number.iloc[worst]),
            "portmanteau_ratio": statistic,
            "p_ratio": float(stats.chi2.sf(statistic, len(r))),
        }
        rows.append(row)
    frame = pd.DataFrame(rows, columns=_WHITENESS)
    if len(frame):
        adjusted_p = frame.groupby("case", sort=False).p_ratio.transform(holm)
    else:
        adjusted_p = frame.p_ratio
    return frame.assign(p_holm_ratio=adjusted_p, white=adjusted_p >= WHITE_ALPHA)


def mode_transitions(tables: Tables) -> pd.DataFrame:
    """Return the changes of the filter's mode with their reasons: number of changes and of runs, and their times.

    change_count: number of changes. run_count, run_ratio: number and fraction of runs with at least one. first_s,
    median_s, last_s: first, median and last time. The table is empty without a mode logic.
    """
    groups = tables.mode_transitions.groupby(["case", "from_mode", "to_mode", "reason"], sort=False)
    changes = groups.agg(
        change_count=("t_s", "size"),
        run_count=("run_number", "nunique"),
        first_s=("t_s", "min"),
        median_s=("t_s", "median"),
        last_s=("t_s", "max"),
    ).reset_index()
    runs = changes.case.map(tables.cases.set_index("case").run_count).astype(float)
    changes.insert(6, "run_ratio", changes.run_count.astype(float) / runs)
    return changes.assign(case=changes.case.map(tables.labels))


def _cases_using_logic(tables: Tables) -> pd.DataFrame:
    return tables.cases[tables.cases.logic.eq(True)]


def modes(tables: Tables) -> pd.DataFrame:
    """Return the fraction of runs in each mode over time, for cases with a mode logic."""
    frames = []
    for case in _cases_using_logic(tables).itertuples():
        changes = pick(tables.mode_transitions, case=case.case)
        times = pick(tables.history, case=case.case).t_s
        t = np.linspace(float(times.min()), float(times.max()), STEPS)
        for mode in MODES:
            entry_times = np.sort(changes.t_s[changes.to_mode == mode])
            exit_times = np.sort(changes.t_s[changes.from_mode == mode])
            entry_count = np.searchsorted(entry_times, t, side="right")
            exit_count = np.searchsorted(exit_times, t, side="right")
            initial = case.run_count if mode == MODES[0] else 0  # all runs begin in the first mode
            mode_ratio = (entry_count - exit_count + initial) / max(1, case.run_count)
            frames.append(
                pd.DataFrame({"case": tables.labels[case.case], "t_s": t, "filter_mode": mode, "run_ratio": mode_ratio})
            )
    if not frames:
        return pd.DataFrame(columns=["case", "t_s", "filter_mode", "run_ratio"])
    return pd.concat(frames)


def stops(tables: Tables) -> pd.DataFrame:
    """Return starts and stops of the filter for each case with a mode logic.

    started_ratio, corrected_ratio: fraction of runs in which the filter ever starts, and ever corrects the outputs.
    stop_count, restart_count: number of stops and restarts. ended_ratio: fraction of runs that correct at the end.
    """
    rows = []
    for case in _cases_using_logic(tables).itertuples():
        changes = pick(tables.mode_transitions, case=case.case)
        starts = pick(changes, to_mode="converging")
        corrections = pick(changes, to_mode="aiding")
        last_mode = changes.sort_values("t_s", kind="stable").groupby("run_number").to_mode.last()
        runs = max(1, int(case.run_count))
        row = {
            "case": case.label,
            "run_count": int(case.run_count),
            "started_ratio": starts.run_number.nunique() / runs,
            "corrected_ratio": corrections.run_number.nunique() / runs,
            "stop_count": len(pick(changes, to_mode="stopped")),
            "restart_count": len(pick(starts, from_mode="stopped")),
            "ended_ratio": float(last_mode.isin(["aiding", "predicting"]).sum()) / runs,
        }
        rows.append(row)
    columns = ["case", "run_count", "started_ratio", "corrected_ratio", "stop_count", "restart_count", "ended_ratio"]
    return pd.DataFrame(rows, columns=columns)
