"""What it costs to correct the error of the injection, by linear covariance and by the runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lvnav_trade.metrics.basics.once import once
from lvnav_trade.metrics.mechanics import impulses, mission
from lvnav_trade.metrics.mission.orbit import orbital_states
from lvnav_trade.store import Tables, load

COLUMNS = [
    "case", "event", "unit", "by", "count", "mean", "q50", "q95", "q99", "velocity_q99", "position_q99",
]  # fmt: skip

_DRAWS = 2**10


@once
def correction(results: Path | str | Tables) -> pd.DataFrame:
    """Return the least delta-v that brings the estimated orbit to the true one, at the last event of `orbit`.

    The least sum of impulses, anywhere in one revolution and linear in the error, that nulls the errors of semi-major
    axis, eccentricity, perigee, inclination and node (see `impulses`); the place along the orbit is left. by "linear
    covariance": draws of its Gaussian; by "Monte Carlo": the runs that did not fail. q50, q95, q99: quantiles;
    velocity_q99, position_q99: the last if only the error of velocity, or of position, were there. In an orbit that
    steers by the estimate it is what a perfect orbit determination would find to be corrected.
    """
    tables = load(results)
    rows = []
    for case, label in tables.labels.items():
        for state in orbital_states(tables, case)[-1:]:
            law = mission.law_at(tables, case, state.event)
            error, failed = mission.run_errors(tables, case, state)
            samples = {"linear covariance": mission.draws(law.mean, law.true, _DRAWS)} if law is not None else {}
            samples |= {"Monte Carlo": error[~failed]} if (~failed).any() else {}
            for by, drawn in samples.items():
                head = {"case": label, "event": state.event, "unit": "m/s", "by": by, "count": len(drawn)}
                rows.append(head | _quantiles(state, drawn))
    return pd.DataFrame(rows, columns=COLUMNS)


def _quantiles(state: mission.State, error: NDArray[np.float64]) -> dict[str, float]:
    keep = {"": np.ones(6), "velocity_": np.repeat([1.0, 0.0], 3), "position_": np.repeat([0.0, 1.0], 3)}
    sizes = {what: impulses.least_at(state.r_i, state.v_i, error * kept).delta_v for what, kept in keep.items()}
    found = {f"q{percent}": float(np.quantile(sizes[""], percent / 100.0)) for percent in (50, 95, 99)}
    parts = {f"{what}q99": float(np.quantile(sizes[what], 0.99)) for what in ("velocity_", "position_")}
    return {"mean": float(sizes[""].mean()), **found, **parts}
