"""Nonlinearity of the navigation at the errors of linear covariance: an estimate with a known error, and its size.

The error is truth minus estimate, states in storage order, frame i.
"""

from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.covariance.history import turns
from lvnav_trade.covariance.workspace import Nominal, new_nominal, new_nominal_previous_epoch
from lvnav_trade.filter.ekf import channel_of, fill_receiver, place_antenna
from lvnav_trade.filter.policies.epoch_differences import PreviousEpoch, is_present, store_estimate
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.attitude import from_rotation, multiply, small_rotation
from lvnav_trade.kernels.covariance import apply_phi
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.kernels.strapdown import N_SUM, Q, R, V, full_rate
from lvnav_trade.kernels.transition import ACCEL, ATT, GYRO, POS, VEL
from lvnav_trade.quantities.records import CovHistory, Floats
from lvnav_trade.simulation.preparation.prepare import Prepared

_driver = getattr(transition.driver, "py_func", transition.driver)  # the formula itself, for arrays of ticks


def navigation(q: Floats, v: Floats, r: Floats, d: Floats) -> Floats:
    """Return the estimated navigation state (10,) with error d (n_state,).

    q, v, r : (4,), (3,) m/s, (3,) m. True attitude, velocity and position, frame i.
    """
    turned = multiply(*from_rotation(-d[ATT], -d[ATT + 1], -d[ATT + 2]), *q)
    return np.concatenate([turned, v - d[VEL : VEL + 3], r - d[POS : POS + 3]])


def navigation_at(prepared: Prepared, tick: int, d: Floats) -> Floats:
    """Return the estimated navigation state (10,) with error d at a tick."""
    reference = prepared.reference
    return navigation(reference.q_b_i[tick], reference.v_i[tick], reference.r_i[tick], d)


class Inputs(NamedTuple):
    """True increments of some ticks, and drivers of IMU parameters.

    true : (n_tick, 6) rad, m/s. True increments, body axes.
    sensors : For gyro and accelerometer: columns of the increments, states (n, 3) of its parameters by kind and axis,
        drivers (n, n_tick, 3).
    dt : s. Tick.
    """

    true: Floats
    sensors: tuple[tuple[slice, Any, Floats], ...]
    dt: float


def inputs(prepared: Prepared, first: int, n_tick: int) -> Inputs:
    """Return the inputs of some ticks; they do not depend on the error of the estimate."""
    ticks, dt = slice(first, first + n_tick), prepared.unit.dt
    true, sensors = np.hstack([prepared.reference.dtheta[ticks], prepared.reference.dvel[ticks]]), []
    for sensor, columns, other_columns in ((GYRO, slice(0, 3), slice(3, 6)), (ACCEL, slice(3, 6), slice(0, 3))):
        blocks = [block for block in prepared.layout.parameters if block.sensor == sensor]
        if blocks:
            drivers = [
                _driver(block.driver, *(true[:, columns] / dt).T, *(true[:, other_columns] / dt).T) for block in blocks
            ]
            states = np.array([block.offset for block in blocks])[:, None] + np.arange(3)
            sensors.append((columns, states, np.stack([np.stack(axes, axis=1) for axes in drivers])))
    return Inputs(true, tuple(sensors), dt)


def compensated(inputs: Inputs, d: Floats) -> Floats:
    """Return increments (n_tick, 6) compensated with parameters in error by d: true increments plus residual errors."""
    result = inputs.true.copy()
    for columns, states, drivers in inputs.sensors:
        terms = drivers * d[states][:, None] * inputs.dt
        result[:, columns] = np.add.reduce(np.concatenate([inputs.true[None, :, columns], terms]))  # in this order
    return result


def increments(prepared: Prepared, first: int, n_tick: int, d: Floats) -> Floats:
    """Return increments (n_tick, 6) of some ticks, compensated with parameters in error by d."""
    return compensated(inputs(prepared, first, n_tick), d)


def tick_at(prepared: Prepared, time: float) -> int:
    """Return the tick nearest to a time (s)."""
    return int(np.argmin(np.abs(prepared.reference.t - time)))


