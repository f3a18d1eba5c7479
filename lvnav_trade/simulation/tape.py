"""Record of one run of a filter: its inputs, and its estimates before and after the measurements of every epoch."""

from typing import NamedTuple

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import zeros_of
from lvnav_trade.quantities.records import Floats


class Estimates(NamedTuple):
    """Estimates of a filter at some times, (n_time, ...).

    nav : (n_time, 10). Navigation state: attitude quaternion body to i, velocity (m/s), position (m), frame i.
    x : (n_time, n_state). Error state, truth minus estimate, SI.
    P : (n_time, n_state, n_state). Covariance of the error state, SI.
    par : (n_time, n_par, 3). IMU parameters, SI.
    clock : (n_time, 2) m, m/s. Clock bias and drift.
    extra : (n_time, n_extra). Extra states, SI.
    """

    nav: Floats
    x: Floats
    P: Floats
    par: Floats
    clock: Floats
    extra: Floats


class Tape(NamedTuple):
    """Record of a run: inputs and estimates of its filter.

    start : (10,). Navigation state at tick 0.
    increments : (n_tick, 6) rad, m/s. Increments as the IMU outputs them.
    ranges : (n_epoch, n_slot, n_observable). Measured observables of the satellites.
    solution : (n_epoch, 6) m, m/s. Measured position and velocity, frame i.
    covariance : (n_epoch, 6, 6). Covariance reported with the solution.
    sensor_measurements : (n_epoch, n_sensor, 4). Measurements of the other sensors.
    estimates_before : Estimates (n_epoch). Estimates before the measurements of every epoch.
    estimates_after : Estimates (n_epoch + 1). Estimates after them; the last is that at the end of the run.
    """

    start: Floats
    increments: Floats
    ranges: Floats
    solution: Floats
    covariance: Floats
    sensor_measurements: Floats
    estimates_before: Estimates
    estimates_after: Estimates


def _new_estimates(work, n_time: int) -> Estimates:
    n = work.x.size
    shapes = {
        "nav": (n_time, 10),
        "x": (n_time, n),
        "P": (n_time, n, n),
        "par": (n_time, *work.par.shape),
        "clock": (n_time, 2),
        "extra": (n_time, work.extra.size),
    }
    return Estimates(**zeros_of(shapes))


def new_tape(work, n_tick: int, n_epoch: int) -> Tape:
    """Return an empty tape for a run.

    Parameters
    ----------
    work
        Work of the run, for the shapes.
    n_tick
        Number of ticks of the IMU.
    n_epoch
        Number of epochs.
    """
    shapes = {
        "start": (10,),
        "increments": (n_tick, 6),
        "ranges": (n_epoch, *work.ranges.shape),
        "solution": (n_epoch, 6),
        "covariance": (n_epoch, 6, 6),
        "sensor_measurements": (n_epoch, *work.sensor_measurements.shape),
    }
    estimates_before = _new_estimates(work, n_epoch)
    estimates_after = _new_estimates(work, n_epoch + 1)
    return Tape(**zeros_of(shapes), estimates_before=estimates_before, estimates_after=estimates_after)


@jit
def _copy(target, source):
    for i in range(target.shape[0]):
        target[i] = source[i]


@jit
def _copy_rows(target, source):
    for i in range(target.shape[0]):
        for j in range(target.shape[1]):
            target[i, j] = source[i, j]


@jit
def _copy_estimates(target, work, index):
    _copy(target.nav[index], work.nav)
    _copy(target.x[index], work.x)
    _copy_rows(target.P[index], work.P)
    _copy_rows(target.par[index], work.par)
    _copy(target.clock[index], work.clock_hat)
    _copy(target.extra[index], work.extra)


@jit
def tape_start(tape, work):
    """Record the initial estimate (Tape, or None)."""
    if tape is not None:
        _copy(tape.start, work.nav)


@jit
def tape_increments(tape, work, first, n_tick):
    """Record the increments of a window before they are compensated.

    Parameters
    ----------
    tape : Tape, updated in place, or None
    work : Work
    first, n_tick : first tick, number of ticks
    """
    if tape is not None:
        for k in range(n_tick):
            _copy(tape.increments[first + k], work.increments[k])


@jit
def tape_epoch(tape, work, receiver, epoch):
    """Record the measurements of an epoch.

    Parameters
    ----------
    tape : Tape, updated in place, or None
    work : Work
    receiver : Receiver that reports a covariance, or None
    epoch : index
    """
    if tape is not None:
        _copy_rows(tape.ranges[epoch], work.ranges)
        _copy(tape.solution[epoch], work.solution)
        _copy_rows(tape.sensor_measurements[epoch], work.sensor_measurements)
        if receiver is not None:
            _copy_rows(tape.covariance[epoch], receiver.covariance)


@jit
def tape_before(tape, work, epoch):
    """Record the estimates before the measurements of an epoch are processed."""
    if tape is not None:
        _copy_estimates(tape.estimates_before, work, epoch)


@jit
def tape_after(tape, work, epoch):
    """Record the estimates after the measurements of an epoch have been processed; -1: at the end of the run."""
    if tape is not None:
        _copy_estimates(tape.estimates_after, work, epoch)
