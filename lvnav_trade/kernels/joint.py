"""The joint vector of true error parameters c and navigation error e (truth minus estimate), source by source.

Sources are independent, so each carries its own covariance of e, and the cross-covariance of e with c is one column per
parameter component, owned by that component's source:

    c+ = f c + w,   e+ = Phi e + b c + g w,   update: e+ = (I - k h) e - k v

Everything is linear in the sources once the gains are fixed, so the true covariance is the sum over them, exactly.
"""

from __future__ import annotations

from lvnav_trade.kernels.covariance import N_NAV_ERROR
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, size


@jit
def apply_phi(y, blocks, rows, columns, decay, clock, seconds):
    """Replace the vector y (n,) by Phi y. Of one run, or lane views of eight."""
    n = size(y, 0)
    for b in range(rows.shape[0]):
        r, c, block = rows[b], columns[b], blocks[b]
        y0, y1, y2 = y[c], y[c + 1], y[c + 2]
        for i in range(3):
            y[r + i] = y[r + i] + (block[3 * i] * y0 + block[3 * i + 1] * y1 + block[3 * i + 2] * y2)
    for i in range(N_NAV_ERROR, n):
        y[i] = y[i] * decay[i]
    if clock >= 0:
        y[clock] = y[clock] + seconds * y[clock + 1]


@jit
def apply_phi_transposed(y, blocks, rows, columns, decay, clock, seconds):
    """Replace the vector y (n,) by Phi' y: what `apply_phi` does, backwards."""
    if clock >= 0:
        y[clock + 1] += seconds * y[clock]
    for i in range(N_NAV_ERROR, y.shape[0]):
        y[i] = y[i] * decay[i]
    for b in range(rows.shape[0] - 1, -1, -1):
        r, c = rows[b], columns[b]
        y0, y1, y2 = y[r], y[r + 1], y[r + 2]
        for i in range(3):
            y[c + i] += blocks[b, i] * y0 + blocks[b, 3 + i] * y1 + blocks[b, 6 + i] * y2


@jit
def update_vector(y, gain, h, entries, columns):
    """Y <- (I - k h) y; return h y before the update. One vector, or lanes."""
    projected = like(y[0], 0.0)
    for c in range(columns.shape[0]):
        projected = projected + h[entries[c]] * y[columns[c]]
    for i in range(size(y, 0)):
        y[i] = y[i] - gain[i] * projected
    return projected


@jit
def update_covariance(P, work, gain, h, entries, columns, variance):
    """P <- (I - k h) P (I - k h)' + k variance k', Joseph's form for any gain; return h P h' before the update.

    Of one run, or lane views of eight.
    """
    n = size(P, 0)
    spread = like(P[0, 0], 0.0)
    for i in range(n):
        value = like(P[0, 0], 0.0)
        for c in range(columns.shape[0]):
            value += P[i, columns[c]] * h[entries[c]]
        work[i] = value
    for c in range(columns.shape[0]):
        spread += h[entries[c]] * work[columns[c]]
    total = spread + variance
    for i in range(n):
        for j in range(i, n):
            value = P[i, j] - gain[i] * work[j] - work[i] * gain[j] + gain[i] * total * gain[j]
            P[i, j] = value
            P[j, i] = value
    return spread
