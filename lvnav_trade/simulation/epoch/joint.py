"""Measurement updates of the joint covariance: every error source and the mean, with the gain of the filter.

The joint vector is [e, s, k]: estimation error e, error s of the receiver's solution, and clones k of the navigation
error for delayed measurements. The true covariance is a sum over error sources, one lane of a group each.
"""

from typing import Any, NamedTuple

from lvnav_trade.filter.policies.delay import channel_ring_index
from lvnav_trade.filter.updates import has_reported_covariance
from lvnav_trade.kernels.covariance import enter, update_covariance, update_vector
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import group, group_view, lane_total
from lvnav_trade.kernels.transition import POS, VEL
from lvnav_trade.sensors.jacobian_row import N_ENTRY

N_NAV, N_CLONE = 9, 12
"""States of a clone: the navigation error (9), and an earlier velocity error (3) for extrapolation."""


class Joint(NamedTuple):
    """Joint covariance in a pass over the nominal flight, with its work arrays and results.

    state : covariance.workspace.JointCovariance. True covariance by source, and mean; updated.
    scratch : covariance.workspace.Scratch. Work arrays.
    tape : covariance.workspace.UpdateTape. Record for the backward pass.
    results : covariance.workspace.PassResults. Results.
    components : covariance.components.Components. True error components.
    """

    state: Any
    scratch: Any
    tape: Any
    results: Any
    components: Any


class NominalFlight(NamedTuple):
    """Nominal flight of a pass: inputs that the epochs of the filter do not need.

    unit : ImuTruth. Truth-side model of the IMU.
    reference : Reference. True motion on the ticks of the IMU.
    chain : SolutionErrorModel. Error propagation of the receiver's solution; None without a reported covariance.
    ticks : covariance.workspace.SampleScratch. Work arrays of IMU samples as measurements; None without.
    """

    unit: Any
    reference: Any
    chain: Any
    ticks: Any


@jit
def _record(tape, gain, h, epoch, channel):
    """Record an update on the tape, if a backward pass is requested."""
    if tape.channel.shape[0] > 0:
        k = tape.n_recorded[0]
        for i in range(gain.shape[0]):
            tape.gain[k, i] = gain[i]
        for i in range(h.shape[0]):
            tape.h[k, i] = h[i]
        tape.epoch[k] = epoch
        tape.channel[k] = channel
        tape.n_recorded[0] = k + 1


@jit
def _enter_component(state, scratch, components, c, a):
    """Add the effect of an error component c on an update, after the update of the states.

    The innovation depends on the component with the partial derivative a, so x changes by -k a c, k the gain.

    Parameters
    ----------
    state, scratch, components : JointCovariance, Scratch, Components; the first two are updated in place
    c : index of the component
    a : partial derivative of the innovation

    Returns
    -------
    float
        Contribution to the innovation variance, 2 a Cov(h x, c) + a^2 Var(c).
    """
    source = components.source[c]
    slot = components.slot[c]
    g = components.group[source]
    lane = components.lane[source]
    gain = scratch.gain
    state_effect = scratch.state_effect
    variance = state.variance[g, slot, 0, lane]
    for i in range(gain.shape[0]):
        state_effect[i] = -a * gain[i]
    P = state.sources[g, ..., lane]
    cross = state.cross[g, slot, ..., lane]
    enter(P, cross, variance, state_effect, 0)
    covariance = scratch.measurement_covariance[g, slot, 0, lane]  # Cov(h x, c)
    return 2.0 * a * covariance + a * a * variance


@jit
def component_partial(h, signals, components, family, epoch, channel, error_in_states):
    """Return the component of an error family that enters a channel, and its partial derivative.

    The derivative is that of the innovation beyond the dependence on filter states: the true derivative minus that of
    the state which models the error.

    Parameters
    ----------
    h : Jacobian row of the measurement
    signals, components : Signals, Components
    family : error family. For a decorrelated solution the number of the component: the error itself is part of the
        error of the solution, so only the correction by the estimated state enters
    epoch, channel : indices
    error_in_states : whether the error of the measurement is in the joint states, as that of a receiver's solution

    Returns
    -------
    int, float
        Component, -1 none, and partial derivative, SI.
    """
    correlated_errors = signals.correlated_errors
    if components.noise_source[channel] < 0 and not error_in_states:  # a difference: its errors are states
        return -1, 0.0
    if error_in_states:
        extra = correlated_errors.extra[family]
        if extra < 0:
            return -1, 0.0
        return family, -h[N_ENTRY + extra]
    true_channel = measured_channel(signals, channel)
    block = components.modelling_block[family]
    modelled_partial = signals.partial[block, epoch, channel] if block >= 0 else 0.0
    component = correlated_errors.member[family, true_channel]
    partial = correlated_errors.partial[family, epoch, true_channel]
    return component, partial - modelled_partial


