"""A few Monte-Carlo runs of a case at the moments where linear covariance is most likely to be wrong."""

from typing import NamedTuple

import numpy as np

from lvnav_trade.engines.setup.prepare import Prepared
from lvnav_trade.engines.simulate.montecarlo import run_block
from lvnav_trade.engines.simulate.statistics import BlockSummary, summarise
from lvnav_trade.records import CovHistory

GAP = 5.0
"""Seconds without a measurement after which the next one is a moment of its own."""
AFTER_GAP = "first measurement at "
"""How the name of such a moment begins."""


def spot_check(prepared: Prepared, history: CovHistory, events: dict[str, float], seed: int, runs: int) -> BlockSummary:
    """Fly the first runs of a case and return their errors at the events and after every gap, as of any block.

    They have the draws of the campaign's own runs of these numbers.
    """
    block = run_block(prepared, seed, 0, runs)
    times = {name: t for name, t in events.items() if prepared.t_hist[0] <= t <= prepared.t_hist[-1]}
    return summarise(block, times | {gap.name: gap.end for gap in gaps(history)}, history.true_sigma, prepared.outputs)


class Gap(NamedTuple):
    """A stretch without measurements: name, begin, and the first history time with the measurement that ends it, s."""

    name: str
    begin: float
    end: float


def gaps(history: CovHistory) -> tuple[Gap, ...]:
    """Return the gaps of a flight: longer than `GAP` and three update intervals. The time before the first measurement
    is one. Their names hold their ends.
    """
    measured = np.flatnonzero(history.n_row > 0)
    if not measured.size:
        return ()
    t = history.t_epoch[measured]
    usual = float(np.median(np.diff(t))) if t.size > 1 else 0.0
    before = np.concatenate([history.t[:1], t[:-1]])
    long = t - before > max(GAP, 3.0 * usual)
    at = np.minimum(np.searchsorted(history.t, t[long] - 1e-9), history.t.size - 1)
    ends = history.t[at].tolist()
    return tuple(
        Gap(f"{AFTER_GAP}{end:g} s", begin, end) for begin, end in zip(before[long].tolist(), ends, strict=True)
    )
