"""How a filter behaves: consistency with its errors and innovations, whiteness, and what its mode logic did."""

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import stats

from lvnav_trade.metrics.basics.probability import holm, mean_square_interval
from lvnav_trade.metrics.basics.select import NAVIGATION, flight_events, history_of, pick
from lvnav_trade.records import MODES, Floats
from lvnav_trade.store.read import Tables

ALPHA = 0.05
WHITE_ALPHA = 0.01
_LEAST_PAIRS = 100  # channels with fewer pairs say nothing: a satellite seen for a few epochs
# Times at which the modes of all runs are reported.
STEPS = 400
VERDICT_ALPHA = 0.01
CONSISTENT, OVERCONFIDENT, CONSERVATIVE, UNKNOWN = "consistent", "overconfident", "conservative", "unknown"
# Of sigma: a smaller departure is no finding, however many runs show it.
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
    """Return the mean normalised innovation squared of accepted rows over time, with 95 % bounds for that many rows.

    Columns: case, t_s, row_count, reject_count, raw_ratio (mean of the accepted rows), anis_ratio (the same over what a
    gate leaves of a matched filter's rows: 1 for a matched filter), low_ratio, high_ratio, expected_ratio (LinCov, with
    the same gate and correction), rejected_ratio (part of rows that the gate rejected), false_rejection_ratio (LinCov),
    inside. Epochs without a row are left out.
    """
    rows = tables.innovations
    rows = rows[(rows.row_count > 0) | (rows.lincov_row_count > 0)]
    gate = rows.case.map(tables.cases.set_index("case").gate_ratio).to_numpy(dtype=float)
    mean, variance = accepted_moments(gate)
    low, high = mean_square_interval(rows.row_count * 2.0 * mean**2 / variance, ALPHA)
    raw = rows.nis_sum_ratio / rows.row_count.where(rows.row_count > 0)
    spread = rows.expected_nis_ratio / rows.lincov_row_count.where(rows.lincov_row_count > 0)
    offered = rows.row_count + rows.reject_count
    return rows[["case", "t_s", "row_count", "reject_count"]].assign(
        case=rows.case.map(tables.labels),
        raw_ratio=raw,
        anis_ratio=raw / mean,
        low_ratio=low,
        high_ratio=high,
        expected_ratio=spread * accepted_moments(gate / np.sqrt(spread))[0] / mean,
        rejected_ratio=rows.reject_count / offered.where(offered > 0),
        false_rejection_ratio=rows.false_rejection_ratio,
        inside=(raw / mean).between(low, high),
    )


def accepted_moments(gate: ArrayLike) -> tuple[Floats, Floats]:
    """Return mean and variance of the square of a standard normal that lies within +- gate (NaN: no gate): 1 and 2.

    With F(x; n) the chi-square distribution: the mean is F(g^2; 3) / F(g^2; 1), the mean square 3 F(g^2; 5) / F(g^2;
    1). The filter's gate works row by row.
    """
    square = np.where(np.isnan(gate), np.inf, np.square(gate))
    inside = stats.chi2.cdf(square, 1)
    mean = stats.chi2.cdf(square, 3) / inside
    return mean, 3.0 * stats.chi2.cdf(square, 5) / inside - mean**2


def consistency(tables: Tables) -> pd.DataFrame:
    """Return for each case and test (ANEES, ANIS) the time mean, what LinCov expects, and how much lies inside.

    Columns: case, test, mean_ratio, expected_ratio, inside_ratio (0.95 is expected of a matched filter), time_count.
    """
    found = []
    for test, rows, value in (("ANEES", nees(tables), "anees_ratio"), ("ANIS", nis(tables), "anis_ratio")):
        for case, group in rows.groupby("case", sort=False):
            inside = group.inside[group[value].notna()]
            part = inside.mean() if len(inside) else float("nan")
            found.append((case, test, group[value].mean(), group.expected_ratio.mean(), part, len(inside)))
    return pd.DataFrame(found, columns=["case", "test", "mean_ratio", "expected_ratio", "inside_ratio", "time_count"])


