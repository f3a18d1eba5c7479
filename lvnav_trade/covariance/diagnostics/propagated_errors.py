"""Navigation errors after some windows of the nominal flight, by the strapdown and by the filter's transition.

Errors are truth minus estimate, states in storage order, frame i.
"""

import numpy as np

from lvnav_trade.covariance.diagnostics.perturbed_estimate import (
    compensate_increments,
    increments,
    inputs,
    navigation_at,
    tick_at,
)
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.attitude import small_rotation
from lvnav_trade.kernels.covariance import apply_phi
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.kernels.strapdown import N_SUM, Q, R, V, full_rate
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.quantities.records import Floats
from lvnav_trade.simulation.preparation.prepare import PreparedCase

Windows = list[tuple[int, int, Floats]]
_PIECES = 60
"""Number of pieces of a gap; estimated biases are constant within each."""


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
    decay = _decay(prepared_case, step)
    last = tick_at(prepared_case, end) - step
    return [(first, step, decay) for first in range(0, last + 1, step)]


def update_windows(prepared_case: PreparedCase, start: int) -> Windows:
    """Return (first tick, ticks, decay of every state) of the covariance steps of one update interval."""
    interval, step = _ticks(prepared_case)
    decay = _decay(prepared_case, step)
    last = start + interval - step
    return [(first, step, decay) for first in range(start, last + 1, step)]


def gap_pieces(prepared_case: PreparedCase, begin: float, end: float) -> Windows:
    """Return the windows of a gap as `update_windows` does, in at most `_PIECES` pieces of whole covariance steps."""
    _, step = _ticks(prepared_case)
    first = tick_at(prepared_case, begin)
    last_tick = prepared_case.reference.t.size - 1
    last = min(tick_at(prepared_case, end), last_tick)
    n_step = max(1, (last - first) // step)
    n_in_piece = -(-n_step // _PIECES)  # rounded up
    decay = _decay(prepared_case, step)
    pieces = []
    for k in range(0, n_step, n_in_piece):
        n = min(n_in_piece, n_step - k)
        first_of_piece = first + step * k
        pieces.append((first_of_piece, step * n, decay**n))
    return pieces


def strapdown_errors(prepared_case: PreparedCase, start: int, errors: Floats, windows: Windows) -> Floats:
    """Return the navigation errors (n, 9) SI at the end of the windows, by the strapdown.

    The error-free flight and the drivers of IMU parameters are computed once.

    Parameters
    ----------
    prepared_case
        Prepared case.
    start
        Tick at which the windows start.
    errors
        (n, n_state) SI. Initial errors.
    windows
        First tick, number of ticks and decay factors (n_state,) of each window.
    """
    sums = np.zeros(N_SUM)
    algorithm = full_rate(prepared_case.model.strapdown.gravity)
    dt = prepared_case.unit.dt
    legs = [(inputs(prepared_case, first, n_tick), n_tick, decay) for first, n_tick, decay in windows]
    tick_before = max(0, start - 1)
    increments_before = inputs(prepared_case, tick_before, 1).true[0]
    attitude = slice(Q, Q + 4)
    velocity = slice(V, V + 3)
    position = slice(R, R + 3)

    def integrate(d: Floats) -> Floats:
        nav = navigation_at(prepared_case, start, d)
        previous = increments_before.copy()
        parameters = d
        for ticks, n_tick, decay in legs:
            compensated_increments = compensate_increments(ticks, parameters)
            mechanise(nav, sums, previous, compensated_increments, n_tick, dt, algorithm, 0.0)
            parameters = decay * parameters
        return nav

    no_error = np.zeros(errors.shape[1])
    exact = integrate(no_error)
    results = np.empty((len(errors), 9))
    for result, d in zip(results, errors, strict=True):
        nav = integrate(d)
        result[ATT : ATT + 3] = small_rotation(*exact[attitude], *nav[attitude])
        result[VEL : VEL + 3] = exact[velocity] - nav[velocity]
        result[POS : POS + 3] = exact[position] - nav[position]
    return results


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
        First tick, number of ticks and decay factors (n_state,) of each window.
    """
    model = prepared_case.model
    dt = prepared_case.unit.dt
    rows = model.block_rows
    columns = model.block_columns
    no_error = np.zeros(directions.shape[1])
    nav = navigation_at(prepared_case, start, no_error)
    sums = np.zeros(N_SUM)
    previous = np.zeros(6)
    errors = directions.copy()
    blocks = np.zeros((rows.size, 9))
    algorithm = full_rate(model.strapdown.gravity)
    for first, n_tick, decay in windows:
        true_increments = increments(prepared_case, first, n_tick, no_error)
        mechanise(nav, sums, previous, true_increments, n_tick, dt, algorithm, 0.0)
        seconds = n_tick * dt
        x, y, z = nav[R : R + 3]
        transition.fill(blocks, model.block_kinds, model.block_drivers, sums, x, y, z, seconds)
        for error in errors:
            apply_phi(error, blocks, rows, columns, decay, model.clock, seconds)
    return errors
