"""Backward pass from a metric at an event: contribution of each error source to its variance, by time of origin.

For a metric m = l' e at the event, the adjoint lambda = l is propagated backwards through every update and window of
the forward pass, with the same gains. Noise that entered with vector g and variance q contributes (lambda' g)^2 q to
the variance of m. Each contribution has a source and a time: the sum over times is the forward error budget, the sum
over sources shows when the error originated. The adjoints of clones and of epoch differences are in
`receiver_error.py` and `difference_errors.py`.
"""

from typing import NamedTuple

from lvnav_trade.covariance.component_inputs import fill_inputs
from lvnav_trade.covariance.difference_errors import joint_clone_adjoint, reset_adjoint
from lvnav_trade.covariance.receiver_error import clone_adjoint, solution_adjoint
from lvnav_trade.filter.policies.delay import channel_ring_index
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.covariance import apply_phi_transposed
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.vehicle import N_SAMPLE, advance_vector_transposed, fill_samples
from lvnav_trade.quantities.records import Floats, Ints
from lvnav_trade.simulation.epoch.joint import component_partial, measured_channel, n_entering
from lvnav_trade.simulation.epoch.joint_ticks import fill_partials, nominal_tick


class BackwardPass(NamedTuple):
    """State and result of a backward pass, updated in place.

    e : (n_metric, N). Adjoint of the joint states.
    c : (n_metric, n_component). Adjoint of the error components.
    contribution : (n_metric, n_source, n_bin). Variance by source and time bin.
    """

    e: Floats
    c: Floats
    contribution: Floats


class BackwardMetrics(NamedTuple):
    """Metrics of a backward pass: linear sums of errors at one or several history times.

    row_index : (n_hist,). Index in `rows` of the history time; -1 if it is not in the sum.
    rows : (n_sum, n_metric, N). Weights of the joint states at each of these times.
    """

    row_index: Ints
    rows: Floats


@jit
def _dot(a, b):
    """Return the sum of products over the length of `a`; `b` may be longer."""
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@jit
def _update_adjoint(backward_pass, tape, components, signals, update_index, time_bin, error_in_states, place):
    """Propagate the adjoint backwards through one update, and add the contribution of its noise.

    Parameters
    ----------
    backward_pass, tape, components, signals : BackwardPass, UpdateTape, Components, Signals
    update_index : index of the update on the tape
    time_bin : bin of the contribution
    error_in_states : whether the error of the measurement is in the joint states, as that of a receiver's solution
    place : place of the stored state that a delayed measurement was compared with
    """
    # the update e+ = (I - k h) e - k v gives lambda <- lambda - h' (k' lambda); v contributes (k' lambda)^2 Var(v)
    gain = tape.gain[update_index]
    h = tape.h[update_index]
    epoch = tape.epoch[update_index]
    channel = tape.channel[update_index]
    source = components.noise_source[channel]
    # the noise of a decorrelated solution entered with the receiver-error states
    is_in_states = error_in_states or source < 0
    variance = 0.0
    if not is_in_states:
        sigma = signals.sigma[epoch, measured_channel(signals, channel)]
        variance = sigma**2
    difference = components.imu_differences.row_index[channel]
    for m in range(backward_pass.e.shape[0]):
        y = backward_pass.e[m]
        sensitivity = _dot(gain, y)
        if variance > 0.0:
            backward_pass.contribution[m, source, time_bin] += sensitivity * sensitivity * variance
        # correlated errors enter a measurement with its partial derivative, so lambda_c <- lambda_c - (k' lambda) dz/dc
        for family in range(n_entering(signals, error_in_states)):
            c, partial = component_partial(h, signals, components, family, epoch, channel, error_in_states)
            if c >= 0:
                backward_pass.c[m, components.first_correlated + c] -= sensitivity * partial
        if difference >= 0:
            for c in range(components.first_correlated):
                partial = components.imu_differences.jacobian[difference, epoch, c]
                backward_pass.c[m, c] -= sensitivity * partial
        for k in range(components.n_entry[channel]):
            state = components.column[place, channel, k]
            entry = components.entry[place, channel, k]
            y[state] -= sensitivity * h[entry]


