"""What tests of innovations are in numbers, and what a run knows of its channels."""

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, where, zeros_of
from lvnav_trade.records import Floats

N_FIT = 4


class Tests(NamedTuple):
    """The tests in numbers. single, windowed: largest square of a normalised innovation, and of the sum of the last
    `window` of a channel; consistent (n_dof + 1,) largest sum of squared residuals of a fit by its degrees of freedom;
    shift, offset: largest squares of the shift of position or velocity, and of bias or drift of the clock, over their
    covariance; hold: epochs that a satellite stays excluded; exclusions: of an epoch at most; recovery: sigmas of
    inflation over the shift found; interval s of epochs.
    """

    single: float
    windowed: float
    window: int
    consistent: Floats
    shift: float
    offset: float
    hold: float
    exclusions: int
    recovery: float
    interval: float


class Monitor(NamedTuple):
    """A run's monitor, updated: out (n_channel,) epochs left without the channel; past (n_channel, window) squares of
    its last normalised innovations; weight, square (n_row,) of rows: inverse variance (0 out of use), squared
    normalised innovation; A, inverse (4, 4), b, fit (4,) of the normal equations;
    isolated (n_epoch,) what was isolated (records.ISOLATED); excluded (n_epoch, n_channel) what was excluded there;
    waited (2,) epochs for which the prediction has disagreed with a solution, or, of ranges, epochs left of the hold
    time after an inertial decision, and how many have followed each other; z (n_row,) innovations of the rows;
    variance (n_row,) that the filter assumes of their noise.
    """

    out: Floats
    past: Floats
    weight: Floats
    square: Floats
    A: Floats
    inverse: Floats
    b: Floats
    fit: Floats
    isolated: Floats
    excluded: Floats
    waited: Floats
    z: Floats
    variance: Floats


def new_monitor(n_epoch: int, n_channel: int, n_row: int, window: int, lanes: int = 0) -> Monitor:
    """Return the arrays of a monitor: one run, or `lanes` runs on the last axis."""
    shapes = {
        "out": (n_channel,), "past": (n_channel, window), "weight": (n_row,), "square": (n_row,),
        "A": (N_FIT, N_FIT), "inverse": (N_FIT, N_FIT), "b": (N_FIT,), "fit": (N_FIT,), "isolated": (n_epoch,),
        "excluded": (n_epoch, n_channel), "waited": (2,), "z": (n_row,), "variance": (n_row,),
    }  # fmt: skip
    return Monitor(**zeros_of(shapes, lanes))


@jit
def begin_monitor(own):
    """Begin a run: every channel is in use."""
    if own is not None:
        own.waited[0], own.waited[1] = like(own.waited[0], 0.0), like(own.waited[0], 0.0)
        for c in range(own.out.shape[0]):
            own.out[c] = like(own.out[c], 0.0)
            for k in range(own.past.shape[1]):
                own.past[c, k] = like(own.out[c], 0.0)


@jit
def forget(own, wanted):
    """Forget past innovations in the runs that want it (1): they were of what has been corrected, or of a filter that
    starts again (Monitor, or None).
    """
    if own is not None:
        for c in range(own.past.shape[0]):
            for k in range(own.past.shape[1]):
                own.past[c, k] = where(wanted > 0.0, 0.0, own.past[c, k])


def permitted(own: Any, channel: Any, gate_squared: Any) -> Any:
    """Return the gate of a channel's row: below zero in the runs that exclude it (Monitor, or None)."""
    return gate_squared if own is None else where(own.out[channel] > 0.0, -1.0, gate_squared)


@overload(permitted)
def _permitted(own, channel, gate_squared):
    if own == types.none:
        return lambda own, channel, gate_squared: gate_squared
    return lambda own, channel, gate_squared: where(own.out[channel] > 0.0, -1.0, gate_squared)


def decisions_of(isolated: Floats, excluded: Floats, t_epoch: Floats, first_run: int) -> Floats:
    """Return the decisions (n, 4) of some runs: run, t s, what was isolated, channel that was excluded (-1: none).

    isolated (n_run, n_epoch), excluded (n_run, n_epoch, n_channel) of their monitors; t_epoch (n_epoch,) s.
    """
    found = []
    for run, at in zip(*np.nonzero(isolated), strict=True):
        channels = np.flatnonzero(excluded[run, at]).tolist() or [-1]
        found += [(first_run + run, t_epoch[at], isolated[run, at], channel) for channel in channels]
    return np.array(found, dtype=float).reshape(-1, 4)
