"""Simulated seconds per wall second and core: identical work (covariance at 200 Hz), and the default setting (10 Hz)
with an extended, an iterated and an unscented filter.
"""

from __future__ import annotations

from benchmarks.common import best, scenario
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.prepare import PreparedCase, prepare

RUNS = 16


def speed(prepared_case: PreparedCase, runs: int = RUNS) -> float:
    """Return simulated seconds per wall second on one core, compilation excluded."""
    seconds = float(prepared_case.reference.t[-1] - prepared_case.reference.t[0])
    return runs * seconds / best(lambda: run_block(prepared_case, 1, 0, runs))


def measure() -> dict[str, float]:
    """Return the speed of the default setting, of the identical work, and of other filters with their cost."""
    default, unscented = prepare(scenario()), prepare(scenario("base.filter.algorithm=unscented"))
    iterated = prepare(scenario("base.filter.algorithm=iterated"))
    identical = prepare(scenario("base.filter.covariance_rate=200 Hz"))
    found = {
        "default_sim_s_per_s_core": speed(default),
        "identical_sim_s_per_s_core": speed(identical),
        "unscented_sim_s_per_s_core": speed(unscented),
        "iterated_sim_s_per_s_core": speed(iterated),
    }
    costs = {
        f"{name}_cost_ratio": found["default_sim_s_per_s_core"] / found[f"{name}_sim_s_per_s_core"]
        for name in ("unscented", "iterated")
    }
    return found | costs