def filter_verdicts(tables: Tables) -> pd.DataFrame:
    """Return for each case whether the filter's covariance matches its errors.

    Columns: case; verdict: "consistent", "overconfident", "conservative", or "unknown" without a finite NEES;
    sigma_ratio: true over assumed sigma, the root of nees_ratio; nees_ratio: NEES per degree of freedom, mean over the
    run; low_ratio, high_ratio: its bounds; moment: "run", or the event that a requirement names where the mean over the
    run is consistent and the value there is not; by: "runs", or "LinCov" without runs; largest_ratio, largest_s: the
    largest NEES per degree of freedom of the history and its time.

    The bounds are the 99 % chi-square bounds of the runs at one time, since the times of a run are correlated, and
    never closer to one than `TOLERANCE` of sigma. Without runs the expectation by linear covariance is compared with
    that tolerance alone. Where the covariance of all states has no inverse, the mean over the nine navigation errors of
    their squares over the filter's variances takes the place of NEES.
    """
    known = nees(tables).groupby("case", sort=False)
    rows = []
    for case, label in tables.labels.items():
        mine = _nees_over_time(tables, case, known.get_group(label))
        rows.append((label, *_filter_verdict(tables, case, mine)))
    return pd.DataFrame(rows, columns=FILTER_VERDICTS)


def _nees_over_time(tables: Tables, case: str, known: pd.DataFrame) -> pd.DataFrame:
    """Return t_s, value (NEES per degree of freedom), low, high and by of a case over time, without missing values."""
    has_runs = bool((known.run_count > 0).any())
    value = known.anees_ratio if has_runs else known.expected_ratio
    states = pick(tables.consistency, case=case).nees_dof_count.to_numpy()
    low, high = mean_square_interval(known.run_count.to_numpy() * states, VERDICT_ALPHA)
    frame = known[["t_s"]].assign(value=value, low=low, high=high)
    if not np.isfinite(value).any():
        frame = _of_navigation(tables, case, has_runs)
    return frame[np.isfinite(frame.value)].assign(by="runs" if has_runs else "LinCov")


def _of_navigation(tables: Tables, case: str, has_runs: bool) -> pd.DataFrame:
    """Return the same from the mean over the nine navigation errors of mean square over the filter's variance."""
    axes = [(quantity, axis) for quantity, axis in tables.people if quantity in NAVIGATION and axis != "3d"]
    series = [history_of(tables, case, *one) for one in axes]
    if has_runs:
        ratios = [(rows.rms_si / rows.filter_sigma_si).to_numpy() ** 2 for rows in series]
    else:
        squares = [(rows.lincov_true_si**2 + rows.lincov_mean_si**2).to_numpy() for rows in series]
        ratios = [one / rows.lincov_formal_si.to_numpy() ** 2 for one, rows in zip(squares, series, strict=True)]
    low, high = mean_square_interval(series[0].run_count * len(axes), VERDICT_ALPHA)
    return series[0][["t_s"]].assign(value=np.mean(ratios, axis=0), low=low, high=high)


def _filter_verdict(tables: Tables, case: str, rows: pd.DataFrame) -> tuple[str | float, ...]:
    """Return the values of `FILTER_VERDICTS` from the verdict on."""
    if rows.empty:
        return UNKNOWN, *[np.nan] * 4, "run", "", np.nan, np.nan
    least, most = (1.0 + TOLERANCE) ** -2, (1.0 + TOLERANCE) ** 2
    low = float(np.fmin(rows.low.mean(), least))
    high = float(np.fmax(rows.high.mean(), most))
    asked = {str(one.get("at")) for one in tables.campaign.get("requirements") or () if one.get("at")}
    found, at = float(rows.value.mean()), "run"
    for event in flight_events(tables, case).itertuples():
        if low <= found <= high and event.event in asked:
            found, at = float(rows.value.iloc[int(np.argmin(np.abs(rows.t_s.to_numpy() - event.t_s)))]), event.event
    if low <= found <= high:
        found, at = float(rows.value.mean()), "run"
    verdict = OVERCONFIDENT if found > high else CONSERVATIVE if found < low else CONSISTENT
    largest = rows.loc[rows.value.idxmax()]
    ends = (at, str(rows.by.iloc[0]), float(largest.value), float(largest.t_s))
    return verdict, float(np.sqrt(found)), found, low, high, *ends


def autocorrelation(tables: Tables) -> pd.DataFrame:
    """Return the autocorrelation of each channel: case, channel, lag_number, pair_count, autocorrelation_ratio."""
    rows = tables.whiteness
    mean = rows.product_sum_ratio / rows.pair_count.where(rows.pair_count > 0)
    zero = mean.where(rows.lag_number == 0).groupby([rows.case, rows.channel], sort=False).transform("max")
    found = rows[["case", "channel", "lag_number", "pair_count"]].assign(autocorrelation_ratio=mean / zero)
    return found.assign(case=found.case.map(tables.labels))


