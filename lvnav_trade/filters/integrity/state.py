"""Tests for faults as numbers, and the fault monitor of a run."""

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from lvnav_trade.kernels.covariance import NOT_USED
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, where, zeros_of
from lvnav_trade.records import Floats

N_FIT = 4


class Tests(NamedTuple):
    """Tests for faults, as numbers.

    single : Largest square of one normalised innovation.
    windowed : Largest sum of the last `window` squares of a channel.
    window : Number of epochs in that sum.
    consistent : (n_dof + 1,). Largest sum of squared residuals of a fit, by degrees of freedom.
    shift : Largest square of the shift of position or velocity, relative to its covariance.
    joint : Largest square of the shift of position or velocity and of the clock together, relative to their covariance.
    offset : Largest square of the shift of clock bias or drift, relative to its variance.
    hold : Epochs for which a satellite stays excluded.
    exclusions : Largest number of exclusions in an epoch.
    recovery : Standard deviation added after a fault, as a multiple of the shift found.
    interval : s. Time between epochs.
    """

    single: float
    windowed: float
    window: int
    consistent: Floats
    shift: float
    joint: float
    offset: float
    hold: float
    exclusions: int
    recovery: float
    interval: float


class Monitor(NamedTuple):
    """Fault monitor of a run, updated in place.

    out : (n_channel,). Remaining epochs without the channel.
    past : (n_channel, window). Squares of the last normalised innovations of the channel.
    weight : (n_row,). Inverse variance of each scalar measurement; 0 if it is not used.
    square : (n_row,). Square of its normalised innovation.
    A : (4, 4). Normal matrix of the fit.
    inverse : (4, 4). Inverse of the normal matrix.
    spare : (4, 4). Inverse of another matrix.
    b : (4,). Right-hand side of the normal equations.
    fit : (4,). Solution of the normal equations.
    isolated : (n_epoch,). Kind of fault isolated, as in `records.ISOLATED`.
    excluded : (n_epoch, n_channel). 1 for the channels excluded at the epoch.
    waited : (2,). Loose: epochs of disagreement with the solution. Tight: hold epochs left after an inertial decision,
        and how many decisions in succession.
    z : (n_row,). Innovations.
    variance : (n_row,). Noise variance in the filter model.
    """

    out: Floats
    past: Floats
    weight: Floats
    square: Floats
    A: Floats
    inverse: Floats
    spare: Floats
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
        "out": (n_channel,),
        "past": (n_channel, window),
        "weight": (n_row,),
        "square": (n_row,),
        "A": (N_FIT, N_FIT),
        "inverse": (N_FIT, N_FIT),
        "spare": (N_FIT, N_FIT),
        "b": (N_FIT,),
        "fit": (N_FIT,),
        "isolated": (n_epoch,),
        "excluded": (n_epoch, n_channel),
        "waited": (2,),
        "z": (n_row,),
        "variance": (n_row,),
    }
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
def clear_innovations(own, wanted):
    """Clear the past innovations of the runs that want it (1): they were of what has been corrected, or of a filter
    that starts again (Monitor, or None).
    """
    if own is not None:
        for c in range(own.past.shape[0]):
            for k in range(own.past.shape[1]):
                own.past[c, k] = where(wanted > 0.0, 0.0, own.past[c, k])


def permitted(own: Any, channel: Any, gate_squared: Any) -> Any:
    """Return the gate of a channel's row: NOT_USED in the runs that exclude it (Monitor, or None)."""
    return gate_squared if own is None else where(own.out[channel] > 0.0, NOT_USED, gate_squared)


@overload(permitted)
def _permitted(own, channel, gate_squared):
    if own == types.none:
        return lambda own, channel, gate_squared: gate_squared
    return lambda own, channel, gate_squared: where(own.out[channel] > 0.0, NOT_USED, gate_squared)


def decisions_of(isolated: Floats, excluded: Floats, t_epoch: Floats, first_run: int) -> Floats:
    """Return the decisions (n, 4) of some runs: run, t s, what was isolated, channel that was excluded (-1: none).

    isolated (n_run, n_epoch), excluded (n_run, n_epoch, n_channel) of their monitors; t_epoch (n_epoch,) s.
    """
    found = []
    for run, at in zip(*np.nonzero(isolated), strict=True):
        channels = np.flatnonzero(excluded[run, at]).tolist() or [-1]
        found += [(first_run + run, t_epoch[at], isolated[run, at], channel) for channel in channels]
    return np.array(found, dtype=float).reshape(-1, 4)
