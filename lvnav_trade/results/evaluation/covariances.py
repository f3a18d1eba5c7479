"""Metrics of linear covariance: errors, range of validity, agreement with Monte Carlo, diagnostics."""

import math
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.statistics.probability import ratio_interval
from lvnav_trade.results.statistics.select import (
    NAVIGATION,
    SAME_TIME,
    cache_result,
    flight_events,
    history_columns,
    names_of_series,
    pick,
)
from lvnav_trade.results.tables.read import Tables

# Largest fraction of good measurements that a gate may reject if linear covariance is to describe the case
REJECTS_TOO_MUCH = 0.01
# rad; a larger attitude sigma at or before lift-off is beyond the small-angle approximation
LINEAR_ATTITUDE = math.radians(5.0)
# Accuracy attributed to linear covariance, relative to the expected RMS, for any number of runs
FIRST_ORDER = 0.01
# sigma; if the mean error is larger, it is nearly equal in all runs, and its second order is as large as the spread
LARGE_MEAN = 5.0
AGREEMENT = ["case", "event", "state", "unit", "monte_carlo", "lincov", "ratio", "low", "high", "agree"]
# Probability that any row of a case disagrees by chance, with both engines describing the same errors
ALPHA = 0.01
# Share of the variance below which a source counts as zero: it has fewer than six digits, which depend on the machine
LEAST_SHARE = 1e-9
# Fraction of the largest singular value below which a singular value is rounding error
NUMERICAL = 1e-10
NOT_APPLICABLE = "not applicable"
_BY_CASE = [
    "case", "verdict", "reason", "alpha_ratio", "tested_count", "outside_count", "state", "event",
    "ratio", "low", "high", "source", "share_ratio",
]  # fmt: skip
OBSERVED = [
    "case", "stretches", "states", "least_rank", "least_rank_with_information", "smallest_ratio",
    "position_against_bias_ratio", "weakest_direction",
]  # fmt: skip


def large_attitude_message(attitude: float, time_text: str = "") -> str:
    """Return the message on an attitude sigma (rad) that is not a small angle; `time_text` begins with a space."""
    size = math.degrees(attitude)
    limit = math.degrees(LINEAR_ATTITUDE)
    return f"an attitude error of {size:.2g} deg (one sigma){time_text} is beyond the linear form ({limit:.0f} deg)"


def initial_tilt_message(tables: Tables, case: str) -> str:
    """Return the message if the attitude error of a case at or before lift-off is not a small angle, else empty."""
    largest, t = _first_tilts(tables).get(case, (0.0, 0.0))
    return _tilt_message(largest, t) if largest > LINEAR_ATTITUDE else ""


def _tilt_message(attitude: float, t: float) -> str:
    """Return the message on an attitude sigma (rad) at a time (s) that is not a small angle."""
    return large_attitude_message(attitude, f" at {t:.0f} s")


@cache_result
def _first_tilts(tables: Tables) -> dict[str, tuple[float, float]]:
    """Return by case the largest attitude sigma (rad) of any axis at or before lift-off, and its time (s)."""
    rows = tables.history[tables.history.t_s <= SAME_TIME]
    rows = rows[(rows.quantity == "attitude") & (rows.axis != "3d")].dropna(subset=["lincov_true_si"])
    largest = rows.sort_values("lincov_true_si", ascending=False, kind="stable").drop_duplicates("case")
    return {row.case: (row.lincov_true_si, row.t_s) for row in largest.itertuples()}


def why_not_applicable(tables: Tables, case: str) -> str:
    """Return the reason why linear covariance does not describe a case at every epoch; empty if it does."""
    reason: str = _cached_reason(tables, case)[0]
    return reason