@jit
def n_entering(signals, error_in_states):
    """Return the number of error families that may enter a measurement; of components for a decorrelated solution."""
    return signals.correlated_errors.extra.shape[0] if error_in_states else signals.correlated_errors.member.shape[0]


@jit
def measured_channel(signals, channel):
    """Return the index of a filter channel among the measured channels: sensor channels are shifted."""
    return channel + signals.shift if channel >= signals.n_receiver else channel


@jit
def _update_correlated_errors(state, scratch, h, signals, components, epoch, channel, error_in_states):
    """Add the correlated measurement errors that enter an update; return their part of the innovation variance."""
    total = 0.0
    for family in range(n_entering(signals, error_in_states)):
        m, a = component_partial(h, signals, components, family, epoch, channel, error_in_states)
        if m >= 0 and a != 0.0:
            component = components.first_correlated + m
            total += _enter_component(state, scratch, components, component, a)
    return total


@jit
def _update_imus(state, scratch, components, epoch, channel):
    """Add the IMU errors that enter a measured difference of two IMUs; return their part of the innovation variance."""
    total = 0.0
    row = components.imu_differences.row_index[channel]
    if row >= 0:
        for c in range(components.first_correlated):
            a = components.imu_differences.jacobian[row, epoch, c]
            if a != 0.0:
                total += _enter_component(state, scratch, components, c, a)
    return total


@jit
def _update_sources(state, scratch, components, h, entries, columns, source, noise):
    """Update the covariance of every source, and the cross covariances with its components, by `scratch.gain`.

    Parameters
    ----------
    state, scratch, components : JointCovariance, Scratch, Components; the first two are updated in place
    h : Jacobian row
    entries, columns : (n_entry,) entries of the row that are not zero, and their states
    source, noise : source of the white measurement noise, and its variance

    Returns
    -------
    float
        True innovation variance by the states and the white noise.
    """
    total = noise
    gain = scratch.gain
    noise_group = components.group[source]
    noise_lane = components.lane[source]
    if noise > 0.0:
        scratch.noise[noise_group, 0, 0, noise_lane] = noise
    for g in range(components.n_slot.shape[0]):
        P = group(state.sources, g)
        innovation_variance = group_view(scratch.innovation_variance)
        noise_by_source = group(scratch.noise, g)[0, 0]
        innovation_variance[0] = update_covariance(P, group_view(scratch.y), gain, h, entries, columns, noise_by_source)
        total += lane_total(scratch.innovation_variance)
        cross = group(state.cross, g)
        measurement_covariance = group(scratch.measurement_covariance, g)
        for k in range(components.n_slot[g]):
            if components.has_cross[g, k]:
                measurement_covariance[k, 0] = update_vector(cross[k], gain, h, entries, columns)
    if noise > 0.0:
        scratch.noise[noise_group, 0, 0, noise_lane] = 0.0
    return total


@jit
def _update_truth(joint, h, innovation, signals, place, epoch, channel, error_in_states):
    """Update every source and the mean with `scratch.gain`; return the expected square of the innovation.

    Parameters
    ----------
    joint : Joint
    h : Jacobian row
    innovation : innovation of the nominal flight, the same in every run
    signals : Signals
    place : place of the stored state that a delayed measurement is compared with
    epoch, channel : indices
    error_in_states : whether the error of the measurement is in the joint states, as that of a receiver's solution
    """
    state = joint.state
    scratch = joint.scratch
    components = joint.components
    gain = scratch.gain
    n_entry = components.n_entry[channel]
    entries = components.entry[place, channel, :n_entry]
    columns = components.column[place, channel, :n_entry]
    _record(joint.tape, gain, h, epoch, channel)
    source = components.noise_source[channel]
    is_in_states = error_in_states or source < 0
    noise = 0.0 if is_in_states else signals.sigma[epoch, measured_channel(signals, channel)] ** 2
    total = _update_sources(state, scratch, components, h, entries, columns, source, noise)
    total += _update_correlated_errors(state, scratch, h, signals, components, epoch, channel, error_in_states)
    total += _update_imus(state, scratch, components, epoch, channel)
    # mean error after the update: (I - k h) m - k z, z the deterministic innovation; h m + z is the mean innovation
    mean = state.mean
    offset = update_vector(mean, gain, h, entries, columns) + innovation
    for i in range(gain.shape[0]):
        mean[i] -= gain[i] * innovation
    return total + offset * offset


@jit
def _correct_clones(gain, clone, delays):
    """Extend the gain to the clones of stored states, which the filter corrects as well (DelayProcessing, or None)."""
    if delays is not None:
        for place in range(delays.is_buffered.shape[0]):
            if delays.is_buffered[place]:
                first = clone + N_CLONE * place
                for i in range(N_NAV):
                    gain[first + i] = gain[i]


