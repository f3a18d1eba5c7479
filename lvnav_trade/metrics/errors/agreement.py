"""Does Monte Carlo agree with linear covariance: navigation errors at the events, tested as one family per case."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.intervals import ratio_interval
from lvnav_trade.metrics.basics.select import NAVIGATION, at_time, flight_events, series
from lvnav_trade.metrics.errors.covariances import reach
from lvnav_trade.store import Tables, load

COLUMNS = ["case", "event", "state", "unit", "monte_carlo", "lincov", "ratio", "low", "high", "agree"]
ALPHA = 0.01
"""Probability that any row of a case disagrees although both engines describe the same errors."""


def agreement(results: Path | str | Tables) -> pd.DataFrame:
    """Return Monte-Carlo RMS over LinCov RMS at every event for the nine navigation errors, in the units of people.

    low and high bound the ratio: chi-square with the runs' degrees of freedom, two-sided, Bonferroni over the rows of a
    case. agree is "agree", "disagree", "no runs", or "not applicable" where the case's gate rejects more than 1 % of
    good rows at some epoch: there linear covariance, which knows no gate, does not describe the filter.
    """
    tables = load(results)
    rows = []
    for case, quantity, axis, history in series(tables):
        if quantity not in NAVIGATION or axis == "3d":
            continue
        unit, factor = tables.people[quantity, axis]
        for event in flight_events(tables, case).itertuples():
            at = at_time(history, event.t_s)
            expected = float(np.hypot(at.lincov_true_si, at.lincov_mean_si))
            if expected > 0 and abs(at.t_s - event.t_s) < 1e-6:
                rows.append(
                    {
                        "case": tables.labels[case],
                        "event": event.event,
                        "state": f"{quantity} {axis}",
                        "unit": unit,
                        "monte_carlo": at.rms_si * factor,
                        "lincov": expected * factor,
                        "ratio": at.rms_si / expected,
                        "freedom": at.run_count * at.dof_ratio,
                    }
                )
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


def by_case(results: Path | str | Tables) -> pd.DataFrame:
    """Return one verdict per case, with the row that is furthest from agreement.

    Columns: case, verdict, reason (why not applicable), alpha_ratio (level of the whole case), tested_count,
    outside_count, state, event, ratio, low, high, source (the largest of that state at that event), share_ratio (its
    part of the variance).
    """
    tables = load(results)
    digests = {label: case for case, label in tables.labels.items()}
    found = []
    for case, group in agreement(tables).groupby("case", sort=False):
        verdict = next((v for v in ("no runs", "not applicable", "disagree") if (group.agree == v).any()), "agree")
        worst = group.iloc[0] if verdict == "no runs" else group.iloc[_furthest(group)]
        found.append(
            {
                "case": case,
                "verdict": verdict,
                "reason": reach(tables, digests[case]).reason,
                "alpha_ratio": ALPHA,
                "tested_count": len(group),
                "outside_count": int(((group.ratio < group.low) | (group.ratio > group.high)).sum()),
                **{name: worst[name] for name in ("state", "event", "ratio", "low", "high")},
                **_largest_source(tables, digests[case], worst.state, worst.event),
            }
        )
    names = ["case", "verdict", "reason", "alpha_ratio", "tested_count", "outside_count", "state", "event", "ratio"]
    return pd.DataFrame(found, columns=[*names, "low", "high", "source", "share_ratio"])


def _furthest(group: pd.DataFrame) -> int:
    """Return the row of largest distance in units of the half-width on a logarithmic scale: 1 is the bound itself."""
    distance = np.abs(np.log(group.ratio)) / np.where(group.ratio > 1, np.log(group.high), -np.log(group.low))
    return int(np.nanargmax(distance.to_numpy()))


def _largest_source(tables: Tables, case: str, state: str, event: str) -> dict[str, Any]:
    """Return the source that makes most of one error at an event; empty where no budget is stored."""
    quantity, axis = state.split(" ")
    rows = tables.budget
    rows = rows[(rows.case == case) & (rows.event == event) & (rows.quantity == quantity) & (rows.axis == axis)]
    if rows.empty:
        return {"source": "", "share_ratio": float("nan")}
    top = rows.loc[rows.share_ratio.idxmax()]
    return {"source": top.source, "share_ratio": float(top.share_ratio)}
