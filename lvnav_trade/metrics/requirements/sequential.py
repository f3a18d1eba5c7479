"""A verdict that may be looked for after every block of runs: exact binomial boundaries, one error for all looks."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy import stats

from lvnav_trade.metrics.basics.intervals import runs_needed
from lvnav_trade.records import Floats

_NEGLIGIBLE = 1e-18
_FURTHEST = 100_000
"""Looks ahead for the number of further runs; beyond them there is no telling."""


class Decision(NamedTuple):
    """met, violated or undecided; the runs after which it was decided, or else those looked at."""

    verdict: str
    runs: int


def spent(runs: int, probability: float, confidence: float) -> float:
    """Return how much of the error 1 - confidence may have been spent on looks after so many runs.

    n / (n + n0) of it, n0 the runs that would decide without a failure at a single look. It depends on neither the
    number of runs planned nor on how many there will be: a campaign may be made longer after it was looked at.
    """
    scale = runs_needed(0, probability, confidence)
    return (1.0 - confidence) * runs / (runs + scale)


class _Boundaries:
    """The numbers of failures that decide, look after look; found as far as they are asked for.

    Were the probability of success exactly the one asked for, the failures in n runs are binomial. `low` is the largest
    number at a look such that ever having been at or below it, at this look or before, has at most the probability
    spent; were the truth worse, that would be rarer still. `high`, the other way round, shows a violation. Each of the
    two holds whether or not one stops at the other.
    """

    def __init__(self, probability: float, confidence: float, block: int) -> None:
        self.asked = probability, confidence
        self.block = block
        self.low: list[int] = []
        self.high: list[int] = []
        self._step: Floats = stats.binom.pmf(np.arange(block + 1), block, 1.0 - probability)
        self._open = [(0, np.ones(1)), (0, np.ones(1))]  # fewest failures, probabilities of that many and more
        self._used = [0.0, 0.0]

    def to(self, looks: int) -> _Boundaries:
        """Return these boundaries with the first `looks` looks found."""
        while len(self.low) < looks:
            allowed = spent((len(self.low) + 1) * self.block, *self.asked)
            for side, found in enumerate((self.low, self.high)):
                first, mass = self._open[side]
                mass = np.convolve(mass, self._step)
                from_edge = np.cumsum(mass if side == 0 else mass[::-1])
                crossing = int(np.searchsorted(from_edge, allowed - self._used[side], side="right"))
                crossing = min(crossing, len(mass) - 1)  # something always stays open
                self._used[side] += float(from_edge[crossing - 1]) if crossing else 0.0
                if side == 0:
                    found.append(first + crossing - 1)
                    first, mass = first + crossing, mass[crossing:]
                else:
                    found.append(first + len(mass) - crossing)
                    mass = mass[: len(mass) - crossing]
                self._open[side] = self._trimmed(side, first, mass)
        return self

    def _trimmed(self, side: int, first: int, mass: Floats) -> tuple[int, Floats]:
        """Drop what is too improbable to matter, on the side of what is spent."""
        kept = np.flatnonzero(mass > _NEGLIGIBLE)
        if not len(kept):
            return first, mass
        cut = mass[kept[0] : kept[-1] + 1]
        self._used[side] += float(mass.sum() - cut.sum())
        return first + int(kept[0]), cut


@lru_cache(maxsize=64)
def _boundaries(probability: float, confidence: float, block: int) -> _Boundaries:
    return _Boundaries(probability, confidence, block)


def boundaries(probability: float, confidence: float, block: int, looks: int) -> tuple[list[int], list[int]]:
    """Return for each look, after block, 2 block, ... runs: failures up to which the requirement is met (-1: none are
    few enough), and failures from which it is violated.
    """
    known = _boundaries(probability, confidence, block).to(looks)
    return known.low[:looks], known.high[:looks]


def decide(failures: Sequence[int], probability: float, confidence: float, block: int) -> Decision:
    """Return the verdict of the first look that decides; `failures` (n_look,) are those of all runs up to each look."""
    low, high = boundaries(probability, confidence, block, len(failures))
    for look, count in enumerate(failures):
        if count <= low[look]:
            return Decision("met", (look + 1) * block)
        if count >= high[look]:
            return Decision("violated", (look + 1) * block)
    return Decision("undecided", len(failures) * block)


def further_runs(failures: Sequence[int], probability: float, confidence: float, block: int) -> int:
    """Return how many further runs, all of them good, would show that a requirement is met that is still undecided."""
    known = _boundaries(probability, confidence, block)
    count, look = (failures[-1] if len(failures) else 0), len(failures)
    while look < _FURTHEST and count > known.to(look + 1).low[look]:
        look += 1
    return (min(look + 1, _FURTHEST) - len(failures)) * block
