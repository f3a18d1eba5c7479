"""The covariance of an error state: propagate it over a window, update it by one scalar measurement.

The first nine states are attitude, velocity, position; parameters follow, and a clock (bias, drift) where there is one.
Only the first nine rows of Phi - I hold blocks; parameters decay. The covariance is kept whole, and written symmetric.
"""

from __future__ import annotations

from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like, size, sqrt, where
from lvnav_trade.kernels.transition import POS, VEL

N_NAV_ERROR = 9


@jit
def _add_to_rows(P, r, c, block, n):
    """Add a block times the three rows from c on to those from r on, in the first n columns."""
    d0, d1, d2, d3, d4, d5 = block[0], block[1], block[2], block[3], block[4], block[5]
    d6, d7, d8 = block[6], block[7], block[8]
    for j in range(n):
        p0, p1, p2 = P[c, j], P[c + 1, j], P[c + 2, j]
        P[r, j] = P[r, j] + d0 * p0 + d1 * p1 + d2 * p2
        P[r + 1, j] = P[r + 1, j] + d3 * p0 + d4 * p1 + d5 * p2
        P[r + 2, j] = P[r + 2, j] + d6 * p0 + d7 * p1 + d8 * p2


@jit
def _add_to_columns(P, r, c, block, n):
    """Add the three columns from c on times a transposed block to those from r on, in the first n rows."""
    d0, d1, d2, d3, d4, d5 = block[0], block[1], block[2], block[3], block[4], block[5]
    d6, d7, d8 = block[6], block[7], block[8]
    for i in range(n):
        p0, p1, p2 = P[i, c], P[i, c + 1], P[i, c + 2]
        P[i, r] = P[i, r] + d0 * p0 + d1 * p1 + d2 * p2
        P[i, r + 1] = P[i, r + 1] + d3 * p0 + d4 * p1 + d5 * p2
        P[i, r + 2] = P[i, r + 2] + d6 * p0 + d7 * p1 + d8 * p2


@jit
def _move_rows(P, seconds, n):
    """Let position move on with velocity for some seconds: rows."""
    for i in range(3):
        for j in range(n):
            P[POS + i, j] = P[POS + i, j] + seconds * P[VEL + i, j]


@jit
def _move_columns(P, seconds, n):
    """Let position move on with velocity for some seconds: columns."""
    for i in range(n):
        for j in range(3):
            P[i, POS + j] = P[i, POS + j] + seconds * P[i, VEL + j]


@jit
def _advance(P, blocks, rows, columns, n):
    """P <- Phi P Phi' without the parameters' decay: every block acts on rows, then on columns; then symmetric.

    Below the ninth row nothing but what mirrors the first nine changes.
    """
    for b in range(rows.shape[0]):
        if rows[b] == POS and columns[b] == VEL:
            _move_rows(P, blocks[b][0], n)
        else:
            _add_to_rows(P, rows[b], columns[b], blocks[b], n)
    for b in range(rows.shape[0]):
        if rows[b] == POS and columns[b] == VEL:
            _move_columns(P, blocks[b][0], N_NAV_ERROR)
        else:
            _add_to_columns(P, rows[b], columns[b], blocks[b], N_NAV_ERROR)
    for i in range(N_NAV_ERROR):
        for j in range(i + 1, n):
            P[j, i] = P[i, j]


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
def predict(P, blocks, rows, columns, decay, noise, clock, seconds):
    """Propagate the covariance over a window: P <- Phi (P + Q/2) Phi' + Q/2, Q diagonal.

    Half of the noise before and half after gives its cross terms to second order in the window.

    Parameters
    ----------
    P : (n, n) symmetric; updated
    blocks : (n_block, 9) at rows, columns (n_block,) int: Phi is the product of what each block does, see `transition`;
        position takes velocity times a number of seconds, the same on all axes
    decay, noise : (n,) decay factor and noise variance of each state over the window
    clock : index of the clock bias, -1 for none; seconds : length of the window
    """
    n = size(P, 0)
    for i in range(n):
        P[i, i] = P[i, i] + 0.5 * noise[i]
    _advance(P, blocks, rows, columns, n)
    _decay(P, decay, n)
    if clock >= 0:
        _advance_clock(P, clock, seconds, n)
    for i in range(n):
        P[i, i] = P[i, i] + 0.5 * noise[i]


@inlined
def _met(P, x, K, h, entries, columns, innovation, variance, n):
    """Set K to P h; return the variance of a row's innovation, and what earlier rows of the epoch have left of it."""
    for i in range(n):
        k = P[i, columns[0]] * h[entries[0]]
        for c in range(1, columns.shape[0]):
            k = k + P[i, columns[c]] * h[entries[c]]
        K[i] = k
    s = 0.0 * x[0] + variance
    residual = innovation
    for c in range(columns.shape[0]):
        s = s + h[entries[c]] * K[columns[c]]
        residual = residual - h[entries[c]] * x[columns[c]]
    return s, residual


@jit
def update_scalar(P, x, K, h, entries, columns, innovation, variance, gate_squared, n_estimated, joseph):
    """Update the error state and its covariance by one scalar measurement, z - z_hat = h . x + v.

    All rows of an epoch are linearised at one point: `innovation` is the one before the epoch, and what earlier rows of
    the epoch have moved is taken off here. States from `n_estimated` on are considered (Schmidt): no gain, but their
    correlations are kept up. A row beyond the gate has zero weight.

    Parameters
    ----------
    P : (n, n), x : (n,) error state; both updated. K : (n,) set to P h before the update
    h : (n_entry,) the row; its `entries` (n_column,) int stand for states `columns` (n_column,) int, the rest are zero
    variance : of v
    gate_squared : largest square of the normalised innovation that is accepted (inf: all)
    joseph : bool, write the update in Joseph's form

    Returns
    -------
    normalised innovation (before the gate), weight (1 / innovation variance, 0 where rejected)
    """
    n = size(P, 0)
    s, residual = _met(P, x, K, h, entries, columns, innovation, variance, n)
    accepted = residual * residual <= gate_squared * s
    inverse = 1.0 / s
    weight = where(accepted, inverse, 0.0)
    step = where(accepted, residual, 0.0) * weight
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
def update_with_gain(P, x, K, h, entries, columns, gain, innovation, variance, gate_squared, n_estimated):
    """Update as `update_scalar` does, but with a given gain (n,): floats, the same in every run.

    The covariance is propagated in Joseph's form: it is what the filter's model says of that gain, and decides
    nothing but the gate.
    """
    n = size(P, 0)
    s, residual = _met(P, x, K, h, entries, columns, innovation, variance, n)
    accepted = residual * residual <= gate_squared * s
    taken = where(accepted, 1.0, 0.0)
    step = where(accepted, residual, 0.0)
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
    return residual * sqrt(inverse), where(accepted, inverse, 0.0)


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
