"""A filter that neglects scale factor and g-sensitivity: optimistic, and known to be so by linear covariance."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from lvnav_trade.covariance.history import covariance
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import ascent

RUNS, BLOCK, ALPHA = 2000, 200, 0.01


@pytest.mark.slow
def test_true_covariance_agrees_with_2000_runs_at_every_event_while_the_filter_is_optimistic():
    case = ascent("base.imu=imu/tactical_mems")
    history, square = covariance(case), 0.0
    for first in range(0, RUNS, BLOCK):
        square = square + np.sum(run_block(case, 20261121, first, BLOCK).err[:, :, :9] ** 2, axis=0)
    at = [int(np.argmin(np.abs(case.t_hist - t))) for t in case.trajectory.events.values()]
    expected = history.true_sigma[at, :9] ** 2 + history.mean[at, :9] ** 2
    # The mean is a few percent of sigma, so the ratio is chi-square with as many degrees of freedom as runs; the level
    # is shared among all components and events.
    tail = ALPHA / 2 / expected.size
    low, high = chi2.ppf([tail, 1.0 - tail], RUNS) / RUNS
    ratio = square[at] / RUNS / expected
    assert np.all((ratio > low) & (ratio < high)), ratio.round(3)
    injection = int(np.argmin(np.abs(case.t_hist - case.trajectory.events["injection"])))
    optimism = np.linalg.norm(history.true_sigma[injection, 3:6]) / np.linalg.norm(history.formal_sigma[injection, 3:6])
    assert optimism > 1.3
