"""Draws at the start of every run as a table: turn-on errors of the IMU and initial errors, as standard normals.

Runs draw the same numbers in `simulation/sensing.py` and `kernels/processes.py`.
"""

from collections.abc import Iterator
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.random import normals, seed_words
from lvnav_trade.quantities.records import Bools
from lvnav_trade.simulation.preparation.prepare import PreparedCase

_ZERO = np.uint64(0)
INITIAL = ("initial attitude", "initial velocity", "initial position")


class InitialDraws(NamedTuple):
    """Draws of initial and turn-on errors.

    runs : (n_run,). Numbers of the runs.
    sources : (n_draw,). Names of the error sources.
    axes : (n_draw,). Axis of each draw: x, y or z.
    values : (n_run, n_draw). Standard normals, errors in units of their sigma.
    """

    runs: NDArray[np.int64]
    sources: tuple[str, ...]
    axes: tuple[str, ...]
    values: NDArray[np.float64]

    def pieces(self, n_run: int = 500) -> Iterator[Self]:
        """Yield the draws in blocks of `n_run` runs."""
        for first in range(0, len(self.runs), n_run):
            block = slice(first, first + n_run)
            yield self._replace(runs=self.runs[block], values=self.values[block])


def start_draws(prepared_case: PreparedCase, seed: int, n_run: int) -> InitialDraws:
    """Return the draws of initial and turn-on errors of runs 0 to n_run - 1; draws without effect are omitted.

    Draws depend on keys and not on an order, so these are the numbers of the simulation, without simulating.

    Parameters
    ----------
    prepared_case
        Prepared case.
    seed
        Seed of the campaign.
    n_run
        Number of runs.
    """
    sources: list[str] = []
    words: list[np.uint64] = []
    has_effect: list[Bools] = []  # by axis
    for term, word, sigma in zip(
        prepared_case.sources, prepared_case.unit.sources, prepared_case.unit.sigma, strict=True
    ):
        sources.append(term.name if term.term_index == 0 else f"{term.name} {term.term_index + 1}")
        words.append(word)
        has_effect.append(sigma > 0.0)
    for name, root, word in zip(
        INITIAL, prepared_case.initial_state.roots, prepared_case.initial_state.source_keys, strict=True
    ):
        if np.any(root):
            sources.append(name)
            words.append(word)
            has_effect.append(np.ones(3, dtype=bool))
    k0, k1 = seed_words(seed)
    values = np.empty((n_run, len(words), 3))
    _fill(values, np.array(words, dtype=np.uint64), k0, k1)
    is_effective = np.array(has_effect, dtype=bool).reshape(-1, 3)
    source_index, axis_index = np.nonzero(is_effective)
    return InitialDraws(
        runs=np.arange(n_run),
        sources=tuple(sources[k] for k in source_index),
        axes=tuple("xyz"[k] for k in axis_index),
        values=values[:, is_effective],
    )


@jit
def _fill(values: NDArray[np.float64], words: NDArray[np.uint64], k0: np.uint64, k1: np.uint64) -> None:
    """Set values (n_run, n_source, 3) to three standard normals of every source in every run."""
    for run in range(values.shape[0]):
        for k in range(words.shape[0]):
            n0, n1, n2, _ = normals(k0, k1, words[k], np.uint64(run), _ZERO, _ZERO)
            draw = values[run, k]
            draw[0] = n0
            draw[1] = n1
            draw[2] = n2
