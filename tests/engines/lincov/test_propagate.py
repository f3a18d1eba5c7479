"""How true parameters enter the filter's error over a window; the whole pass is tested with engines.lincov."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.engines.cover import fill_inputs
from lvnav_trade.engines.truth import source_names, true_model
from lvnav_trade.filters.belief import transition_blocks
from lvnav_trade.kernels.strapdown import N_SUM, SUM_C, SUM_F, SUM_TH, SUM_V
from lvnav_trade.kernels.transition import fill
from lvnav_trade.layout import ParameterBlock
from tests.building import case

SECONDS = 0.1
CASE = case()
TRUE = true_model(CASE, source_names(CASE))


def window_sums():
    sums = np.zeros(N_SUM)
    sums[SUM_C : SUM_C + 9] = SECONDS * np.eye(3).ravel()
    sums[SUM_V : SUM_V + 3], sums[SUM_TH : SUM_TH + 3], sums[SUM_F : SUM_F + 3] = (
        (3, 1, -2),
        (1e-2, 2e-2, 3e-2),
        (3, 1, -2),
    )
    return sums


def inputs(j, decay):
    n = CASE.layout.n_state
    b, g = np.full((3, n), np.nan), np.full((3, n), np.nan)
    fill_inputs(b, g, np.zeros(9), j, TRUE, window_sums(), SECONDS, decay, 0.9)
    return b, g


@pytest.mark.parametrize("j", np.flatnonzero(TRUE.matched >= 0))
def test_a_parameter_that_the_filter_carries_enters_by_the_difference_of_the_two_decays(j):
    at, n = TRUE.matched[j], CASE.layout.n_state
    decay = np.ones(n)
    decay[at : at + 3] = 0.7
    b, g = inputs(j, decay)
    np.testing.assert_allclose(b[:, at : at + 3], 0.2 * np.eye(3), atol=1e-15)
    np.testing.assert_array_equal(g[:, at : at + 3], np.eye(3))
    assert np.count_nonzero(b) == np.count_nonzero(g) == 3


@pytest.mark.parametrize("j", np.flatnonzero(TRUE.matched < 0))
def test_a_parameter_that_the_filter_does_not_carry_enters_as_the_blocks_of_the_transition(j):
    b, g = inputs(j, np.ones(CASE.layout.n_state))
    stand_in = (ParameterBlock("any", 0, 9, int(TRUE.sensor[j]), int(TRUE.driver[j]), 0.0, 0.0, 0.0),)
    rows, columns, kinds, drivers = transition_blocks(stand_in, 2)
    blocks, phi = np.zeros((rows.size, 9)), np.eye(12)
    fill(blocks, kinds, drivers, window_sums(), 7e6, 0.0, 0.0, SECONDS)
    for row, column, block in zip(rows, columns, blocks, strict=True):
        phi[row : row + 3] += block.reshape(3, 3) @ phi[column : column + 3]
    np.testing.assert_allclose(b[:, :9].T, phi[:9, 9:], rtol=1e-13)
    assert not b[:, 9:].any()
    assert not g.any()
