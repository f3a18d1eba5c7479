"""Product Phi P Phi' of a covariance, block by block of the transition matrix."""

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.transition import POS, VEL

N_NAV_ROWS = 9
"""Rows of Phi - I that are not zero: attitude, velocity and position errors."""


@jit
def _add_block_rows(P, r, c, block, n):
    """Add a block times the three rows from c on to those from r on, in the first n columns."""
    b00 = block[0]
    b01 = block[1]
    b02 = block[2]
    b10 = block[3]
    b11 = block[4]
    b12 = block[5]
    b20 = block[6]
    b21 = block[7]
    b22 = block[8]
    for j in range(n):
        p0 = P[c, j]
        p1 = P[c + 1, j]
        p2 = P[c + 2, j]
        P[r, j] = P[r, j] + b00 * p0 + b01 * p1 + b02 * p2
        P[r + 1, j] = P[r + 1, j] + b10 * p0 + b11 * p1 + b12 * p2
        P[r + 2, j] = P[r + 2, j] + b20 * p0 + b21 * p1 + b22 * p2


@jit
def _add_block_columns(P, r, c, block, n):
    """Add the three columns from c on times a transposed block to those from r on, in the first n rows."""
    b00 = block[0]
    b01 = block[1]
    b02 = block[2]
    b10 = block[3]
    b11 = block[4]
    b12 = block[5]
    b20 = block[6]
    b21 = block[7]
    b22 = block[8]
    for i in range(n):
        p0 = P[i, c]
        p1 = P[i, c + 1]
        p2 = P[i, c + 2]
        P[i, r] = P[i, r] + b00 * p0 + b01 * p1 + b02 * p2
        P[i, r + 1] = P[i, r + 1] + b10 * p0 + b11 * p1 + b12 * p2
        P[i, r + 2] = P[i, r + 2] + b20 * p0 + b21 * p1 + b22 * p2


@jit
def advance_by_blocks(P, blocks, rows, columns, n):
    """P <- Phi P Phi' without the decay of parameters: each block acts on rows, then on columns.

    Only the first nine rows are computed; the columns below them are copied from the rows. The block of position by
    velocity is a multiple of the identity, so one number replaces nine.
    """
    for b in range(rows.shape[0]):
        if rows[b] == POS and columns[b] == VEL:
            seconds = blocks[b][0]
            for i in range(3):
                for j in range(n):
                    P[POS + i, j] += seconds * P[VEL + i, j]
        else:
            _add_block_rows(P, rows[b], columns[b], blocks[b], n)
    for b in range(rows.shape[0]):
        if rows[b] == POS and columns[b] == VEL:
            seconds = blocks[b][0]
            for i in range(N_NAV_ROWS):
                for j in range(3):
                    P[i, POS + j] += seconds * P[i, VEL + j]
        else:
            _add_block_columns(P, rows[b], columns[b], blocks[b], N_NAV_ROWS)
    for i in range(N_NAV_ROWS):
        for j in range(i + 1, n):
            P[j, i] = P[i, j]
