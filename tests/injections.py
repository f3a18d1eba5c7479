"""Injections of eight runs with known numbers: six reach their cut-off, one is empty before, one has no navigation."""

from __future__ import annotations

import numpy as np
import pandas as pd

from lvnav_trade.engines.simulate.statistics import summarise
from lvnav_trade.records import ORBIT, OUTCOMES
from lvnav_trade.store.read import Tables
from lvnav_trade.store.runs import ORBIT_UNITS, run_columns
from tests import synthetic

SIZES = np.array([1e3, 2e3, 2e3, 1e-4, 1e-4, 1e-3, 2e-3])


def rows() -> np.ndarray:
    """Return the rows of `RunBlock.injections` of eight runs."""
    draws = np.random.default_rng(4)
    outcome = [OUTCOMES.index("injected")] * 6 + [OUTCOMES.index("depleted"), OUTCOMES.index("navigation failed")]
    head = np.stack([outcome, 500.0 + np.arange(8), 10.0 * np.arange(8)], axis=1)
    error, knowledge, navigation = draws.standard_normal((3, 8, len(ORBIT))) * SIZES
    return np.concatenate([head, error, 0.1 * knowledge, 0.5 * navigation], axis=1)


def with_injections(tables: Tables) -> Tables:
    """Return results of eight runs as if the first case were guided."""
    cov = synthetic.covariance()
    block = synthetic.block(cov, 0, 8)._replace(injections=rows())
    summary = summarise(block, synthetic.EVENTS, cov.true_sigma, synthetic.OUTPUTS)
    columns = run_columns(synthetic.OUTPUTS, summary)["injections"]
    case = synthetic.CASES[0][0].id
    budget = pd.DataFrame(
        [
            {"case": case, "source": source, "quantity": name, "unit": ORBIT_UNITS[name], "sigma_si": sigma}
            for source, sizes in (("thrust", SIZES), ("dry_mass", 0.1 * SIZES))
            for name, sigma in zip(ORBIT, sizes, strict=True)
        ]
    )
    frame = pd.DataFrame({"case": case, **columns})
    return tables.with_frames(injections=frame, injection_budget=budget)
