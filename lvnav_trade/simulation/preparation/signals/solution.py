"""Error propagation of a receiver's solution on the nominal flight, from epoch to epoch.

The error s of the receiver's estimate follows s+ = A s + W w + B c + d, with white errors w of ranges, rates and clock,
correlated measurement errors c, and the deterministic error d. A directly simulated solution has no memory:
s+ = -w - c. See `filter.receivers.error_propagation` for the filter of the receiver.
"""

from typing import NamedTuple

import numpy as np

from lvnav_trade.filter.receivers.carrier_smoothing import Smoothing
from lvnav_trade.filter.receivers.error_propagation import (
    SOLUTION,
    ErrorPropagation,
    design,
    filtered,
    mismatch,
    nominal_acceleration,
    point_solution,
    reported_covariance,
    started,
)
from lvnav_trade.filter.receivers.receiver import BIAS, DRIFT, N_STATE, ReceiverFilter, Solver
from lvnav_trade.quantities.line_of_sight import sight
from lvnav_trade.quantities.records import Bools, Floats, Ints
from lvnav_trade.simulation.preparation.signals.lines_of_sight import Lines
from lvnav_trade.simulation.preparation.signals.receiver_measurements import AssumedNoise, TrueSignals

# Sources of white errors.
RANGE, RATE, CLOCK, PLACE, SPEED, PHASE = 0, 1, 2, 3, 4, 5


class SolutionErrorModel(NamedTuple):
    """Propagation of the error of a receiver's solution from epoch to epoch.

    At epoch k the error of m states is e_k = A e_(k-1) + W w + B c + d, with white noise w and correlated errors c.

    move : (n_epoch, m, m). A, the effect of the previous error.
    white : (n_epoch, m, n_in). W, the effect of white noise.
    variance : (n_epoch, n_in). Variance of the white noise w.
    kind : (n_in,). Source of the white noise: RANGE, RATE, CLOCK, PLACE, SPEED or PHASE.
    shared : (n_epoch, m, n_component). B, the effect of correlated measurement errors.
    push : (n_epoch, m). d, the deterministic error.
    pick : (6,). States that are position and velocity.
    reported : (n_epoch, 6, 6). Covariance reported with the solution.
    solved : (n_epoch,). Whether there is a solution.
    point : (n_epoch, 6) m, m/s. Position and velocity of a solution without error, frame i.
    own : (n_epoch, 11, 11). Covariance modelled by the receiver's solver; empty for a simulated solution.
    """

    move: Floats
    white: Floats
    variance: Floats
    kind: Ints
    shared: Floats
    push: Floats
    pick: Ints
    reported: Floats
    solved: Bools
    point: Floats
    own: Floats = np.zeros((0, N_STATE, N_STATE))


def _shared(received: TrueSignals, epoch: int, channels: Ints) -> Floats:
    """Return the derivatives (n_channel, n_component) of channels with respect to the correlated errors at an epoch."""
    shared = received.shared
    partials = np.zeros((channels.size, shared.start.size))
    for family in range(len(shared.member)):
        member = shared.member[family, channels]
        rows = np.flatnonzero(member >= 0)
        components = member[rows]
        entered_channels = channels[rows]
        partials[rows, components] += shared.partial[family, epoch, entered_channels]
    return partials


def simulated(received: TrueSignals, assumed: Floats) -> SolutionErrorModel:
    """Return the error propagation of a directly simulated solution, which has no memory.

    Its arrays have the memory order of those of `solved`, so that no further kernel is compiled.

    Parameters
    ----------
    received
        True side of the measurements.
    assumed
        (n_epoch, n_channel) SI squared. Noise variance reported with the solution.
    """
    n_epoch = len(received.n_used)
    axes = np.arange(6)
    sigma = np.ascontiguousarray(received.sigma[:, axes])
    variance = np.ascontiguousarray(assumed[:, axes])
    partials = np.array([_shared(received, epoch, axes) for epoch in range(n_epoch)])
    return SolutionErrorModel(
        move=np.zeros((n_epoch, 6, 6)),
        white=np.tile(-np.eye(6), (n_epoch, 1, 1)),
        variance=sigma**2,
        kind=np.repeat(np.array([PLACE, SPEED]), 3),
        shared=-partials.reshape(n_epoch, 6, -1),
        push=np.zeros((n_epoch, 6)),
        pick=axes,
        reported=variance[:, :, None] * np.eye(6),
        solved=received.n_used >= 4,
        point=np.hstack([received.position, received.velocity]),
    )


