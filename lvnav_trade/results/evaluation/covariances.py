"""Metrics of linear covariance: errors, range of validity, agreement with Monte Carlo, diagnostics."""

import math

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.statistics.probability import ratio_interval
from lvnav_trade.results.statistics.select import (
    NAVIGATION,
    SAME_TIME,
    flight_events,
    history_columns,
    names_of_series,
    once,
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
OBSERVED = [
    "case",
    "stretches",
    "states",
    "least_rank",
    "least_rank_with_information",
    "smallest_ratio",
    "position_against_bias_ratio",
    "weakest_direction",
]


def beyond_linear(attitude: float, when: str = "") -> str:
    """Return the message on an attitude sigma (rad) that is not a small angle; `when` begins with a space."""
    size, limit = math.degrees(attitude), math.degrees(LINEAR_ATTITUDE)
    return f"an attitude error of {size:.2g} deg (one sigma){when} is beyond the linear form ({limit:.0f} deg)"


def beyond_at_start(tables: Tables, case: str) -> str:
    """Return the message if the attitude error of a case at or before lift-off is not a small angle, else empty."""
    largest, t = _first_tilts(tables).get(case, (0.0, 0.0))
    return _beyond_at(largest, t) if largest > LINEAR_ATTITUDE else ""


def _beyond_at(attitude: float, t: float) -> str:
    return beyond_linear(attitude, f" at {t:.0f} s")


@once
def _first_tilts(tables: Tables) -> dict[str, tuple[float, float]]:
    """Return by case the largest attitude sigma (rad) of any axis at or before lift-off, and its time (s)."""
    rows = tables.history[tables.history.t_s <= SAME_TIME]
    rows = rows[(rows.quantity == "attitude") & (rows.axis != "3d")].dropna(subset=["lincov_true_si"])
    largest = rows.sort_values("lincov_true_si", ascending=False, kind="stable").drop_duplicates("case")
    return dict(zip(largest.case, zip(largest.lincov_true_si, largest.t_s, strict=True), strict=True))


def why_not_applicable(tables: Tables, case: str) -> str:
    """Return the reason why linear covariance does not describe a case at every epoch; empty if it does."""
    reason: str = _why_not(tables, case)[0]
    return reason


@once
def _why_not(tables: Tables, case: str) -> list[str]:
    return [_why_not_applicable(tables, case)]


def _why_not_applicable(tables: Tables, case: str) -> str:
    # with a spot check, its runs decide whether the attitude error is too large
    checked = (tables.campaign.get("covariance") or {}).get("spot_check")
    rows = pick(tables.innovations, case=case)
    return why_outside(
        bool(pick(tables.cases, case=case).logic.any()),
        (0.0, 0.0) if checked else _first_tilts(tables).get(case, (0.0, 0.0)),
        rows.t_s.to_numpy(dtype=float),
        rows.false_rejection_ratio.to_numpy(dtype=float),
    )


def why_outside(has_logic: bool, first_tilt: tuple[float, float], t: Floats, rejected: Floats) -> str:
    """Return the reason why linear covariance does not describe a case at every epoch; empty if it does.

    Parameters
    ----------
    has_logic : bool
        Whether a mode logic decides in each run which measurements the filter uses.
    first_tilt : (float, float)
        Largest attitude sigma (rad) of any axis at or before lift-off, and its time (s).
    t : (n_epoch,) array
        Times of the epochs, s since lift-off.
    rejected : (n_epoch,) array
        Largest probability at each epoch that the gate rejects a good scalar measurement.
    """
    if has_logic:
        return "the filter starts, leaves out and stops by a logic of its own, run by run"
    if first_tilt[0] > LINEAR_ATTITUDE:
        return _beyond_at(*first_tilt)
    largest = np.nanmax(rejected, initial=0.0)
    if not largest > REJECTS_TOO_MUCH:
        return ""
    return f"the gate rejects {100 * largest:.2g} % of good rows at {t[np.nanargmax(rejected)]:.0f} s"


def why_second_order(tables: Tables, case: str) -> str:
    """Return the reason why first-order errors are not sufficient for a case in which the engines disagree.

    It is a large attitude error in flight, or a mean error much larger than its spread; empty if neither applies.
    """
    rows = _navigation_history(tables, case)
    tilted = rows[rows.quantity == "attitude"]
    if len(tilted) and tilted.lincov_true_si.max() > LINEAR_ATTITUDE:
        at = tilted.loc[tilted.lincov_true_si.idxmax()]
        return beyond_linear(float(at.lincov_true_si), f" at {at.t_s:.0f} s")
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
    at = rows.loc[ratio.idxmax()]
    return (
        f"the mean error is {ratio.max():.2g} sigma ({at.quantity} {at.axis} at {at.t_s:.0f} s): runs hardly spread, "
        "and the second order of the mean counts"
    )


@once
def agreement(tables: Tables) -> pd.DataFrame:
    """Return the ratio of Monte Carlo RMS to LinCov RMS at every event for the nine navigation errors.

    monte_carlo, lincov: RMS errors in display units. low, high: acceptance limits of the ratio: two-sided chi-square
    with the degrees of freedom of the runs, with Bonferroni's correction over the rows of a case, and at least
    `FIRST_ORDER` from one. agree: "agree", "disagree", "no runs", or "not applicable" if linear covariance does not
    describe the case (`why_not_applicable`), or if the engines disagree about second-order errors (`why_second_order`).
    """
    rows = []
    names = ("t_s", "rms_si", "lincov_true_si", "lincov_mean_si", "run_count", "dof_ratio")
    moments = {case: _moments(tables, case) for case in tables.labels}
    for case, quantity, axis in names_of_series(tables):
        if quantity not in NAVIGATION or axis == "3d":
            continue
        unit, factor = tables.people[quantity, axis]
        events, times = moments[case]
        history = history_columns(tables, case, quantity, axis, *names)
        at = np.argmin(np.abs(history[0] - times[:, None]), axis=1)
        values = zip(events, times, *(column[at] for column in history), strict=True)
        for event, when, t, rms, true, mean, runs, dof in values:
            expected = float(np.hypot(true, mean))
            if expected > 0 and abs(t - when) < SAME_TIME:
                head = (tables.labels[case], event, f"{quantity} {axis}", unit)
                rows.append((*head, rms * factor, expected * factor, rms / expected, runs * dof))
    found = _with_verdicts(pd.DataFrame(rows, columns=[*AGREEMENT[:7], "freedom"]))
    differ = set(found.case[found.agree == "disagree"])
    outside = [
        label
        for case, label in tables.labels.items()
        if why_not_applicable(tables, case) or (label in differ and why_second_order(tables, case))
    ]
    tested = found.agree.isin(["agree", "disagree"])
    return found.assign(agree=found.agree.mask(tested & found.case.isin(outside), NOT_APPLICABLE))


def _moments(tables: Tables, case: str) -> tuple[list[str], Floats]:
    events = flight_events(tables, case)
    return list(events.event), events.t_s.to_numpy(dtype=float)


def _with_verdicts(frame: pd.DataFrame) -> pd.DataFrame:
    members = frame.groupby("case").case.transform("size").to_numpy(dtype=float)
    low, high = np.empty(len(frame)), np.empty(len(frame))
    for size in np.unique(members):
        chosen = members == size
        low[chosen], high[chosen] = ratio_interval(frame.freedom[chosen], ALPHA / size)
    low, high = np.minimum(low, 1.0 - FIRST_ORDER), np.maximum(high, 1.0 + FIRST_ORDER)
    inside = (frame.ratio >= low) & (frame.ratio <= high)
    verdict = np.where(frame.freedom == 0, "no runs", np.where(inside, "agree", "disagree"))
    return frame.assign(low=low, high=high, agree=verdict)[AGREEMENT]


@once
def by_case(tables: Tables) -> pd.DataFrame:
    """Return one verdict per case, with the row of `agreement` that is furthest from agreement.

    reason: why linear covariance is not applicable. alpha_ratio: significance level of the whole case. tested_count,
    outside_count: number of rows, and of those outside their limits. source, share_ratio: largest error source of the
    state at the event, and its share of the variance; empty without an error budget.
    """
    digests = {label: case for case, label in tables.labels.items()}
    found = []
    for label, group in agreement(tables).groupby("case", sort=False):
        case = digests[label]
        verdict = next((v for v in ("no runs", NOT_APPLICABLE, "disagree") if (group.agree == v).any()), "agree")
        # logarithmic distance from 1 over that of the limit: above 1 the ratio is outside
        distance = np.abs(np.log(group.ratio)) / np.where(group.ratio > 1, np.log(group.high), -np.log(group.low))
        worst = group.iloc[0 if verdict == "no runs" else int(np.nanargmax(distance.to_numpy()))]
        outside = int(((group.ratio < group.low) | (group.ratio > group.high)).sum())
        quantity, axis = worst.state.split(" ")
        sources = pick(tables.budget, case=case, event=worst.event, quantity=quantity, axis=axis)
        share = sources.set_index("source").share_ratio
        largest = (share.idxmax(), float(share.max())) if len(share) else ("", float("nan"))
        reason = why_not_applicable(tables, case)
        if verdict == NOT_APPLICABLE and not reason:
            reason = why_second_order(tables, case)
        head = (label, verdict, reason, ALPHA, len(group), outside)
        found.append((*head, *worst[["state", "event", "ratio", "low", "high"]], *largest))
    names = ["case", "verdict", "reason", "alpha_ratio", "tested_count", "outside_count", "state", "event", "ratio"]
    return pd.DataFrame(found, columns=[*names, "low", "high", "source", "share_ratio"])


def budget(tables: Tables) -> pd.DataFrame:
    """Return the error budget: 3-D navigation errors by source at every event, by linear covariance.

    sigma: error of this source alone, in display units; squares of sources add. share_ratio: share of the variance.
    Both are zero below `LEAST_SHARE`. The largest source comes first within case, event and metric. The table is empty
    if the campaign does not store the budget.
    """
    rows = tables.budget
    rows = rows[(rows.event != "") & (rows.axis == "3d") & rows.quantity.isin(NAVIGATION)]
    negligible = rows.share_ratio < LEAST_SHARE
    found = _labelled(tables, rows, "event", "source").assign(
        sigma=rows.sigma_si.mask(negligible, 0.0) * _factors(tables, rows),
        share_ratio=rows.share_ratio.mask(negligible, 0.0),
    )
    found = found[["case", "event", "source", "metric", "unit", "sigma", "share_ratio"]]
    place = found.groupby(["case", "event", "metric"], sort=False).ngroup()
    order = found.assign(place=place).sort_values(["place", "share_ratio"], ascending=[True, False], kind="stable")
    return order.drop(columns="place").reset_index(drop=True)


def _labelled(tables: Tables, rows: pd.DataFrame, *columns: str) -> pd.DataFrame:
    """Return case and columns of rows, with the name of the metric (a 3-D error) and its display unit."""
    units = rows.quantity.map({quantity: unit for (quantity, axis), (unit, _) in tables.people.items() if axis == "3d"})
    found = rows[["case", *columns]].assign(metric=rows.quantity + "_error", unit=units)
    return found.assign(case=rows.case.map(tables.labels))


def _factors(tables: Tables, rows: pd.DataFrame) -> pd.Series:
    factors = {quantity: factor for (quantity, axis), (_, factor) in tables.people.items() if axis == "3d"}
    return rows.quantity.map(factors).astype(float)


def contributions(tables: Tables) -> pd.DataFrame:
    """Return the contributions of each source to the 3-D navigation errors at one event, by time of their origin.

    t_start_s, t_end_s: time bin of the origin. share_ratio: share of the variance at the event; the sum over sources
    and bins is 1.
    """
    rows = tables.adjoint[tables.adjoint.axis == "3d"]
    total = rows.groupby(["case", "quantity"], sort=False).variance_si2.transform("sum")
    rows = rows.rename(columns={"bin_start_s": "t_start_s", "bin_end_s": "t_end_s"})
    found = _labelled(tables, rows, "event", "source", "t_start_s", "t_end_s")
    found = found.assign(share_ratio=rows.variance_si2 / total).reset_index(drop=True)
    return found[["case", "event", "metric", "source", "t_start_s", "t_end_s", "share_ratio"]]


def sensitivity(tables: Tables) -> pd.DataFrame:
    """Return the 3-D navigation errors at one event with the sigma of each source scaled by a factor.

    frozen: RMS error by linear covariance with the gains of the campaign's filter, in display units. retuned: with the
    filter model matched to the scaled sigma.
    """
    rows, factors = tables.sensitivity, _factors(tables, tables.sensitivity)
    found = _labelled(tables, rows, "event", "source", "factor_ratio")
    found = found.assign(frozen=rows.frozen_si * factors, retuned=rows.retuned_si * factors)
    return found[["case", "event", "metric", "unit", "source", "factor_ratio", "frozen", "retuned"]]


def observability(tables: Tables) -> pd.DataFrame:
    """Return the observability of the filter's states from the measurements, by case and phase.

    measurement_count: number of scalar measurements. rank_count, state_count: rank of the observability matrix and
    number of states; tolerance_ratio: relative tolerance of the rank. smallest_ratio, second_ratio, third_ratio:
    relative singular values, from the smallest. weakest_direction: direction of the smallest.
    """
    counts = ["measurement_count", "rank_count", "state_count", "tolerance_ratio"]
    smallest = ["smallest_ratio", "second_ratio", "third_ratio"]
    found = []
    for _, group in tables.observability.groupby(["case", "phase", "t_s"], sort=False):
        first = group.iloc[0]
        values = dict(zip(smallest, np.sort(group.singular_ratio.to_numpy()), strict=False))
        head = {"case": tables.labels[first.case], "t_start_s": first.t_s}
        found.append({**head, **first[["phase", "t_end_s", *counts, "weakest_direction"]], **values})
    return pd.DataFrame(
        found, columns=["case", "phase", "t_start_s", "t_end_s", *counts, *smallest, "weakest_direction"]
    )


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
        phases = [phase for _, phase in group.groupby("t_s")]
        ranks = [int((phase.singular_ratio > NUMERICAL * phase.singular_ratio.max()).sum()) for phase in phases]
        of_bias = group.singular_ratio[np.array([is_position_bias(text) for text in group.direction], dtype=bool)]
        counts = (len(phases), int(group.state_count.iloc[0]), min(ranks), int(group.rank_count.min()))
        smallest = (float(group.singular_ratio.min()), float(of_bias.min()) if len(of_bias) else np.nan)
        rows.append((tables.labels[str(case)], *counts, *smallest, str(group.direction[group.singular_ratio.idxmin()])))
    return pd.DataFrame(rows, columns=OBSERVED)


def is_position_bias(direction: str) -> bool:
    """Whether a direction in words is a combination of position and its bias alone."""
    names = [part.split(" ", 1)[1] for part in direction.split(", ") if " " in part]
    of_bias = any(name.startswith("position bias") for name in names)
    return of_bias and all(name.startswith("position") for name in names)