@cache_result
def _cached_reason(tables: Tables, case: str) -> list[str]:
    first_tilt = (0.0, 0.0)
    # With a spot check, its runs decide whether the attitude error is too large.
    if not (tables.campaign.get("covariance") or {}).get("spot_check"):
        first_tilt = _first_tilts(tables).get(case, first_tilt)
    rows = pick(tables.innovations, case=case)
    reason = why_outside(
        bool(pick(tables.cases, case=case).logic.any()),
        first_tilt,
        rows.t_s.to_numpy(dtype=float),
        rows.false_rejection_ratio.to_numpy(dtype=float),
    )
    return [reason]


def why_outside(has_logic: bool, first_tilt: tuple[float, float], t: Floats, rejection_probability: Floats) -> str:
    """Return the reason why linear covariance does not describe a case at every epoch; empty if it does.

    Parameters
    ----------
    has_logic : bool
        Whether a mode logic decides in each run which measurements the filter uses.
    first_tilt : (float, float)
        Largest attitude sigma (rad) of any axis at or before lift-off, and its time (s).
    t : (n_epoch,) array
        Times of the epochs, s since lift-off.
    rejection_probability : (n_epoch,) array
        Largest probability at each epoch that the gate rejects a good scalar measurement.
    """
    if has_logic:
        return "the filter starts, leaves out and stops by a logic of its own, run by run"
    if first_tilt[0] > LINEAR_ATTITUDE:
        return _tilt_message(*first_tilt)
    largest = np.nanmax(rejection_probability, initial=0.0)
    if not largest > REJECTS_TOO_MUCH:
        return ""
    t_largest = t[np.nanargmax(rejection_probability)]
    return f"the gate rejects {100 * largest:.2g} % of good rows at {t_largest:.0f} s"


def why_second_order(tables: Tables, case: str) -> str:
    """Return the reason why first-order errors are not sufficient for a case in which the engines disagree.

    It is a large attitude error in flight, or a mean error much larger than its spread; empty if neither applies.
    """
    rows = _navigation_history(tables, case)
    attitude = rows[rows.quantity == "attitude"]
    if len(attitude) and attitude.lincov_true_si.max() > LINEAR_ATTITUDE:
        largest = attitude.loc[attitude.lincov_true_si.idxmax()]
        return _tilt_message(float(largest.lincov_true_si), largest.t_s)
    return why_large_mean(tables, case)


def _navigation_history(tables: Tables, case: str) -> pd.DataFrame:
    """Return the history of the navigation errors by axis, where their sigma is not zero."""
    rows = pick(tables.history, case=case)
    return rows[rows.quantity.isin(NAVIGATION) & (rows.axis != "3d") & (rows.lincov_true_si > 0.0)]


def why_large_mean(tables: Tables, case: str) -> str:
    """Return the message if the mean error of a case is much larger than its spread at some time, else empty."""
    rows = _navigation_history(tables, case)
    ratio = rows.lincov_mean_si.abs() / rows.lincov_true_si
    if not ratio.max() > LARGE_MEAN:
        return ""
    row = rows.loc[ratio.idxmax()]
    return (
        f"the mean error is {ratio.max():.2g} sigma ({row.quantity} {row.axis} at {row.t_s:.0f} s): runs hardly "
        "spread, and the second order of the mean counts"
    )


@cache_result
def agreement(tables: Tables) -> pd.DataFrame:
    """Return the ratio of Monte Carlo RMS to LinCov RMS at every event for the nine navigation errors.

    monte_carlo, lincov: RMS errors in display units. low, high: acceptance limits of the ratio: two-sided chi-square
    with the degrees of freedom of the runs, with Bonferroni's correction over the rows of a case, and at least
    `FIRST_ORDER` from one. agree: "agree", "disagree", "no runs", or "not applicable" if linear covariance does not
    describe the case (`why_not_applicable`), or if the engines disagree about second-order errors (`why_second_order`).
    """
    rows = []
    for case, quantity, axis in names_of_series(tables):
        if quantity in NAVIGATION and axis != "3d":
            rows += _rms_ratios(tables, case, quantity, axis)
    frame = _test_ratios(pd.DataFrame(rows, columns=[*AGREEMENT[:7], "freedom"]))
    disagreeing = set(frame.case[frame.agree == "disagree"])
    inapplicable = []
    for case, label in tables.labels.items():
        if why_not_applicable(tables, case) or (label in disagreeing and why_second_order(tables, case)):
            inapplicable.append(label)
    is_tested = frame.agree.isin(["agree", "disagree"])
    return frame.assign(agree=frame.agree.mask(is_tested & frame.case.isin(inapplicable), NOT_APPLICABLE))


