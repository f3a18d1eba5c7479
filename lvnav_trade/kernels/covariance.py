"""Covariance of an error state: propagation over a window, update by one scalar measurement.

The first nine states are attitude, velocity and position errors; parameters follow, and the clock (bias, drift) if the
filter has one. Phi - I has 3 x 3 blocks in its first nine rows only; parameters decay. Covariances are stored in full,
and both triangles are written with the same values.

Linear covariance propagates the joint vector of true error parameters c and navigation error e (truth minus estimate).
Error sources are independent, so each source has a covariance of e of its own. The cross-covariance of e with c has one
column per parameter component, which belongs to the source of that component:

    c+ = f c + w,   e+ = Phi e + b c + g w,   update: e+ = (I - k h) e - k v

With given gains everything is linear in the sources, so the true covariance is exactly the sum over them.
"""

import numpy as np

from lvnav_trade.kernels.block_products import N_NAV_ROWS, advance_by_blocks
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import number_like, sqrt, where
from lvnav_trade.kernels.strapdown import SUM_C
from lvnav_trade.kernels.transition import ATT, VEL

N_NAV_ERROR = N_NAV_ROWS
CLOSED_GATE = -1.0
"""Gate of a measurement that is not used: no squared innovation is below it, so its weight is zero."""


@jit
def finish_window(P, decay, noise, clock, seconds):
    """Apply the decay of parameters and the drift of the clock over a window, then add the second half of the noise.

    The parameters are those of `predict`.
    """
    n = P.shape[0]
    for j in range(N_NAV_ERROR, n):
        if decay[j] != 1.0:
            for i in range(n):
                P[i, j] *= decay[j]
            for i in range(n):
                P[j, i] *= decay[j]
    if clock >= 0:
        for j in range(n):
            P[clock, j] += seconds * P[clock + 1, j]
        for i in range(n):
            P[i, clock] += seconds * P[i, clock + 1]
    for i in range(n):
        P[i, i] += 0.5 * noise[i]


@jit
def predict(P, blocks, rows, columns, decay, noise, clock, seconds):
    """Propagate the covariance over a window: P <- Phi (P + Q/2) Phi' + Q/2, Q diagonal.

    Adding half of the noise before and half after gives its cross terms to second order in the window.

    Parameters
    ----------
    P : (n, n) symmetric covariance, updated in place
    blocks : (n_block, 9) blocks by rows; Phi is their product, see `transition`. The block of position by velocity is a
        multiple of the identity
    rows, columns : (n_block,) int, first row and first column of each block
    decay, noise : (n,) decay factor and noise variance of each state over the window
    clock : index of the clock bias, -1 none
    seconds : s, length of the window
    """
    n = P.shape[0]
    for i in range(n):
        P[i, i] += 0.5 * noise[i]
    advance_by_blocks(P, blocks, rows, columns, n)
    finish_window(P, decay, noise, clock, seconds)


@jit
def add_axis_noise(P, axis_densities, sums, seconds):
    """Add half of the white noise by which body axes differ: C diag(q) C' seconds / 2, in attitude and in velocity.

    C is the mean rotation from body axes to frame i over the window, from the integrals `sums` (18,) of the strapdown.
    axis_densities : (2, 3) q of gyros and accelerometers, SI squared per second; None if all axes are alike
    """
    if axis_densities is not None:
        _add_axis_noise(P, axis_densities, sums, seconds)


@jit
def _add_axis_noise(P, axis_densities, sums, seconds):
    if seconds > 0.0:
        for sensor in range(2):
            first = ATT if sensor == 0 else VEL
            for i in range(3):
                for j in range(i, 3):
                    # with the integral S of C: C diag(q) C' seconds / 2 = S diag(q) S' / (2 seconds)
                    total = number_like(P[0, 0], 0.0)
                    for axis in range(3):
                        product = sums[SUM_C + 3 * i + axis] * sums[SUM_C + 3 * j + axis]
                        density = 0.5 * axis_densities[sensor, axis] / seconds
                        total += density * product
                    value = P[first + i, first + j] + total
                    P[first + i, first + j] = value
                    P[first + j, first + i] = value


@jit
def inflate(P, factor, n_estimated):
    """Apply fading memory: P <- A P A, with A diagonal, `factor` for estimated states and 1 for considered states."""
    for i in range(n_estimated):
        for j in range(n_estimated):
            P[i, j] *= factor * factor
        for j in range(n_estimated, P.shape[0]):
            P[i, j] *= factor
            P[j, i] *= factor


