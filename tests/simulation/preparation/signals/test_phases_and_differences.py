"""Which differences there are: epochs at which a satellite is new, away, interrupted, or repeated."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lvnav_trade.simulation.preparation.signals.phases_and_differences import phase_continuity, wavelength
from tests.building import loaded

N = 6


def sky(breaks=()):
    """One satellite, whose carrier was interrupted before some epochs."""
    continuous = np.ones((N, 1), bool)
    continuous[[0, *breaks]] = False
    return SimpleNamespace(is_tracked=np.ones((N, 1), bool), continuous=continuous)


def signals(used=range(N), frozen=()):
    """Epochs at which it is used, and at which the output stands still."""
    n_used, still = np.zeros(N, dtype=int), np.zeros(N, bool)
    n_used[list(used)], still[list(frozen)] = 1, True
    return SimpleNamespace(satellite_by_slot=np.zeros((N, 1), dtype=int), n_used=n_used, is_frozen=still)


def epochs(*masks):
    return [np.flatnonzero(mask[:, 0]).tolist() for mask in masks]


@pytest.mark.parametrize(
    ("seen", "taken", "restart", "before", "going_on"),
    [
        (sky(), signals(), [0], [1, 2, 3, 4, 5], [1, 2, 3, 4, 5]),
        (sky(breaks=[3]), signals(), [0, 3], [1, 2, 3, 4, 5], [1, 2, 4, 5]),
        # not used for an epoch: the phase goes on, but there is no difference over two intervals
        (sky(), signals(used=[0, 1, 3, 4, 5]), [0], [1, 4, 5], [1, 4, 5]),
        # interrupted while it was not used: new when it is used again
        (sky(breaks=[2]), signals(used=[0, 1, 3, 4, 5]), [0, 3], [1, 4, 5], [1, 4, 5]),
        # an output that stands still repeats itself, and what was interrupted behind it is new afterwards
        (sky(), signals(frozen=[2, 3]), [0], [1, 2, 3, 4, 5], [1, 2, 3, 4, 5]),
        (sky(breaks=[3]), signals(frozen=[2, 3]), [0, 4], [1, 2, 3, 4, 5], [1, 2, 3, 5]),
    ],
    ids=["always", "interrupted", "away", "interrupted while away", "frozen", "interrupted while frozen"],
)
def test_a_difference_needs_both_epochs_and_a_phase_that_went_on(seen, taken, restart, before, going_on):
    assert epochs(*phase_continuity(seen, taken)) == [restart, before, going_on]


def test_the_carrier_is_l1_unless_a_link_says_otherwise():
    assert wavelength(loaded()) == pytest.approx(0.190293673, rel=1e-8)
