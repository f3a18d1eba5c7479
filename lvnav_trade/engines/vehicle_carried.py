"""What the pass of a flight with an attitude reference carries; sources in lanes; ticks of the nominal flight."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from lvnav_trade.kernels.attitude import cross, matrix
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import view
from lvnav_trade.kernels.strapdown import mechanise, place
from lvnav_trade.kernels.vector import WIDTH
from lvnav_trade.records import Floats

Ints = NDArray[np.int64]


class Spread(NamedTuple):
    """State of the pass, updated: formal (n, n); mean (n,); sources (n_group, n, n, 8), a source a lane (without
    compiled code: (n_source, n, n)); y (n_part, n) and variance (n_part,) of the true parameters.
    """

    formal: Floats
    mean: Floats
    sources: Floats
    y: Floats
    variance: Floats


class Desk(NamedTuple):
    """Work arrays: of the filter's own covariance, of eight sources, of rows, of a window of the nominal flight."""

    D: Floats
    D_true: Floats
    moved: Floats
    K: Floats
    x: Floats
    z: Floats
    weight: Floats
    residual: Floats
    gain: Floats
    work: Floats
    seen: Floats
    moved_source: Floats
    Y: Floats
    S: Floats
    sample_noise: Floats
    row_noise: Floats
    row_gain: Floats
    sums: Floats
    increments: Floats
    still: Floats
    expected: Floats
    turned: Floats
    sparse: Floats
    at: Ints
    n_at: Ints
    one: Floats


class Parts(NamedTuple):
    """True parameters, a component an entry: source; matched state of the filter, -1 none; followed: c is carried with
    its y; sample: component of the unit's samples that it adds to, -1 none; shared: component of the errors that
    measurements share, -1 none; fade, wander (n_length, n_part); family (n_family,) of the filter's extra states that
    stands for the same thing, -1 none. row_source (3,) of position, velocity and attitude rows; sample_rows,
    sample_columns (6, 2) and sample_entries (6,) of the unit's rows. noise (n_length, n_source, n_state) white noise of
    a filter without a vehicle model. nav_rows ... nav_drivers: blocks of the true transition.
    """

    source: Ints
    matched: Ints
    followed: NDArray[np.bool_]
    sample: Ints
    shared: Ints
    fade: Floats
    wander: Floats
    family: Ints
    row_source: Ints
    sample_rows: Floats
    sample_columns: Ints
    sample_entries: Ints
    noise: Floats
    nav_rows: Ints
    nav_columns: Ints
    nav_kinds: Ints
    nav_drivers: Ints


class Covered(NamedTuple):
    """What the pass fills: formal, true (n_hist, n, n) and mean (n_hist, n), frame i; sources (n_hist, n_source, n, n);
    sample_spread (n_hist, n_source, 6) variance of true parameters in a sample; n_row, expected_nis, worst_ratio
    (n_epoch,).
    """

    formal: Floats
    true: Floats
    mean: Floats
    sources: Floats
    sample_spread: Floats
    n_row: Ints
    expected_nis: Floats
    worst_ratio: Floats


def group(array: Any, index: Any) -> Any:
    """Return one group of sources, as eight lanes where they are lanes."""
    return array[index]


@overload(group)
def _group(array, index):
    return lambda array, index: view(array[index])


def whole(array: Any) -> Any:
    """Return a work array of one group, as lanes where groups are lanes."""
    return array


@overload(whole)
def _whole(array):
    return lambda array: view(array)


def add_to(array: Any, source: Any, i: Any, j: Any, value: Any) -> None:
    """Add to an entry of one source; of two that mirror each other the upper one is meant."""
    array[source, min(i, j), max(i, j)] += value


@overload(add_to)
def _add_to(array, source, i, j, value):
    def lanes(array, source, i, j, value):
        array[source // WIDTH, min(i, j), max(i, j), source % WIDTH] += value

    return lanes


def entry(array: Any, source: Any, i: Any, j: Any) -> Any:
    """Return an entry (i, j) of one source."""
    return array[source, i, j]


@overload(entry)
def _entry(array, source, i, j):
    return lambda array, source, i, j: array[source // WIDTH, i, j, source % WIDTH]


def set_noise(array: Any, source: Any, row: Any, value: Any) -> None:
    """Set the noise that one source has in a row."""
    array[source, row] = value


@overload(set_noise)
def _set_noise(array, source, row, value):
    def lanes(array, source, row, value):
        array[source // WIDTH, row, source % WIDTH] = value

    return lanes


@jit
def nominal_tick(sums, reference, tick, dt):
    """Set the integral of C_b_i and the velocity gained over a tick of the nominal flight."""
    q, a, f = reference.q_b_i[tick], reference.dtheta[tick], reference.dvel[tick]
    c = matrix(q[0], q[1], q[2], q[3])
    rx, ry, rz = cross(a[0], a[1], a[2], f[0], f[1], f[2])
    for i in range(3):
        for j in range(3):
            sums[3 * i + j] = dt * c[3 * i + j]
        sums[9 + i] = c[3 * i] * (f[0] + 0.5 * rx) + c[3 * i + 1] * (f[1] + 0.5 * ry) + c[3 * i + 2] * (f[2] + 0.5 * rz)


@jit
def nominal_window(nominal, sums, increments, reference, first, n_tick, dt, kind):
    """Mechanise the ideal increments of a window from the true state: sums (18,) that the transition needs are set."""
    for k in range(n_tick):
        for axis in range(3):
            increments[k, axis] = reference.dtheta[first + k, axis]
            increments[k, 3 + axis] = reference.dvel[first + k, axis]
    place(nominal.nav, reference, first)
    mechanise(nominal.nav, sums, nominal.previous, increments, n_tick, dt, kind)