def place(prepared: Prepared, work: Nominal, epoch: int, d: Floats, time: float | None = None) -> None:
    """Set the estimate in `work` to the truth minus an error.

    Parameters
    ----------
    prepared
        Prepared case.
    work
        Arrays of the nominal run; navigation state, increments, clock, extra states and antennas are set.
    epoch
        Epoch, whose antennas are placed.
    d
        (n_state,) SI. Error, truth minus estimate.
    time
        s since lift-off. Time of the truth; None: that of the epoch.
    """
    model = prepared.model
    tick = tick_at(prepared, prepared.t_epoch[epoch] if time is None else time)
    work.nav[:] = navigation_at(prepared, tick, d)
    work.previous[:] = increments(prepared, max(0, tick - 1), 1, d)[0]
    work.clock_hat[:] = -d[model.clock : model.clock + 2] if model.clock >= 0 else 0.0
    for extra, offset in enumerate(model.extra_offset):
        work.extra[extra] = -d[offset]
    place_antenna(work, None, None, model, prepared.unit.dt, epoch)


def place_previous_epoch(prepared: Prepared, work: Nominal, epoch: int, d: Floats) -> PreviousEpoch | None:
    """Return the stored estimate of the previous epoch, with the error of the clones in d (n_state,).

    None without differences of two epochs. The navigation state of `work` is changed.
    """
    delayed, model = prepared.options.delayed, prepared.model
    previous_epoch = new_nominal_previous_epoch(prepared)
    if delayed is None or previous_epoch is None:
        return None
    error = np.zeros_like(d)
    error[delayed.cloned] = d[delayed.clone + np.arange(delayed.cloned.size)]
    place(prepared, work, max(0, epoch - 1), error)
    store_estimate(work, previous_epoch, None, None, delayed, model, epoch)
    return previous_epoch


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
        prediction. NaN without rows.
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
    linear = _linear(prepared, start, directions, windows)
    plus, minus = (_propagated(prepared, start, sign * directions, windows) for sign in (1.0, -1.0))
    if end is not None:  # the measurement at the end of the gap sees the grown errors
        formal, true = _covariances(prepared, history, max(hist, int(np.searchsorted(prepared.t_hist, end - 1e-9)) - 1))
        directions, time = scale * _factor(true), end
    sigma = np.sqrt(np.diag(formal))[:9]
    sound = np.where(sigma > 0.0, sigma, np.inf)
    second = np.abs(plus + minus) / 2.0 / sound
    first = np.abs((plus - minus) / 2.0 - linear[:, :9]) / sound
    worst = int(np.argmax(second)) % second.shape[1]
    rows = _rows(prepared, time, directions, formal)
    return Nonlinearity(time, float(second.max()) / scale, worst, float(first.max()) / scale, rows / scale)


def open_loop_nonlinearity(prepared: Prepared, history: CovHistory, time: float) -> Nonlinearity:
    """Return the nonlinearity of an open loop at the history time nearest to `time` (s), accumulated since the start.

    The filter is linearised at the uncorrected INS, whose distance from the truth grows. The directions are those of
    the initial errors. The second-order part is the error of the INS beyond the filter's transition; measurements do
    not correct it here, so `motion` is an upper bound. The curvature of a measurement is the same at successive epochs
    and does not average out, so `rows` is in sigmas of the prediction, without noise.
    """
    hist = int(np.argmin(np.abs(prepared.t_hist - time)))
    time = float(prepared.t_hist[hist])
    steps, pieces = _steps(prepared, time), _pieces(prepared, float(prepared.t_hist[0]), time)
    directions = _factor(_covariances(prepared, history, 0)[1])
    distance = _linear(prepared, 0, directions, steps)
    plus, minus = (_propagated(prepared, 0, sign * directions, pieces) for sign in (1.0, -1.0))
    formal, _ = _covariances(prepared, history, hist)
    sigma = np.sqrt(np.diag(formal))[:9]
    sound = np.where(sigma > 0.0, sigma, np.inf)
    second = np.abs(plus + minus) / 2.0 / sound
    first = np.abs((plus - minus) / 2.0 - distance[:, :9]) / sound
    worst = int(np.argmax(second)) % second.shape[1]
    rows = _rows(prepared, time, distance, formal, noise=0.0)
    return Nonlinearity(time, float(second.max()), worst, float(first.max()), rows)


