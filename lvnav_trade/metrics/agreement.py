"""Does Monte Carlo agree with linear covariance: navigation errors at the events, tested as one family per case."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from lvnav_trade.metrics.intervals import ratio_interval
from lvnav_trade.metrics.select import NAVIGATION, at_time, flight_events, series
from lvnav_trade.store import Tables, load

COLUMNS = ["case", "event", "state", "unit", "monte_carlo", "lincov", "ratio", "low", "high", "agree"]
ALPHA = 0.01
"""Probability that any row of a case disagrees although both engines describe the same errors."""


def agreement(results: Path | str | Tables) -> pd.DataFrame:
    """Return Monte-Carlo RMS over LinCov RMS at every event for the nine navigation errors, in the units of people.

    low and high bound the ratio: chi-square with the runs' degrees of freedom, two-sided, Bonferroni over the rows of a
    case. agree is "agree", "disagree", or "no runs".
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
    return _judged(pd.DataFrame(rows, columns=[*COLUMNS[:7], "freedom"]))


def _judged(frame: pd.DataFrame) -> pd.DataFrame:
    """Add the bounds and the verdict of each row."""
    members = frame.groupby("case").case.transform("size").to_numpy(dtype=float)
    low, high = np.empty(len(frame)), np.empty(len(frame))
    for size in np.unique(members):
        chosen = members == size
        low[chosen], high[chosen] = ratio_interval(frame.freedom[chosen], ALPHA / size)
    inside = (frame.ratio >= low) & (frame.ratio <= high)
    verdict = np.where(frame.freedom == 0, "no runs", np.where(inside, "agree", "disagree"))
    return frame.assign(low=low, high=high, agree=verdict)[COLUMNS]


def by_case(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one verdict per case, with the row that is furthest from agreement.

    Columns: case, verdict, tested_count, outside_count, state, event, ratio, low, high.
    """
    found = []
    for case, group in rows.groupby("case", sort=False):
        outside = int((group.agree == "disagree").sum())
        none = (group.agree == "no runs").all()
        # distance in units of the half-width on a logarithmic scale: 1 is the bound itself
        distance = np.abs(np.log(group.ratio)) / np.where(group.ratio > 1, np.log(group.high), -np.log(group.low))
        worst = group.iloc[int(np.nanargmax(distance.to_numpy()))] if not none else group.iloc[0]
        found.append(
            {
                "case": case,
                "verdict": "no runs" if none else "disagree" if outside else "agree",
                "tested_count": len(group),
                "outside_count": outside,
                **{name: worst[name] for name in ("state", "event", "ratio", "low", "high")},
            }
        )
    names = ["case", "verdict", "tested_count", "outside_count", "state", "event", "ratio", "low", "high"]
    return pd.DataFrame(found, columns=names)
