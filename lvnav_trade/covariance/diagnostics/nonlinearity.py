"""Nonlinearity of the navigation at the errors of linear covariance.

Errors are truth minus estimate, states in storage order, frame i.
"""

from typing import NamedTuple

import numpy as np

from lvnav_trade.covariance.diagnostics.perturbed_estimate import (
    compensated,
    increments,
    inputs,
    navigation_at,
    place,
    place_previous_epoch,
    tick_at,
)
from lvnav_trade.covariance.history import turns
from lvnav_trade.covariance.workspace import Nominal, new_nominal
from lvnav_trade.filter.ekf import channel_of, fill_receiver
from lvnav_trade.filter.policies.epoch_differences import is_present
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.attitude import small_rotation
from lvnav_trade.kernels.covariance import apply_phi
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.kernels.strapdown import N_SUM, Q, R, V, full_rate
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.quantities.records import CovHistory, Floats
from lvnav_trade.simulation.preparation.prepare import Prepared

Windows = list[tuple[int, int, Floats]]
_PIECES = 60
"""Number of pieces of a gap; estimated biases are constant within each."""


class Nonlinearity(NamedTuple):
    """Deviation from linearity over one update interval, a gap, or an open loop, at one-sigma true errors; 0 if linear.

    time : s since lift-off; of a gap, its end.
    motion : Largest second-order part of the propagated error, in formal sigmas of the state.
    state : Index of that state.
    transition : Largest difference between the first-order part and the filter's transition, likewise.
    rows : Largest second-order part of a predicted measurement, in sigmas of its innovation; in an open loop, of its
        prediction. NaN without measurements.
    """

    time: float
    motion: float
    state: int
    transition: float
    rows: float


def nonlinearity(
    prepared: Prepared, history: CovHistory, time: float, scale: float = 1.0, end: float | None = None
) -> Nonlinearity:
    """Return the nonlinearity over one update interval, or over a gap without measurements.

    The directions are the columns of the Cholesky factor of the true covariance. Each is propagated with both signs:
    half of the sum of the two results is the second-order part, half of the difference is the first-order part.

    Parameters
    ----------
    prepared
        Prepared case.
    history
        Linear covariance of the case.
    time
        s since lift-off. Start of the interval or gap; the nearest history time is used.
    scale
        Size of the errors in sigmas; the second-order part per sigma is proportional to it.
    end
        s since lift-off. First measurement after the gap; None: one update interval.
    """
    hist = int(np.argmin(np.abs(prepared.t_hist - time)))
    time = float(prepared.t_hist[hist])
    formal, true = _covariances(prepared, history, hist)
    directions = scale * _factor(true)
    start = _start_tick(prepared, time)
    windows = _windows(prepared, start) if end is None else _pieces(prepared, time, end)
    linear = _linear_errors(prepared, start, directions, windows)
    # f(d) = L d + q(d, d): half of the sum of both signs is q, half of the difference is L d
    plus = _strapdown_errors(prepared, start, directions, windows)
    minus = _strapdown_errors(prepared, start, -directions, windows)
    if end is not None:  # the measurement at the end of the gap sees the grown errors
        last = max(hist, int(np.searchsorted(prepared.t_hist, end - 1e-9)) - 1)
        formal, true = _covariances(prepared, history, last)
        directions = scale * _factor(true)
        time = end
    first_order, second_order = _orders(plus, minus, linear, formal)
    rows = _row_nonlinearity(prepared, time, directions, formal)
    return Nonlinearity(
        time=time,
        motion=float(second_order.max()) / scale,
        state=int(np.argmax(second_order)) % second_order.shape[1],
        transition=float(first_order.max()) / scale,
        rows=rows / scale,
    )


