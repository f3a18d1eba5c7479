"""What stretches of flight tell of a filter's states, case by case: ranks, and what tells a position from its bias."""

from __future__ import annotations

import numpy as np
import pandas as pd

from lvnav_trade.store import Tables

NUMERICAL = 1e-10
"""Of the largest singular value: what is below is lost to rounding."""
COLUMNS = [
    "case", "stretches", "states", "least_rank", "least_rank_with_information", "smallest_ratio",
    "position_against_bias_ratio", "weakest",
]  # fmt: skip


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
    return pd.DataFrame(rows, columns=COLUMNS)


def is_position_bias(direction: str) -> bool:
    """Say whether a direction in words is one in which a position trades with its bias."""
    names = [part.split(" ", 1)[1] for part in direction.split(", ") if " " in part]
    of_bias = any(name.startswith("position bias") for name in names)
    return of_bias and all(name.startswith("position") for name in names)
