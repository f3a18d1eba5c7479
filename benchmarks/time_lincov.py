"""Linear covariance: one case with every source at every event, and a sweep of 100 cases with the adjoint at
injection.
"""

from __future__ import annotations

import time

from joblib import Parallel, delayed

from benchmarks.common import best, scenario
from lvnav_trade.covariance.history import adjoint, covariance
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.prepare import prepare

CASES = 100


def _case(one: Scenario) -> float:
    prepared_case = prepare(one)
    budget = adjoint(prepared_case, prepared_case.trajectory.events["injection"])
    return float(covariance(prepared_case).true_sigma[-1, 3] + budget.contribution.sum())


def sweep(jobs: int, n_case: int = CASES) -> float:
    """Return wall seconds of a sweep over the accelerometers' bias: true and formal covariance, adjoint at
    injection.
    """
    found = [scenario(f"base.imu.accel.bias_repeatability={0.1 + 0.02 * k} mg") for k in range(n_case)]
    with Parallel(n_jobs=jobs) as pool:
        pool(delayed(_case)(one) for one in found[:jobs])  # workers start, kernels load, the trajectory is built
        start = time.perf_counter()
        pool(delayed(_case)(one) for one in found)
        return time.perf_counter() - start


def measure() -> dict[str, float]:
    """Return seconds of one rich case on one core (all rows of the card, 44 states) and of the sweep on two."""
    sets = ("base.imu=imu/tactical_mems", "base.filter=filters/tight_extended")
    rich = prepare(scenario(*sets))
    return {"lincov_one_rich_case_s": best(lambda: covariance(rich), 2), "lincov_100_cases_s": sweep(2)}
