"""Phi P Phi' by blocks against dense matrices."""

from __future__ import annotations

import numpy as np

from lvnav_trade.kernels.block_products import N_NAV_ROWS, advance_by_blocks
from lvnav_trade.kernels.transition import ATT, POS, VEL

N, SECONDS = 15, 0.3


def test_blocks_in_succession_are_the_product_of_dense_matrices():
    rng = np.random.default_rng(3)
    A = rng.standard_normal((N, N))
    P = A @ A.T
    rows = np.array([POS, VEL, VEL, ATT, POS])
    columns = np.array([VEL, POS, ATT, N_NAV_ROWS, VEL])
    blocks = rng.standard_normal((5, 9))
    blocks[0] = blocks[4] = SECONDS * np.eye(3).ravel()
    phi = np.eye(N)
    for row, column, block in zip(rows, columns, blocks, strict=True):
        factor = np.eye(N)
        factor[row : row + 3, column : column + 3] += block.reshape(3, 3)
        phi = factor @ phi
    expected = phi @ P @ phi.T
    advance_by_blocks(P, blocks, rows, columns, N)
    np.testing.assert_allclose(P, expected, rtol=1e-11, atol=1e-11)
    np.testing.assert_array_equal(P, P.T)
