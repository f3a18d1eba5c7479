"""How a parameter enters attitude, velocity and position over a window."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.covariance.component_inputs import input_matrix
from lvnav_trade.covariance.components import build_components
from lvnav_trade.filter.model import transition_blocks
from lvnav_trade.kernels.strapdown import N_SUM, SUM_C, SUM_F, SUM_TH, SUM_V
from lvnav_trade.kernels.transition import fill
from lvnav_trade.quantities.state_layout import ErrorTerm
from tests.building import case

SECONDS = 0.1
CASE = case()
TRUE = build_components(CASE)


def window_sums():
    sums = np.zeros(N_SUM)
    sums[SUM_C : SUM_C + 9] = SECONDS * np.eye(3).ravel()
    sums[SUM_V : SUM_V + 3], sums[SUM_TH : SUM_TH + 3], sums[SUM_F : SUM_F + 3] = (
        (3, 1, -2),
        (1e-2, 2e-2, 3e-2),
        (3, 1, -2),
    )
    return sums


@pytest.mark.parametrize("j", np.flatnonzero(TRUE.filter_state < 0))
def test_a_parameter_that_the_filter_does_not_carry_enters_as_the_blocks_of_the_transition(j):
    b = np.full((9, 3), np.nan)
    input_matrix(b, np.zeros(9), j, TRUE, window_sums(), SECONDS)
    stand_in = (ErrorTerm("any", 0, int(TRUE.sensor[j]), int(TRUE.driver[j]), 0.0, offset=9),)
    rows, columns, kinds, drivers = transition_blocks(stand_in, 2)
    blocks, phi = np.zeros((rows.size, 9)), np.eye(12)
    fill(blocks, kinds, drivers, window_sums(), 7e6, 0.0, 0.0, SECONDS)
    for row, column, block in zip(rows, columns, blocks, strict=True):
        phi[row : row + 3] += block.reshape(3, 3) @ phi[column : column + 3]
    np.testing.assert_allclose(b, phi[:9, 9:], rtol=1e-13)
