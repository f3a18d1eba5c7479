"""A filter behind a filter, linearly: from errors of ranges to the receiver's solution, and on to the navigation.

All errors are truth minus estimate. Over an epoch the receiver's error e follows

    e+ = (I - K H)(Phi e + d + w) - K v

with H the rows of ranges and range rates, v the errors in them (white ones and those that measurements share), w what
the true clock does beside its transition and d = x - Phi x_before what the true motion does, the same in every run. The
navigation filter takes the solution, of error S e, for a measurement: its innovation is H_nav e_nav - S e. So e belongs
into the joint vector, with its own gains K: it is coloured, and a covariance that takes it for white noise at every
epoch is the better the slower the navigation filter forgets, and too small.

What stands here is written for reading, in dense matrices; `propagate` is the reference that an implementation by
sources is held against.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.receivers.base import (
    ACC,
    BIAS,
    DRIFT,
    N_FIX,
    N_STATE,
    POS,
    VEL,
    FilterModel,
    Floats,
    PointModel,
    transition,
)
from lvnav_trade.receivers.ekf_gnss import adapted, drive

# The solution's six components among the states of the receiver's filter.
SOLUTION = np.array([*range(POS, POS + 3), *range(VEL, VEL + 3)])
# States of the point solution, in its own order.
FIX_STATES = np.array([*SOLUTION, BIAS, DRIFT])


class Gains(NamedTuple):
    """What the receiver does at an epoch: phi (11, 11), keep (11, 11) = I - K H, gain (11, n_row) = K, and its own
    covariance P (11, 11) after it. A fix that starts the filter keeps nothing: keep is zero.
    """

    phi: Floats
    keep: Floats
    gain: Floats
    P: Floats


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


def design(r_i: Floats, v_i: Floats, satellite: Floats, moving: Floats) -> Floats:
    """Return the rows (2 n_sat, 11) of pseudorange and range rate in turn; satellites (n_sat, 3), all in frame i."""
    line, relative = satellite - r_i, moving - v_i
    distance = np.linalg.norm(line, axis=1)[:, None]
    u = line / distance
    along = np.sum(u * relative, axis=1, keepdims=True)
    found = np.zeros((2 * len(u), N_STATE))
    found[0::2, POS : POS + 3] = -u
    found[0::2, BIAS] = 1.0
    found[1::2, POS : POS + 3] = -(relative - along * u) / distance
    found[1::2, VEL : VEL + 3] = -u
    found[1::2, DRIFT] = 1.0
    return found


def point_gain(rows: Floats) -> Floats:
    """Return G (8, n_row) of the point solution: position, velocity, bias, drift get the error -G v from errors v.

    Position and bias come from the pseudoranges alone; a wrong position then turns the lines of sight of the rates.
    Fewer than four satellites have none: numpy.linalg.LinAlgError, or not enough rows, is the caller's to avoid.
    """
    ranges, rates = rows[0::2], rows[1::2]
    place = np.linalg.pinv(ranges[:, [*range(POS, POS + 3), BIAS]])
    speed = np.linalg.pinv(rates[:, [*range(VEL, VEL + 3), DRIFT]])
    found = np.zeros((N_FIX, len(rows)))
    found[np.ix_([0, 1, 2, 6], range(0, len(rows), 2))] = place
    found[np.ix_([3, 4, 5, 7], range(1, len(rows), 2))] = speed
    found[np.ix_([3, 4, 5, 7], range(0, len(rows), 2))] = -speed @ rates[:, POS : POS + 3] @ place[:3]
    return found


def noises(model: FilterModel, acceleration: Floats, n_row: int) -> tuple[Floats, Floats]:
    """Return the filter's own process noise (11, 11) and variances (n_row,) of rows under a nominal acceleration."""
    x, y, z, ranges, rates = adapted(*(float(a) for a in acceleration), model)
    noise = np.zeros((N_STATE, N_STATE))
    drive(noise, model, x, y, z)
    return noise, np.tile([ranges, rates], n_row // 2)


def nominal_acceleration(v_i: Floats, fixed: NDArray[np.bool_], interval: float) -> Floats:
    """Return the acceleration (n_epoch, 3) that the receiver's filter would adapt by on the nominal motion.

    The difference of velocities (n_epoch, 3) at the last two epochs with a point solution, `fixed` (n_epoch,), over the
    time between them; before there are two of them zero, and while there is none the last one.
    """
    found, before = np.zeros_like(v_i), -1
    for k in range(len(v_i)):
        found[k] = found[k - 1] if k else 0.0
        if fixed[k]:
            if before >= 0:
                found[k] = (v_i[k] - v_i[before]) / (interval * (k - before))
            before = k
    return found


def started(model: FilterModel, point: PointModel, rows: Floats) -> Gains:
    """Return the epoch of the fix that starts the filter; the error of acceleration is the whole of it afterwards."""
    n_row = len(rows)
    gain = np.zeros((N_STATE, n_row))
    gain[FIX_STATES] = point_gain(rows)
    ranges, rates = rows[0::2], rows[1::2]
    at, rate_at = [*range(POS, POS + 3), BIAS], [*range(VEL, VEL + 3), DRIFT]
    P = np.zeros((N_STATE, N_STATE))
    P[np.ix_(at, at)] = point.range_variance * np.linalg.inv(ranges[:, at].T @ ranges[:, at])
    P[np.ix_(rate_at, rate_at)] = point.rate_variance * np.linalg.inv(rates[:, rate_at].T @ rates[:, rate_at])
    P[range(ACC, ACC + 3), range(ACC, ACC + 3)] = model.start
    keep = np.zeros((N_STATE, N_STATE))
    keep[ACC : ACC + 3, ACC : ACC + 3] = np.eye(3)
    return Gains(np.zeros((N_STATE, N_STATE)), keep, gain, P)


def filtered(P: Floats, model: FilterModel, rows: Floats, acceleration: Floats) -> Gains:
    """Return the epoch of a running filter whose covariance was P; with no rows it carries on."""
    noise, variance = noises(model, acceleration, len(rows))
    phi = transition(model)
    P = phi @ P @ phi.T + noise
    gain = np.asarray(np.linalg.solve(rows @ P @ rows.T + np.diag(variance), rows @ P).T, dtype=np.float64)
    keep = np.eye(N_STATE) - gain @ rows
    return Gains(phi, keep, gain, keep @ P @ keep.T + (gain * variance) @ gain.T)


def mismatch(model: FilterModel, acceleration: Floats, v_i: Floats, r_i: Floats) -> Floats:
    """Return d (n_epoch, 11): what true motion (n_epoch, 3) adds to the filter's error; at the first epoch the state.

    Without acceleration states there is no error of them: give zeros for the acceleration.
    """
    state = np.zeros((len(r_i), N_STATE))
    state[:, ACC : ACC + 3], state[:, VEL : VEL + 3], state[:, POS : POS + 3] = acceleration, v_i, r_i
    found = state.copy()
    found[1:] -= state[:-1] @ transition(model).T
    return found


def reported_covariance(gains: Gains, model: FilterModel) -> Floats:
    """Return the covariance (6, 6) that goes out with a solution of the filter."""
    reported = model.reported
    if not reported.own:
        return np.diag([reported.position_variance] * 3 + [reported.velocity_variance] * 3)
    R = reported.factor * gains.P[np.ix_(SOLUTION, SOLUTION)]
    return R if reported.correlated else np.diag(np.diag(R))


def propagate(
    epochs: list[Gains],
    pushes: Floats,
    clock: Floats,
    variances: list[Floats],
    model: FilterModel,
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
    rx, c = slice(n, n + N_STATE), slice(n + N_STATE, n + N_STATE + m)
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
        A[rx, rx] = gains.phi
        C, mean = A @ C @ A.T + noise, A @ mean
        mean[rx] += pushes[k]
        U = np.eye(len(C))
        U[rx, rx], U[rx, c] = gains.keep, -gains.gain @ partials[k]
        C, mean = U @ C @ U.T, U @ mean
        C[rx, rx] += (gains.gain * variances[k]) @ gains.gain.T
        reported = reported_covariance(gains, model)
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
