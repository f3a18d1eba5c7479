"""Linear error propagation from ranges to the receiver's solution, and from there to the navigation filter.

All errors are truth minus estimate. Over an epoch the receiver's error e follows

    e+ = (I - K H)(Phi e + d + w) - K v

with H the rows of ranges and range rates, v the errors in them (white ones and those that measurements share), w what
the true clock does beside its transition and d = x - Phi x_before what the true motion does, the same in every run. The
navigation filter takes the solution, of error S e, for a measurement: its innovation is H_nav e_nav - S e. So e belongs
into the joint vector, with its own gains K: it is coloured, and a covariance that takes it for white noise at every
epoch is the better the slower the navigation filter forgets, and too small.

What stands here is written in dense matrices.
"""

from typing import NamedTuple

import numpy as np

from lvnav_trade.line_of_sight import sight
from lvnav_trade.receivers.base import (
    ACC,
    BIAS,
    DRIFT,
    N_FIX,
    N_STATE,
    POS,
    VEL,
    PointModel,
    ReceiverFilter,
    ReportedCovariance,
    transition,
)
from lvnav_trade.receivers.ekf_gnss import adapted, drive
from lvnav_trade.records import Bools, Floats

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


def design(r_i: Floats, v_i: Floats, satellite: Floats, moving: Floats) -> Floats:
    """Return the rows (2 n_sat, 11) of pseudorange and range rate in turn; satellites (n_sat, 3), all in frame i."""
    seen = sight(satellite - r_i, moving - v_i)
    found = np.zeros((2 * len(satellite), N_STATE))
    found[0::2, POS : POS + 3] = -seen.direction
    found[0::2, BIAS] = 1.0
    found[1::2, POS : POS + 3] = -seen.turning
    found[1::2, VEL : VEL + 3] = -seen.direction
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


def noises(model: ReceiverFilter, acceleration: Floats, n_row: int) -> tuple[Floats, Floats]:
    """Return the filter's own process noise (11, 11) and variances (n_row,) of rows under a nominal acceleration."""
    x, y, z, ranges, rates = adapted(*(float(a) for a in acceleration), model)
    noise = np.zeros((N_STATE, N_STATE))
    drive(noise, model, x, y, z)
    return noise, np.tile([ranges, rates], n_row // 2)


def nominal_acceleration(v_i: Floats, fixed: Bools, interval: float) -> Floats:
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


def point_solution(model: PointModel, rows: Floats) -> Gains:
    """Return an epoch of the point solution, which keeps nothing of the one before."""
    P, gain = np.zeros((N_STATE, N_STATE)), np.zeros((N_STATE, len(rows)))
    gain[FIX_STATES] = point_gain(rows)
    for at, variance, part in (
        ([*range(POS, POS + 3), BIAS], model.range_variance, rows[0::2]),
        ([*range(VEL, VEL + 3), DRIFT], model.rate_variance, rows[1::2]),
    ):
        P[np.ix_(at, at)] = variance * np.linalg.inv(part[:, at].T @ part[:, at])
    return Gains(np.zeros((N_STATE, N_STATE)), np.zeros((N_STATE, N_STATE)), gain, P)


def started(model: ReceiverFilter, point: PointModel, rows: Floats) -> Gains:
    """Return the epoch of the fix that starts the filter; the error of acceleration is the whole of it afterwards."""
    found, acceleration = point_solution(point, rows), range(ACC, ACC + 3)
    found.P[acceleration, acceleration] = model.start
    found.keep[acceleration, acceleration] = 1.0
    return found


def filtered(P: Floats, model: ReceiverFilter, rows: Floats, acceleration: Floats) -> Gains:
    """Return the epoch of a running filter whose covariance was P; with no rows it carries on."""
    noise, variance = noises(model, acceleration, len(rows))
    phi = transition(model)
    P = phi @ P @ phi.T + noise
    gain = np.asarray(np.linalg.solve(rows @ P @ rows.T + np.diag(variance), rows @ P).T, dtype=np.float64)
    keep = np.eye(N_STATE) - gain @ rows
    return Gains(phi, keep, gain, keep @ P @ keep.T + (gain * variance) @ gain.T)


def mismatch(model: ReceiverFilter, acceleration: Floats, v_i: Floats, r_i: Floats) -> Floats:
    """Return d (n_epoch, 11): what true motion (n_epoch, 3) adds to the filter's error; at the first epoch the state.

    Without acceleration states there is no error of them: give zeros for the acceleration.
    """
    state = np.zeros((len(r_i), N_STATE))
    state[:, ACC : ACC + 3], state[:, VEL : VEL + 3], state[:, POS : POS + 3] = acceleration, v_i, r_i
    found = state.copy()
    found[1:] -= state[:-1] @ transition(model).T
    return found


def reported_covariance(reported: ReportedCovariance, P: Floats) -> Floats:
    """Return the covariance (6, 6) that goes out with a solution whose own covariance is P (11, 11)."""
    if not reported.own:
        return np.diag([reported.position_variance] * 3 + [reported.velocity_variance] * 3)
    R = np.asarray(reported.factor * P[np.ix_(SOLUTION, SOLUTION)])
    return R if reported.correlated else np.diag(np.diag(R))