def _steps(prepared: Prepared, end: float) -> Windows:
    """Return the covariance steps from the start of the flight to a time (s)."""
    step = _ticks(prepared)[1]
    decay = prepared.model.decay[int(np.argmin(np.abs(prepared.lengths - step * prepared.unit.dt)))]
    return [(first, step, decay) for first in range(0, tick_at(prepared, end) - step + 1, step)]


def _covariances(prepared: Prepared, history: CovHistory, hist: int) -> tuple[Floats, Floats]:
    """Return the formal and the true covariance (n_state, n_state) at a history time, frame i."""
    turn, layout = turns(prepared)[hist], prepared.layout
    states = slice(0, len(turn))  # further outputs are not states
    formal, true = (turn.T @ cov[hist, states, states] @ turn for cov in (history.formal_cov, history.true_cov))
    if not layout.n_delayed:
        return formal, true
    whole = np.zeros((layout.n_state, len(turn)))  # clones equal their states, noise states of an epoch are zero
    whole[layout.reported, range(len(turn))] = 1.0
    whole[layout.clone : layout.clone + len(layout.cloned)] = whole[list(layout.cloned)]
    return whole @ formal @ whole.T, whole @ true @ whole.T


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
    return max(1, round(rate / card.update_rate)), max(1, round(rate / card.covariance_rate))


def _start_tick(prepared: Prepared, time: float) -> int:
    """Return the tick at a time, or the last from which an update interval remains."""
    return max(0, min(tick_at(prepared, time), prepared.reference.t.size - 1 - _ticks(prepared)[0]))


def _windows(prepared: Prepared, start: int) -> Windows:
    """Return (first tick, ticks, decay of every state) of the covariance steps of one update interval."""
    interval, step = _ticks(prepared)
    length = int(np.argmin(np.abs(prepared.lengths - step * prepared.unit.dt)))
    decay = prepared.model.decay[length]
    return [(first, step, decay) for first in range(start, start + interval - step + 1, step)]


