"""Monte Carlo of a case of any kind: run_block(prepared, seed, first_run, n_run) -> RunBlock, replay."""

from __future__ import annotations

from lvnav_trade.engines import montecarlo, reported
from lvnav_trade.engines.prepare import Prepared, prepare
from lvnav_trade.records import RunBlock


def run_block(prepared: Prepared, seed: int, first_run: int, n_run: int) -> RunBlock:
    """Fly runs first_run to first_run + n_run - 1, with all that is reported of them."""
    return reported.beside_runs(prepared, seed, montecarlo.run_block(prepared, seed, first_run, n_run))


def replay(prepared: Prepared, seed: int, run: int) -> RunBlock:
    """Fly one run again, bit for bit as in its block, with every covariance step recorded: `montecarlo.replay`."""
    finer = prepare(prepared.scenario, every_step_beside=prepared.t_hist)
    return reported.beside_runs(finer, seed, montecarlo.replay(prepared, seed, run))