def _epoch(point: Floats, received: TrueSignals, epoch: int) -> tuple[Floats, Floats, Ints]:
    """Return Jacobian rows (n_row, 11) at the true point, innovations (n_row,) there, and channels (n_row,)."""
    n_used = received.n_used[epoch]
    satellites = received.used[epoch, :n_used]
    r_i = point[epoch, :3]
    v_i = point[epoch, 3:]
    satellite_r_i = received.satellite[epoch, satellites]
    satellite_v_i = received.satellite_velocity[epoch, satellites]
    rows = design(r_i, v_i, satellite_r_i, satellite_v_i)
    predicted = sight(satellite_r_i - r_i, satellite_v_i - v_i)
    received_range = received.range[epoch, satellites]
    received_rate = received.rate[epoch, satellites]
    # range and range rate of each satellite in turn
    n_row = 2 * satellites.size
    range_channels = 2 * satellites
    innovation = np.empty(n_row)
    innovation[0::2] = received_range - predicted.distance
    innovation[1::2] = received_rate - predicted.rate
    channels = np.empty(n_row, dtype=np.int64)
    channels[0::2] = range_channels
    channels[1::2] = range_channels + 1
    return rows, innovation, channels


_NOTHING = ErrorPropagation(
    np.zeros((N_STATE, N_STATE)), np.zeros((N_STATE, N_STATE)), np.zeros((N_STATE, 0)), np.zeros((N_STATE, N_STATE))
)


def _coasts(model: ReceiverFilter, n_used: Ints, begun: int) -> Bools:
    """Return whether the receiver's filter outputs a solution at each epoch: after its start, while it may coast.

    Parameters
    ----------
    model
        Settings of the receiver's filter.
    n_used
        (n_epoch,). Number of satellites in use.
    begun
        Epoch of the first fix.
    """
    outputs = np.zeros(n_used.size, dtype=bool)
    idle = 0.0
    for k in range(begun, n_used.size):
        idle = 0.0 if n_used[k] > 0 else idle + model.interval
        outputs[k] = idle <= model.coast
    return outputs


def _gains(
    solver: Solver,
    before: Floats,
    rows: Floats,
    acceleration: Floats,
    since: int,
    fixed: bool,
) -> ErrorPropagation:
    """Return the receiver's gains at an epoch.

    Parameters
    ----------
    solver
        Settings of the receiver's solution.
    before
        (11, 11). Covariance modelled by the receiver at the previous epoch.
    rows
        (n_row, 11). Jacobian rows at the true point.
    acceleration
        (3,) m/s^2. Nominal acceleration, frame i.
    since
        Number of epochs since the first fix; negative before.
    fixed
        Whether a point solution is possible.
    """
    model: ReceiverFilter | None = solver.filter
    if model is None:
        return point_solution(solver.point, rows) if fixed else _NOTHING
    if since > 0:
        return filtered(before, model, rows, acceleration)
    return started(model, solver.point, rows) if since == 0 else _NOTHING


def _moved(model: ReceiverFilter, point: Floats, acceleration: Floats, begun: int, received: TrueSignals) -> Floats:
    """Return the deterministic error of the receiver's filter by true motion and clock jumps, (n_epoch, 11)."""
    r_i = point[:, :3]
    v_i = point[:, 3:]
    modelled = acceleration if len(model.rows) > 1 else np.zeros_like(acceleration)
    moved = mismatch(model, modelled, v_i, r_i)
    moved[:, BIAS] += received.clock_jump[:, 0]
    moved[:, DRIFT] += received.clock_jump[:, 1]
    # at its start the filter has no estimate of the acceleration, so the whole acceleration is its error
    moved[begun, :3] = modelled[begun]
    return moved


def chain_of(
    solver: Solver | None,
    has_covariance: bool,
    received: TrueSignals,
    assumed: AssumedNoise,
    line: Lines,
) -> SolutionErrorModel | None:
    """Return the error propagation of solutions with a reported covariance; None otherwise.

    The reported covariance includes the noise factors of the filter's tuning.

    Parameters
    ----------
    solver
        Settings of the receiver's solution; None if it is simulated directly.
    has_covariance
        Whether the receiver reports a covariance with its solution.
    received, assumed
        True side of the measurements, and noise model of the filter.
    line
        Lines of sight.
    """
    if solver is None:
        return simulated(received, assumed.variance) if has_covariance else None
    point = np.hstack([line.position, line.velocity])
    chain = solved(solver, received, point, line.push, assumed.scale[:, :6])
    if solver.smoothing is not None:
        chain = _add_smoothing(chain, solver.smoothing, received)
    if received.frozen.any():
        chain = _add_output(chain, received.frozen)
    return chain