@jit
def _set_gain(gain, work, weight, gains, n_estimated, epoch, channel):
    """Set the gain on the joint states: StoredGains, or `work.K` (P h') times weight on estimated states."""
    for i in range(gain.shape[0]):
        gain[i] = 0.0
    for i in range(n_estimated):
        gain[i] = work.K[i] * weight if gains is None else gains.gain[epoch, channel, i]


@jit
def follow_update(joint, work, case, weight, epoch, row, channel):
    """Update every source and the mean with the gain by which the filter has processed a scalar measurement.

    `work.z` is the innovation of the nominal flight: errors that are the same in every run and not in the filter model,
    such as an uncompensated latency. Their effect is in the mean, so the error state is reset to zero.

    Parameters
    ----------
    joint : Joint, or None in a run
    work, case : Nominal, FilterCase
    weight : 1 / innovation variance of the filter; 0 if the measurement is rejected
    epoch, row, channel : indices; counts and expected squares are added to the results of the epoch
    """
    if joint is not None and weight > 0.0:
        model = case.model
        delays = case.options.delay_processing
        gain = joint.scratch.gain
        results = joint.results
        _set_gain(gain, work, weight, case.options.gains, model.n_estimated, epoch, channel)
        _correct_clones(gain, joint.components.clone, delays)
        error_in_states = has_reported_covariance(model, channel)
        place = channel_ring_index(delays, channel, epoch)
        h = work.H[row]
        innovation = work.z[row]
        square = _update_truth(joint, h, innovation, case.signals, place, epoch, channel, error_in_states)
        _clear(work.x)
        square = square * weight  # expected square of the normalised innovation
        results.expected_nis[epoch] += square
        results.expected_row_nis[epoch, row] = max(results.expected_row_nis[epoch, row], square)
        results.n_row[epoch] += 1


@jit
def _clear(x):
    """Set a vector to zero."""
    for i in range(x.shape[0]):
        x[i] = 0.0


@jit
def follow_clock(joint, work, case, weight, epoch, row, observable):
    """Update every source and the mean as the filter does when a reference satellite determines the clock.

    Parameters
    ----------
    joint, work, case, weight, epoch, row : as in `follow_update`
    observable : index of the observable of the satellite
    """
    if joint is not None and weight > 0.0:
        model = case.model
        signals = case.signals
        gain = joint.scratch.gain
        for i in range(gain.shape[0]):
            gain[i] = model.clock_gain[observable, i] if i < model.n_state else 0.0
        satellite = signals.satellite_by_slot[epoch, row // model.n_observable]
        channel = model.n_observable * satellite + observable
        place = channel_ring_index(case.options.delay_processing, channel, epoch)
        h = work.H[row]
        innovation = work.z[row]
        _update_truth(joint, h, innovation, signals, place, epoch, channel, False)
        _clear(work.x)


@jit
def start_joint(joint, work, case, mode_state, rules, epoch):
    """Start the filter in the joint covariance.

    A filter that starts from the receiver's sample takes over its error: an update with gain 1 of position and velocity
    in every source and in the mean. The error state stays zero.

    Parameters
    ----------
    joint : Joint, or None
    work, case : Nominal, FilterCase
    mode_state, rules : state and rules of the mode logic
    epoch : index
    """
    if joint is not None:
        _clear(work.x)
        if rules.from_gnss and mode_state.sample[1] > 0.0:
            gain = joint.scratch.gain
            error_in_states = case.model.has_reported_covariance
            for row in range(6):
                state = POS + row if row < 3 else VEL + row - 3
                for i in range(gain.shape[0]):
                    gain[i] = 1.0 if i == state else 0.0
                _correct_clones(gain, joint.components.clone, case.options.delay_processing)
                place = channel_ring_index(case.options.delay_processing, row, epoch)
                h = work.H[row]
                innovation = work.z[row]
                _update_truth(joint, h, innovation, case.signals, place, epoch, row, error_in_states)


@jit
def innovation_of(joint, work, delays, epoch, row, channel):
    """Return the innovation of a scalar measurement for tests, before its prediction by the error state is subtracted.

    In a run it is `work.z`. In the joint covariance it is the mean, the innovation of a run without noise.

    Parameters
    ----------
    joint : Joint; None in a run
    work : Work or Nominal
    delays : DelayProcessing, or None
    epoch, row, channel : indices
    """
    if joint is None:
        return work.z[row]
    place = channel_ring_index(delays, channel, epoch)
    mean_innovation = _mean_innovation(joint, work.H[row], place, channel)
    return work.z[row] + mean_innovation


@jit
def _mean_innovation(joint, h, place, channel):
    """Return the mean of an innovation by the mean of the joint states, h m."""
    components = joint.components
    mean = joint.state.mean
    total = 0.0
    for k in range(components.n_entry[channel]):
        total += h[components.entry[place, channel, k]] * mean[components.column[place, channel, k]]
    return total
