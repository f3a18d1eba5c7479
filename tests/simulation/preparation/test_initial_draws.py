"""The draws at the start of a run are those that the run flew with."""

from __future__ import annotations

import numpy as np

from lvnav_trade.kernels import processes
from lvnav_trade.kernels.random import seed_words
from lvnav_trade.simulation.preparation.initial_draws import INITIAL, start_draws
from tests.building import case


def test_they_are_the_parameters_that_the_unit_of_a_run_starts_with():
    prepared_case = case()
    found = start_draws(prepared_case, 7, 3)
    sigma = prepared_case.unit.sigma
    k0, k1 = seed_words(7)
    for run in range(3):
        values = np.zeros((len(sigma), 3))
        processes.start(values, sigma, prepared_case.unit.sources, k0, k1, np.uint64(run))
        drawn = values[sigma > 0.0] / sigma[sigma > 0.0]
        np.testing.assert_allclose(found.values[run, : drawn.size], drawn, rtol=1e-12)
    assert found.sources[drawn.size :: 3] == INITIAL


def test_every_draw_has_a_name_of_its_own_and_acts():
    prepared_case = case()
    found = start_draws(prepared_case, 7, 2)
    names = list(zip(found.sources, found.axes, strict=True))
    assert len(set(names)) == len(names) == found.values.shape[1]
    assert ("accelerometer scale factor", "x") in names
    assert ("accelerometer rate random walk", "x") not in names  # it starts at zero


def test_they_are_independent_standard_normals():
    values = start_draws(case(), 1, 4000).values
    n, m = values.shape
    assert np.abs(values.mean(axis=0)).max() < 4.5 / np.sqrt(n)
    correlation = np.corrcoef(values.T) - np.eye(m)
    assert np.abs(correlation).max() < 5.0 / np.sqrt(n)
    assert np.abs(values.var(axis=0) - 1.0).max() < 4.5 * np.sqrt(2.0 / n)


def test_a_longer_campaign_begins_with_the_same_draws():
    np.testing.assert_array_equal(start_draws(case(), 1, 9).values[:4], start_draws(case(), 1, 4).values)
