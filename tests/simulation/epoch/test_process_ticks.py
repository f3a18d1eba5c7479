"""Samples of the IMU as measurements: the filter's own covariance is one computation for both engines."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.covariance.history import covariance
from lvnav_trade.simulation.epoch.process import sample_window
from lvnav_trade.simulation.montecarlo import run_block
from tests.both_engines.modelled import MODEL, PUBLISHED, modelled


@pytest.mark.slow  # two large kernels
def test_samples_leave_the_same_covariance_in_a_run_and_on_the_nominal_flight():
    assert callable(sample_window)
    prepared_case = modelled(MODEL, PUBLISHED)
    history, block = covariance(prepared_case), run_block(prepared_case, 5, 0, 8)
    early = history.t <= 3.0  # before estimates differ from the truth by much
    ratio = block.sigma[:, early].mean(axis=0) / history.formal_sigma[early]
    assert np.abs(ratio - 1.0).max() < 2e-2
