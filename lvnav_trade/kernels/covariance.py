"""The covariance of an error state: propagate it over a window, absorb one scalar row.

The first nine states are attitude, velocity, position; parameters follow, and a clock (bias, drift) where there is one.
Only the first nine rows of Phi - I hold blocks; parameters decay. The covariance is kept whole, and written symmetric.
"""

from __future__ import annotations

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, size, sqrt, where

N_NAV_ERROR = 9


@jit
def _advance_rows(P, X, blocks, rows, columns, n):
    """Set the first nine rows of X to those of Phi P."""
    for i in range(N_NAV_ERROR):
        for j in range(n):
            X[i, j] = P[i, j]
    for b in range(rows.shape[0]):
        r, c, block = rows[b], columns[b], blocks[b]
        d0, d1, d2, d3, d4, d5 = block[0], block[1], block[2], block[3], block[4], block[5]
        d6, d7, d8 = block[6], block[7], block[8]
        for j in range(n):
            p0, p1, p2 = P[c, j], P[c + 1, j], P[c + 2, j]
            X[r, j] = X[r, j] + d0 * p0 + d1 * p1 + d2 * p2
            X[r + 1, j] = X[r + 1, j] + d3 * p0 + d4 * p1 + d5 * p2
            X[r + 2, j] = X[r + 2, j] + d6 * p0 + d7 * p1 + d8 * p2


@jit
def _advance_columns(P, X, blocks, rows, columns, n):
    """Set P to Phi P Phi' from the first nine rows of Phi P: their first nine columns change, the rest is copied."""
    for i in range(N_NAV_ERROR):
        for j in range(i, N_NAV_ERROR):
            P[i, j] = X[i, j]
    for b in range(rows.shape[0]):
        r, c, block = rows[b], columns[b], blocks[b]
        d0, d1, d2, d3, d4, d5 = block[0], block[1], block[2], block[3], block[4], block[5]
        d6, d7, d8 = block[6], block[7], block[8]
        for i in range(r + 3):
            p0, p1, p2 = X[i, c], X[i, c + 1], X[i, c + 2]
            P[i, r] = P[i, r] + d0 * p0 + d1 * p1 + d2 * p2
            P[i, r + 1] = P[i, r + 1] + d3 * p0 + d4 * p1 + d5 * p2
            P[i, r + 2] = P[i, r + 2] + d6 * p0 + d7 * p1 + d8 * p2
    for i in range(N_NAV_ERROR):
        for j in range(i + 1, N_NAV_ERROR):
            P[j, i] = P[i, j]
        for j in range(N_NAV_ERROR, n):
            value = X[i, j]
            P[i, j] = value
            P[j, i] = value


@jit
def _decay(P, decay, n):
    """Scale rows and columns of Gauss-Markov parameters by their decay over the window."""
    for j in range(N_NAV_ERROR, n):
        factor = decay[j]
        if factor != 1.0:
            for i in range(n):
                P[i, j] = P[i, j] * factor
            for i in range(n):
                P[j, i] = P[j, i] * factor


@jit
def _advance_clock(P, clock, seconds, n):
    for j in range(n):
        P[clock, j] = P[clock, j] + seconds * P[clock + 1, j]
    for i in range(n):
        P[i, clock] = P[i, clock] + seconds * P[i, clock + 1]


@jit
def predict(P, X, blocks, rows, columns, decay, noise, clock, seconds):
    """Propagate the covariance over a window: P <- Phi (P + Q/2) Phi' + Q/2, Q diagonal.

    Half of the noise before and half after gives its cross terms to second order in the window.

    Parameters
    ----------
    P : (n, n) symmetric; updated. X : (n, n) work
    blocks : (n_block, 9) of Phi - I at rows, columns (n_block,) int
    decay, noise : (n,) decay factor and noise variance of each state over the window
    clock : index of the clock bias, -1 for none; seconds : length of the window
    """
    n = noise.shape[0]
    for i in range(n):
        P[i, i] = P[i, i] + 0.5 * noise[i]
    _advance_rows(P, X, blocks, rows, columns, n)
    _advance_columns(P, X, blocks, rows, columns, n)
    _decay(P, decay, n)
    if clock >= 0:
        _advance_clock(P, clock, seconds, n)
    for i in range(n):
        P[i, i] = P[i, i] + 0.5 * noise[i]