@jit
def _component_adjoint(backward_pass, scratch, sums, components, units, seconds, window_ticks, time_bin):
    """Propagate the adjoint of the components backwards through a window, and add the contribution of their noise.

    Parameters
    ----------
    backward_pass : BackwardPass, updated in place
    scratch : BackwardScratch
    sums : (18,) integrals of the strapdown over the window
    components : Components
    units : ImuArray; None for one IMU
    seconds : s, length of the window
    window_ticks : index of its length, first tick, number of ticks
    time_bin : bin of the contribution
    """
    length_index, first, n_tick = window_ticks
    decay = components.state_decay[length_index]
    fill_inputs(scratch, components, units, sums, seconds, first, n_tick)
    for c in range(components.source.shape[0]):
        source = components.source[c]
        k = components.slot[c]
        g = components.group[source]
        lane = components.lane[source]
        first_pair = components.state_from[c]
        last_pair = components.state_from[c + 1]
        factor = components.component_decay[length_index, g, k, 0, lane]
        noise = components.noise[length_index, g, k, 0, lane]
        has_echo = components.echo[length_index, g, k, 0, lane] > 0.0
        drives_motion = first_pair == last_pair and components.drives_motion[g, k]
        b = scratch.b[g, k, ..., lane]
        for m in range(backward_pass.e.shape[0]):
            y = backward_pass.e[m]
            noise_sensitivity = backward_pass.c[m, c]  # effect on the metric of the noise that drives the component
            state_sensitivity = 0.0  # effect of the component by the states that it enters over the window
            # the same noise drives the component and the error of the states that model it
            for p in range(first_pair, last_pair):
                state = components.states[p]
                noise_sensitivity += y[state]
                state_sensitivity += (factor - decay[state]) * y[state]
            if drives_motion:
                state_sensitivity = _dot(b, y)
                if has_echo:
                    noise_sensitivity -= state_sensitivity
            backward_pass.contribution[m, source, time_bin] += noise_sensitivity * noise_sensitivity * noise
            backward_pass.c[m, c] = factor * backward_pass.c[m, c] + state_sensitivity


@jit
def _add_white_noise(backward_pass, components, length_index, time_bin):
    """Add the contribution of half of the white noise of a window by source; the other half enters at its other end."""
    for source in range(components.group.shape[0]):
        g = components.group[source]
        lane = components.lane[source]
        white = components.white_variance[length_index, g, ..., lane]
        for i in range(backward_pass.e.shape[1]):
            variance = white[i]
            if variance > 0.0:
                for m in range(backward_pass.e.shape[0]):
                    sensitivity = backward_pass.e[m, i]
                    backward_pass.contribution[m, source, time_bin] += 0.5 * variance * sensitivity * sensitivity


@jit
def _add_initial_errors(backward_pass, components):
    """Add the contributions of initial errors, and of initial values of components with the states that model them."""
    n = backward_pass.e.shape[1]
    for m in range(backward_pass.e.shape[0]):
        y = backward_pass.e[m]
        for source in range(components.initial_covariance.shape[0]):  # lambda' P lambda
            for i in range(n):
                for k in range(n):
                    covariance = components.initial_covariance[source, i, k]
                    backward_pass.contribution[m, source, 0] += y[i] * covariance * y[k]
        for c in range(components.source.shape[0]):
            source = components.source[c]
            sensitivity = backward_pass.c[m, c]
            for p in range(components.state_from[c], components.state_from[c + 1]):
                state = components.states[p]
                sensitivity += y[state]
            backward_pass.contribution[m, source, 0] += sensitivity * sensitivity * components.initial_variance[c]


