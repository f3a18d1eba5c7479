"""Does the filter's covariance fit its errors: normalised errors and innovations squared against their bounds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from lvnav_trade.metrics.basics.intervals import mean_square_interval
from lvnav_trade.store import Tables, load

ALPHA = 0.05
Floats = NDArray[np.float64]


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

    Columns: case, t_s, row_count, reject_count, raw_ratio (mean of the accepted rows), anis_ratio (the same over what a
    gate leaves of a matched filter's rows: 1 for a matched filter), low_ratio, high_ratio, expected_ratio (LinCov, with
    the same gate and correction), rejected_ratio (part of rows that the gate rejected), false_rejection_ratio (LinCov),
    inside. Epochs without a row are left out.
    """
    tables = load(results)
    rows = tables.innovations
    rows = rows[(rows.row_count > 0) | (rows.lincov_row_count > 0)]
    gate = rows.case.map(tables.cases.set_index("case").gate_ratio).to_numpy(dtype=float)
    mean, variance = accepted_moments(gate)
    low, high = mean_square_interval(rows.row_count * 2.0 * mean**2 / variance, ALPHA)
    raw = rows.nis_sum_ratio / rows.row_count.where(rows.row_count > 0)
    spread = rows.expected_nis_ratio / rows.lincov_row_count.where(rows.lincov_row_count > 0)
    offered = rows.row_count + rows.reject_count
    found = pd.DataFrame(
        {
            "case": rows.case.map(tables.labels),
            "t_s": rows.t_s,
            "row_count": rows.row_count,
            "reject_count": rows.reject_count,
            "raw_ratio": raw,
            "anis_ratio": raw / mean,
            "low_ratio": low,
            "high_ratio": high,
            "expected_ratio": spread * accepted_moments(gate / np.sqrt(spread))[0] / mean,
            "rejected_ratio": rows.reject_count / offered.where(offered > 0),
            "false_rejection_ratio": rows.false_rejection_ratio,
        }
    )
    return found.assign(inside=found.anis_ratio.between(found.low_ratio, found.high_ratio))


def accepted_moments(gate: ArrayLike) -> tuple[Floats, Floats]:
    """Return mean and variance of the square of a standard normal that lies within +- gate (NaN: no gate): 1 and 2.

    With F(x; n) the chi-square distribution: the mean is F(g^2; 3) / F(g^2; 1), the mean square 3 F(g^2; 5) / F(g^2;
    1). The filter's gate works row by row.
    """
    square = np.where(np.isnan(gate), np.inf, np.square(gate))
    inside = stats.chi2.cdf(square, 1)
    mean = stats.chi2.cdf(square, 3) / inside
    return mean, 3.0 * stats.chi2.cdf(square, 5) / inside - mean**2


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