@jit
def grow(P, weights):
    """Increase a covariance as an H-infinity filter does: P <- (P^-1 - S)^-1, S diagonal, with `weights` in the first
    states. The result is not-a-number if P^-1 - S is not positive definite, because no such filter exists.
    """
    # one state at a time, with P_k its column: (P^-1 - s e e')^-1 = P + s P_k P_k' / (1 - s P_kk) (Sherman, Morrison)
    n = P.shape[0]
    for k in range(weights.shape[0]):
        if weights[k] > 0.0:
            margin = 1.0 - weights[k] * P[k, k]
            root = sqrt(where(margin > 0.0, margin, np.nan))
            for i in range(n):
                if i != k:
                    scaled_entry = weights[k] * (P[i, k] / root)
                    for j in range(i, n):
                        if j != k:
                            value = P[i, j] + scaled_entry * (P[j, k] / root)
                            P[i, j] = value
                            P[j, i] = value
            for i in range(n):
                value = P[i, k] / (root * root)
                P[i, k] = value
                P[k, i] = value


@inline_jit
def _innovation_and_variance(P, x, Ph, h, entries, columns, innovation, variance, beta, n):
    """Set Ph to P h'; return the innovation variance and the innovation after earlier measurements of the epoch."""
    for i in range(n):
        value = P[i, columns[0]] * h[entries[0]]
        for c in range(1, columns.shape[0]):
            state = columns[c]
            value += P[i, state] * h[entries[c]]
        Ph[i] = value
    # s = (1 + beta) h P h' + variance, residual = innovation - h x
    s = 0.0 * x[0] + variance
    residual = innovation
    for c in range(columns.shape[0]):
        state = columns[c]
        entry = h[entries[c]]
        s += (1.0 + beta) * entry * Ph[state]
        residual = residual - entry * x[state]
    return s, residual


@jit
def update_scalar(P, x, Ph, h, entries, columns, innovation, variance, gate_squared, n_estimated, joseph, beta=0.0):
    """Update the error state and its covariance by one scalar measurement, z - z_hat = h . x + v.

    K = P h' / s,   x <- x + K (z - z_hat - h x),   P <- P - K h P,   s = (1 + beta) h P h' + variance

    All measurements of an epoch are linearised at the same state, so `innovation` is that before the epoch; the
    correction h x by earlier measurements of the epoch is subtracted here. States from `n_estimated` on are considered
    (Schmidt): their gain is zero, but their correlations are updated. A measurement beyond the gate has weight zero.

    Parameters
    ----------
    P, x : (n, n) covariance and (n,) error state, both updated in place
    Ph : (n,) set to P h' before the update
    h : (n_entry,) Jacobian row
    entries, columns : (n_column,) int, entries of h that are not zero, and the states that they multiply
    innovation : measured minus predicted at the linearisation point
    variance : variance of v
    gate_squared : largest square of the normalised innovation that is accepted (inf: all; CLOSED_GATE: none)
    n_estimated : number of estimated states
    joseph : whether the covariance update has Joseph's form
    beta : underweighting (Lear): the innovation variance has beta h P h' in addition

    Returns
    -------
    normalised_innovation : innovation divided by its standard deviation, before the gate
    weight : 1 / innovation variance; 0 if rejected
    """
    n = P.shape[0]
    s, residual = _innovation_and_variance(P, x, Ph, h, entries, columns, innovation, variance, beta, n)
    is_accepted = residual * residual <= gate_squared * s
    inverse = 1.0 / s
    weight = where(is_accepted, inverse, 0.0)
    step = where(is_accepted, residual, 0.0) * weight
    for i in range(n_estimated):
        x[i] += Ph[i] * step
    if joseph:
        _joseph(P, Ph, Ph, weight, s, n_estimated, n)
    else:
        for i in range(n_estimated):
            gain = Ph[i] * weight
            for j in range(i, n):
                value = P[i, j] - gain * Ph[j]
                P[i, j] = value
                P[j, i] = value
    normalised_innovation = residual * sqrt(inverse)
    return normalised_innovation, weight


@jit
def update_with_gain(P, x, Ph, h, entries, columns, gain, innovation, variance, gate_squared, n_estimated, beta=0.0):
    """Update as `update_scalar` does, with a stored gain (n,) in place of the optimal gain.

    The gain is the same in every run. The covariance is updated in Joseph's form, which is valid for any gain; it only
    decides which measurements pass the gate.
    """
    n = P.shape[0]
    s, residual = _innovation_and_variance(P, x, Ph, h, entries, columns, innovation, variance, beta, n)
    is_accepted = residual * residual <= gate_squared * s
    step = where(is_accepted, residual, 0.0)
    for i in range(n_estimated):
        x[i] += gain[i] * step
    gain_factor = where(is_accepted, 1.0, 0.0)
    _joseph(P, Ph, gain, gain_factor, s, n_estimated, n)
    inverse = 1.0 / s
    normalised_innovation = residual * sqrt(inverse)
    weight = where(is_accepted, inverse, 0.0)
    return normalised_innovation, weight


@jit
def _joseph(P, Ph, gain, weight, s, n_estimated, n):
    """P <- (I - g h) P (I - g h)' + g R g' with g = gain * weight on the estimated states, by elements."""
    for i in range(n_estimated):
        gain_i = gain[i] * weight
        for j in range(i, n):
            gain_j = gain[j] * weight
            # the gain of a considered state j is zero, so only the first product remains
            value = P[i, j] - gain_i * Ph[j]
            if j < n_estimated:
                value = value - Ph[i] * gain_j + gain_i * s * gain_j
            P[i, j] = value
            P[j, i] = value


