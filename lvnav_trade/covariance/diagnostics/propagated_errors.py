"""Navigation errors after some windows of the nominal flight, by the strapdown and by the filter's transition.

Errors are truth minus estimate, states in storage order, frame i.
"""

from typing import NamedTuple

import numpy as np

from lvnav_trade.covariance.diagnostics.perturbed_estimate import (
    compensate,
    imu_inputs,
    increments,
    navigation_at,
    tick_at,
)
from lvnav_trade.kernels.attitude import small_rotation
from lvnav_trade.kernels.covariance import apply_phi
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.strapdown import N_SUM, Q, R, Strapdown, V, full_rate, integrate
from lvnav_trade.kernels.transition import ATT, POS, VEL, fill
from lvnav_trade.quantities.records import Floats, Ints
from lvnav_trade.simulation.preparation.prepare import PreparedCase

_PIECES = 60
"""Number of pieces of a gap; estimated biases are constant within each."""


class Windows(NamedTuple):
    """Successive windows of the flight.

    first : (n,). First tick of each window.
    n_tick : (n,). Number of ticks.
    decay : (n, n_state). Decay factor of every state over the window.
    """

    first: Ints
    n_tick: Ints
    decay: Floats


class _Strapdown(NamedTuple):
    """Strapdown integration of an estimate.

    nav : (10,). Navigation state, frame i.
    previous : (6,) rad, m/s. Increments of the tick before, body axes.
    sums : (18,). Integrals over a window.
    increments : (n, 6) rad, m/s. Compensated increments of a window, body axes.
    algorithm : Algorithm at the rate of the IMU.
    """

    nav: Floats
    previous: Floats
    sums: Floats
    increments: Floats
    algorithm: Strapdown


class _Transition(NamedTuple):
    """Transition matrix of the filter over a window, by blocks as in `kernels.transition`.

    blocks : (n_block, 9). Scratch.
    kinds : (n_block,). Kind of each block.
    drivers : (n_block,). Quantity that the parameter of the block multiplies.
    rows : (n_block,). First row.
    columns : (n_block,). First column.
    clock : State of the clock bias; -1 without.
    """

    blocks: Floats
    kinds: Ints
    drivers: Ints
    rows: Ints
    columns: Ints
    clock: int


def _ticks(prepared_case: PreparedCase) -> tuple[int, int]:
    """Return the ticks of one update interval and of one covariance step."""
    card = prepared_case.scenario.filter
    rate = prepared_case.scenario.imu.rate
    interval = max(1, round(rate / card.update_rate))
    step = max(1, round(rate / card.covariance_rate))
    return interval, step


def start_tick(prepared_case: PreparedCase, time: float) -> int:
    """Return the tick at a time, or the last from which an update interval remains."""
    interval, _ = _ticks(prepared_case)
    last_tick = prepared_case.reference.t.size - 1
    last_start = last_tick - interval
    return max(0, min(tick_at(prepared_case, time), last_start))


def _decay(prepared_case: PreparedCase, n_tick: int) -> Floats:
    """Return the decay factors (n_state,) of the window length closest to a number of ticks."""
    seconds = n_tick * prepared_case.unit.dt
    difference = np.abs(prepared_case.lengths - seconds)
    length = int(np.argmin(difference))
    return prepared_case.model.decay[length]


def covariance_steps(prepared_case: PreparedCase, end: float) -> Windows:
    """Return the covariance steps from the start of the flight to a time (s)."""
    _, step = _ticks(prepared_case)
    last = tick_at(prepared_case, end) - step
    return _steps(prepared_case, 0, last)


def update_windows(prepared_case: PreparedCase, start: int) -> Windows:
    """Return the covariance steps of one update interval from a tick on."""
    interval, step = _ticks(prepared_case)
    last = start + interval - step
    return _steps(prepared_case, start, last)


def _steps(prepared_case: PreparedCase, start: int, last: int) -> Windows:
    """Return the covariance steps that start at a tick and later, up to the tick `last`."""
    _, step = _ticks(prepared_case)
    first = np.arange(start, last + 1, step)
    decay = _decay(prepared_case, step)
    return Windows(first, np.full_like(first, step), np.tile(decay, (first.size, 1)))


