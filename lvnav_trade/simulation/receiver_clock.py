"""True receiver clock of one run by itself, for `api.flights`: with the draws and the step of `sensing`."""

import numpy as np

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.random import normals, seed_words
from lvnav_trade.quantities.records import Floats
from lvnav_trade.simulation.preparation.prepare import PreparedCase
from lvnav_trade.simulation.sensing import step_clock


@jit
def _walk(
    path: Floats,
    jump: Floats,
    start: Floats,
    step: Floats,
    interval: float,
    source_keys: tuple[np.uint64, np.uint64],
    run: np.uint64,
    key: tuple[np.uint64, np.uint64],
) -> None:
    """Set bias and drift before the first epoch and at every epoch.

    Parameters
    ----------
    path
        (n_epoch + 1, 2) m and m/s, set here.
    jump
        (n_epoch, 2) m and m/s. Jumps of bias and drift by faults.
    start, step
        (2,) initial one-sigma; (3,) Cholesky factor of the noise over an epoch.
    interval
        s. Time between epochs.
    source_keys
        Keys of the draws of the start and of the steps.
    run, key
        Number of the run; key words of the seed.
    """
    zero = np.uint64(0)
    start_source, epoch_source = source_keys
    k0, k1 = key
    n0, n1, _, _ = normals(k0, k1, start_source, run, zero, zero)
    path[0, 0] = start[0] * n0
    path[0, 1] = start[1] * n1
    for epoch in range(jump.shape[0]):
        n0, n1, _, _ = normals(k0, k1, epoch_source, run, np.uint64(epoch + 1), zero)
        path[epoch + 1, 0] = path[epoch, 0]
        path[epoch + 1, 1] = path[epoch, 1]
        step_clock(path[epoch + 1], step, interval, jump[epoch], n0, n1)


def true_clock(prepared_case: PreparedCase, seed: int, run: int) -> Floats:
    """Return the true clock bias (m) and drift (m/s) of the receiver at the epochs of a run, (n_epoch, 2).

    Parameters
    ----------
    prepared_case
        Prepared case.
    seed
        Seed of the campaign.
    run
        Number of the run.
    """
    signals = prepared_case.signals
    path = np.zeros((prepared_case.t_epoch.size + 1, 2))
    _walk(
        path,
        signals.clock_jump,
        signals.clock_start,
        signals.clock_step,
        signals.interval,
        (signals.source_keys[3], signals.source_keys[0]),
        np.uint64(run),
        seed_words(seed),
    )
    return path[1:]
