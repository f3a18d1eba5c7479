"""Two workers over one: blocks of runs through joblib, as a campaign does it."""

from __future__ import annotations

import time

from joblib import Parallel, delayed

from benchmarks.common import scenario
from lvnav_trade.engines.montecarlo import run_block
from lvnav_trade.engines.prepare import prepare
from lvnav_trade.scenario import Scenario

BLOCKS, RUNS = 64, 40


def _block(one: Scenario, first: int) -> float:
    return float(run_block(prepare(one), 1, first, RUNS).nis.sum())


def _seconds(jobs: int) -> float:
    one = scenario()
    with Parallel(n_jobs=jobs) as pool:
        pool(delayed(_block)(one, 0) for _ in range(6 * jobs))  # every worker loads its kernels and builds the flight
        start = time.perf_counter()
        pool(delayed(_block)(one, RUNS * k) for k in range(BLOCKS))
        return time.perf_counter() - start


def measure() -> dict[str, float]:
    """Return how much faster two workers fly the same blocks than one."""
    return {"two_workers_over_one": _seconds(1) / _seconds(2)}
