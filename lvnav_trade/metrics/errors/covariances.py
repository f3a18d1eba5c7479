"""What linear covariance says of an error at an event, where it applies, and whether Monte Carlo agrees with it."""

from typing import NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.probability import ratio_interval
from lvnav_trade.metrics.basics.select import NAVIGATION, SAME_TIME, at_time, flight_events, history_of, pick, series
from lvnav_trade.records import Floats
from lvnav_trade.store import Tables

REJECTS_TOO_MUCH = 0.01
"""A gate that rejects more than this part of good rows is not what linear covariance describes."""
COLUMNS = ["case", "event", "state", "unit", "monte_carlo", "lincov", "ratio", "low", "high", "agree"]
ALPHA = 0.01
"""Probability that any row of a case disagrees although both engines describe the same errors."""


class Gaussian(NamedTuple):
    """Mean (k,), covariance (k, k) of a metric's components, SI; sources: covariance of each source that is known."""

    mean: Floats
    covariance: Floats
    sources: dict[str, Floats]


class Reach(NamedTuple):
    """Whether linear covariance describes a case: the largest probability that a gate rejects a good row, and when; a
    logic that starts, rejects and stops by the run it does not describe.
    """

    applies: bool
    rejected: float
    time: float
    logic: bool = False

    @property
    def reason(self) -> str:
        """Say in words why not; empty where it applies."""
        if self.applies:
            return ""
        if self.logic:
            return "the filter starts, leaves out and stops by a logic of its own, run by run"
        return f"the gate rejects {100 * self.rejected:.2g} % of good rows at {self.time:.0f} s"


def gaussian(tables: Tables, case: str, event: str, quantity: str, axis: str) -> Gaussian | None:
    """Return linear covariance's Gaussian of a metric (axis "3d": three components) at an event; None if unknown."""
    rows = pick(tables.covariances, case=case, event=event, quantity=quantity)
    axes = list(dict.fromkeys(rows.axis))
    wanted = axes if axis == "3d" else [axis]
    if rows.empty or not set(wanted) <= set(axes):
        return None
    found = {str(source): _matrix(part, axes, wanted) for source, part in rows.groupby("source", sort=False)}
    t = float(rows.t_s.iloc[0])
    mean = [float(at_time(history_of(tables, case, quantity, name), t).lincov_mean_si) for name in wanted]
    return Gaussian(np.array(mean), found.pop(""), found)


def _matrix(rows: pd.DataFrame, axes: list[str], wanted: list[str]) -> Floats:
    matrix = np.zeros((len(axes), len(axes)))
    i, j = (pd.Index(axes).get_indexer(names) for names in (rows.axis, rows.other_axis))
    matrix[i, j] = matrix[j, i] = rows.true_si2.to_numpy()
    chosen = [axes.index(name) for name in wanted]
    return matrix[np.ix_(chosen, chosen)]


def reach(tables: Tables, case: str) -> Reach:
    """Return whether linear covariance describes a case at every epoch."""
    if bool(tables.cases.set_index("case").logic.get(case)):
        return Reach(False, 0.0, float("nan"), logic=True)
    rows = pick(tables.innovations, case=case)
    if rows.empty or not (rows.false_rejection_ratio > 0).any():
        return Reach(True, 0.0, float("nan"))
    worst = rows.loc[rows.false_rejection_ratio.idxmax()]
    rejected = float(worst.false_rejection_ratio)
    return Reach(rejected <= REJECTS_TOO_MUCH, rejected, float(worst.t_s))


def agreement(tables: Tables) -> pd.DataFrame:
    """Return Monte-Carlo RMS over LinCov RMS at every event for the nine navigation errors, in the units of people.

    low and high bound the ratio: chi-square with the runs' degrees of freedom, two-sided, Bonferroni over the rows of a
    case. agree is "agree", "disagree", "no runs", or "not applicable" where the case's gate rejects more than 1 % of
    good rows at some epoch: there linear covariance, which knows no gate, does not describe the filter.
    """
    rows = []
    for case, quantity, axis, history in series(tables):
        if quantity not in NAVIGATION or axis == "3d":
            continue
        unit, factor = tables.people[quantity, axis]
        for event in flight_events(tables, case).itertuples():
            at = at_time(history, event.t_s)
            expected = float(np.hypot(at.lincov_true_si, at.lincov_mean_si))
            if expected > 0 and abs(at.t_s - event.t_s) < SAME_TIME:
                head = (tables.labels[case], event.event, f"{quantity} {axis}", unit)
                sizes = (at.rms_si * factor, expected * factor, at.rms_si / expected)
                rows.append((*head, *sizes, at.run_count * at.dof_ratio))
    found = _with_verdicts(pd.DataFrame(rows, columns=[*COLUMNS[:7], "freedom"]))
    outside = [label for case, label in tables.labels.items() if not reach(tables, case).applies]
    tested = found.agree.isin(["agree", "disagree"])
    return found.assign(agree=found.agree.mask(tested & found.case.isin(outside), "not applicable"))


def _with_verdicts(frame: pd.DataFrame) -> pd.DataFrame:
    """Add the bounds and the verdict of each row."""
    members = frame.groupby("case").case.transform("size").to_numpy(dtype=float)
    low, high = np.empty(len(frame)), np.empty(len(frame))
    for size in np.unique(members):
        chosen = members == size
        low[chosen], high[chosen] = ratio_interval(frame.freedom[chosen], ALPHA / size)
    inside = (frame.ratio >= low) & (frame.ratio <= high)
    verdict = np.where(frame.freedom == 0, "no runs", np.where(inside, "agree", "disagree"))
    return frame.assign(low=low, high=high, agree=verdict)[COLUMNS]


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
        verdict = next((v for v in ("no runs", "not applicable", "disagree") if (group.agree == v).any()), "agree")
        worst = group.iloc[0] if verdict == "no runs" else group.iloc[_furthest(group)]
        outside = int(((group.ratio < group.low) | (group.ratio > group.high)).sum())
        quantity, axis = worst.state.split(" ")
        sources = pick(tables.budget, case=case, event=worst.event, quantity=quantity, axis=axis)
        share = sources.set_index("source").share_ratio
        largest = (share.idxmax(), float(share.max())) if len(share) else ("", float("nan"))
        head = (label, verdict, reach(tables, case).reason, ALPHA, len(group), outside)
        found.append((*head, *worst[["state", "event", "ratio", "low", "high"]], *largest))
    names = ["case", "verdict", "reason", "alpha_ratio", "tested_count", "outside_count", "state", "event", "ratio"]
    return pd.DataFrame(found, columns=[*names, "low", "high", "source", "share_ratio"])


def _furthest(group: pd.DataFrame) -> int:
    """Return the row of largest distance in units of the half-width on a logarithmic scale: 1 is the bound itself."""
    distance = np.abs(np.log(group.ratio)) / np.where(group.ratio > 1, np.log(group.high), -np.log(group.low))
    return int(np.nanargmax(distance.to_numpy()))