@jit
def normalised_square(P, X, y, x, n):
    """Return x' P^-1 x over the first n states (NEES), by an L D L' factorisation.

    With P = L D L' and L y = x it is the sum of y_i^2 / D_i.

    X (n, n) and y (n,) are scratch: X gets L below its diagonal, D on it, and (L D)' above it.
    """
    total = number_like(x[0], 0.0)
    for i in range(n):
        pivot = P[i, i]
        residual = x[i]
        for j in range(i):
            value = P[i, j]
            for k in range(j):
                value -= X[k, i] * X[j, k]
            X[j, i] = value
            factor = value / X[j, j]
            X[i, j] = factor
            pivot -= value * factor
            residual -= factor * y[j]
        X[i, i] = pivot
        y[i] = residual
        total += residual * residual / pivot
    return total


@jit
def apply_phi(y, blocks, rows, columns, decay, clock, seconds):
    """Replace the vector y (n,) by Phi y; parameters as in `predict`, for one run or lane views of eight."""
    n = y.shape[0]
    for b in range(rows.shape[0]):
        r = rows[b]
        c = columns[b]
        block = blocks[b]
        y0 = y[c]
        y1 = y[c + 1]
        y2 = y[c + 2]
        for i in range(3):
            first = 3 * i
            y[r + i] += block[first] * y0 + block[first + 1] * y1 + block[first + 2] * y2
    for i in range(N_NAV_ERROR, n):
        y[i] *= decay[i]
    if clock >= 0:
        y[clock] += seconds * y[clock + 1]


@jit
def apply_phi_transposed(y, blocks, rows, columns, decay, clock, seconds):
    """Replace the vector y (n,) by Phi' y: the transposed blocks of `apply_phi` in reverse order."""
    if clock >= 0:
        y[clock + 1] += seconds * y[clock]
    for i in range(N_NAV_ERROR, y.shape[0]):
        y[i] *= decay[i]
    for b in range(rows.shape[0] - 1, -1, -1):
        r = rows[b]
        c = columns[b]
        y0 = y[r]
        y1 = y[r + 1]
        y2 = y[r + 2]
        for i in range(3):
            b0 = blocks[b, i]
            b1 = blocks[b, 3 + i]
            b2 = blocks[b, 6 + i]
            y[c + i] += b0 * y0 + b1 * y1 + b2 * y2


@jit
def update_vector(y, gain, h, entries, columns):
    """Y <- (I - k h) y; return h y before the update. One vector, or lanes; parameters as in `update_scalar`."""
    projection = number_like(y[0], 0.0)
    for c in range(columns.shape[0]):
        state = columns[c]
        projection += h[entries[c]] * y[state]
    for i in range(y.shape[0]):
        y[i] -= gain[i] * projection
    return projection


@jit
def update_covariance(P, work, gain, h, entries, columns, variance):
    """P <- (I - k h) P (I - k h)' + k variance k' for any gain k (n,); return h P h' before the update."""
    n = P.shape[0]
    for i in range(n):  # work = P h'
        value = number_like(P[0, 0], 0.0)
        for c in range(columns.shape[0]):
            state = columns[c]
            value += P[i, state] * h[entries[c]]
        work[i] = value
    predicted_variance = number_like(P[0, 0], 0.0)
    for c in range(columns.shape[0]):
        state = columns[c]
        predicted_variance += h[entries[c]] * work[state]
    total = predicted_variance + variance
    for i in range(n):
        for j in range(i, n):
            value = P[i, j] - gain[i] * work[j] - work[i] * gain[j] + gain[i] * total * gain[j]
            P[i, j] = value
            P[j, i] = value
    return predicted_variance


@jit
def enter(P, y, variance, b, first):
    """Add an error component c, with a variance, to the states from `first` on: x += b c, b (m,).

    P <- P + b y' + y b' + variance b b',   y <- y + variance b

    P : (n, n) covariance of x; y : (n,) Cov(x, c); both updated in place
    """
    for i in range(b.shape[0]):
        if b[i] != 0.0:
            for j in range(y.shape[0]):
                value = b[i] * y[j]
                P[first + i, j] += value
                P[j, first + i] += value
            for j in range(b.shape[0]):
                P[first + i, first + j] += b[i] * variance * b[j]
    for i in range(b.shape[0]):
        y[first + i] += b[i] * variance


@jit
def variance_along(P, first, c0, c1, c2):
    """Return the variance c' P c of a block of three states, from `first` on, along a direction c."""
    i = first
    j = first + 1
    k = first + 2
    xx = P[i, i] * c0 * c0
    yy = P[j, j] * c1 * c1
    zz = P[k, k] * c2 * c2
    xy = P[i, j] * c0 * c1
    xz = P[i, k] * c0 * c2
    yz = P[j, k] * c1 * c2
    squares = xx + yy + zz
    products = xy + xz + yz
    return squares + 2.0 * products
