"""A tape of a run: what its filter took in and what it made of it, to replay the filter elsewhere."""

from typing import NamedTuple

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import zeros_of
from lvnav_trade.records import Floats


class Tape(NamedTuple):
    """What is recorded of a run. start (10,) navigation state at tick 0; increments (n_imu, 6) as the unit puts them
    out; ranges (n_epoch, n_slot, n_kind), solution (n_epoch, 6) with its own covariance (n_epoch, 6, 6) and observed
    (n_epoch, n_sensor, 4) as they are measured; at the end of every window nav (n_window, 10), x (n_window, n_state),
    variance (n_window, n_state), par (n_window, n_par, 3), clock (n_window, 2) and extra (n_window, n_extra) estimated.
    """

    start: Floats
    increments: Floats
    ranges: Floats
    solution: Floats
    covariance: Floats
    observed: Floats
    nav: Floats
    x: Floats
    variance: Floats
    par: Floats
    clock: Floats
    extra: Floats


MEASURED = ("ranges", "solution", "covariance", "observed")
STATES = ("nav", "x", "variance", "par", "clock", "extra")


def new_tape(work, n_imu: int, n_epoch: int, n_window: int) -> Tape:
    """Return an empty tape of a run whose arrays (Work) these are."""
    shapes = {
        "start": (10,), "increments": (n_imu, 6), "ranges": (n_epoch, *work.ranges.shape), "solution": (n_epoch, 6),
        "covariance": (n_epoch, 6, 6), "observed": (n_epoch, *work.observed.shape), "nav": (n_window, 10),
        "x": (n_window, work.x.size), "variance": (n_window, work.x.size), "par": (n_window, *work.par.shape),
        "clock": (n_window, 2), "extra": (n_window, work.extra.size),
    }  # fmt: skip
    return Tape(**zeros_of(shapes))


@jit
def _copy(to, source):
    for i in range(to.shape[0]):
        to[i] = source[i]


@jit
def _copy_rows(to, source):
    for i in range(to.shape[0]):
        for j in range(to.shape[1]):
            to[i, j] = source[i, j]


@jit
def tape_start(tape, work):
    """Record where a filter starts (Tape, or None where nothing is recorded)."""
    if tape is not None:
        _copy(tape.start, work.nav)


@jit
def tape_increments(tape, work, first, n_tick):
    """Record the increments of a window before the filter takes anything off them."""
    if tape is not None:
        for k in range(n_tick):
            _copy(tape.increments[first + k], work.increments[k])


@jit
def tape_epoch(tape, work, rx, epoch):
    """Record what is measured at an epoch (Receiver, or None where its solution has no covariance of its own)."""
    if tape is not None:
        _copy_rows(tape.ranges[epoch], work.ranges)
        _copy(tape.solution[epoch], work.solution)
        _copy_rows(tape.observed[epoch], work.observed)
        if rx is not None:
            _copy_rows(tape.covariance[epoch], rx.covariance)


@jit
def tape_state(tape, work, w):
    """Record the filter's estimates and variances at the end of a window."""
    if tape is not None:
        _copy(tape.nav[w], work.nav)
        _copy(tape.x[w], work.x)
        _copy_rows(tape.par[w], work.par)
        _copy(tape.clock[w], work.clock_hat)
        _copy(tape.extra[w], work.extra)
        for i in range(work.x.shape[0]):
            tape.variance[w, i] = work.P[i, i]