def _rms_ratios(tables: Tables, case: str, quantity: str, axis: str) -> list[dict[str, Any]]:
    """Return `AGREEMENT` up to the ratio, and the degrees of freedom of the runs, of an error at every event."""
    unit, factor = tables.display_units[quantity, axis]
    names = ("t_s", "rms_si", "lincov_true_si", "lincov_mean_si", "run_count", "dof_ratio")
    t, rms, true, mean, runs, dof = history_columns(tables, case, quantity, axis, *names)
    events = flight_events(tables, case)
    nearest = np.argmin(np.abs(t - events.t_s.to_numpy(dtype=float)[:, None]), axis=1)
    rows = []
    for event, t_event, k in zip(events.event, events.t_s, nearest, strict=True):
        expected_rms = float(np.hypot(true[k], mean[k]))
        if expected_rms > 0 and abs(t[k] - t_event) < SAME_TIME:
            row = {
                "case": tables.labels[case],
                "event": event,
                "state": f"{quantity} {axis}",
                "unit": unit,
                "monte_carlo": rms[k] * factor,
                "lincov": expected_rms * factor,
                "ratio": rms[k] / expected_rms,
                "freedom": runs[k] * dof[k],
            }
            rows.append(row)
    return rows


def _test_ratios(frame: pd.DataFrame) -> pd.DataFrame:
    """Return `AGREEMENT` from ratios and their degrees of freedom: limits, and whether each ratio is within."""
    members = frame.groupby("case").case.transform("size").to_numpy(dtype=float)
    low = np.empty(len(frame))
    high = np.empty(len(frame))
    for size in np.unique(members):
        same_size = members == size
        low[same_size], high[same_size] = ratio_interval(frame.freedom[same_size], ALPHA / size)  # Bonferroni
    low = np.minimum(low, 1.0 - FIRST_ORDER)
    high = np.maximum(high, 1.0 + FIRST_ORDER)
    is_inside = (frame.ratio >= low) & (frame.ratio <= high)
    verdict = np.where(frame.freedom == 0, "no runs", np.where(is_inside, "agree", "disagree"))
    return frame.assign(low=low, high=high, agree=verdict)[AGREEMENT]


@cache_result
def by_case(tables: Tables) -> pd.DataFrame:
    """Return one verdict per case, with the row of `agreement` that is furthest from agreement.

    reason: why linear covariance is not applicable. alpha_ratio: significance level of the whole case. tested_count,
    outside_count: number of rows, and of those outside their limits. source, share_ratio: largest error source of the
    state at the event, and its share of the variance; empty without an error budget.
    """
    digests = {label: case for case, label in tables.labels.items()}
    rows = [
        _case_verdict(tables, digests[label], ratios) for label, ratios in agreement(tables).groupby("case", sort=False)
    ]
    return pd.DataFrame(rows, columns=_BY_CASE)