def solved(
    solver: Solver,
    received: TrueSignals,
    point: Floats,
    acceleration: Floats,
    scale: Floats,
) -> SolutionErrorModel:
    """Return the error propagation of a receiver that computes its position and velocity.

    Parameters
    ----------
    solver
        Settings of the receiver's solution.
    received
        True side of the measurements.
    point
        (n_epoch, 6) m, m/s. Position and velocity of the point of the solution at the times of validity, frame i.
    acceleration
        (n_epoch, 3) m/s^2. Acceleration of that point, frame i.
    scale
        (n_epoch, 6). Factor of the filter's tuning on the reported sigmas.
    """
    model: ReceiverFilter | None = solver.filter
    fixed = received.n_used >= 4
    n_epoch = len(point)
    begun = int(np.argmax(fixed)) if fixed.any() else n_epoch
    if model is None:
        moved = np.zeros((n_epoch, N_STATE))
        has_solution = fixed
        reported_model = solver.point.reported
    else:
        moved = _moved(model, point, acceleration, min(begun, n_epoch - 1), received)
        has_solution = _coasts(model, received.n_used, begun)
        reported_model = model.reported
    slope = nominal_acceleration(point[:, 3:], fixed, received.interval)
    step = received.clock_step
    clock_noise = np.array([[step[0], 0.0], [step[1], step[2]]])  # Cholesky factor, see `sensing.step_clock`
    chain = _new_chain(received, point, has_solution)
    gains = _NOTHING
    for k in range(n_epoch):
        rows, innovation, channels = _epoch(point, received, k)
        gains = _gains(solver, gains.P, rows, slope[k], k - begun, bool(fixed[k]))
        gain = gains.gain
        keep = gains.keep
        n_row = gain.shape[1]  # zero if the receiver processes nothing
        channels = channels[:n_row]
        shared_partials = _shared(received, k, channels)
        kept_clock = keep[:, [BIAS, DRIFT]]
        kept_motion = keep @ moved[k]
        correction = gain @ innovation[:n_row]
        chain.move[k] = keep @ gains.phi
        chain.own[k] = gains.P
        chain.white[k, :, :n_row] = -gain
        chain.variance[k, :n_row] = received.sigma[k, channels] ** 2
        chain.white[k, :, -2:] = kept_clock @ clock_noise
        chain.variance[k, -2:] = 1.0
        chain.shared[k] = -gain @ shared_partials
        chain.push[k] = kept_motion - correction
        if has_solution[k]:
            chain.reported[k] = reported_covariance(reported_model, gains.P)
    scaled = chain.reported * scale[:, :, None] * scale[:, None, :]
    return chain._replace(reported=scaled)


def _new_chain(received: TrueSignals, point: Floats, has_solution: Bools) -> SolutionErrorModel:
    """Return the error propagation of a computed solution before its epochs are filled: zeros, reported unit matrix."""
    n_epoch = len(point)
    n_slot = received.used.shape[1]
    n_in = 2 * n_slot + 2
    sources = [*np.tile([RANGE, RATE], n_slot), CLOCK, CLOCK]
    return SolutionErrorModel(
        move=np.zeros((n_epoch, N_STATE, N_STATE)),
        white=np.zeros((n_epoch, N_STATE, n_in)),
        variance=np.zeros((n_epoch, n_in)),
        kind=np.array(sources, dtype=np.int64),
        shared=np.zeros((n_epoch, N_STATE, received.shared.start.size)),
        push=np.zeros((n_epoch, N_STATE)),
        pick=SOLUTION.astype(np.int64),
        reported=np.tile(np.eye(6), (n_epoch, 1, 1)),
        solved=has_solution,
        point=point,
        own=np.zeros((n_epoch, N_STATE, N_STATE)),
    )


