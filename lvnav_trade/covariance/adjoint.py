"""Backward pass from a metric at an event: contribution of each error source to its variance, by time of origin.

For a metric m = l' e at the event, the adjoint lambda = l is propagated backwards through every update and window of
the forward pass, with the same gains. Noise that entered with vector g and variance q contributes (lambda' g)^2 q to
the variance of m. Each contribution has a source and a time: the sum over times is the forward error budget, the sum
over sources shows when the error originated.
"""

from typing import NamedTuple

from lvnav_trade.covariance.component_inputs import fill_inputs
from lvnav_trade.covariance.difference_errors import joint_back, renew_back
from lvnav_trade.covariance.receiver_error import clone_back, solution_back
from lvnav_trade.filter.policies.delay import place_of_channel
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

    place : (n_hist,). Index in `rows` of the history time; -1 if it is not in the sum.
    rows : (n_sum, n_metric, N). Weights of the joint states at each of these times.
    """

    place: Ints
    rows: Floats


@jit
def _dot(a, b):
    """Return the sum of products over the length of `a`; `b` may be longer."""
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@jit
def _update_back(back, tape, true, signals, row_of, time_bin, error_in_states, place):
    """Propagate the adjoint backwards through one update, and add the contribution of its noise.

    Parameters
    ----------
    back, tape, true, signals : BackwardPass, UpdateTape, Components, Signals
    row_of : number of the update on the tape
    time_bin : bin of the contribution
    error_in_states : whether the error of the measurement is in the joint states, as that of a receiver's solution
    place : place of the stored state that a delayed measurement was compared with
    """
    # the update e+ = (I - k h) e - k v gives lambda <- lambda - h' (k' lambda); v contributes (k' lambda)^2 Var(v)
    gain = tape.gain[row_of]
    h = tape.h[row_of]
    epoch = tape.epoch[row_of]
    channel = tape.channel[row_of]
    source = true.noise_source[channel]
    # the noise of a decorrelated solution entered with the receiver-error states
    is_in_states = error_in_states or source < 0
    variance = 0.0
    if not is_in_states:
        sigma = signals.sigma[epoch, measured_channel(signals, channel)]
        variance = sigma**2
    difference = true.differences.of[channel]
    for m in range(back.e.shape[0]):
        y = back.e[m]
        through = _dot(gain, y)
        if variance > 0.0:
            back.contribution[m, source, time_bin] += through * through * variance
        # correlated errors enter a measurement with its partial derivative, so lambda_c <- lambda_c - (k' lambda) dz/dc
        for family in range(n_entering(signals, error_in_states)):
            c, partial = component_partial(h, signals, true, family, epoch, channel, error_in_states)
            if c >= 0:
                back.c[m, true.first_shared + c] -= through * partial
        if difference >= 0:
            for c in range(true.first_shared):
                partial = true.differences.reach[difference, epoch, c]
                back.c[m, c] -= through * partial
        for k in range(true.n_entry[channel]):
            state = true.column[place, channel, k]
            entry = true.entry[place, channel, k]
            y[state] -= through * h[entry]


@jit
def _components_back(back, scratch, sums, true, units, seconds, window, time_bin):
    """Propagate the adjoint of the components backwards through a window, and add the contribution of their noise.

    Parameters
    ----------
    back : BackwardPass, updated in place
    scratch : BackwardScratch
    sums : (18,) integrals of the strapdown over the window
    true : Components
    units : ImuArray; None for one IMU
    seconds : s, length of the window
    window : index of its length, first tick, number of ticks
    time_bin : bin of the contribution
    """
    length, first, n_tick = window
    decay = true.decay[length]
    fill_inputs(scratch, true, units, sums, seconds, first, n_tick)
    for c in range(true.source.shape[0]):
        source = true.source[c]
        k = true.slot[c]
        g = true.group[source]
        lane = true.lane[source]
        first_pair = true.state_from[c]
        last_pair = true.state_from[c + 1]
        factor = true.factor[length, g, k, 0, lane]
        noise = true.noise[length, g, k, 0, lane]
        has_echo = true.echo[length, g, k, 0, lane] > 0.0
        drives_motion = first_pair == last_pair and true.moves[g, k]
        b = scratch.b[g, k, ..., lane]
        for m in range(back.e.shape[0]):
            y = back.e[m]
            through = back.c[m, c]  # effect on the metric of the noise that drives the component
            entered = 0.0  # effect of the component by the states that it enters over the window
            # the same noise drives the component and the error of the states that model it
            for p in range(first_pair, last_pair):
                state = true.states[p]
                through += y[state]
                entered += (factor - decay[state]) * y[state]
            if drives_motion:
                entered = _dot(b, y)
                if has_echo:
                    through -= entered
            back.contribution[m, source, time_bin] += through * through * noise
            back.c[m, c] = factor * back.c[m, c] + entered


@jit
def _white_back(back, true, length, time_bin):
    """Add the contribution of half of the white noise of a window by source; the other half enters at its other end."""
    for source in range(true.group.shape[0]):
        g = true.group[source]
        lane = true.lane[source]
        white = true.white[length, g, ..., lane]
        for i in range(back.e.shape[1]):
            variance = white[i]
            if variance > 0.0:
                for m in range(back.e.shape[0]):
                    through = back.e[m, i]
                    back.contribution[m, source, time_bin] += 0.5 * variance * through * through


@jit
def _start_back(back, true):
    """Add the contributions of initial errors, and of initial values of components with the states that model them."""
    n = back.e.shape[1]
    for m in range(back.e.shape[0]):
        y = back.e[m]
        for source in range(true.initial.shape[0]):  # lambda' P lambda
            for i in range(n):
                for k in range(n):
                    covariance = true.initial[source, i, k]
                    back.contribution[m, source, 0] += y[i] * covariance * y[k]
        for c in range(true.source.shape[0]):
            source = true.source[c]
            through = back.c[m, c]
            for p in range(true.state_from[c], true.state_from[c + 1]):
                state = true.states[p]
                through += y[state]
            back.contribution[m, source, 0] += through * through * true.start[c]


@jit
def _samples_back(back, scratch, sample_gain, true, vehicle, units, tick, time_bin):
    """Propagate the adjoint backwards through the update of a tick by IMU samples, and add contributions.

    Parameters
    ----------
    back : BackwardPass, updated in place
    scratch : BackwardScratch, with the partial derivatives of the tick
    sample_gain : (n_tick, 6, n) joint gains on the tape
    true, vehicle : Components, VehicleModel
    units : ImuArray; None for one IMU
    tick : index
    time_bin : bin of the contribution
    """
    h = scratch.h
    columns = vehicle.columns
    gain_adjoint = scratch.y
    fill_samples(h, vehicle.blocks, vehicle.rate[tick], vehicle.force[tick])
    n_axis = 1 if units is None else 3  # an axis of an array enters all combined axes
    for m in range(back.e.shape[0]):
        y = back.e[m]
        for r in range(N_SAMPLE):
            gain_adjoint[r] = _dot(sample_gain[tick, r], y)
        for source in range(true.group.shape[0]):
            for r in range(N_SAMPLE):
                through = gain_adjoint[r]
                variance = true.sample_noise[source, r]
                back.contribution[m, source, time_bin] += through * through * variance
        for j in range(true.sensor.shape[0]):
            if true.sampled[j] and true.profile[j] < 0:
                sensor = true.sensor[j]
                first = true.first[j]
                source = true.source[first]
                k = true.slot[first]
                g = true.group[source]
                lane = true.lane[source]
                for axis in range(3):
                    for i in range(n_axis):
                        r = 3 * sensor + (axis + i) % 3
                        partial = scratch.a[g, k + axis, r, lane]
                        back.c[m, first + axis] -= gain_adjoint[r] * partial
        for r in range(N_SAMPLE):
            for k in range(columns.shape[1]):
                state = columns[r, k]
                y[state] -= gain_adjoint[r] * h[r, k]


@jit
def _tick_back(back, scratch, flight, true, vehicle, units, tick):
    """Propagate the adjoint backwards over a tick, and set the partial derivatives of its samples.

    Parameters
    ----------
    back, scratch : BackwardPass, BackwardScratch; updated in place
    flight, true, vehicle : NominalFlight, Components, VehicleModel
    units : ImuArray; None for one IMU
    tick : index
    """
    dt = flight.unit.dt
    nominal_tick(scratch.sums, flight.reference, tick, dt)
    fill_partials(scratch.a, true, units, vehicle, tick, dt)
    for m in range(back.e.shape[0]):
        advance_vector_transposed(back.e[m], scratch.sums, dt, vehicle.motion)


@jit
def _ticks_back(back, scratch, tape, true, case, flight, vehicle, window):
    """Propagate the adjoint backwards through the ticks of a window with IMU samples.

    Parameters
    ----------
    back, scratch : BackwardPass, BackwardScratch; updated in place
    tape, true, case, flight : UpdateTape, Components, FilterCase, NominalFlight
    vehicle : VehicleModel, or None
    window : first tick, number of ticks, bin of time
    """
    if vehicle is not None:
        first, n_tick, time_bin = window
        units = case.options.units
        for tick in range(first + n_tick - 1, first - 1, -1):
            _tick_back(back, scratch, flight, true, vehicle, units, tick)
            _samples_back(back, scratch, tape.sample_gain, true, vehicle, units, tick, time_bin)


@jit
def _window_back(back, scratch, tape, true, case, w, time_bin):
    """Propagate the adjoint backwards over a window, and add the contributions of process noise and components.

    Parameters
    ----------
    back, scratch : BackwardPass, BackwardScratch; updated in place
    tape, true, case : UpdateTape, Components, FilterCase
    w : index of the window
    time_bin : bin of the contribution
    """
    schedule = case.schedule
    model = case.model
    units = case.options.units
    length = schedule.length[w]
    first = schedule.first_tick[w]
    n_tick = schedule.n_tick[w]
    seconds = model.seconds[length]
    sums = tape.sums[w]
    position = tape.position[w]
    D = scratch.D
    transition.fill(D, true.nav_kinds, true.nav_drivers, sums, position[0], position[1], position[2], seconds)
    _white_back(back, true, length, time_bin)
    window = length, first, n_tick
    _components_back(back, scratch, sums, true, units, seconds, window, time_bin)
    rows = true.nav_rows
    columns = true.nav_columns
    decay = true.decay[length]
    for m in range(back.e.shape[0]):
        apply_phi_transposed(back.e[m], D, rows, columns, decay, model.clock, seconds)
    _white_back(back, true, length, time_bin)


@jit
def _solution_back(back, y, chain, true, epoch, time_bin):
    """Propagate the adjoint backwards through an epoch of the receiver-error states (SolutionErrorModel, or None)."""
    if chain is not None:
        solution_back(back, y, chain, true, epoch, time_bin)


@jit
def _add_metrics(back, entering, hist):
    """Add the weights of the metrics at a history time to the adjoint; return whether there are weights at that time.

    Parameters
    ----------
    back : BackwardPass, updated in place
    entering : BackwardMetrics
    hist : history time, -1 none
    """
    if hist < 0:
        return False
    place = entering.place[hist]
    if place < 0:
        return False
    for m in range(back.e.shape[0]):
        for i in range(back.e.shape[1]):
            back.e[m, i] += entering.rows[place, m, i]
    return True


@jit
def go_back(back, scratch, tape, true, case, flight, entering, time_bins):
    """Propagate the adjoint from the end of the flight back to its start.

    Parameters
    ----------
    back : BackwardPass, of zeros; set here
    scratch : BackwardScratch
    tape : UpdateTape of the forward pass
    true, case, flight : Components, FilterCase, NominalFlight
    entering : BackwardMetrics, the metrics
    time_bins : (n_window,) time bin of each window
    """
    schedule = case.schedule
    signals = case.signals
    options = case.options
    model = case.model
    successive = true.successive
    has_entered = False
    # each window in the reverse order of `forward.forward`: history, clones, updates, receiver errors, propagation
    for w in range(schedule.n_tick.shape[0] - 1, -1, -1):
        time_bin = time_bins[w]
        epoch = schedule.epoch[w]
        first = schedule.first_tick[w]
        n_tick = schedule.n_tick[w]
        if _add_metrics(back, entering, schedule.hist[w]):
            has_entered = True
        if not has_entered:
            continue
        if epoch >= 0:
            joint_back(back, true, options.late, options.delayed, epoch)
        for row in range(tape.first[w + 1] - 1, tape.first[w] - 1, -1):
            channel = tape.channel[row]
            place = place_of_channel(options.late, channel, tape.epoch[row])
            error_in_states = model.has_covariance and channel < signals.n_receiver
            _update_back(back, tape, true, signals, row, time_bin, error_in_states, place)
        if epoch >= 0:
            _solution_back(back, scratch.y, flight.chain, true, epoch, time_bin)
            renew_back(back, successive, model, epoch, time_bin)
            _solution_back(back, scratch.y, successive, true, epoch, time_bin)
        if n_tick > 0:
            clone_back(back, true, options.late, w)
            _window_back(back, scratch, tape, true, case, w, time_bin)
            window = first, n_tick, time_bin
            _ticks_back(back, scratch, tape, true, case, flight, options.vehicle, window)
    _start_back(back, true)