def _pieces(prepared: Prepared, begin: float, end: float) -> Windows:
    """Return the windows of a gap as `_windows` does, in at most `_PIECES` pieces of whole covariance steps."""
    step, t = _ticks(prepared)[1], prepared.reference.t
    first, last = (int(np.argmin(np.abs(t - time))) for time in (begin, end))
    steps = max(1, (min(last, t.size - 1) - first) // step)
    size = -(-steps // _PIECES)
    decay = prepared.model.decay[int(np.argmin(np.abs(prepared.lengths - step * prepared.unit.dt)))]
    return [
        (first + step * k, step * min(size, steps - k), decay ** min(size, steps - k)) for k in range(0, steps, size)
    ]


def _propagated(prepared: Prepared, start: int, errors: Floats, windows: Windows) -> Floats:
    """Return the navigation errors (n, 9) at the end of the windows for initial errors (n, n_state), by the strapdown.

    The error-free flight and the drivers of IMU parameters are computed once.
    """
    none, sums = np.zeros(errors.shape[1]), np.zeros(N_SUM)
    algorithm, dt = full_rate(prepared.model.strapdown.gravity), prepared.unit.dt
    legs = [(inputs(prepared, first, n_tick), n_tick, decay) for first, n_tick, decay in windows]
    before = inputs(prepared, max(0, start - 1), 1).true[0]

    def integrate(d: Floats) -> Floats:
        nav, previous, parameters = navigation_at(prepared, start, d), before.copy(), d
        for ticks, n_tick, decay in legs:
            mechanise(nav, sums, previous, compensated(ticks, parameters), n_tick, dt, algorithm, 0.0)
            parameters = decay * parameters
        return nav

    exact, results = integrate(none), []
    for d in errors:
        nav = integrate(d)
        turned = small_rotation(*exact[Q : Q + 4], *nav[Q : Q + 4])
        results.append(np.concatenate([turned, exact[V : V + 3] - nav[V : V + 3], exact[R : R + 3] - nav[R : R + 3]]))
    return np.array(results)


def _linear(prepared: Prepared, start: int, directions: Floats, windows: Windows) -> Floats:
    """Return the errors (n, n_state) at the end of the windows for initial errors (n, n_state), by the filter's
    transition.
    """
    model, dt = prepared.model, prepared.unit.dt
    none = np.zeros(directions.shape[1])
    nav, sums = navigation_at(prepared, start, none), np.zeros(N_SUM)
    previous, errors = np.zeros(6), directions.copy()
    blocks, algorithm = np.zeros((model.block_rows.size, 9)), full_rate(model.strapdown.gravity)
    for first, n_tick, decay in windows:
        mechanise(nav, sums, previous, increments(prepared, first, n_tick, none), n_tick, dt, algorithm, 0.0)
        seconds = n_tick * dt
        transition.fill(blocks, model.block_kinds, model.block_drivers, sums, nav[R], nav[R + 1], nav[R + 2], seconds)
        for error in errors:
            apply_phi(error, blocks, model.block_rows, model.block_columns, decay, model.clock, seconds)
    return errors


def _rows(prepared: Prepared, time: float, directions: Floats, formal: Floats, noise: float = 1.0) -> float:
    """Return the largest second-order part of a measurement at the nearest epoch, in sigmas of its innovation.

    noise : factor on the noise variance; 0: in sigmas of the prediction
    """
    model = prepared.model
    if not model.n_receiver or not prepared.t_epoch.size:
        return float("nan")
    epoch = int(np.argmin(np.abs(prepared.t_epoch - time)))
    used = int(prepared.signals.n_used[epoch])
    if used == 0 or (not model.tight and used < 4) or not _present(prepared, epoch):
        return float("nan")
    work = new_nominal(prepared)
    expected = _predicted(prepared, work, epoch, np.zeros(directions.shape[1]))
    sigma = _innovation_sigma(prepared, work, epoch, formal, noise)
    bent = [
        _predicted(prepared, work, epoch, d) + _predicted(prepared, work, epoch, -d) - 2.0 * expected
        for d in directions
    ]
    return float(np.max(np.abs(bent) / 2.0 / sigma))


def _predicted(prepared: Prepared, work: Nominal, epoch: int, d: Floats) -> Floats:
    """Return minus the predicted measurements of an epoch, by an estimate in error by d, up to a constant."""
    model, signals, delayed = prepared.model, prepared.signals, prepared.options.delayed
    previous_epoch = place_previous_epoch(prepared, work, epoch, d)
    place(prepared, work, epoch, d)
    fill_receiver(work, previous_epoch, delayed, model, signals, epoch)
    return work.z[_present(prepared, epoch)]


def _present(prepared: Prepared, epoch: int) -> list[int]:
    """Return the receiver rows that the filter processes at an epoch."""
    model, signals, delayed = prepared.model, prepared.signals, prepared.options.delayed
    n_row = model.n_kind * signals.n_used[epoch] if model.tight else 6
    return [row for row in range(n_row) if is_present(delayed, model, epoch, channel_of(model, signals, epoch, row))]


def _innovation_sigma(prepared: Prepared, work: Nominal, epoch: int, formal: Floats, noise: float) -> Floats:
    """Return the formal sigma of the innovations of the rows in `work`; noise: factor on the noise variance."""
    model, signals, sigma = prepared.model, prepared.signals, []
    for row in _present(prepared, epoch):
        channel = channel_of(model, signals, epoch, row)
        n = model.n_entry[channel]
        h = np.zeros(prepared.layout.n_state)
        h[model.column[channel, :n]] = work.H[row, model.entry[channel, :n]]
        sigma.append(np.sqrt(h @ formal @ h + noise * signals.variance[epoch, channel]))
    return np.array(sigma)
