"""Nonlinearity of the navigation at the errors of linear covariance.

Errors are truth minus estimate, states in storage order, frame i.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.covariance.diagnostics.perturbed_estimate import place, place_previous_epoch
from lvnav_trade.covariance.diagnostics.propagated_errors import (
    Windows,
    covariance_steps,
    gap_pieces,
    linear_error_history,
    linear_errors,
    start_tick,
    strapdown_errors,
    update_windows,
)
from lvnav_trade.covariance.history import reporting_rotations
from lvnav_trade.covariance.workspace import Nominal, new_nominal
from lvnav_trade.filter.ekf import fill_receiver, receiver_channel
from lvnav_trade.filter.policies.epoch_differences import is_present
from lvnav_trade.quantities.records import CovHistory, Floats
from lvnav_trade.simulation.preparation.prepare import PreparedCase


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
    prepared_case: PreparedCase, history: CovHistory, time: float, scale: float = 1.0, end: float | None = None
) -> Nonlinearity:
    """Return the nonlinearity over one update interval, or over a gap without measurements.

    The directions are the columns of the Cholesky factor of the true covariance. Each is propagated with both signs:
    half of the sum of the two results is the second-order part, half of the difference is the first-order part.

    Parameters
    ----------
    prepared_case
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
    hist = int(np.argmin(np.abs(prepared_case.t_hist - time)))
    time = float(prepared_case.t_hist[hist])
    formal, true = _covariances(prepared_case, history, hist)
    directions = scale * _factor(true)
    start = start_tick(prepared_case, time)
    windows = update_windows(prepared_case, start) if end is None else gap_pieces(prepared_case, time, end)
    linear = linear_errors(prepared_case, start, directions, windows)
    plus, minus = _errors_of_both_signs(prepared_case, start, directions, windows)
    if end is not None:  # the measurement at the end of the gap sees the grown errors
        last_before_end = int(np.searchsorted(prepared_case.t_hist, end - 1e-9)) - 1
        last = max(hist, last_before_end)
        formal, true = _covariances(prepared_case, history, last)
        directions = scale * _factor(true)
        time = end
    first_order, second_order = _orders(plus, minus, linear, formal)
    rows = _row_nonlinearity(prepared_case, time, directions, formal)
    n_state = second_order.shape[1]
    return Nonlinearity(
        time=time,
        motion=float(second_order.max()) / scale,
        state=int(np.argmax(second_order)) % n_state,
        transition=float(first_order.max()) / scale,
        rows=rows / scale,
    )


def _errors_of_both_signs(
    prepared_case: PreparedCase, start: int, directions: Floats, windows: Windows
) -> tuple[Floats, Floats]:
    """Return the errors (n, 9) by the strapdown at the end of windows, of directions and of their negatives.

    f(d) = L d + q(d, d): half of the sum of both signs is q, half of the difference is L d.
    """
    both_signs = np.concatenate([directions, -directions])
    plus, minus = np.split(strapdown_errors(prepared_case, start, both_signs, windows), 2)
    return plus, minus


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
    even_part = np.abs(plus + minus) / 2.0
    odd_part = (plus - minus) / 2.0
    second_order = even_part / sigma
    first_order = np.abs(odd_part - linear[:, :9]) / sigma
    return first_order, second_order


def open_loop_nonlinearities(
    prepared_case: PreparedCase, history: CovHistory, times: Sequence[float]
) -> list[Nonlinearity]:
    """Return the nonlinearities of an open loop at some times, each accumulated since the start.

    The filter is linearised at the uncorrected INS, whose distance from the truth grows. The directions are those of
    the initial errors. The second-order part is the error of the INS beyond the filter's transition; measurements do
    not correct it here, so `motion` is an upper bound. The curvature of a measurement is the same at successive epochs
    and does not average out, so `rows` is in sigmas of the prediction, without noise.

    Parameters
    ----------
    prepared_case
        Prepared case.
    history
        Linear covariance of the case.
    times
        s since lift-off. The nearest history times are used.
    """
    if not times:
        return []
    indices = [int(np.argmin(np.abs(prepared_case.t_hist - time))) for time in times]
    _, initial = _covariances(prepared_case, history, 0)
    directions = _factor(initial)
    # the covariance steps until an earlier time are the first of those until the last time
    steps_by_time = [covariance_steps(prepared_case, float(prepared_case.t_hist[hist])) for hist in indices]
    step_counts = np.array([steps.first.size for steps in steps_by_time])
    longest = int(np.argmax(step_counts))
    distances = linear_error_history(prepared_case, 0, directions, steps_by_time[longest], step_counts)
    return [
        _open_loop_nonlinearity(prepared_case, history, hist, directions, distance)
        for hist, distance in zip(indices, distances, strict=True)
    ]


def _open_loop_nonlinearity(
    prepared_case: PreparedCase, history: CovHistory, hist: int, directions: Floats, distance: Floats
) -> Nonlinearity:
    """Return the nonlinearity of an open loop at a history time.

    Parameters
    ----------
    prepared_case
        Prepared case.
    history
        Linear covariance of the case.
    hist
        Index of the history time.
    directions, distance
        (n, n_state) SI. Initial errors, and the errors that the filter's transition makes of them.
    """
    begin = float(prepared_case.t_hist[0])
    time = float(prepared_case.t_hist[hist])
    pieces = gap_pieces(prepared_case, begin, time)
    plus, minus = _errors_of_both_signs(prepared_case, 0, directions, pieces)
    formal, _ = _covariances(prepared_case, history, hist)
    first_order, second_order = _orders(plus, minus, distance, formal)
    rows = _row_nonlinearity(prepared_case, time, distance, formal, noise=0.0)
    n_state = second_order.shape[1]
    return Nonlinearity(
        time=time,
        motion=float(second_order.max()),
        state=int(np.argmax(second_order)) % n_state,
        transition=float(first_order.max()),
        rows=rows,
    )


