"""The joint covariance of a receiver's filter and a navigation filter behind it, in dense matrices, for comparison."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lvnav_trade.filter.receivers.error_propagation import SOLUTION, ErrorPropagation, reported_covariance
from lvnav_trade.filter.receivers.receiver import BIAS, DRIFT, N_STATE, ReceiverFilter
from lvnav_trade.quantities.records import Floats


class Outer(NamedTuple):
    """A navigation filter: phi, noise (n, n) of the truth, assumed (n, n) noise, rows (6, n) of the solution."""

    phi: Floats
    noise: Floats
    assumed: Floats
    rows: Floats


class History(NamedTuple):
    """By epochs: mean (n_epoch, n_z) and covariance (n_epoch, n_z, n_z) of z = [e_nav, e_receiver, shared]; formal
    (n_epoch, n, n) of the navigation filter; white (n_epoch, n, n) its true covariance if the receiver's error were
    white noise of the same size.
    """

    mean: Floats
    covariance: Floats
    formal: Floats
    white: Floats


def propagate(
    epochs: list[ErrorPropagation],
    pushes: Floats,
    clock: Floats,
    variances: list[Floats],
    model: ReceiverFilter,
    outer: Outer,
    P: Floats,
    shared: Floats,
    decay: Floats,
    partials: list[Floats],
) -> History:
    """Carry the navigation filter behind the receiver's over epochs, one interval between two, solution at every one.

    Parameters
    ----------
    epochs : gains of the receiver; pushes (n_epoch, 11) `mismatch`; clock (2, 2) noise of the true clock an interval
    variances : true variances (n_row,) of the rows' white errors, by epoch
    outer, P : the navigation filter and its covariance (n, n) before the first epoch, true and assumed
    shared : (m, m) steady covariance of errors that rows share; decay (m,) over an interval; partials (n_row, m) of the
        rows with respect to them, by epoch
    """
    n, m = len(P), len(shared)
    receiver, c = slice(n, n + N_STATE), slice(n + N_STATE, n + N_STATE + m)
    mean, C = np.zeros(n + N_STATE + m), np.zeros((n + N_STATE + m,) * 2)
    C[:n, :n], C[c, c], formal, white = P, shared, P.copy(), P.copy()
    found: list[tuple[Floats, Floats, Floats, Floats]] = []
    for k, gains in enumerate(epochs):
        A, noise = np.eye(len(C)), np.zeros_like(C)
        if k:
            A[:n, :n], A[c, c] = outer.phi, np.diag(decay)
            noise[:n, :n] = outer.noise
            noise[c, c] = shared * (1.0 - np.outer(decay, decay))
            formal = outer.phi @ formal @ outer.phi.T + outer.assumed
            white = outer.phi @ white @ outer.phi.T + outer.noise
            noise[n + BIAS : n + DRIFT + 1, n + BIAS : n + DRIFT + 1] = clock
        A[receiver, receiver] = gains.phi
        C, mean = A @ C @ A.T + noise, A @ mean
        mean[receiver] += pushes[k]
        U = np.eye(len(C))
        U[receiver, receiver], U[receiver, c] = gains.update_matrix, -gains.gain @ partials[k]
        C, mean = U @ C @ U.T, U @ mean
        C[receiver, receiver] += (gains.gain * variances[k]) @ gains.gain.T
        reported = reported_covariance(model.reported_covariance, gains.P)
        gain = np.linalg.solve(outer.rows @ formal @ outer.rows.T + reported, outer.rows @ formal).T
        keep = np.eye(n) - gain @ outer.rows
        U = np.eye(len(C))
        U[:n, :n] = keep
        U[:n, n + SOLUTION] = gain
        error = C[np.ix_(n + SOLUTION, n + SOLUTION)]
        white = keep @ white @ keep.T + gain @ error @ gain.T
        formal = keep @ formal @ keep.T + gain @ reported @ gain.T
        C, mean = U @ C @ U.T, U @ mean
        found.append((mean, C, formal, white))
    means, covariances, formals, whites = zip(*found, strict=True)
    return History(np.array(means), np.array(covariances), np.array(formals), np.array(whites))
