"""A weighted fit of position or velocity and clock to the rows of an epoch, and its residuals."""

import numpy as np

from lvnav_trade.filters.integrity.state import N_FIT
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, where
from lvnav_trade.observables.base import H_CLOCK


@jit
def limit(table, dof):
    """Return the entry of a table by degrees of freedom; without any nothing is beyond it."""
    found = like(dof, np.inf)
    for k in range(1, table.shape[0]):
        found = where(dof == float(k), table[k], found)
    return found


@jit
def invert(inverse, A):
    """Set the inverse of a positive definite matrix (n, n), which is overwritten."""
    n = A.shape[0]
    for i in range(n):
        for j in range(n):
            inverse[i, j] = like(A[0, 0], 1.0 if i == j else 0.0)
    for k in range(n):
        scale = 1.0 / A[k, k]
        for j in range(n):
            A[k, j], inverse[k, j] = A[k, j] * scale, inverse[k, j] * scale
        for i in range(n):
            if i != k:
                factor = A[i, k]
                for j in range(n):
                    A[i, j] = A[i, j] - factor * A[k, j]
                    inverse[i, j] = inverse[i, j] - factor * inverse[k, j]


@jit
def _direction(H, row, first, i):
    """Return the entry of a row's fit: three of position or velocity, then the clock's."""
    return H[row, first + i] if i < 3 else H[row, H_CLOCK]


@jit
def fit(own, H, z, first, kind, n_kind, n_row):
    """Fit position or velocity (entries from `first` on) and clock to the rows of a kind that are in use: own.fit and
    its covariance, own.inverse. Return the weighted sum of squared residuals and the degrees of freedom.
    """
    zero = like(own.fit[0], 0.0)
    for i in range(N_FIT):
        own.b[i] = zero
        for j in range(N_FIT):
            # too few rows leave the rest undetermined: a fit that nothing asks for
            own.A[i, j] = zero + (1e-12 if i == j else 0.0)
    dof = zero - N_FIT
    for row in range(kind, n_row, n_kind):
        w = where(own.weight[row] > 0.0, own.weight[row], 0.0)  # below zero: withheld
        dof = dof + where(w > 0.0, 1.0, 0.0)
        for i in range(N_FIT):
            g = _direction(H, row, first, i)
            own.b[i] = own.b[i] + w * g * z[row]
            for j in range(N_FIT):
                own.A[i, j] = own.A[i, j] + w * g * _direction(H, row, first, j)
    invert(own.inverse, own.A)
    for i in range(N_FIT):
        total = zero
        for j in range(N_FIT):
            total = total + own.inverse[i, j] * own.b[j]
        own.fit[i] = total
    square = zero
    for row in range(kind, n_row, n_kind):
        residual = z[row]
        for i in range(N_FIT):
            residual = residual - _direction(H, row, first, i) * own.fit[i]
        square = square + where(own.weight[row] > 0.0, own.weight[row], 0.0) * residual * residual
    return square, dof
