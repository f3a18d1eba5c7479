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
    design_matrix,
    filter_epoch,
    filter_start,
    mismatch,
    nominal_acceleration,
    point_solution,
    reported_covariance,
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

    transition : (n_epoch, m, m). A, the effect of the previous error.
    noise_input : (n_epoch, m, n_in). W, the effect of white noise.
    variance : (n_epoch, n_in). Variance of the white noise w.
    noise_type : (n_in,). Source of the white noise: RANGE, RATE, CLOCK, PLACE, SPEED or PHASE.
    correlated_input : (n_epoch, m, n_component). B, the effect of correlated measurement errors.
    deterministic_error : (n_epoch, m). d, the deterministic error.
    solution_states : (6,). States that are position and velocity.
    reported_covariance : (n_epoch, 6, 6). Covariance reported with the solution.
    has_solution : (n_epoch,). Whether there is a solution.
    point : (n_epoch, 6) m, m/s. Position and velocity of a solution without error, frame i.
    solver_covariance : (n_epoch, 11, 11). Covariance modelled by the receiver's solver; empty for a simulated solution.
    """

    transition: Floats
    noise_input: Floats
    variance: Floats
    noise_type: Ints
    correlated_input: Floats
    deterministic_error: Floats
    solution_states: Ints
    reported_covariance: Floats
    has_solution: Bools
    point: Floats
    solver_covariance: Floats = np.zeros((0, N_STATE, N_STATE))


def _correlated_partials(true_signals: TrueSignals, epoch: int, channels: Ints) -> Floats:
    """Return the derivatives (n_channel, n_component) of channels with respect to the correlated errors at an epoch."""
    errors = true_signals.correlated_errors
    partials = np.zeros((channels.size, errors.initial_sigma.size))
    for family in range(len(errors.member)):
        member = errors.member[family, channels]
        rows = np.flatnonzero(member >= 0)
        components = member[rows]
        entered_channels = channels[rows]
        partials[rows, components] += errors.partial[family, epoch, entered_channels]
    return partials


def direct_error_model(true_signals: TrueSignals, noise_variance: Floats) -> SolutionErrorModel:
    """Return the error propagation of a directly simulated solution, which has no memory.

    Its arrays have the memory order of those of `solver_error_model`, so that no further kernel is compiled.

    Parameters
    ----------
    true_signals
        True side of the measurements.
    noise_variance
        (n_epoch, n_channel) SI squared. Noise variance reported with the solution.
    """
    n_epoch = len(true_signals.n_used)
    axes = np.arange(6)
    sigma = np.ascontiguousarray(true_signals.sigma[:, axes])
    variance = np.ascontiguousarray(noise_variance[:, axes])
    partials = np.array([_correlated_partials(true_signals, epoch, axes) for epoch in range(n_epoch)])
    return SolutionErrorModel(
        transition=np.zeros((n_epoch, 6, 6)),
        noise_input=np.tile(-np.eye(6), (n_epoch, 1, 1)),
        variance=sigma**2,
        noise_type=np.repeat(np.array([PLACE, SPEED]), 3),
        correlated_input=-partials.reshape(n_epoch, 6, -1),
        deterministic_error=np.zeros((n_epoch, 6)),
        solution_states=axes,
        reported_covariance=variance[:, :, None] * np.eye(6),
        has_solution=true_signals.n_used >= 4,
        point=np.hstack([true_signals.position, true_signals.velocity]),
    )


def _epoch_equations(point: Floats, true_signals: TrueSignals, epoch: int) -> tuple[Floats, Floats, Ints]:
    """Return Jacobian rows (n_row, 11) at the true point, innovations (n_row,) there, and channels (n_row,)."""
    n_used = true_signals.n_used[epoch]
    satellites = true_signals.satellite_by_slot[epoch, :n_used]
    r_i = point[epoch, :3]
    v_i = point[epoch, 3:]
    satellite_r_i = true_signals.satellite_position[epoch, satellites]
    satellite_v_i = true_signals.satellite_velocity[epoch, satellites]
    rows = design_matrix(r_i, v_i, satellite_r_i, satellite_v_i)
    true_sight = sight(satellite_r_i - r_i, satellite_v_i - v_i)
    received_range = true_signals.range[epoch, satellites]
    received_rate = true_signals.rate[epoch, satellites]
    # range and range rate of each satellite in turn
    n_row = 2 * satellites.size
    range_channels = 2 * satellites
    innovation = np.empty(n_row)
    innovation[0::2] = received_range - true_sight.distance
    innovation[1::2] = received_rate - true_sight.rate
    channels = np.empty(n_row, dtype=np.int64)
    channels[0::2] = range_channels
    channels[1::2] = range_channels + 1
    return rows, innovation, channels


_NO_PROPAGATION = ErrorPropagation(
    np.zeros((N_STATE, N_STATE)), np.zeros((N_STATE, N_STATE)), np.zeros((N_STATE, 0)), np.zeros((N_STATE, N_STATE))
)


def _coasts(model: ReceiverFilter, n_used: Ints, first_fix_epoch: int) -> Bools:
    """Return whether the receiver's filter outputs a solution at each epoch: after its start, while it may coast.

    Parameters
    ----------
    model
        Settings of the receiver's filter.
    n_used
        (n_epoch,). Number of satellites in use.
    first_fix_epoch
        Epoch of the first fix.
    """
    outputs = np.zeros(n_used.size, dtype=bool)
    idle = 0.0
    for k in range(first_fix_epoch, n_used.size):
        idle = 0.0 if n_used[k] > 0 else idle + model.interval
        outputs[k] = idle <= model.coast
    return outputs


def _gains(
    solver: Solver,
    previous_covariance: Floats,
    rows: Floats,
    acceleration: Floats,
    epochs_since_fix: int,
    has_fix: bool,
) -> ErrorPropagation:
    """Return the receiver's gains at an epoch.

    Parameters
    ----------
    solver
        Settings of the receiver's solution.
    previous_covariance
        (11, 11). Covariance modelled by the receiver at the previous epoch.
    rows
        (n_row, 11). Jacobian rows at the true point.
    acceleration
        (3,) m/s^2. Nominal acceleration, frame i.
    epochs_since_fix
        Number of epochs since the first fix; negative before.
    has_fix
        Whether a point solution is possible.
    """
    model: ReceiverFilter | None = solver.filter
    if model is None:
        return point_solution(solver.point, rows) if has_fix else _NO_PROPAGATION
    if epochs_since_fix > 0:
        return filter_epoch(previous_covariance, model, rows, acceleration)
    return filter_start(model, solver.point, rows) if epochs_since_fix == 0 else _NO_PROPAGATION


def _motion_error(
    model: ReceiverFilter, point: Floats, acceleration: Floats, first_fix_epoch: int, true_signals: TrueSignals
) -> Floats:
    """Return the deterministic error of the receiver's filter by true motion and clock jumps, (n_epoch, 11)."""
    r_i = point[:, :3]
    v_i = point[:, 3:]
    modelled_acceleration = acceleration if len(model.rows) > 1 else np.zeros_like(acceleration)
    motion_error = mismatch(model, modelled_acceleration, v_i, r_i)
    motion_error[:, BIAS] += true_signals.clock_jump[:, 0]
    motion_error[:, DRIFT] += true_signals.clock_jump[:, 1]
    # at its start the filter has no estimate of the acceleration, so the whole acceleration is its error
    motion_error[first_fix_epoch, :3] = modelled_acceleration[first_fix_epoch]
    return motion_error


