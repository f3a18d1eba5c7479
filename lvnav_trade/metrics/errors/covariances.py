"""Metrics of linear covariance: errors, range of validity, agreement with Monte Carlo, diagnostics."""

import math

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.probability import ratio_interval
from lvnav_trade.metrics.basics.select import (
    NAVIGATION,
    SAME_TIME,
    flight_events,
    history_columns,
    names_of_series,
    once,
    pick,
)
from lvnav_trade.records import Floats
from lvnav_trade.store.read import Tables

# A gate that rejects more than this part of good rows is not what linear covariance describes.
REJECTS_TOO_MUCH = 0.01
# rad; a larger one-sigma of attitude at or before lift-off is beyond the linear form: 1 - cos is 4 % of 5 deg.
LINEAR_ATTITUDE = math.radians(5.0)
# Of the expected size: what linear covariance is trusted with, however many runs there are and however little they
# spread.
FIRST_ORDER = 0.01
# sigma; an error whose mean is larger is nearly the same in every run: its second order is no smaller than the spread.
LARGE_MEAN = 5.0
AGREEMENT = ["case", "event", "state", "unit", "monte_carlo", "lincov", "ratio", "low", "high", "agree"]
# Probability that any row of a case disagrees although both engines describe the same errors.
ALPHA = 0.01
# Share of the variance below which a source counts as zero: smaller ones have fewer than six digits, and other ones on
# another machine.
LEAST_SHARE = 1e-9
# Of the largest singular value: what is below is lost to rounding.
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
    "weakest",
]


def beyond_linear(attitude: float, when: str = "") -> str:
    """Say that a one-sigma of attitude (rad) is no small angle; `when` begins with a space."""
    size, limit = math.degrees(attitude), math.degrees(LINEAR_ATTITUDE)
    return f"an attitude error of {size:.2g} deg (one sigma){when} is beyond the linear form ({limit:.0f} deg)"


def beyond_at_start(tables: Tables, case: str) -> str:
    """Say that the attitude of a case at or before lift-off is no small angle; empty where it is."""
    largest, t = _first_tilts(tables).get(case, (0.0, 0.0))
    return _beyond_at(largest, t) if largest > LINEAR_ATTITUDE else ""


def _beyond_at(attitude: float, t: float) -> str:
    return beyond_linear(attitude, f" at {t:.0f} s")


@once
def _first_tilts(tables: Tables) -> dict[str, tuple[float, float]]:
    """Return by case the largest sigma of attitude (rad) of an axis at or before lift-off, and its time (s)."""
    rows = tables.history[tables.history.t_s <= SAME_TIME]
    rows = rows[(rows.quantity == "attitude") & (rows.axis != "3d")].dropna(subset=["lincov_true_si"])
    largest = rows.sort_values("lincov_true_si", ascending=False, kind="stable").drop_duplicates("case")
    return dict(zip(largest.case, zip(largest.lincov_true_si, largest.t_s, strict=True), strict=True))


def why_not_applicable(tables: Tables, case: str) -> str:
    """Say why linear covariance does not describe a case at every epoch; empty where it does."""
    found: str = _why_not(tables, case)[0]
    return found


@once
def _why_not(tables: Tables, case: str) -> list[str]:
    return [_why_not_applicable(tables, case)]


def _why_not_applicable(tables: Tables, case: str) -> str:
    checked = (tables.campaign.get("covariance") or {}).get("spot_check")  # then that tells, by runs
    rows = pick(tables.innovations, case=case)
    return why_outside(
        bool(pick(tables.cases, case=case).logic.any()),
        (0.0, 0.0) if checked else _first_tilts(tables).get(case, (0.0, 0.0)),
        rows.t_s.to_numpy(dtype=float),
        rows.false_rejection_ratio.to_numpy(dtype=float),
    )