@jit
def _sample_adjoint(backward_pass, scratch, sample_gain, components, vehicle, units, tick, time_bin):
    """Propagate the adjoint backwards through the update of a tick by IMU samples, and add contributions.

    Parameters
    ----------
    backward_pass : BackwardPass, updated in place
    scratch : BackwardScratch, with the partial derivatives of the tick
    sample_gain : (n_tick, 6, n) joint gains on the tape
    components, vehicle : Components, VehicleModel
    units : ImuArray; None for one IMU
    tick : index
    time_bin : bin of the contribution
    """
    h = scratch.h
    columns = vehicle.columns
    gain_adjoint = scratch.y
    fill_samples(h, vehicle.blocks, vehicle.rate[tick], vehicle.force[tick])
    n_axis = 1 if units is None else 3  # an axis of an array enters all combined axes
    for m in range(backward_pass.e.shape[0]):
        y = backward_pass.e[m]
        for r in range(N_SAMPLE):
            gain_adjoint[r] = _dot(sample_gain[tick, r], y)
        for source in range(components.group.shape[0]):
            for r in range(N_SAMPLE):
                sensitivity = gain_adjoint[r]
                variance = components.sample_noise[source, r]
                backward_pass.contribution[m, source, time_bin] += sensitivity * sensitivity * variance
        for j in range(components.sensor.shape[0]):
            if components.block_enters_samples[j] and components.profile[j] < 0:
                sensor = components.sensor[j]
                first = components.first[j]
                source = components.source[first]
                k = components.slot[first]
                g = components.group[source]
                lane = components.lane[source]
                for axis in range(3):
                    for i in range(n_axis):
                        r = 3 * sensor + (axis + i) % 3
                        partial = scratch.a[g, k + axis, r, lane]
                        backward_pass.c[m, first + axis] -= gain_adjoint[r] * partial
        for r in range(N_SAMPLE):
            for k in range(columns.shape[1]):
                state = columns[r, k]
                y[state] -= gain_adjoint[r] * h[r, k]


@jit
def _tick_adjoint(backward_pass, scratch, flight, components, vehicle, units, tick):
    """Propagate the adjoint backwards over a tick, and set the partial derivatives of its samples.

    Parameters
    ----------
    backward_pass, scratch : BackwardPass, BackwardScratch; updated in place
    flight, components, vehicle : NominalFlight, Components, VehicleModel
    units : ImuArray; None for one IMU
    tick : index
    """
    dt = flight.unit.dt
    nominal_tick(scratch.sums, flight.reference, tick, dt)
    fill_partials(scratch.a, components, units, vehicle, tick, dt)
    for m in range(backward_pass.e.shape[0]):
        advance_vector_transposed(backward_pass.e[m], scratch.sums, dt, vehicle.motion)


@jit
def _window_sample_adjoint(backward_pass, scratch, tape, components, case, flight, vehicle, window):
    """Propagate the adjoint backwards through the ticks of a window with IMU samples.

    Parameters
    ----------
    backward_pass, scratch : BackwardPass, BackwardScratch; updated in place
    tape, components, case, flight : UpdateTape, Components, FilterCase, NominalFlight
    vehicle : VehicleModel, or None
    window : first tick, number of ticks, bin of time
    """
    if vehicle is not None:
        first, n_tick, time_bin = window
        units = case.options.imu_array
        for tick in range(first + n_tick - 1, first - 1, -1):
            _tick_adjoint(backward_pass, scratch, flight, components, vehicle, units, tick)
            _sample_adjoint(backward_pass, scratch, tape.sample_gain, components, vehicle, units, tick, time_bin)


