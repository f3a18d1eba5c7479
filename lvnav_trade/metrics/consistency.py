"""Does the filter's covariance fit its errors: normalised errors and innovations squared against their bounds."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from lvnav_trade.metrics.intervals import mean_square_interval
from lvnav_trade.store import Tables, load

ALPHA = 0.05


def nees(results: Path | str | Tables) -> pd.DataFrame:
    """Return the mean normalised estimation error squared per degree of freedom over time, with 95 % bounds.

    Columns: case, t_s, run_count, anees_ratio (1 for a matched filter), low_ratio, high_ratio, expected_ratio (LinCov),
    inside.
    """
    tables = load(results)
    rows = tables.consistency
    low, high = mean_square_interval(rows.run_count * rows.nees_dof_count, ALPHA)
    found = pd.DataFrame(
        {
            "case": rows.case.map(tables.labels),
            "t_s": rows.t_s,
            "run_count": rows.run_count,
            "anees_ratio": rows.nees_mean_ratio / rows.nees_dof_count,
            "low_ratio": low,
            "high_ratio": high,
            "expected_ratio": rows.expected_nees_ratio / rows.nees_dof_count,
        }
    )
    return found.assign(inside=found.anees_ratio.between(found.low_ratio, found.high_ratio))


def nis(results: Path | str | Tables) -> pd.DataFrame:
    """Return the mean normalised innovation squared of accepted rows over time, with 95 % bounds for that many rows.

    Columns: case, t_s, row_count, reject_count, anis_ratio (1 for a matched filter), low_ratio, high_ratio,
    expected_ratio (LinCov), inside. Epochs without a row are left out.
    """
    tables = load(results)
    rows = tables.innovations
    rows = rows[(rows.row_count > 0) | (rows.lincov_row_count > 0)]
    low, high = mean_square_interval(rows.row_count, ALPHA)
    found = pd.DataFrame(
        {
            "case": rows.case.map(tables.labels),
            "t_s": rows.t_s,
            "row_count": rows.row_count,
            "reject_count": rows.reject_count,
            "anis_ratio": rows.nis_sum_ratio / rows.row_count.where(rows.row_count > 0),
            "low_ratio": low,
            "high_ratio": high,
            "expected_ratio": rows.expected_nis_ratio / rows.lincov_row_count.where(rows.lincov_row_count > 0),
        }
    )
    return found.assign(inside=found.anis_ratio.between(found.low_ratio, found.high_ratio))


def consistency(results: Path | str | Tables) -> pd.DataFrame:
    """Return for each case and test (ANEES, ANIS) the time mean, what LinCov expects, and how much lies inside.

    Columns: case, test, mean_ratio, expected_ratio, inside_ratio (0.95 is expected of a matched filter), time_count.
    """
    tables = load(results)
    found = []
    for test, rows, value in (("ANEES", nees(tables), "anees_ratio"), ("ANIS", nis(tables), "anis_ratio")):
        for case, group in rows.groupby("case", sort=False):
            there = group[value].notna()
            found.append(
                {
                    "case": case,
                    "test": test,
                    "mean_ratio": group[value].mean(),
                    "expected_ratio": group.expected_ratio.mean(),
                    "inside_ratio": group.inside[there].mean() if there.any() else float("nan"),
                    "time_count": int(there.sum()),
                }
            )
    return pd.DataFrame(found)