def why_outside(has_logic: bool, first_tilt: tuple[float, float], t: Floats, rejected: Floats) -> str:
    """Say why linear covariance does not describe a case at every epoch; empty where it does.

    has_logic : Whether a mode logic decides run by run what the filter uses.
    first_tilt : Largest sigma of attitude (rad) of an axis at or before lift-off, and its time (s).
    t : (n_epoch,) s since lift-off.
    rejected : (n_epoch,). Largest probability that the gate rejects a good scalar measurement.
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
    """Say what of a case is too large for a first order, where engines disagree: attitude in flight, or a mean that
    the runs hardly spread about; empty where neither is.
    """
    rows = _navigation_history(tables, case)
    tilted = rows[rows.quantity == "attitude"]
    if len(tilted) and tilted.lincov_true_si.max() > LINEAR_ATTITUDE:
        at = tilted.loc[tilted.lincov_true_si.idxmax()]
        return beyond_linear(float(at.lincov_true_si), f" at {at.t_s:.0f} s")
    return why_large_mean(tables, case)


def _navigation_history(tables: Tables, case: str) -> pd.DataFrame:
    """Return the history of the navigation errors by axis, where they have a spread."""
    rows = pick(tables.history, case=case)
    return rows[rows.quantity.isin(NAVIGATION) & (rows.axis != "3d") & (rows.lincov_true_si > 0.0)]


def why_large_mean(tables: Tables, case: str) -> str:
    """Say that runs of a case hardly spread about their mean error at some time; empty where they do at all times."""
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
    """Return Monte-Carlo RMS over LinCov RMS at every event for the nine navigation errors, in the units of people.

    low and high bound the ratio: chi-square with the runs' degrees of freedom, two-sided, Bonferroni over the rows of a
    case, and never closer to one than `FIRST_ORDER`. agree is "agree", "disagree", "no runs", or "not applicable":
    where linear covariance does not describe the case (`why_not_applicable`: a gate that rejects more than 1 % of good
    rows), and where the engines disagree over what is no first order (`why_second_order`).
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
    """Return one verdict per case, with the row that is furthest from agreement.

    Columns: case, verdict, reason (why not applicable), alpha_ratio (level of the whole case), tested_count,
    outside_count, state, event, ratio, low, high, source (the largest of that state at that event; empty where no
    budget is stored), share_ratio (its part of the variance).
    """
    digests = {label: case for case, label in tables.labels.items()}
    found = []
    for label, group in agreement(tables).groupby("case", sort=False):
        case = digests[label]
        verdict = next((v for v in ("no runs", NOT_APPLICABLE, "disagree") if (group.agree == v).any()), "agree")
        # in units of the half-width on a logarithmic scale: 1 is the bound itself
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
    """Return LinCov's 3-D navigation errors by source at every event, in the units of people.

    Columns: case, event, source, metric, unit, sigma (of this source alone; squares of sources add), share_ratio (of
    the variance); both are zero below `LEAST_SHARE`. Largest first within case, event and metric. Empty where the
    campaign asked for no budget.
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
    """Return case and columns of rows with the name of the metric, a 3-D error, and its unit for people."""
    units = rows.quantity.map({quantity: unit for (quantity, axis), (unit, _) in tables.people.items() if axis == "3d"})
    found = rows[["case", *columns]].assign(metric=rows.quantity + "_error", unit=units)
    return found.assign(case=rows.case.map(tables.labels))


def _factors(tables: Tables, rows: pd.DataFrame) -> pd.Series:
    factors = {quantity: factor for (quantity, axis), (_, factor) in tables.people.items() if axis == "3d"}
    return rows.quantity.map(factors).astype(float)


def contributions(tables: Tables) -> pd.DataFrame:
    """Return what each source put into the 3-D navigation errors at the explained event, and when.

    Columns: case, event, metric, source, t_start_s, t_end_s, share_ratio (of the variance at the event; over sources
    and bins they sum to 1).
    """
    rows = tables.adjoint[tables.adjoint.axis == "3d"]
    total = rows.groupby(["case", "quantity"], sort=False).variance_si2.transform("sum")
    rows = rows.rename(columns={"bin_start_s": "t_start_s", "bin_end_s": "t_end_s"})
    found = _labelled(tables, rows, "event", "source", "t_start_s", "t_end_s")
    found = found.assign(share_ratio=rows.variance_si2 / total).reset_index(drop=True)
    return found[["case", "event", "metric", "source", "t_start_s", "t_end_s", "share_ratio"]]


def sensitivity(tables: Tables) -> pd.DataFrame:
    """Return the 3-D navigation errors at the explained event with each source's sigma multiplied.

    Columns: case, event, metric, unit, source, factor_ratio, frozen (with the gains of the campaign's filter), retuned
    (with a filter that knows the new sigma); root mean squares by linear covariance, in the units of people.
    """
    rows, factors = tables.sensitivity, _factors(tables, tables.sensitivity)
    found = _labelled(tables, rows, "event", "source", "factor_ratio")
    found = found.assign(frozen=rows.frozen_si * factors, retuned=rows.retuned_si * factors)
    return found[["case", "event", "metric", "unit", "source", "factor_ratio", "frozen", "retuned"]]


def observability(tables: Tables) -> pd.DataFrame:
    """Return per case and phase what the measurements tell of the filter's states.

    Columns: case, phase, t_start_s, t_end_s, row_count, rank_count, state_count, tolerance_ratio, smallest_ratio,
    second_ratio, third_ratio (singular values from the smallest up), weakest.
    """
    counts = ["row_count", "rank_count", "state_count", "tolerance_ratio"]
    smallest = ["smallest_ratio", "second_ratio", "third_ratio"]
    found = []
    for _, group in tables.observability.groupby(["case", "phase", "t_s"], sort=False):
        first = group.iloc[0]
        values = dict(zip(smallest, np.sort(group.singular_ratio.to_numpy()), strict=False))
        head = {"case": tables.labels[first.case], "t_start_s": first.t_s}
        found.append({**head, **first[["phase", "t_end_s", *counts, "weakest"]], **values})
    return pd.DataFrame(found, columns=["case", "phase", "t_start_s", "t_end_s", *counts, *smallest, "weakest"])


def nonlinearity(tables: Tables) -> pd.DataFrame:
    """Return the nonlinearity at every event: case, event, t_s, motion_ratio, state, transition_ratio, row_ratio,
    remark: where the measure does not apply, since it is that of the spread about the mean.
    """
    rows = tables.nonlinearity
    means = {case: why_large_mean(tables, case) for case in tables.labels}
    remark = [f"does not apply: {means[case]}" if means.get(case) else "" for case in rows.case]
    return rows.assign(case=rows.case.map(tables.labels), remark=remark).reset_index(drop=True)


def observed(tables: Tables) -> pd.DataFrame:
    """Return the least rank of any stretch (singular values above 1e-10 of the largest), the least rank with
    information (above the tolerance of the results), the smallest singular value, the smallest of a direction in
    which a position trades with its bias (NaN where there is none), and the direction of the smallest of all, in words.
    """
    rows = []
    for case, one in tables.observability.groupby("case", sort=False):
        stretches = [part for _, part in one.groupby("t_s")]
        ranks = [int((part.singular_ratio > NUMERICAL * part.singular_ratio.max()).sum()) for part in stretches]
        apart = one.singular_ratio[np.array([is_position_bias(text) for text in one.direction], dtype=bool)]
        counts = (len(stretches), int(one.state_count.iloc[0]), min(ranks), int(one.rank_count.min()))
        smallest = (float(one.singular_ratio.min()), float(apart.min()) if len(apart) else np.nan)
        rows.append((tables.labels[str(case)], *counts, *smallest, str(one.direction[one.singular_ratio.idxmin()])))
    return pd.DataFrame(rows, columns=OBSERVED)


def is_position_bias(direction: str) -> bool:
    """Say whether a direction in words is one in which a position trades with its bias."""
    names = [part.split(" ", 1)[1] for part in direction.split(", ") if " " in part]
    of_bias = any(name.startswith("position bias") for name in names)
    return of_bias and all(name.startswith("position") for name in names)