@jit
def _window_adjoint(backward_pass, scratch, tape, components, case, w, time_bin):
    """Propagate the adjoint backwards over a window, and add the contributions of process noise and components.

    Parameters
    ----------
    backward_pass, scratch : BackwardPass, BackwardScratch; updated in place
    tape, components, case : UpdateTape, Components, FilterCase
    w : index of the window
    time_bin : bin of the contribution
    """
    schedule = case.schedule
    model = case.model
    units = case.options.imu_array
    length_index = schedule.length_index[w]
    first = schedule.first_tick[w]
    n_tick = schedule.n_tick[w]
    seconds = model.seconds[length_index]
    sums = tape.sums[w]
    position = tape.position[w]
    D = scratch.D
    transition.fill(
        D, components.nav_kinds, components.nav_drivers, sums, position[0], position[1], position[2], seconds
    )
    _add_white_noise(backward_pass, components, length_index, time_bin)
    window_ticks = length_index, first, n_tick
    _component_adjoint(backward_pass, scratch, sums, components, units, seconds, window_ticks, time_bin)
    rows = components.nav_rows
    columns = components.nav_columns
    decay = components.state_decay[length_index]
    for m in range(backward_pass.e.shape[0]):
        apply_phi_transposed(backward_pass.e[m], D, rows, columns, decay, model.clock, seconds)
    _add_white_noise(backward_pass, components, length_index, time_bin)


@jit
def _solution_adjoint(backward_pass, y, chain, components, epoch, time_bin):
    """Propagate the adjoint backwards through an epoch of the receiver-error states (SolutionErrorModel, or None)."""
    if chain is not None:
        solution_adjoint(backward_pass, y, chain, components, epoch, time_bin)


@jit
def _add_metrics(backward_pass, metrics, hist):
    """Add the weights of the metrics at a history time to the adjoint; return whether there are weights at that time.

    Parameters
    ----------
    backward_pass : BackwardPass, updated in place
    metrics : BackwardMetrics
    hist : history time, -1 none
    """
    if hist < 0:
        return False
    row = metrics.row_index[hist]
    if row < 0:
        return False
    for m in range(backward_pass.e.shape[0]):
        for i in range(backward_pass.e.shape[1]):
            backward_pass.e[m, i] += metrics.rows[row, m, i]
    return True


@jit
def run_backward(backward_pass, scratch, tape, components, case, flight, metrics, time_bins):
    """Propagate the adjoint from the end of the flight back to its start.

    Parameters
    ----------
    backward_pass : BackwardPass, of zeros; set here
    scratch : BackwardScratch
    tape : UpdateTape of the forward pass
    components, case, flight : Components, FilterCase, NominalFlight
    metrics : BackwardMetrics, the metrics
    time_bins : (n_window,) time bin of each window
    """
    schedule = case.schedule
    signals = case.signals
    options = case.options
    model = case.model
    successive_errors = components.successive_errors
    has_entered = False
    # each window in the reverse order of `forward.forward`: history, clones, updates, receiver errors, propagation
    for w in range(schedule.n_tick.shape[0] - 1, -1, -1):
        time_bin = time_bins[w]
        epoch = schedule.epoch[w]
        first = schedule.first_tick[w]
        n_tick = schedule.n_tick[w]
        if _add_metrics(backward_pass, metrics, schedule.hist[w]):
            has_entered = True
        if not has_entered:
            continue
        if epoch >= 0:
            joint_clone_adjoint(backward_pass, components, options.delay_processing, options.differences, epoch)
        for row in range(tape.first[w + 1] - 1, tape.first[w] - 1, -1):
            channel = tape.channel[row]
            place = channel_ring_index(options.delay_processing, channel, tape.epoch[row])
            error_in_states = model.has_reported_covariance and channel < signals.n_receiver
            _update_adjoint(backward_pass, tape, components, signals, row, time_bin, error_in_states, place)
        if epoch >= 0:
            _solution_adjoint(backward_pass, scratch.y, flight.chain, components, epoch, time_bin)
            reset_adjoint(backward_pass, successive_errors, model, epoch, time_bin)
            _solution_adjoint(backward_pass, scratch.y, successive_errors, components, epoch, time_bin)
        if n_tick > 0:
            clone_adjoint(backward_pass, components, options.delay_processing, w)
            _window_adjoint(backward_pass, scratch, tape, components, case, w, time_bin)
            window = first, n_tick, time_bin
            _window_sample_adjoint(backward_pass, scratch, tape, components, case, flight, options.vehicle, window)
    _add_initial_errors(backward_pass, components)
