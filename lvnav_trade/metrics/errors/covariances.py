"""What linear covariance says of an error at an event: mean and covariance, all sources together and each alone."""

from typing import NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.select import at_time, history_of, pick
from lvnav_trade.records import Floats
from lvnav_trade.store import Tables

REJECTS_TOO_MUCH = 0.01
"""A gate that rejects more than this part of good rows is not what linear covariance describes."""


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
