"""How much less a nozzle moves: reductions of totals over paired runs, with their intervals; motion in envelopes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from lvnav_trade.metrics.basics.select import pick
from lvnav_trade.store import Tables

Floats = NDArray[np.float64]
_DEG_H = 206264.80624709636


class Reduction(NamedTuple):
    """Part by which totals are lower, with its interval; each a number per column."""

    part: Floats
    low: Floats
    high: Floats


def reduction(base: Floats, lower: Floats, alpha: float = 0.05) -> Reduction:
    """Return by what part the totals `lower` (n_run, k) are below `base` (n_run, k), runs paired by their draws.

    One minus the geometric mean of the runs' ratios; its interval is Student's t on their logarithms. What differs from
    run to run and not between the two of a pair, such as the wind, cancels. ValueError for fewer than two runs.
    """
    if len(base) != len(lower) or len(base) < 2:
        raise ValueError(f"{len(base)} and {len(lower)} runs: a paired comparison needs two or more of each, alike")
    ratio = np.log(lower / base)
    mean, n = ratio.mean(axis=0), len(ratio)
    reach = float(stats.t.isf(alpha / 2.0, n - 1)) * ratio.std(axis=0, ddof=1) / np.sqrt(n)
    return Reduction(1.0 - np.exp(mean), 1.0 - np.exp(mean + reach), 1.0 - np.exp(mean - reach))


COLUMNS = [
    "case", "burn", "axis", "runs", "raw_deg", "filtered_deg", "true_deg", "less_percent", "low_percent",
    "high_percent",
]  # fmt: skip


def nozzle(tables: Tables, alpha: float = 0.05) -> pd.DataFrame:
    """Return mean movements of the nozzle (deg) by what feeds the controller, and by how much less (%) it moves with
    the filtered than with the raw rate, with the interval of paired runs; per burn, and over the flight.

    A burn in which every run's nozzle is at rest, and a single run, have no reduction.
    """
    rows = []
    for (case, burn, axis), one in tables.nozzle.groupby(["case", "burn", "axis"], sort=False):
        moved = one.pivot(index="run_number", columns="feed", values="moved_rad")
        less: tuple[float, ...] = (np.nan, np.nan, np.nan)
        if len(moved) > 1 and bool((moved > 0.0).all(axis=None)):
            found = reduction(moved[["raw"]].to_numpy(), moved[["filtered"]].to_numpy(), alpha)
            less = tuple(100.0 * float(part[0]) for part in found)
        means = [float(np.degrees(moved[feed].mean())) for feed in ("raw", "filtered", "true")]
        rows.append((tables.labels[str(case)], burn, axis, len(moved), *means, *less))
    return pd.DataFrame(rows, columns=COLUMNS)


def worth(tables: Tables) -> pd.DataFrame:
    """Return what the filtered rate gains a controller over the flight, case by case and axis by axis.

    Movement of the nozzle and less_percent as in `nozzle`; possible_percent: how much less the nozzle moves with the
    true rate, the most that any filter can gain; *_error_mrad: root mean square of the attitude's error in burns.
    """
    moved, errors = pick(nozzle(tables), burn="flight"), pick(turning(tables), phase="burn")
    moved = moved.drop(columns=["burn", "runs"]).reset_index(drop=True)
    moved["possible_percent"] = 100.0 * (1.0 - moved.true_deg / moved.raw_deg.where(moved.raw_deg > 0.0))
    wide = errors.pivot_table(index=["case", "axis"], columns="feed", values="attitude_error_mrad")
    wide = wide.reindex(columns=["raw", "filtered", "true"]).add_suffix("_error_mrad")
    return moved.join(wide, on=["case", "axis"])


def turning(tables: Tables) -> pd.DataFrame:
    """Return how often and how far true angular acceleration and jerk leave their envelopes (% of ticks, times), and
    attitude and rate errors, by what feeds the controller, axis and phase.
    """
    rows = tables.turning
    return rows[["case", "feed", "axis", "phase"]].assign(
        case=rows.case.map(tables.labels),
        turning_inside_percent=100.0 * rows.inside_turning_ratio,
        turning_furthest_times=rows.furthest_turning_ratio,
        jerk_inside_percent=100.0 * rows.inside_jerk_ratio,
        jerk_furthest_times=rows.furthest_jerk_ratio,
        attitude_error_mrad=1e3 * rows.attitude_error_rad,
        rate_error_deg_per_h=_DEG_H * rows.rate_error_rad_per_s,
        rate_sigma_deg_per_h=_DEG_H * rows.rate_sigma_rad_per_s,
    )