def _case_verdict(tables: Tables, case: str, ratios: pd.DataFrame) -> dict[str, Any]:
    """Return the row of `by_case` for the rows of a case in `agreement`."""
    verdict = "agree"
    for word in ("no runs", NOT_APPLICABLE, "disagree"):
        if (ratios.agree == word).any():
            verdict = word
            break
    reason = why_not_applicable(tables, case)
    if verdict == NOT_APPLICABLE and not reason:
        reason = why_second_order(tables, case)
    # logarithmic distance from 1 over that of the limit: above 1 the ratio is outside
    limit = np.where(ratios.ratio > 1, np.log(ratios.high), -np.log(ratios.low))
    distance = np.abs(np.log(ratios.ratio)) / limit
    worst = ratios.iloc[0 if verdict == "no runs" else int(np.nanargmax(distance.to_numpy()))]
    is_outside = (ratios.ratio < ratios.low) | (ratios.ratio > ratios.high)
    quantity, axis = worst.state.split(" ")
    sources = pick(tables.budget, case=case, event=worst.event, quantity=quantity, axis=axis)
    share = sources.set_index("source").share_ratio
    return {
        "case": tables.labels[case],
        "verdict": verdict,
        "reason": reason,
        "alpha_ratio": ALPHA,
        "tested_count": len(ratios),
        "outside_count": int(is_outside.sum()),
        "state": worst.state,
        "event": worst.event,
        "ratio": worst.ratio,
        "low": worst.low,
        "high": worst.high,
        "source": share.idxmax() if len(share) else "",
        "share_ratio": float(share.max()) if len(share) else float("nan"),
    }


def budget(tables: Tables) -> pd.DataFrame:
    """Return the error budget: 3-D navigation errors by source at every event, by linear covariance.

    sigma: error of this source alone, in display units; squares of sources add. share_ratio: share of the variance.
    Both are zero below `LEAST_SHARE`. The largest source comes first within case, event and metric. The table is empty
    if the campaign does not store the budget.
    """
    rows = tables.budget
    rows = rows[(rows.event != "") & (rows.axis == "3d") & rows.quantity.isin(NAVIGATION)]
    negligible = rows.share_ratio < LEAST_SHARE
    frame = _label_rows(tables, rows, "event", "source").assign(
        sigma=rows.sigma_si.mask(negligible, 0.0) * _factors(tables, rows),
        share_ratio=rows.share_ratio.mask(negligible, 0.0),
    )
    frame = frame[["case", "event", "source", "metric", "unit", "sigma", "share_ratio"]]
    group = frame.groupby(["case", "event", "metric"], sort=False).ngroup()
    grouped_frame = frame.assign(group=group)
    sorted_frame = grouped_frame.sort_values(["group", "share_ratio"], ascending=[True, False], kind="stable")
    return sorted_frame.drop(columns="group").reset_index(drop=True)


def _label_rows(tables: Tables, rows: pd.DataFrame, *columns: str) -> pd.DataFrame:
    """Return case and columns of rows, with the name of the metric (a 3-D error) and its display unit."""
    units = {quantity: unit for (quantity, axis), (unit, _) in tables.display_units.items() if axis == "3d"}
    return rows[["case", *columns]].assign(
        case=rows.case.map(tables.labels),
        metric=rows.quantity + "_error",
        unit=rows.quantity.map(units),
    )


def _factors(tables: Tables, rows: pd.DataFrame) -> pd.Series:
    """Return the factor from SI to the display unit of the 3-D error of each row."""
    factors = {quantity: factor for (quantity, axis), (_, factor) in tables.display_units.items() if axis == "3d"}
    return rows.quantity.map(factors).astype(float)


def contributions(tables: Tables) -> pd.DataFrame:
    """Return the contributions of each source to the 3-D navigation errors at one event, by time of their origin.

    t_start_s, t_end_s: time bin of the origin. share_ratio: share of the variance at the event; the sum over sources
    and bins is 1.
    """
    rows = tables.adjoint[tables.adjoint.axis == "3d"]
    total = rows.groupby(["case", "quantity"], sort=False).variance_si2.transform("sum")
    rows = rows.rename(columns={"bin_start_s": "t_start_s", "bin_end_s": "t_end_s"})
    frame = _label_rows(tables, rows, "event", "source", "t_start_s", "t_end_s")
    frame = frame.assign(share_ratio=rows.variance_si2 / total).reset_index(drop=True)
    return frame[["case", "event", "metric", "source", "t_start_s", "t_end_s", "share_ratio"]]


