"""A second strapdown that is never corrected: the fall-back of a vehicle (fail-operational).

It takes the increments as the unit puts them out. Its covariance is that of the filter's model without measurements, by
the transition at the corrected state, the best that is known.
"""

from typing import NamedTuple

from lvnav_trade.filters.ekf import predict_covariance
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import zeros_of
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.kernels.strapdown import N_SUM
from lvnav_trade.records import Floats


class Backup(NamedTuple):
    """State of the strapdown, updated: nav (10,), sums (18,), previous (6,), P (n, n) covariance of the filter's states
    without measurements, x (n,) error at a history time.
    """

    nav: Floats
    sums: Floats
    previous: Floats
    P: Floats
    x: Floats


def new_backup(n_state: int, lanes: int = 0) -> Backup:
    """Return the arrays of a strapdown that is never corrected: one run, or `lanes` runs on the last axis."""
    shapes = {"nav": (10,), "sums": (N_SUM,), "previous": (6,), "P": (n_state, n_state), "x": (n_state,)}
    return Backup(**zeros_of(shapes, lanes))


@jit
def begin_backup(backup, work):
    """Let it start where the corrected one does, with nothing sensed before."""
    if backup is not None:
        for i in range(10):
            backup.nav[i] = work.nav[i]
        for i in range(6):
            backup.previous[i] = work.previous[i]
        for i in range(work.P.shape[0]):
            for j in range(work.P.shape[0]):
                backup.P[i, j] = work.P[i, j]


@inlined
def advance_backup(backup, work, model, n_tick, dt, seconds):
    """Mechanise the increments of a window before anything is taken off them; dt s of a strapdown step, seconds from
    tick 0 to the first of them.
    """
    if backup is not None:
        how = model.strapdown
        mechanise(backup.nav, backup.sums, backup.previous, work.increments, n_tick // how.subsamples, dt, how, seconds)


@inlined
def predict_backup(backup, work, model, length, injection):
    """Propagate its covariance over a window, with the blocks that `fill_transition` has filled."""
    if backup is not None:
        predict_covariance(backup.P, work.D, work.sums, model, length, injection)