def whiteness(tables: Tables) -> pd.DataFrame:
    """Return one row per case and channel.

    Columns: case, channel, pair_count (least of the lags), largest_ratio (autocorrelation of largest size),
    largest_lag_number, portmanteau_ratio (sum of n r^2 over lags 1 to 10, chi-square with as many degrees of freedom
    for white innovations), p_ratio, p_holm_ratio (for all channels of the case together), white (at alpha 0.01).
    """
    found = []
    for (case, channel), group in autocorrelation(tables).groupby(["case", "channel"], sort=False):
        lags = group[group.lag_number > 0]
        pairs, r = lags.pair_count.to_numpy(), lags.autocorrelation_ratio.to_numpy()
        if lags.pair_count.min() < _LEAST_PAIRS or np.isnan(r).any():
            continue
        worst = int(np.argmax(np.abs(r)))
        statistic = float(np.sum(pairs * r**2))
        largest = (float(r[worst]), int(lags.lag_number.iloc[worst]))
        found.append((case, channel, int(pairs.min()), *largest, statistic, float(stats.chi2.sf(statistic, len(r)))))
    names = ["case", "channel", "pair_count", "largest_ratio", "largest_lag_number", "portmanteau_ratio", "p_ratio"]
    frame = pd.DataFrame(found, columns=names)
    adjusted = frame.groupby("case", sort=False).p_ratio.transform(holm) if len(frame) else frame.p_ratio
    return frame.assign(p_holm_ratio=adjusted, white=adjusted >= WHITE_ALPHA)


def logic(tables: Tables) -> pd.DataFrame:
    """Return how often each change happened and why: case, from_mode, to_mode, reason, change_count, run_count (runs
    with one at least), run_ratio, first_s, median_s, last_s. Empty where no filter has a logic.
    """
    found = (
        tables.logic.groupby(["case", "from_mode", "to_mode", "reason"], sort=False)
        .agg(
            change_count=("t_s", "size"),
            run_count=("run_number", "nunique"),
            first_s=("t_s", "min"),
            median_s=("t_s", "median"),
            last_s=("t_s", "max"),
        )
        .reset_index()
    )
    runs = found.case.map(tables.cases.set_index("case").run_count).astype(float)
    found.insert(6, "run_ratio", found.run_count.astype(float) / runs)
    return found.assign(case=found.case.map(tables.labels))


def _with_logic(tables: Tables) -> pd.DataFrame:
    return tables.cases[tables.cases.logic.eq(True)]


def modes(tables: Tables) -> pd.DataFrame:
    """Return the part of runs in each mode over time: case, t_s, filter_mode, run_ratio; of cases with a logic only."""
    found = [pd.DataFrame(columns=["case", "t_s", "filter_mode", "run_ratio"])]
    for case in _with_logic(tables).itertuples():
        rows, ends = pick(tables.logic, case=case.case), pick(tables.history, case=case.case).t_s
        t = np.linspace(float(ends.min()), float(ends.max()), STEPS)
        for mode in MODES:
            entered = np.searchsorted(np.sort(rows.t_s[rows.to_mode == mode]), t, side="right")
            left = np.searchsorted(np.sort(rows.t_s[rows.from_mode == mode]), t, side="right")
            part = (entered - left + (case.run_count if mode == MODES[0] else 0)) / max(1, case.run_count)
            found.append(
                pd.DataFrame({"case": tables.labels[case.case], "t_s": t, "filter_mode": mode, "run_ratio": part})
            )
    return pd.concat(found[1:] or found)


def stops(tables: Tables) -> pd.DataFrame:
    """Return for each case with a logic: run_count, started_ratio (runs that ever start), corrected_ratio (runs that
    ever correct), stop_count, restart_count, ended_ratio (runs that correct at the end of the flight).
    """
    rows = []
    for case in _with_logic(tables).itertuples():
        mine, runs = pick(tables.logic, case=case.case), max(1, int(case.run_count))
        last = mine.sort_values("t_s", kind="stable").groupby("run_number").to_mode.last()
        starts = pick(mine, to_mode="converging")
        started, corrected = (part.run_number.nunique() / runs for part in (starts, pick(mine, to_mode="aiding")))
        stopped, again = len(pick(mine, to_mode="stopped")), len(pick(starts, from_mode="stopped"))
        ended = float(last.isin(["aiding", "predicting"]).sum()) / runs
        rows.append((case.label, int(case.run_count), started, corrected, stopped, again, ended))
    columns = ["case", "run_count", "started_ratio", "corrected_ratio", "stop_count", "restart_count", "ended_ratio"]
    return pd.DataFrame(rows, columns=columns)