def _orders(plus: Floats, minus: Floats, linear: Floats, formal: Floats) -> tuple[Floats, Floats]:
    """Return the deviation of the first-order part from a linear propagation, and the second-order part, (n, 9).

    Both are in formal sigmas of the states, and zero for a state without formal sigma.

    Parameters
    ----------
    plus, minus
        (n, 9) SI. Propagated errors of both signs.
    linear
        (n, n_state) SI. Errors by the filter's transition.
    formal
        (n_state, n_state) SI squared. Formal covariance.
    """
    sigma = np.sqrt(np.diag(formal))[:9]
    sigma = np.where(sigma > 0.0, sigma, np.inf)
    second_order = np.abs(plus + minus) / 2.0 / sigma
    first_order = np.abs((plus - minus) / 2.0 - linear[:, :9]) / sigma
    return first_order, second_order


def open_loop_nonlinearity(prepared: Prepared, history: CovHistory, time: float) -> Nonlinearity:
    """Return the nonlinearity of an open loop, accumulated since the start.

    The filter is linearised at the uncorrected INS, whose distance from the truth grows. The directions are those of
    the initial errors. The second-order part is the error of the INS beyond the filter's transition; measurements do
    not correct it here, so `motion` is an upper bound. The curvature of a measurement is the same at successive epochs
    and does not average out, so `rows` is in sigmas of the prediction, without noise.

    Parameters
    ----------
    prepared
        Prepared case.
    history
        Linear covariance of the case.
    time
        s since lift-off. The nearest history time is used.
    """
    hist = int(np.argmin(np.abs(prepared.t_hist - time)))
    time = float(prepared.t_hist[hist])
    pieces = _pieces(prepared, float(prepared.t_hist[0]), time)
    _, initial = _covariances(prepared, history, 0)
    directions = _factor(initial)
    distance = _linear_errors(prepared, 0, directions, _steps(prepared, time))
    plus = _strapdown_errors(prepared, 0, directions, pieces)
    minus = _strapdown_errors(prepared, 0, -directions, pieces)
    formal, _ = _covariances(prepared, history, hist)
    first_order, second_order = _orders(plus, minus, distance, formal)
    return Nonlinearity(
        time=time,
        motion=float(second_order.max()),
        state=int(np.argmax(second_order)) % second_order.shape[1],
        transition=float(first_order.max()),
        rows=_row_nonlinearity(prepared, time, distance, formal, noise=0.0),
    )


def _steps(prepared: Prepared, end: float) -> Windows:
    """Return the covariance steps from the start of the flight to a time (s)."""
    _, step = _ticks(prepared)
    decay = _decay(prepared, step)
    return [(first, step, decay) for first in range(0, tick_at(prepared, end) - step + 1, step)]


def _decay(prepared: Prepared, n_tick: int) -> Floats:
    """Return the decay factors (n_state,) of the window length closest to a number of ticks."""
    return prepared.model.decay[int(np.argmin(np.abs(prepared.lengths - n_tick * prepared.unit.dt)))]


def _covariances(prepared: Prepared, history: CovHistory, hist: int) -> tuple[Floats, Floats]:
    """Return the formal and the true covariance (n_state, n_state) at a history time, frame i."""
    turn = turns(prepared)[hist]
    layout = prepared.layout
    states = slice(0, len(turn))  # further outputs are not states
    formal = turn.T @ history.formal_cov[hist, states, states] @ turn
    true = turn.T @ history.true_cov[hist, states, states] @ turn
    if not layout.n_delayed:
        return formal, true
    # all states from the reported states: clones equal their states, noise states of an epoch are zero
    selection = np.zeros((layout.n_state, len(turn)))
    selection[layout.reported, range(len(turn))] = 1.0
    selection[layout.clone : layout.clone + len(layout.cloned)] = selection[list(layout.cloned)]
    return selection @ formal @ selection.T, selection @ true @ selection.T


def _factor(covariance: Floats) -> Floats:
    """Return the columns of a Cholesky factor as rows (n, n); zero for a state without variance."""
    sigma = np.sqrt(np.maximum(0.0, np.diag(covariance)))
    safe = np.where(sigma > 0.0, sigma, 1.0)
    correlation = covariance / safe[:, None] / safe[None, :]
    # states differ by ten orders of magnitude, so the correlation is factorised, made safe against rounding
    correlation[range(len(sigma)), range(len(sigma))] = 1.0 + 1e-9
    factor = np.linalg.cholesky(correlation) * sigma[:, None]
    return np.array(factor.T, dtype=np.float64, order="C")


