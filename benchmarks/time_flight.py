"""Simulated seconds per wall second and core: identical work (covariance at 200 Hz) and the default setting (10 Hz)."""

from __future__ import annotations

from benchmarks.common import best, scenario
from lvnav_trade.engines.setup.prepare import Prepared, prepare
from lvnav_trade.engines.simulate.montecarlo import run_block

RUNS = 16


def speed(prepared: Prepared, runs: int = RUNS) -> float:
    """Return simulated seconds per wall second on one core, compilation excluded."""
    seconds = float(prepared.reference.t[-1] - prepared.reference.t[0])
    return runs * seconds / best(lambda: run_block(prepared, 1, 0, runs))


def measure() -> dict[str, float]:
    """Return the speed of the default setting and of the identical work."""
    default = prepare(scenario())
    identical = prepare(scenario("base.filter.covariance_rate=200 Hz"))
    return {"default_sim_s_per_s_core": speed(default), "identical_sim_s_per_s_core": speed(identical)}
