"""Selection of designs for a full analysis: random designs, the best, and designs that runs are to decide."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.quantities.records import Floats, Ints
from lvnav_trade.results.evaluation.resources import dominating

AT_RANDOM = 8
"""Number of randomly drawn designs whose runs check linear covariance."""

Chosen = dict[str, list[int]]
"""Numbers of the selected designs, by reason."""


def chosen(table: pa.Table, campaign: Campaign) -> Chosen:
    """Select designs of a campaign for a full analysis, from the table of all designs.

    The selection has the best design; with a spot check random designs; with Monte Carlo the designs on the Pareto
    front, or those whose largest error is closest to its limit.
    """
    case = np.array(table["case"].to_pylist())
    possible = np.flatnonzero(case != "")
    numbers = table["design_number"].to_numpy()
    ratio = _column(table, "error_ratio")
    selected: Chosen = {"best": numbers[_best(table, possible, ratio)].tolist()}
    if campaign.covariance.spot_check:
        rng = np.random.default_rng([campaign.seed, len(possible)])
        drawn = rng.choice(possible, min(AT_RANDOM, len(possible)), replace=False)
        selected["at random"] = numbers[np.sort(drawn)].tolist()
    card = campaign.monte_carlo
    if card is not None:
        wanted = front(table, possible) if card.cases == "front" else nearest(possible, ratio)
        selected[card.cases or "undecided"] = numbers[wanted[: card.chosen_most]].tolist()
    return selected


def _column(table: pa.Table, name: str) -> Floats:
    """Return a column of numbers; all NaN if the table does not have it."""
    if name not in table.column_names:
        return np.full(table.num_rows, np.nan)
    return np.asarray(table[name].to_numpy(), dtype=float)


def _best(table: pa.Table, possible: Ints, ratio: Floats) -> Ints:
    """Return the row with the smallest ratio of error to limit; without requirements the smallest velocity error."""
    value = ratio if np.isfinite(ratio[possible]).any() else _column(table, "velocity_m_per_s")
    known = possible[np.isfinite(value[possible])]
    return known[np.argsort(value[known], kind="stable")][:1] if len(known) else possible[:1]


def nearest(possible: Ints, ratio: Floats) -> Ints:
    """Return the rows sorted by the distance of the largest error from its limit, as |log(error / limit)|."""
    known = possible[np.isfinite(ratio[possible]) & (ratio[possible] > 0.0)]
    return known[np.argsort(np.abs(np.log(ratio[known])), kind="stable")]


def front(table: pa.Table, possible: Ints) -> Ints:
    """Return the rows on the Pareto front of error and totals of the devices, sorted by the error over its limit."""
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
