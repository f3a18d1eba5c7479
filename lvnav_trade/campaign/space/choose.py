"""Which of many designs are analysed whole: some at random, the best, and those that runs are to decide."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.metrics.resources import dominating
from lvnav_trade.records import Floats, Ints

AT_RANDOM = 8
"""Designs drawn at random: linear covariance is checked with runs of these."""

Chosen = dict[str, list[int]]
"""Numbers of designs by why they are analysed whole."""


def chosen(table: pa.Table, campaign: Campaign) -> Chosen:
    """Return the designs of a campaign that are analysed whole, from the table of all of them.

    The best one; with a spot check some at random; with Monte Carlo those on the Pareto front, or those whose largest
    error is nearest to its limit.
    """
    case = np.array(table["case"].to_pylist())
    possible = np.flatnonzero(case != "")
    numbers = table["design_number"].to_numpy()
    ratio = _column(table, "error_ratio")
    found: Chosen = {"best": numbers[_best(table, possible, ratio)].tolist()}
    if campaign.covariance.spot_check:
        rng = np.random.default_rng([campaign.seed, len(possible)])
        drawn = rng.choice(possible, min(AT_RANDOM, len(possible)), replace=False)
        found["at random"] = numbers[np.sort(drawn)].tolist()
    card = campaign.monte_carlo
    if card is not None:
        wanted = front(table, possible) if card.cases == "front" else nearest(possible, ratio)
        found[card.cases or "undecided"] = numbers[wanted[: card.chosen_most]].tolist()
    return found


def _column(table: pa.Table, name: str) -> Floats:
    """Return a column of numbers; NaN throughout where there is none."""
    if name not in table.column_names:
        return np.full(table.num_rows, np.nan)
    return np.asarray(table[name].to_numpy(), dtype=float)


def _best(table: pa.Table, possible: Ints, ratio: Floats) -> Ints:
    """Return the row with the smallest error over its limit; without requirements that with the smallest velocity."""
    value = ratio if np.isfinite(ratio[possible]).any() else _column(table, "velocity_m_per_s")
    known = possible[np.isfinite(value[possible])]
    return known[np.argsort(value[known], kind="stable")][:1] if len(known) else possible[:1]


def nearest(possible: Ints, ratio: Floats) -> Ints:
    """Return the rows by how near the largest error is to its limit, the nearest first."""
    known = possible[np.isfinite(ratio[possible]) & (ratio[possible] > 0.0)]
    return known[np.argsort(np.abs(np.log(ratio[known])), kind="stable")]


def front(table: pa.Table, possible: Ints) -> Ints:
    """Return the rows on the Pareto front of the error over its limit and what the devices cost and need, the cheapest
    in error first.
    """
    names = ["error_ratio", "cost", "mass_kg", "power_w", "volume_m3"]
    columns = [_column(table, name)[possible] for name in names]
    used = [column for column in columns if np.isfinite(column).any()]
    if not used:
        return possible
    values = np.stack(used, axis=1)
    known = np.isfinite(values).all(axis=1)
    rows, values = possible[known], values[known]
    kept = np.array([dominating(values, k) < 0 for k in range(len(rows))], dtype=bool)
    return rows[kept][np.argsort(values[kept, 0], kind="stable")]