def solution_error_model(
    solver: Solver | None,
    has_covariance: bool,
    true_signals: TrueSignals,
    assumed_noise: AssumedNoise,
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
    true_signals, assumed_noise
        True side of the measurements, and noise model of the filter.
    line
        Lines of sight.
    """
    if solver is None:
        return direct_error_model(true_signals, assumed_noise.variance) if has_covariance else None
    point = np.hstack([line.position, line.velocity])
    chain = solver_error_model(solver, true_signals, point, line.vehicle_acceleration, assumed_noise.scale[:, :6])
    if solver.smoothing is not None:
        chain = _add_smoothing(chain, solver.smoothing, true_signals)
    if true_signals.is_frozen.any():
        chain = _add_output(chain, true_signals.is_frozen)
    return chain


def solver_error_model(
    solver: Solver,
    true_signals: TrueSignals,
    point: Floats,
    acceleration: Floats,
    scale: Floats,
) -> SolutionErrorModel:
    """Return the error propagation of a receiver that computes its position and velocity.

    Parameters
    ----------
    solver
        Settings of the receiver's solution.
    true_signals
        True side of the measurements.
    point
        (n_epoch, 6) m, m/s. Position and velocity of the point of the solution at the times of validity, frame i.
    acceleration
        (n_epoch, 3) m/s^2. Acceleration of that point, frame i.
    scale
        (n_epoch, 6). Factor of the filter's tuning on the reported sigmas.
    """
    model: ReceiverFilter | None = solver.filter
    has_fix = true_signals.n_used >= 4
    n_epoch = len(point)
    first_fix_epoch = int(np.argmax(has_fix)) if has_fix.any() else n_epoch
    if model is None:
        motion_error = np.zeros((n_epoch, N_STATE))
        has_solution = has_fix
        reported_model = solver.point.reported_covariance
    else:
        motion_error = _motion_error(model, point, acceleration, min(first_fix_epoch, n_epoch - 1), true_signals)
        has_solution = _coasts(model, true_signals.n_used, first_fix_epoch)
        reported_model = model.reported_covariance
    slope = nominal_acceleration(point[:, 3:], has_fix, true_signals.interval)
    step = true_signals.clock_step
    clock_noise = np.array([[step[0], 0.0], [step[1], step[2]]])  # Cholesky factor, see `sensing.step_clock`
    chain = _new_chain(true_signals, point, has_solution)
    gains = _NO_PROPAGATION
    for k in range(n_epoch):
        rows, innovation, channels = _epoch_equations(point, true_signals, k)
        gains = _gains(solver, gains.P, rows, slope[k], k - first_fix_epoch, bool(has_fix[k]))
        gain = gains.gain
        keep = gains.update_matrix
        n_row = gain.shape[1]  # zero if the receiver processes nothing
        channels = channels[:n_row]
        shared_partials = _correlated_partials(true_signals, k, channels)
        kept_clock = keep[:, [BIAS, DRIFT]]
        kept_motion = keep @ motion_error[k]
        correction = gain @ innovation[:n_row]
        chain.transition[k] = keep @ gains.phi
        chain.solver_covariance[k] = gains.P
        chain.noise_input[k, :, :n_row] = -gain
        chain.variance[k, :n_row] = true_signals.sigma[k, channels] ** 2
        chain.noise_input[k, :, -2:] = kept_clock @ clock_noise
        chain.variance[k, -2:] = 1.0
        chain.correlated_input[k] = -gain @ shared_partials
        chain.deterministic_error[k] = kept_motion - correction
        if has_solution[k]:
            chain.reported_covariance[k] = reported_covariance(reported_model, gains.P)
    scaled_covariance = chain.reported_covariance * scale[:, :, None] * scale[:, None, :]
    return chain._replace(reported_covariance=scaled_covariance)


def _new_chain(true_signals: TrueSignals, point: Floats, has_solution: Bools) -> SolutionErrorModel:
    """Return the error propagation of a computed solution before its epochs are filled: zeros, reported unit matrix."""
    n_epoch = len(point)
    n_slot = true_signals.satellite_by_slot.shape[1]
    n_in = 2 * n_slot + 2
    sources = [*np.tile([RANGE, RATE], n_slot), CLOCK, CLOCK]
    return SolutionErrorModel(
        transition=np.zeros((n_epoch, N_STATE, N_STATE)),
        noise_input=np.zeros((n_epoch, N_STATE, n_in)),
        variance=np.zeros((n_epoch, n_in)),
        noise_type=np.array(sources, dtype=np.int64),
        correlated_input=np.zeros((n_epoch, N_STATE, true_signals.correlated_errors.initial_sigma.size)),
        deterministic_error=np.zeros((n_epoch, N_STATE)),
        solution_states=SOLUTION.astype(np.int64),
        reported_covariance=np.tile(np.eye(6), (n_epoch, 1, 1)),
        has_solution=has_solution,
        point=point,
        solver_covariance=np.zeros((n_epoch, N_STATE, N_STATE)),
    )


def _add_output(chain: SolutionErrorModel, frozen: Bools) -> SolutionErrorModel:
    """Return the chain with six additional states, the error of the receiver's output.

    It is the error of the estimate. While the output is frozen, it is the previous error plus the true motion since.
    """
    n_epoch, m = chain.deterministic_error.shape
    states = (0, 6)
    transition = np.pad(chain.transition, ((0, 0), states, states))
    noise_input = np.pad(chain.noise_input, ((0, 0), states, (0, 0)))
    correlated_input = np.pad(chain.correlated_input, ((0, 0), states, (0, 0)))
    deterministic_error = np.pad(chain.deterministic_error, ((0, 0), states))
    solution_states = chain.solution_states
    for k in range(n_epoch):
        A = transition[k]
        d = deterministic_error[k]
        if frozen[k] and k:
            previous_point = chain.point[k - 1]
            A[m:, m:] = np.eye(6)
            d[m:] = chain.point[k] - previous_point
        else:
            A[m:, :m] = chain.transition[k, solution_states]
            noise_input[k, m:] = chain.noise_input[k, solution_states]
            correlated_input[k, m:] = chain.correlated_input[k, solution_states]
            d[m:] = chain.deterministic_error[k, solution_states]
    return chain._replace(
        transition=transition,
        noise_input=noise_input,
        correlated_input=correlated_input,
        deterministic_error=deterministic_error,
        solution_states=np.arange(m, m + 6),
    )


def _add_smoothing(chain: SolutionErrorModel, smoothing: Smoothing, true_signals: TrueSignals) -> SolutionErrorModel:
    """Return the chain of a receiver with carrier smoothing of its ranges.

    For each satellite it has an additional state D, the error of the average of code minus carrier, and for each slot
    an additional white error, that of the carrier. With the gain a, the error of a smoothed range is

        (1 - a) D + a v + (1 - a) n + (p - (1 - a) d) c,

    v white error of the code, n of the carrier; p and d derivatives of code and of code minus carrier with respect to
    the correlated errors c.
    """
    is_smoothed = np.any(smoothing.gain > 0.0, axis=0)
    smoothed_satellites = np.flatnonzero(is_smoothed)
    m = chain.transition.shape[1]
    n_slot = true_signals.satellite_by_slot.shape[1]
    n_in = chain.noise_input.shape[2]
    states = (0, smoothed_satellites.size)
    transition = np.pad(chain.transition, ((0, 0), states, states))
    noise_input = np.pad(chain.noise_input, ((0, 0), states, (0, n_slot)))
    variance = np.pad(chain.variance, ((0, 0), (0, n_slot)))
    correlated_input = np.pad(chain.correlated_input, ((0, 0), states, (0, 0)))
    deterministic_error = np.pad(chain.deterministic_error, ((0, 0), states))
    # D is constant except when its satellite is used
    average_states = np.arange(m, m + smoothed_satellites.size)
    transition[:, average_states, average_states] = 1.0
    state_of = dict(zip(smoothed_satellites.tolist(), average_states.tolist(), strict=True))
    for k in range(len(deterministic_error)):
        A = transition[k]
        W = noise_input[k]
        B = correlated_input[k]
        n_used = true_signals.n_used[k]
        satellites = true_signals.satellite_by_slot[k, :n_used]
        for slot, satellite in enumerate(satellites.tolist()):
            state = state_of[satellite]
            code = 2 * slot
            phase = n_in + slot
            a = smoothing.gain[k, satellite]
            keep = 1.0 - a
            gain = chain.noise_input[k, :, code]  # minus the solver's gain
            kept_gain = keep * gain
            d = _code_minus_carrier(true_signals, smoothing, k, satellite)
            A[:m, state] = kept_gain
            A[state, state] = keep
            W[:m, code] = a * gain
            W[state, code] = a
            W[:m, phase] = kept_gain
            W[state, phase] = -a
            B[:m] -= keep * np.outer(gain, d)
            B[state] = a * d
            code_sigma = true_signals.sigma[k, 2 * satellite]
            phase_sigma = smoothing.sigma[k, satellite]
            variance[k, code] = code_sigma**2
            variance[k, phase] = phase_sigma**2
    phase_sources = np.full(n_slot, PHASE)
    noise_sources = np.concatenate([chain.noise_type, phase_sources])
    return chain._replace(
        transition=transition,
        noise_input=noise_input,
        variance=variance,
        noise_type=noise_sources,
        correlated_input=correlated_input,
        deterministic_error=deterministic_error,
    )


def _code_minus_carrier(true_signals: TrueSignals, smoothing: Smoothing, epoch: int, satellite: int) -> Floats:
    """Return the derivatives (n_component,) of code minus carrier of a satellite with respect to correlated errors."""
    errors = true_signals.correlated_errors
    range_channel = 2 * satellite
    members = errors.member[:, range_channel].tolist()
    partials = np.zeros(errors.initial_sigma.size)
    for family, member in enumerate(members):
        if member >= 0:
            partials[member] += smoothing.code[family, epoch, satellite]
    return partials
