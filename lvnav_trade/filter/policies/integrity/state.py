"""Tests for faults as numbers, the fault monitor of a run, and the weighted fit that both rest on."""

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from lvnav_trade.kernels.covariance import CLOSED_GATE
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import number_like, where, zeros_of
from lvnav_trade.quantities.records import Floats
from lvnav_trade.sensors.jacobian_row import H_CLOCK

N_FIT = 4


class FaultTests(NamedTuple):
    """Thresholds of the tests for faults.

    single_limit : Largest square of one normalised innovation.
    window_limit : Largest sum of the last `window` squares of a channel.
    window : Number of epochs in that sum.
    residual_limits : (n_dof + 1,). Largest sum of squared residuals of a fit, by degrees of freedom.
    shift_limit : Largest square of the shift of position or velocity, relative to its covariance.
    joint_limit : Largest square of the shift of position or velocity and of the clock together, relative to their
        covariance.
    clock_limit : Largest square of the shift of clock bias or drift, relative to its variance.
    hold : Epochs for which a satellite stays excluded.
    exclusions : Largest number of exclusions in an epoch.
    recovery : Standard deviation added after a fault, as a multiple of the shift found.
    interval : s. Time between epochs.
    """

    single_limit: float
    window_limit: float
    window: int
    residual_limits: Floats
    shift_limit: float
    joint_limit: float
    clock_limit: float
    hold: float
    exclusions: int
    recovery: float
    interval: float


class Monitor(NamedTuple):
    """Fault monitor of a run, updated in place.

    remaining_hold : (n_channel,). Remaining epochs without the channel.
    recent_squares : (n_channel, window). Squares of the last normalised innovations of the channel.
    weight : (n_row,). Inverse variance of each scalar measurement; 0 if it is not used.
    square : (n_row,). Square of its normalised innovation.
    A : (4, 4). Normal matrix of the fit.
    inverse : (4, 4). Inverse of the normal matrix.
    spare : (4, 4). Scratch for the inverse of another matrix.
    b : (4,). Right-hand side of the normal equations.
    fit : (4,). Solution of the normal equations.
    fault_type : (n_epoch,). Kind of fault isolated, as in `records.ISOLATED`.
    is_excluded : (n_epoch, n_channel). 1 for the channels excluded at the epoch.
    fault_counters : (2,). Loose: epochs of disagreement with the solution. Tight: remaining hold epochs after an
        inertial decision, and number of successive decisions.
    z : (n_row,). Innovations.
    variance : (n_row,). Noise variance in the filter model.
    """

    remaining_hold: Floats
    recent_squares: Floats
    weight: Floats
    square: Floats
    A: Floats
    inverse: Floats
    spare: Floats
    b: Floats
    fit: Floats
    fault_type: Floats
    is_excluded: Floats
    fault_counters: Floats
    z: Floats
    variance: Floats


def new_monitor(n_epoch: int, n_channel: int, n_row: int, window: int, lanes: int = 0) -> Monitor:
    """Return the arrays of a monitor: one run, or `lanes` runs on the last axis."""
    shapes = {
        "remaining_hold": (n_channel,),
        "recent_squares": (n_channel, window),
        "weight": (n_row,),
        "square": (n_row,),
        "A": (N_FIT, N_FIT),
        "inverse": (N_FIT, N_FIT),
        "spare": (N_FIT, N_FIT),
        "b": (N_FIT,),
        "fit": (N_FIT,),
        "fault_type": (n_epoch,),
        "is_excluded": (n_epoch, n_channel),
        "fault_counters": (2,),
        "z": (n_row,),
        "variance": (n_row,),
    }
    return Monitor(**zeros_of(shapes, lanes))


@jit
def begin_monitor(monitor):
    """Reset the monitor (Monitor, or None) at the start of a run: every channel is in use."""
    if monitor is not None:
        monitor.fault_counters[0] = number_like(monitor.fault_counters[0], 0.0)
        monitor.fault_counters[1] = number_like(monitor.fault_counters[0], 0.0)
        for c in range(monitor.remaining_hold.shape[0]):
            monitor.remaining_hold[c] = number_like(monitor.remaining_hold[c], 0.0)
            for k in range(monitor.recent_squares.shape[1]):
                monitor.recent_squares[c, k] = number_like(monitor.remaining_hold[c], 0.0)


@jit
def clear_innovations(monitor, selection):
    """Clear the stored innovations in the runs where `selection` is 1 (Monitor, or None).

    Called after a recovery or a restart of the filter: earlier innovations do not test the new estimate.
    """
    if monitor is not None:
        for c in range(monitor.recent_squares.shape[0]):
            for k in range(monitor.recent_squares.shape[1]):
                monitor.recent_squares[c, k] = where(selection > 0.0, 0.0, monitor.recent_squares[c, k])


