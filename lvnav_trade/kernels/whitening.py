"""Correlated measurements made independent before scalar updates."""

import numpy as np

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import sqrt, where


@jit
def whiten(R, z, H, n, n_entry):
    """Decorrelate (whiten) n measurements z = H x + v with Cov v = R: their errors become independent, of variance 1.

    With R = L L': z <- L^-1 z, H <- L^-1 H, in place. Measurement i becomes a combination of measurements 0 to i, so
    its Jacobian row needs the entries of all of them. Scalar updates in sequence with variance 1 are equivalent to the
    joint update with R. A measurement that is missing, or whose variance is not positive, becomes not-a-number. So do
    later measurements that are correlated with it.

    Parameters
    ----------
    R : (n, n) symmetric; its lower triangle is overwritten by L
    z : (n,) measured minus predicted, updated in place
    H : (n, n_entry) Jacobian rows, updated in place
    n, n_entry : number of scalar measurements and of entries
    """
    for i in range(n):  # Cholesky factor and forward substitution, row by row
        pivot = R[i, i]
        for k in range(i):
            factor = R[i, k]
            pivot -= factor * factor
            z[i] -= factor * z[k]
            for e in range(n_entry):
                H[i, e] -= factor * H[k, e]
        root = sqrt(where(pivot > 0.0, pivot, np.nan))
        scale = 1.0 / root
        R[i, i] = root
        z[i] *= scale
        for e in range(n_entry):
            H[i, e] *= scale
        for j in range(i + 1, n):
            value = R[j, i]
            for k in range(i):
                value -= R[j, k] * R[i, k]
            R[j, i] = value * scale