@jit
def absorb(P, x, K, h, entries, columns, innovation, variance, gate_squared, n_estimated, joseph):
    """Absorb one scalar row, z - z_hat = h . x + v, into the error state and its covariance.

    All rows of an epoch are linearised at one point: `innovation` is the one before the epoch, and what earlier rows of
    the epoch have moved is taken off here. States from `n_estimated` on are considered (Schmidt): no gain, but their
    correlations are kept up. A row beyond the gate has zero weight.

    Parameters
    ----------
    P : (n, n), x : (n,) error state; both updated. K : (n,) set to P h before the update
    h : (n_entry,) the row; its `entries` (n_column,) int stand for states `columns` (n_column,) int, the rest are zero
    variance : of v
    gate_squared : largest square of the normalised innovation that is believed (inf: all)
    joseph : bool, write the update in Joseph's form

    Returns
    -------
    normalised innovation (before the gate), weight (1 / innovation variance, 0 where rejected)
    """
    n = size(P, 0)
    for i in range(n):
        k = P[i, columns[0]] * h[entries[0]]
        for c in range(1, columns.shape[0]):
            k = k + P[i, columns[c]] * h[entries[c]]
        K[i] = k
    s = like(x[0], variance)
    residual = innovation
    for c in range(columns.shape[0]):
        s = s + h[entries[c]] * K[columns[c]]
        residual = residual - h[entries[c]] * x[columns[c]]
    believed = residual * residual <= gate_squared * s
    inverse = 1.0 / s
    weight = where(believed, inverse, 0.0)
    step = where(believed, residual, 0.0) * weight
    for i in range(n_estimated):
        x[i] = x[i] + K[i] * step
    if joseph:
        _joseph(P, K, s, weight, n_estimated, n)
    else:
        for i in range(n_estimated):
            gain = K[i] * weight
            for j in range(i, n):
                value = P[i, j] - gain * K[j]
                P[i, j] = value
                P[j, i] = value
    return residual * sqrt(inverse), weight


@jit
def absorb_with(P, x, K, h, entries, columns, gain, innovation, variance, gate_squared, n_estimated):
    """Absorb one scalar row as `absorb` does, but with a gain (n,) that is given: floats, the same in every run.

    The covariance is carried along in Joseph's form: it is what the filter's model says of that gain, and decides
    nothing but the gate.
    """
    n = size(P, 0)
    for i in range(n):
        k = P[i, columns[0]] * h[entries[0]]
        for c in range(1, columns.shape[0]):
            k = k + P[i, columns[c]] * h[entries[c]]
        K[i] = k
    s = like(x[0], variance)
    residual = innovation
    for c in range(columns.shape[0]):
        s = s + h[entries[c]] * K[columns[c]]
        residual = residual - h[entries[c]] * x[columns[c]]
    believed = residual * residual <= gate_squared * s
    taken = where(believed, 1.0, 0.0)
    step = where(believed, residual, 0.0)
    for i in range(n_estimated):
        x[i] = x[i] + gain[i] * step
    for i in range(n_estimated):
        g = gain[i] * taken
        for j in range(i, n):
            value = P[i, j] - g * K[j]
            if j < n_estimated:
                value = value - K[i] * (gain[j] * taken) + g * s * gain[j]
            P[i, j] = value
            P[j, i] = value
    inverse = 1.0 / s
    return residual * sqrt(inverse), where(believed, inverse, 0.0)


@jit
def _joseph(P, K, s, weight, n_estimated, n):
    """P <- (I - g h) P (I - g h)' + g R g' with gain g = K weight on the estimated states, by elements."""
    for i in range(n_estimated):
        gain_i = K[i] * weight
        for j in range(i, n):
            gain_j = K[j] * weight
            value = P[i, j] - gain_i * K[j]
            if j < n_estimated:
                value = value - K[i] * gain_j + gain_i * s * gain_j
            P[i, j] = value
            P[j, i] = value


@jit
def normalised_square(P, X, y, x, n):
    """Return x' P^-1 x over the first n states (NEES), by an L D L' factorisation.

    X (n, n) and y (n,) are work: below the diagonal of X stands L, on it D, above it L D transposed.
    """
    total = like(x[0], 0.0)
    for i in range(n):
        pivot, residual = P[i, i], x[i]
        for j in range(i):
            value = P[i, j]
            for k in range(j):
                value = value - X[k, i] * X[j, k]
            X[j, i] = value
            factor = value / X[j, j]
            X[i, j] = factor
            pivot = pivot - value * factor
            residual = residual - factor * y[j]
        X[i, i], y[i] = pivot, residual
        total = total + residual * residual / pivot
    return total
