"""How much less a nozzle moves: reductions of totals over paired runs, with their intervals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Floats = NDArray[np.float64]


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