def _covariances(prepared_case: PreparedCase, history: CovHistory, hist: int) -> tuple[Floats, Floats]:
    """Return the formal and the true covariance (n_state, n_state) at a history time, frame i."""
    turn = reporting_rotations(prepared_case)[hist]
    layout = prepared_case.layout
    n_reported = len(turn)
    states = slice(0, n_reported)  # further outputs are not states
    formal = turn.T @ history.formal_cov[hist, states, states] @ turn
    true = turn.T @ history.true_cov[hist, states, states] @ turn
    if not layout.n_earlier_epoch:
        return formal, true
    # all states from the reported states: clones equal their states, noise states of an epoch are zero
    selection = np.zeros((layout.n_state, n_reported))
    selection[layout.reported_states, range(n_reported)] = 1.0
    clones = slice(layout.clone, layout.clone + len(layout.cloned_states))
    selection[clones] = selection[list(layout.cloned_states)]
    formal = selection @ formal @ selection.T
    true = selection @ true @ selection.T
    return formal, true


def _factor(covariance: Floats) -> Floats:
    """Return the columns of a Cholesky factor as rows (n, n); zero for a state without variance."""
    variance = np.maximum(0.0, np.diag(covariance))
    sigma = np.sqrt(variance)
    divisor = np.where(sigma > 0.0, sigma, 1.0)
    correlation = covariance / divisor[:, None] / divisor[None, :]
    # states differ by ten orders of magnitude, so the correlation is factorised, made safe against rounding
    diagonal = range(len(sigma))
    correlation[diagonal, diagonal] = 1.0 + 1e-9
    factor = np.linalg.cholesky(correlation) * sigma[:, None]
    return np.array(factor.T, dtype=np.float64, order="C")


def _row_nonlinearity(
    prepared_case: PreparedCase, time: float, directions: Floats, formal: Floats, noise: float = 1.0
) -> float:
    """Return the largest second-order part of a measurement at the nearest epoch, in sigmas of its innovation.

    It is NaN if the filter processes no measurement of the receiver at that epoch.

    Parameters
    ----------
    prepared_case
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
    model = prepared_case.model
    if not model.n_receiver or not prepared_case.t_epoch.size:
        return float("nan")
    epoch = int(np.argmin(np.abs(prepared_case.t_epoch - time)))
    n_satellite = int(prepared_case.signals.n_used[epoch])
    min_satellites = 1 if model.tight else 4  # a receiver's solution needs four
    rows = _present_rows(prepared_case, epoch)
    if n_satellite < min_satellites or not rows:
        return float("nan")
    work = new_nominal(prepared_case)
    no_error = np.zeros(directions.shape[1])
    exact = _predicted_rows(prepared_case, work, epoch, rows, no_error)
    sigma = _innovation_sigma(prepared_case, work, epoch, formal, noise)
    second_differences = []
    for d in directions:
        plus = _predicted_rows(prepared_case, work, epoch, rows, d)
        minus = _predicted_rows(prepared_case, work, epoch, rows, -d)
        second_differences.append(plus + minus - 2.0 * exact)
    second_order = np.abs(second_differences) / 2.0
    return float(np.max(second_order / sigma))


def _predicted_rows(prepared_case: PreparedCase, work: Nominal, epoch: int, rows: list[int], d: Floats) -> Floats:
    """Return minus the predicted measurements of an epoch, up to a constant, SI.

    Parameters
    ----------
    prepared_case
        Prepared case.
    work
        Arrays of the nominal run, set here.
    epoch
        Index of the epoch.
    rows
        Indices of the scalar measurements of the receiver.
    d
        (n_state,) SI. Error of the estimate, truth minus estimate.
    """
    model = prepared_case.model
    signals = prepared_case.signals
    differences = prepared_case.options.differences
    previous_epoch = place_previous_epoch(prepared_case, work, epoch, d)
    place(prepared_case, work, epoch, d)
    fill_receiver(work, previous_epoch, differences, model, signals, epoch)
    return work.z[rows]


def _present_rows(prepared_case: PreparedCase, epoch: int) -> list[int]:
    """Return the indices of the scalar measurements of the receiver that the filter processes at an epoch."""
    model = prepared_case.model
    signals = prepared_case.signals
    differences = prepared_case.options.differences
    n_row = model.n_observable * signals.n_used[epoch] if model.tight else 6
    rows = []
    for row in range(n_row):
        channel = receiver_channel(model, signals, epoch, row)
        if is_present(differences, model, epoch, channel):
            rows.append(row)
    return rows


def _innovation_sigma(prepared_case: PreparedCase, work: Nominal, epoch: int, formal: Floats, noise: float) -> Floats:
    """Return the formal sigma of the innovations of `_present_rows`; noise: factor on the noise variance."""
    model = prepared_case.model
    signals = prepared_case.signals
    sigma = []
    for row in _present_rows(prepared_case, epoch):
        channel = receiver_channel(model, signals, epoch, row)
        n = model.n_entry[channel]
        entries = model.entry[channel, :n]
        states = model.column[channel, :n]
        h = np.zeros(prepared_case.layout.n_state)
        h[states] = work.H[row, entries]
        noise_variance = noise * signals.variance[epoch, channel]
        variance = h @ formal @ h + noise_variance
        sigma.append(np.sqrt(variance))
    return np.array(sigma)