def sensitivity(tables: Tables) -> pd.DataFrame:
    """Return the 3-D navigation errors at one event with the sigma of each source scaled by a factor.

    frozen: RMS error by linear covariance with the gains of the campaign's filter, in display units. retuned: with the
    filter model matched to the scaled sigma.
    """
    rows = tables.sensitivity
    factors = _factors(tables, rows)
    frame = _label_rows(tables, rows, "event", "source", "factor_ratio")
    frame = frame.assign(frozen=rows.frozen_si * factors, retuned=rows.retuned_si * factors)
    return frame[["case", "event", "metric", "unit", "source", "factor_ratio", "frozen", "retuned"]]


def observability(tables: Tables) -> pd.DataFrame:
    """Return the observability of the filter's states from the measurements, by case and phase.

    measurement_count: number of scalar measurements. rank_count, state_count: rank of the observability matrix and
    number of states; tolerance_ratio: relative tolerance of the rank. smallest_ratio, second_ratio, third_ratio:
    relative singular values, from the smallest. weakest_direction: direction of the smallest.
    """
    counts = ["measurement_count", "rank_count", "state_count", "tolerance_ratio"]
    smallest = ["smallest_ratio", "second_ratio", "third_ratio"]
    rows = []
    for _, phase in tables.observability.groupby(["case", "phase", "t_s"], sort=False):
        first = phase.iloc[0]
        row = {"case": tables.labels[first.case], "t_start_s": first.t_s}
        row |= first[["phase", "t_end_s", *counts, "weakest_direction"]].to_dict()
        row |= dict(zip(smallest, np.sort(phase.singular_ratio.to_numpy()), strict=False))
        rows.append(row)
    columns = ["case", "phase", "t_start_s", "t_end_s", *counts, *smallest, "weakest_direction"]
    return pd.DataFrame(rows, columns=columns)


def nonlinearity(tables: Tables) -> pd.DataFrame:
    """Return the nonlinearity indices at every event.

    remark: reason why the index does not apply. It measures the nonlinearity of the spread about the mean, and has no
    meaning for a mean error much larger than the spread.
    """
    rows = tables.nonlinearity
    means = {case: why_large_mean(tables, case) for case in tables.labels}
    remark = [f"does not apply: {means[case]}" if means.get(case) else "" for case in rows.case]
    return rows.assign(case=rows.case.map(tables.labels), remark=remark).reset_index(drop=True)


def observability_ranks(tables: Tables) -> pd.DataFrame:
    """Return the smallest rank of the observability matrix over all phases, with its smallest singular values.

    least_rank: number of singular values above 1e-10 of the largest; least_rank_with_information: above the tolerance
    of the results. smallest_ratio: smallest singular value; weakest_direction: its direction in words.
    position_against_bias_ratio: smallest singular value of a direction in which position and its bias cannot be
    separated; NaN if there is none.
    """
    rows = []
    for case, group in tables.observability.groupby("case", sort=False):
        ratio = group.singular_ratio
        ranks = []
        for _, phase_ratio in ratio.groupby(group.t_s):
            ranks.append(int((phase_ratio > NUMERICAL * phase_ratio.max()).sum()))
        is_bias = np.array([is_position_bias(text) for text in group.direction], dtype=bool)
        row = {
            "case": tables.labels[str(case)],
            "stretches": len(ranks),
            "states": int(group.state_count.iloc[0]),
            "least_rank": min(ranks),
            "least_rank_with_information": int(group.rank_count.min()),
            "smallest_ratio": float(ratio.min()),
            "position_against_bias_ratio": float(ratio[is_bias].min()),  # NaN if there is no such direction
            "weakest_direction": str(group.direction[ratio.idxmin()]),
        }
        rows.append(row)
    return pd.DataFrame(rows, columns=OBSERVED)


def is_position_bias(direction: str) -> bool:
    """Whether a direction in words is a combination of position and its bias alone."""
    names = [component.split(" ", 1)[1] for component in direction.split(", ") if " " in component]
    has_bias = any(name.startswith("position bias") for name in names)
    return has_bias and all(name.startswith("position") for name in names)
