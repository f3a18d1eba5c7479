"""Are the innovations white: autocorrelation at lags 1 to 10 and one portmanteau test per channel."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

from lvnav_trade.metrics.basics.intervals import holm
from lvnav_trade.store import Tables, load

ALPHA = 0.01
_LEAST_PAIRS = 100
"""Channels with fewer pairs say nothing: a satellite seen for a few epochs."""


def autocorrelation(results: Path | str | Tables) -> pd.DataFrame:
    """Return the autocorrelation of each channel: case, channel, lag_number, pair_count, autocorrelation_ratio."""
    tables = load(results)
    rows = tables.whiteness
    mean = rows.product_sum_ratio / rows.pair_count.where(rows.pair_count > 0)
    zero = mean.where(rows.lag_number == 0).groupby([rows.case, rows.channel], sort=False).transform("max")
    found = rows[["case", "channel", "lag_number", "pair_count"]].assign(autocorrelation_ratio=mean / zero)
    return found.assign(case=found.case.map(tables.labels))


def whiteness(results: Path | str | Tables) -> pd.DataFrame:
    """Return one row per case and channel.

    Columns: case, channel, pair_count (least of the lags), largest_ratio (autocorrelation of largest size),
    largest_lag_number, portmanteau_ratio (sum of n r^2 over lags 1 to 10, chi-square with as many degrees of freedom
    for white innovations), p_ratio, p_holm_ratio (for all channels of the case together), white (at alpha 0.01).
    """
    found = []
    for (case, channel), group in autocorrelation(results).groupby(["case", "channel"], sort=False):
        lags = group[group.lag_number > 0]
        if lags.pair_count.min() < _LEAST_PAIRS or lags.autocorrelation_ratio.isna().any():
            continue
        r = lags.autocorrelation_ratio.to_numpy()
        worst = int(np.argmax(np.abs(r)))
        statistic = float(np.sum(lags.pair_count.to_numpy() * r**2))
        found.append(
            {
                "case": case,
                "channel": channel,
                "pair_count": int(lags.pair_count.min()),
                "largest_ratio": float(r[worst]),
                "largest_lag_number": int(lags.lag_number.iloc[worst]),
                "portmanteau_ratio": statistic,
                "p_ratio": float(stats.chi2.sf(statistic, len(r))),
            }
        )
    names = ["case", "channel", "pair_count", "largest_ratio", "largest_lag_number", "portmanteau_ratio", "p_ratio"]
    frame = pd.DataFrame(found, columns=names)
    adjusted = frame.groupby("case", sort=False).p_ratio.transform(holm) if len(frame) else frame.p_ratio
    return frame.assign(p_holm_ratio=adjusted, white=adjusted >= ALPHA)