def _ticks(prepared: Prepared) -> tuple[int, int]:
    """Return the ticks of one update interval and of one covariance step."""
    card, rate = prepared.scenario.filter, prepared.scenario.imu.rate
    interval = max(1, round(rate / card.update_rate))
    step = max(1, round(rate / card.covariance_rate))
    return interval, step


def _start_tick(prepared: Prepared, time: float) -> int:
    """Return the tick at a time, or the last from which an update interval remains."""
    interval, _ = _ticks(prepared)
    last = prepared.reference.t.size - 1 - interval
    return max(0, min(tick_at(prepared, time), last))


def _windows(prepared: Prepared, start: int) -> Windows:
    """Return (first tick, ticks, decay of every state) of the covariance steps of one update interval."""
    interval, step = _ticks(prepared)
    decay = _decay(prepared, step)
    return [(first, step, decay) for first in range(start, start + interval - step + 1, step)]


def _pieces(prepared: Prepared, begin: float, end: float) -> Windows:
    """Return the windows of a gap as `_windows` does, in at most `_PIECES` pieces of whole covariance steps."""
    _, step = _ticks(prepared)
    first = tick_at(prepared, begin)
    last = min(tick_at(prepared, end), prepared.reference.t.size - 1)
    n_step = max(1, (last - first) // step)
    n_in_piece = -(-n_step // _PIECES)  # rounded up
    decay = _decay(prepared, step)
    pieces = []
    for k in range(0, n_step, n_in_piece):
        n = min(n_in_piece, n_step - k)
        pieces.append((first + step * k, step * n, decay**n))
    return pieces


def _strapdown_errors(prepared: Prepared, start: int, errors: Floats, windows: Windows) -> Floats:
    """Return the navigation errors (n, 9) SI at the end of the windows, by the strapdown.

    The error-free flight and the drivers of IMU parameters are computed once.

    Parameters
    ----------
    prepared
        Prepared case.
    start
        Tick at which the windows start.
    errors
        (n, n_state) SI. Initial errors.
    windows
        First tick, number of ticks and decay factors (n_state,) of each window.
    """
    sums = np.zeros(N_SUM)
    algorithm = full_rate(prepared.model.strapdown.gravity)
    dt = prepared.unit.dt
    legs = [(inputs(prepared, first, n_tick), n_tick, decay) for first, n_tick, decay in windows]
    increments_before = inputs(prepared, max(0, start - 1), 1).true[0]

    def integrate(d: Floats) -> Floats:
        nav = navigation_at(prepared, start, d)
        previous = increments_before.copy()
        parameters = d
        for ticks, n_tick, decay in legs:
            mechanise(nav, sums, previous, compensated(ticks, parameters), n_tick, dt, algorithm, 0.0)
            parameters = decay * parameters
        return nav

    exact = integrate(np.zeros(errors.shape[1]))
    results = np.empty((len(errors), 9))
    for result, d in zip(results, errors, strict=True):
        nav = integrate(d)
        result[ATT : ATT + 3] = small_rotation(*exact[Q : Q + 4], *nav[Q : Q + 4])
        result[VEL : VEL + 3] = exact[V : V + 3] - nav[V : V + 3]
        result[POS : POS + 3] = exact[R : R + 3] - nav[R : R + 3]
    return results


def _linear_errors(prepared: Prepared, start: int, directions: Floats, windows: Windows) -> Floats:
    """Return the errors (n, n_state) SI at the end of the windows, by the filter's transition.

    Parameters
    ----------
    prepared
        Prepared case.
    start
        Tick at which the windows start.
    directions
        (n, n_state) SI. Initial errors.
    windows
        First tick, number of ticks and decay factors (n_state,) of each window.
    """
    model, dt = prepared.model, prepared.unit.dt
    no_error = np.zeros(directions.shape[1])
    nav = navigation_at(prepared, start, no_error)
    sums, previous = np.zeros(N_SUM), np.zeros(6)
    errors = directions.copy()
    blocks = np.zeros((model.block_rows.size, 9))
    algorithm = full_rate(model.strapdown.gravity)
    for first, n_tick, decay in windows:
        true_increments = increments(prepared, first, n_tick, no_error)
        mechanise(nav, sums, previous, true_increments, n_tick, dt, algorithm, 0.0)
        seconds = n_tick * dt
        x, y, z = nav[R : R + 3]
        transition.fill(blocks, model.block_kinds, model.block_drivers, sums, x, y, z, seconds)
        for error in errors:
            apply_phi(error, blocks, model.block_rows, model.block_columns, decay, model.clock, seconds)
    return errors


def _row_nonlinearity(prepared: Prepared, time: float, directions: Floats, formal: Floats, noise: float = 1.0) -> float:
    """Return the largest second-order part of a measurement at the nearest epoch, in sigmas of its innovation.

    It is NaN if the filter processes no measurement of the receiver at that epoch.

    Parameters
    ----------
    prepared
        Prepared case.
    time
        s since lift-off.
    directions
        (n, n_state) SI. Errors of the estimate.
    formal
        (n_state, n_state) SI squared. Formal covariance.
    noise
        Factor on the noise variance; 0: in sigmas of the prediction.
    """
    model = prepared.model
    if not model.n_receiver or not prepared.t_epoch.size:
        return float("nan")
    epoch = int(np.argmin(np.abs(prepared.t_epoch - time)))
    n_satellite = int(prepared.signals.n_used[epoch])
    least = 1 if model.tight else 4  # a receiver's solution needs four
    if n_satellite < least or not _present_rows(prepared, epoch):
        return float("nan")
    work = new_nominal(prepared)
    exact = _predicted_rows(prepared, work, epoch, np.zeros(directions.shape[1]))
    sigma = _innovation_sigma(prepared, work, epoch, formal, noise)
    second_differences = []
    for d in directions:
        plus = _predicted_rows(prepared, work, epoch, d)
        minus = _predicted_rows(prepared, work, epoch, -d)
        second_differences.append(plus + minus - 2.0 * exact)
    return float(np.max(np.abs(second_differences) / 2.0 / sigma))


def _predicted_rows(prepared: Prepared, work: Nominal, epoch: int, d: Floats) -> Floats:
    """Return minus the predicted measurements of an epoch, up to a constant, SI.

    Parameters
    ----------
    prepared
        Prepared case.
    work
        Arrays of the nominal run, set here.
    epoch
        Index of the epoch.
    d
        (n_state,) SI. Error of the estimate, truth minus estimate.
    """
    model, signals, delayed = prepared.model, prepared.signals, prepared.options.delayed
    previous_epoch = place_previous_epoch(prepared, work, epoch, d)
    place(prepared, work, epoch, d)
    fill_receiver(work, previous_epoch, delayed, model, signals, epoch)
    return work.z[_present_rows(prepared, epoch)]


def _present_rows(prepared: Prepared, epoch: int) -> list[int]:
    """Return the indices of the scalar measurements of the receiver that the filter processes at an epoch."""
    model, signals, delayed = prepared.model, prepared.signals, prepared.options.delayed
    n_row = model.n_kind * signals.n_used[epoch] if model.tight else 6
    rows = []
    for row in range(n_row):
        if is_present(delayed, model, epoch, channel_of(model, signals, epoch, row)):
            rows.append(row)
    return rows


def _innovation_sigma(prepared: Prepared, work: Nominal, epoch: int, formal: Floats, noise: float) -> Floats:
    """Return the formal sigma of the innovations of `_present_rows`; noise: factor on the noise variance."""
    model, signals = prepared.model, prepared.signals
    sigma = []
    for row in _present_rows(prepared, epoch):
        channel = channel_of(model, signals, epoch, row)
        n = model.n_entry[channel]
        h = np.zeros(prepared.layout.n_state)
        h[model.column[channel, :n]] = work.H[row, model.entry[channel, :n]]
        variance = h @ formal @ h + noise * signals.variance[epoch, channel]
        sigma.append(np.sqrt(variance))
    return np.array(sigma)
