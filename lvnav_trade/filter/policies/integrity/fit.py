"""Least-squares fit of position and clock bias, or of velocity and clock drift, to the innovations of an epoch."""

import numpy as np

from lvnav_trade.filter.policies.integrity.state import N_FIT
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, where
from lvnav_trade.sensors.jacobian_row import H_CLOCK


@jit
def limit(table, dof):
    """Return the threshold for a number of degrees of freedom; infinite without redundancy (dof below 1)."""
    threshold = like(dof, np.inf)
    for k in range(1, table.shape[0]):
        threshold = where(dof == float(k), table[k], threshold)
    return threshold


@jit
def invert(inverse, A):
    """Set the inverse of a positive definite matrix A (n, n) by Gauss-Jordan elimination; A is overwritten."""
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
    """Return the design-matrix element of a row for unknown i: position or velocity (0 to 2), clock (3)."""
    return H[row, first + i] if i < 3 else H[row, H_CLOCK]


@jit
def fit(monitor, H, z, first, kind, n_kind, n_row):
    """Fit position or velocity and clock to the innovations z of one observable, by weighted least squares.

    Sets `monitor.fit` = (G' W G)^-1 G' W z and its covariance `monitor.inverse` = (G' W G)^-1.

    Parameters
    ----------
    monitor : Monitor, with the weights W of the rows; rows without a positive weight do not enter
    H : (n_row, n_entry) Jacobian rows
    z : (n_row,) innovations
    first : first entry of position or velocity in a row
    kind, n_kind : observable, and number of observables of a satellite
    n_row : number of rows

    Returns
    -------
    square : weighted sum of squared residuals
    dof : degrees of freedom, rows in use minus 4
    """
    zero = like(monitor.fit[0], 0.0)
    for i in range(N_FIT):
        monitor.b[i] = zero
        for j in range(N_FIT):
            # keeps the matrix regular with fewer than four rows; such a fit is not used, since its dof is negative
            monitor.A[i, j] = zero + (1e-12 if i == j else 0.0)
    dof = zero - N_FIT
    for row in range(kind, n_row, n_kind):
        w = where(monitor.weight[row] > 0.0, monitor.weight[row], 0.0)  # negative: withheld from the fit
        dof = dof + where(w > 0.0, 1.0, 0.0)
        for i in range(N_FIT):
            g = _direction(H, row, first, i)
            monitor.b[i] = monitor.b[i] + w * g * z[row]
            for j in range(N_FIT):
                monitor.A[i, j] = monitor.A[i, j] + w * g * _direction(H, row, first, j)
    invert(monitor.inverse, monitor.A)
    for i in range(N_FIT):
        total = zero
        for j in range(N_FIT):
            total = total + monitor.inverse[i, j] * monitor.b[j]
        monitor.fit[i] = total
    square = zero
    for row in range(kind, n_row, n_kind):
        residual = z[row]
        for i in range(N_FIT):
            residual = residual - _direction(H, row, first, i) * monitor.fit[i]
        square = square + where(monitor.weight[row] > 0.0, monitor.weight[row], 0.0) * residual * residual
    return square, dof