def _add_output(chain: SolutionErrorModel, frozen: Bools) -> SolutionErrorModel:
    """Return the chain with six additional states, the error of the receiver's output.

    It is the error of the estimate. While the output is frozen, it is the previous error plus the true motion since.
    """
    n_epoch, m = chain.push.shape
    states = (0, 6)
    move = np.pad(chain.move, ((0, 0), states, states))
    white = np.pad(chain.white, ((0, 0), states, (0, 0)))
    shared = np.pad(chain.shared, ((0, 0), states, (0, 0)))
    push = np.pad(chain.push, ((0, 0), states))
    pick = chain.pick
    for k in range(n_epoch):
        A = move[k]
        d = push[k]
        if frozen[k] and k:
            previous_point = chain.point[k - 1]
            A[m:, m:] = np.eye(6)
            d[m:] = chain.point[k] - previous_point
        else:
            A[m:, :m] = chain.move[k, pick]
            white[k, m:] = chain.white[k, pick]
            shared[k, m:] = chain.shared[k, pick]
            d[m:] = chain.push[k, pick]
    return chain._replace(move=move, white=white, shared=shared, push=push, pick=np.arange(m, m + 6))


def _add_smoothing(chain: SolutionErrorModel, smoothing: Smoothing, received: TrueSignals) -> SolutionErrorModel:
    """Return the chain of a receiver with carrier smoothing of its ranges.

    For each satellite it has an additional state D, the error of the average of code minus carrier, and for each slot
    an additional white error, that of the carrier. With the gain a, the error of a smoothed range is

        (1 - a) D + a v + (1 - a) n + (p - (1 - a) d) c,

    v white error of the code, n of the carrier; p and d derivatives of code and of code minus carrier with respect to
    the correlated errors c.
    """
    is_smoothed = np.any(smoothing.gain > 0.0, axis=0)
    smoothed = np.flatnonzero(is_smoothed)
    m = chain.move.shape[1]
    n_slot = received.used.shape[1]
    n_in = chain.white.shape[2]
    states = (0, smoothed.size)
    move = np.pad(chain.move, ((0, 0), states, states))
    white = np.pad(chain.white, ((0, 0), states, (0, n_slot)))
    variance = np.pad(chain.variance, ((0, 0), (0, n_slot)))
    shared = np.pad(chain.shared, ((0, 0), states, (0, 0)))
    push = np.pad(chain.push, ((0, 0), states))
    # D is constant except when its satellite is used
    average_states = np.arange(m, m + smoothed.size)
    move[:, average_states, average_states] = 1.0
    state_of = dict(zip(smoothed.tolist(), average_states.tolist(), strict=True))
    for k in range(len(push)):
        A = move[k]
        W = white[k]
        B = shared[k]
        n_used = received.n_used[k]
        satellites = received.used[k, :n_used]
        for slot, satellite in enumerate(satellites.tolist()):
            state = state_of[satellite]
            code = 2 * slot
            phase = n_in + slot
            a = smoothing.gain[k, satellite]
            keep = 1.0 - a
            gain = chain.white[k, :, code]  # minus the solver's gain
            kept_gain = keep * gain
            d = _code_minus_carrier(received, smoothing, k, satellite)
            A[:m, state] = kept_gain
            A[state, state] = keep
            W[:m, code] = a * gain
            W[state, code] = a
            W[:m, phase] = kept_gain
            W[state, phase] = -a
            B[:m] -= keep * np.outer(gain, d)
            B[state] = a * d
            code_sigma = received.sigma[k, 2 * satellite]
            phase_sigma = smoothing.sigma[k, satellite]
            variance[k, code] = code_sigma**2
            variance[k, phase] = phase_sigma**2
    phase_sources = np.full(n_slot, PHASE)
    noise_sources = np.concatenate([chain.kind, phase_sources])
    return chain._replace(
        move=move,
        white=white,
        variance=variance,
        kind=noise_sources,
        shared=shared,
        push=push,
    )


def _code_minus_carrier(received: TrueSignals, smoothing: Smoothing, epoch: int, satellite: int) -> Floats:
    """Return the derivatives (n_component,) of code minus carrier of a satellite with respect to correlated errors."""
    errors = received.shared
    range_channel = 2 * satellite
    members = errors.member[:, range_channel].tolist()
    partials = np.zeros(errors.start.size)
    for family, member in enumerate(members):
        if member >= 0:
            partials[member] += smoothing.code[family, epoch, satellite]
    return partials
