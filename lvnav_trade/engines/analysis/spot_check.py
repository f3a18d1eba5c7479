"""A few Monte-Carlo runs of a case at the moments where linear covariance is most likely to be wrong."""

from typing import NamedTuple

import numpy as np
from scipy.special import erfc, gammainc, gammaincc

from lvnav_trade.engines.setup.prepare import Prepared
from lvnav_trade.engines.simulate.montecarlo import run_block
from lvnav_trade.engines.simulate.statistics import BlockSummary, merge, summarise
from lvnav_trade.kernels.covariance import N_NAV_ERROR
from lvnav_trade.kernels.vector import WIDTH
from lvnav_trade.records import CovHistory, Floats

GAP = 5.0
"""Seconds without a measurement after which the next one is a moment of its own."""
AFTER_GAP = "first measurement at "
"""How the name of such a moment begins."""


SUSPECT = 0.2
"""Level, over all errors of a case at all its moments, at which its first runs call for the others."""


def spot_check(prepared: Prepared, history: CovHistory, events: dict[str, float], seed: int, runs: int) -> BlockSummary:
    """Fly runs of a case and return their errors at the events and after every gap, as of any block.

    Half of the runs are flown first, the others only where an error of these is larger or smaller than expected.
    They have the draws of the campaign's own runs of these numbers.
    """
    times = {name: t for name, t in events.items() if prepared.t_hist[0] <= t <= prepared.t_hist[-1]}
    times |= {gap.name: gap.end for gap in gaps(history)}

    def flown(first: int, count: int) -> BlockSummary:
        return summarise(run_block(prepared, seed, first, count), times, history.true_sigma, prepared.outputs)

    half = WIDTH * -(-runs // (2 * WIDTH))
    begun = flown(0, min(half, runs))
    if half >= runs or not _suspect(begun, history):
        return begun
    return merge([begun, flown(half, runs - half)])


def _suspect(found: BlockSummary, history: CovHistory) -> bool:
    """Whether a navigation error of some runs is no draw of linear covariance's, at level `SUSPECT` for all together:
    its mean square about the mean, by chi-square, or its largest one, by the Gaussian.
    """
    at = np.searchsorted(history.t, found.t_event - 1e-9)
    sigma, mean = (each[at, :N_NAV_ERROR] for each in (history.true_sigma, history.mean))
    with np.errstate(divide="ignore", invalid="ignore"):
        z: Floats = (found.event_error[:, :, :N_NAV_ERROR] - mean) / sigma
    z = z[:, sigma > 0.0]
    if not z.size:
        return False
    if not np.isfinite(z).all():
        return True  # a run failed
    n, n_row = z.shape
    half = 0.5 * np.sum(z**2, axis=0)
    chances = 2.0 * np.minimum(gammainc(0.5 * n, half), gammaincc(0.5 * n, half))
    largest = n * erfc(np.abs(z).max() / np.sqrt(2.0))
    return bool(min(chances.min(), largest) < SUSPECT / n_row)


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