def gap_pieces(prepared_case: PreparedCase, begin: float, end: float) -> Windows:
    """Return the windows of a gap, at most `_PIECES` pieces of whole covariance steps."""
    _, step = _ticks(prepared_case)
    first = tick_at(prepared_case, begin)
    last_tick = prepared_case.reference.t.size - 1
    last = min(tick_at(prepared_case, end), last_tick)
    n_step = max(1, (last - first) // step)
    n_in_piece = -(-n_step // _PIECES)  # rounded up
    decay = _decay(prepared_case, step)
    first_steps = np.arange(0, n_step, n_in_piece)
    step_counts = np.minimum(n_in_piece, n_step - first_steps)
    piece_decay = np.array([decay ** int(n) for n in step_counts])
    return Windows(first + step * first_steps, step * step_counts, piece_decay)


@jit
def _integrate(strapdown, d, inputs, windows):
    """Integrate an estimate over the windows.

    Parameters
    ----------
    strapdown : _Strapdown, updated in place
    d : (n_state,) SI, initial error of the estimate; errors of parameters decay in place
    inputs, windows : ImuInputs, Windows
    """
    increments = strapdown.increments
    for w in range(windows.first.shape[0]):
        n_tick = windows.n_tick[w]
        compensate(increments, inputs, d, windows.first[w], n_tick)
        integrate(
            strapdown.nav, strapdown.sums, strapdown.previous, increments, n_tick, inputs.dt, strapdown.algorithm, False
        )
        for i in range(d.shape[0]):
            d[i] *= windows.decay[w, i]


def strapdown_errors(prepared_case: PreparedCase, start: int, errors: Floats, windows: Windows) -> Floats:
    """Return the navigation errors (n, 9) SI at the end of the windows, by the strapdown.

    Parameters
    ----------
    prepared_case
        Prepared case.
    start
        Tick at which the windows start.
    errors
        (n, n_state) SI. Initial errors.
    windows
        Windows from this tick on.
    """
    no_error = np.zeros(errors.shape[1])
    tick_before = max(0, start - 1)
    increments_before = increments(prepared_case, tick_before, 1, no_error)[0]
    inputs = imu_inputs(prepared_case)
    algorithm = full_rate(prepared_case.model.strapdown.gravity)

    def final_state(d: Floats) -> Floats:
        nav = navigation_at(prepared_case, start, d)
        scratch = np.zeros((int(windows.n_tick.max()), 6))
        strapdown = _Strapdown(nav, increments_before.copy(), np.zeros(N_SUM), scratch, algorithm)
        _integrate(strapdown, d.copy(), inputs, windows)
        return nav

    attitude = slice(Q, Q + 4)
    velocity = slice(V, V + 3)
    position = slice(R, R + 3)
    exact = final_state(no_error)
    results = np.empty((len(errors), 9))
    for result, d in zip(results, errors, strict=True):
        nav = final_state(d)
        result[ATT : ATT + 3] = small_rotation(*exact[attitude], *nav[attitude])
        result[VEL : VEL + 3] = exact[velocity] - nav[velocity]
        result[POS : POS + 3] = exact[position] - nav[position]
    return results


@jit
def _propagate_linearly(results, window_counts, errors, no_error, strapdown, transition, inputs, windows):
    """Propagate errors by the filter's transition, linearised at the true flight.

    Parameters
    ----------
    results : (n_count, n, n_state) set to the errors after some windows
    window_counts : (n_count,) numbers of these windows; results of the count 0 are not set
    errors : (n, n_state) SI, initial errors, updated in place
    no_error : (n_state,) zeros
    strapdown : _Strapdown of the true flight, updated in place
    transition : _Transition
    inputs, windows : ImuInputs, Windows
    """
    nav = strapdown.nav
    sums = strapdown.sums
    increments = strapdown.increments
    blocks = transition.blocks
    for w in range(windows.first.shape[0]):
        n_tick = windows.n_tick[w]
        seconds = n_tick * inputs.dt
        compensate(increments, inputs, no_error, windows.first[w], n_tick)
        integrate(nav, sums, strapdown.previous, increments, n_tick, inputs.dt, strapdown.algorithm, False)
        fill(blocks, transition.kinds, transition.drivers, sums, nav[R], nav[R + 1], nav[R + 2], seconds)
        for k in range(errors.shape[0]):
            decay = windows.decay[w]
            apply_phi(errors[k], blocks, transition.rows, transition.columns, decay, transition.clock, seconds)
        for c in range(window_counts.shape[0]):
            if window_counts[c] == w + 1:
                for k in range(errors.shape[0]):
                    for i in range(errors.shape[1]):
                        results[c, k, i] = errors[k, i]


def linear_errors(prepared_case: PreparedCase, start: int, directions: Floats, windows: Windows) -> Floats:
    """Return the errors (n, n_state) SI at the end of the windows, by the filter's transition.

    Parameters
    ----------
    prepared_case
        Prepared case.
    start
        Tick at which the windows start.
    directions
        (n, n_state) SI. Initial errors.
    windows
        Windows from this tick on.
    """
    window_counts = np.array([windows.first.size])
    return linear_error_history(prepared_case, start, directions, windows, window_counts)[0]


def linear_error_history(
    prepared_case: PreparedCase, start: int, directions: Floats, windows: Windows, window_counts: Ints
) -> Floats:
    """Return the errors (n_count, n, n_state) SI after some numbers of windows, by the filter's transition.

    Parameters
    ----------
    prepared_case
        Prepared case.
    start
        Tick at which the windows start.
    directions
        (n, n_state) SI. Initial errors.
    windows
        Windows from this tick on.
    window_counts
        (n_count,). Numbers of windows.
    """
    model = prepared_case.model
    no_error = np.zeros(directions.shape[1])
    strapdown = _Strapdown(
        nav=navigation_at(prepared_case, start, no_error),
        previous=np.zeros(6),
        sums=np.zeros(N_SUM),
        increments=np.zeros((windows.n_tick.max(initial=0), 6)),
        algorithm=full_rate(model.strapdown.gravity),
    )
    transition = _Transition(
        blocks=np.zeros((model.block_rows.size, 9)),
        kinds=model.block_kinds,
        drivers=model.block_drivers,
        rows=model.block_rows,
        columns=model.block_columns,
        clock=model.clock,
    )
    results = np.repeat(directions[None], window_counts.size, axis=0)
    errors = directions.copy()
    inputs = imu_inputs(prepared_case)
    _propagate_linearly(results, window_counts, errors, no_error, strapdown, transition, inputs, windows)
    return results
