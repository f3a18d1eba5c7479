"""Injections of eight runs with known numbers: six reach their cut-off, one is empty before, one has no navigation.
Linear covariance of the same, with known sigmas by source.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import ORBIT, OUTCOMES, InjectionLaw
from lvnav_trade.results.tables.diagnostics_tables import injection_rows
from lvnav_trade.results.tables.read import Tables
from lvnav_trade.results.tables.run_tables import run_columns
from lvnav_trade.simulation.statistics import summarise
from tests import synthetic

SIZES = np.array([1e3, 2e3, 2e3, 1e-4, 1e-4, 1e-3, 2e-3])


LOST = np.array([[6, 0, 1, -2.5], [6, 1, 0, 0.3], [6, 1, 1, -3.1], [7, 0, 0, 0.1]])
"""Draws of the two runs that are lost: of thrust and specific impulse, by stage."""


def rows() -> np.ndarray:
    """Return the rows of `RunBlock.injections` of eight runs."""
    draws = np.random.default_rng(4)
    outcome = [OUTCOMES.index("injected")] * 6 + [OUTCOMES.index("depleted"), OUTCOMES.index("navigation failed")]
    head = np.stack([outcome, 500.0 + np.arange(8), 10.0 * np.arange(8)], axis=1)
    error, knowledge = draws.standard_normal((2, 8, len(ORBIT))) * SIZES
    return np.concatenate([head, error, 0.1 * knowledge], axis=1)


def with_injections(tables: Tables) -> Tables:
    """Return results of eight runs as if the first case were guided."""
    cov = synthetic.covariance()
    block = synthetic.block(cov, 0, 8)._replace(injections=rows(), lost_draws=LOST)
    summary = summarise(block, synthetic.EVENTS, cov.true_sigma, synthetic.OUTPUTS)
    case = synthetic.CASES[0][0].id
    columns = run_columns(synthetic.OUTPUTS, summary)
    frames = {name: pd.DataFrame({"case": case, **columns[name]}) for name in ("injections", "failed_injection_draws")}
    expected = injection_rows(law())
    frames |= {name: pd.DataFrame([{"case": case, **row} for row in rows]) for name, rows in expected.items()}
    return tables.with_frames(**frames)


SOURCES = {"gyro bias": 0.5, "accelerometer bias": 0.1, "thrust": 1.0, "dry mass": 0.1}
"""Sources of linear covariance, two of navigation and two of the vehicle, with their sigmas as shares of `SIGMAS`."""
SIGMAS = np.append(SIZES, [0.2, 5.0])
REFERENCE = np.array([6.9e6, 4.0e5, 6.4e5, 0.01, 0.015, 1.7, 0.5, 503.0, 60.0])


def law(**changes: Any) -> InjectionLaw:
    """Return linear covariance of an injection whose numbers are independent of one another."""
    covariance = np.array([np.diag((share * SIGMAS) ** 2) for share in SOURCES.values()])
    variance = np.diagonal(covariance, axis1=1, axis2=2)[:, : len(ORBIT)]
    of_navigation = np.array([1.0, 1.0, 0.0, 0.0])[:, None]
    found = InjectionLaw(
        reference=REFERENCE,
        target=REFERENCE[: len(ORBIT)],
        mean=np.append(0.1 * SIZES, REFERENCE[len(ORBIT) :]),
        second_order=np.zeros(len(SIGMAS)),
        sources=tuple(SOURCES),
        n_navigation=2,
        covariance=covariance,
        knowledge=of_navigation * variance,
        execution=(1.0 - of_navigation) * variance,
    )
    return found._replace(**changes)