def channel_gate(monitor: Any, channel: Any, gate_squared: Any) -> Any:
    """Return the gate for a channel: CLOSED_GATE in the runs that exclude it (Monitor), otherwise `gate_squared`."""
    if monitor is None:
        return gate_squared
    return where(monitor.remaining_hold[channel] > 0.0, CLOSED_GATE, gate_squared)


@overload(channel_gate)
def _overload_channel_gate(monitor, channel, gate_squared):
    if monitor == types.none:
        return lambda monitor, channel, gate_squared: gate_squared
    return lambda monitor, channel, gate_squared: where(
        monitor.remaining_hold[channel] > 0.0, CLOSED_GATE, gate_squared
    )


def fault_decisions(fault_type: Floats, is_excluded: Floats, t_epoch: Floats, first_run: int) -> Floats:
    """Return the decisions of the fault monitors of some runs.

    Parameters
    ----------
    fault_type
        (n_run, n_epoch). Kind of fault isolated, as in `records.ISOLATED`; 0 none.
    is_excluded
        (n_run, n_epoch, n_channel). 1 for excluded channels.
    t_epoch
        (n_epoch,) s. Times of the epochs.
    first_run
        Number of the first of these runs.

    Returns
    -------
    ndarray
        (n, 4). Run, time (s), kind of fault, excluded channel (-1 none); one row per excluded channel.
    """
    decisions = []
    for run, epoch in np.argwhere(fault_type):
        channels = np.flatnonzero(is_excluded[run, epoch]).tolist()
        for channel in channels or [-1]:
            decisions.append((first_run + run, t_epoch[epoch], fault_type[run, epoch], channel))
    return np.array(decisions, dtype=float).reshape(-1, 4)


@jit
def limit(table, dof):
    """Return the threshold for a number of degrees of freedom; infinite without redundancy (dof below 1)."""
    threshold = number_like(dof, np.inf)
    for k in range(1, table.shape[0]):
        threshold = where(dof == float(k), table[k], threshold)
    return threshold


@jit
def invert(inverse, A):
    """Set the inverse of a positive definite matrix A (n, n) by Gauss-Jordan elimination; A is overwritten."""
    n = A.shape[0]
    for i in range(n):
        for j in range(n):
            inverse[i, j] = number_like(A[0, 0], 1.0 if i == j else 0.0)
    for k in range(n):
        scale = 1.0 / A[k, k]
        for j in range(n):
            A[k, j] = A[k, j] * scale
            inverse[k, j] = inverse[k, j] * scale
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
def _fit_weight(monitor, row):
    """Return the weight of a row in a fit; a negative weight marks a row that is withheld from fits."""
    return where(monitor.weight[row] > 0.0, monitor.weight[row], 0.0)


@jit
def fit(monitor, H, z, first, observable, n_observable, n_row):
    """Fit position or velocity and clock to the innovations z of one observable, by weighted least squares.

    Sets `monitor.fit` = (G' W G)^-1 G' W z and its covariance `monitor.inverse` = (G' W G)^-1.

    Parameters
    ----------
    monitor : Monitor, with the weights W of the rows; rows without a positive weight do not enter
    H : (n_row, n_entry) Jacobian rows
    z : (n_row,) innovations
    first : first entry of position or velocity in a row
    observable, n_observable : observable, and number of observables of a satellite
    n_row : number of rows

    Returns
    -------
    square : weighted sum of squared residuals
    dof : degrees of freedom, rows in use minus 4
    """
    zero = number_like(monitor.fit[0], 0.0)
    for i in range(N_FIT):
        monitor.b[i] = zero
        for j in range(N_FIT):
            # keeps the matrix regular with fewer than four rows; such a fit is not used, since its dof is negative
            monitor.A[i, j] = zero + (1e-12 if i == j else 0.0)
    dof = zero - N_FIT
    for row in range(observable, n_row, n_observable):
        weight = _fit_weight(monitor, row)
        dof = dof + where(weight > 0.0, 1.0, 0.0)
        for i in range(N_FIT):
            weighted_entry = weight * _direction(H, row, first, i)
            monitor.b[i] = monitor.b[i] + weighted_entry * z[row]
            for j in range(N_FIT):
                normal_term = weighted_entry * _direction(H, row, first, j)
                monitor.A[i, j] = monitor.A[i, j] + normal_term
    invert(monitor.inverse, monitor.A)
    for i in range(N_FIT):
        total = zero
        for j in range(N_FIT):
            total = total + monitor.inverse[i, j] * monitor.b[j]
        monitor.fit[i] = total
    square = zero
    for row in range(observable, n_row, n_observable):
        residual = z[row]
        for i in range(N_FIT):
            residual = residual - _direction(H, row, first, i) * monitor.fit[i]
        weight = _fit_weight(monitor, row)
        square = square + weight * residual * residual
    return square, dof
