"""Backup strapdown, which is never corrected: the fall-back of a fail-operational vehicle.

It integrates the increments as the IMU outputs them. Its covariance is that of the filter model without measurements,
with the transition matrix linearised at the corrected state, which is the best estimate.
"""

from typing import NamedTuple

from lvnav_trade.filter.ekf import predict_covariance
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import zeros_of
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.kernels.strapdown import N_SUM
from lvnav_trade.quantities.records import Floats


class Backup(NamedTuple):
    """State of the backup strapdown, updated in place.

    nav : (10,). Navigation state, frame i.
    sums : (18,). Strapdown integrals over the window.
    previous : (6,) rad, m/s. Increments of the step before.
    P : (n_state, n_state). Covariance of the filter's states without measurements.
    x : (n_state,). Error at a history time.
    """

    nav: Floats
    sums: Floats
    previous: Floats
    P: Floats
    x: Floats


def new_backup(n_state: int, lanes: int = 0) -> Backup:
    """Return the arrays of a backup strapdown: one run, or `lanes` runs on the last axis."""
    shapes = {"nav": (10,), "sums": (N_SUM,), "previous": (6,), "P": (n_state, n_state), "x": (n_state,)}
    return Backup(**zeros_of(shapes, lanes))


@jit
def begin_backup(backup, work):
    """Start the backup strapdown with the state and the covariance of the corrected strapdown."""
    if backup is not None:
        for i in range(10):
            backup.nav[i] = work.nav[i]
        for i in range(6):
            backup.previous[i] = work.previous[i]
        for i in range(work.P.shape[0]):
            for j in range(work.P.shape[0]):
                backup.P[i, j] = work.P[i, j]


@inline_jit
def advance_backup(backup, work, model, n_tick, dt, seconds):
    """Integrate the increments of a window; called before the estimated IMU errors are removed from them.

    Parameters
    ----------
    backup : Backup, or None
    n_tick : number of increments in the window
    dt : s, of a strapdown step
    seconds : s, from tick 0 to the first tick of the window
    """
    if backup is not None:
        algorithm = model.strapdown
        n_step = n_tick // algorithm.subsamples
        mechanise(backup.nav, backup.sums, backup.previous, work.increments, n_step, dt, algorithm, seconds)


@inline_jit
def predict_backup(backup, work, model, length_index, injection):
    """Propagate the covariance of the backup strapdown over a window, with the blocks of `ekf.fill_transition`."""
    if backup is not None:
        predict_covariance(backup.P, work.D, work.sums, model, length_index, injection)
