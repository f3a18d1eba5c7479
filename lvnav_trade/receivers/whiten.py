"""Measurements with correlated errors as rows with errors of their own: the scalar rows that an update takes."""

from __future__ import annotations

import numpy as np

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import sqrt, where


@jit
def whiten(R, z, H, n, n_entry):
    """Turn n rows z = H x + v, Cov v = R, into n rows whose errors are independent with variance one.

    With R = L L': z <- L^-1 z, H <- L^-1 H, in place. Row i becomes a mixture of rows 0 to i, so it needs the entries
    of all of them. Processed one after another with variance one they are the joint update with R. A row whose R is not
    positive, or that is not measured, becomes not-a-number, and the rows after it that depend on it too.

    Parameters
    ----------
    R : (n, n) symmetric; L is left in its lower triangle
    z : (n,) measured minus predicted; H : (n, n_entry) rows; both updated
    """
    for i in range(n):
        pivot = R[i, i]
        for k in range(i):
            pivot = pivot - R[i, k] * R[i, k]
            z[i] = z[i] - R[i, k] * z[k]
            for e in range(n_entry):
                H[i, e] = H[i, e] - R[i, k] * H[k, e]
        root = sqrt(where(pivot > 0.0, pivot, np.nan))
        scale = 1.0 / root
        R[i, i] = root
        z[i] = z[i] * scale
        for e in range(n_entry):
            H[i, e] = H[i, e] * scale
        for j in range(i + 1, n):
            value = R[j, i]
            for k in range(i):
                value = value - R[j, k] * R[i, k]
            R[j, i] = value * scale
