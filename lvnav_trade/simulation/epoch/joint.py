"""Measurement updates of the joint covariance: every error source and the mean, with the gain of the filter.

The joint vector is [e, s, k]: estimation error e, error s of the receiver's solution, and clones k of the navigation
error for delayed measurements. The true covariance is a sum over error sources, one lane of a group each.
"""

from typing import Any, NamedTuple

from lvnav_trade.filter.policies.delay import place_of_channel
from lvnav_trade.filter.updates import has_reported_covariance
from lvnav_trade.kernels.covariance import enter, update_covariance, update_vector
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import group, total_of, whole
from lvnav_trade.kernels.transition import POS, VEL
from lvnav_trade.sensors.jacobian_row import N_ENTRY

N_NAV, N_CLONE = 9, 12
"""States of a clone: the navigation error (9), and an earlier velocity error (3) for extrapolation."""


class Joint(NamedTuple):
    """Joint covariance in a pass over the nominal flight, with its work arrays and results.

    state : covariance.workspace.JointCovariance. True covariance by source, and mean; updated.
    scratch : covariance.workspace.Scratch. Work arrays.
    tape : covariance.workspace.UpdateTape. Record for the backward pass.
    out : covariance.workspace.PassResults. Results.
    true : covariance.components.Components. True error components.
    """

    state: Any
    scratch: Any
    tape: Any
    out: Any
    true: Any


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
        k = tape.used[0]
        for i in range(gain.shape[0]):
            tape.gain[k, i] = gain[i]
        for i in range(h.shape[0]):
            tape.h[k, i] = h[i]
        tape.epoch[k] = epoch
        tape.channel[k] = channel
        tape.used[0] = k + 1


@jit
def _enter_component(state, scratch, true, c, a):
    """Add the effect of an error component c on an update, after the update of the states.

    The innovation depends on the component with the partial derivative a, so x changes by -k a c, k the gain.

    Parameters
    ----------
    state, scratch, true : JointCovariance, Scratch, Components; the first two are updated in place
    c : index of the component
    a : partial derivative of the innovation

    Returns
    -------
    float
        Contribution to the innovation variance, 2 a Cov(h x, c) + a^2 Var(c).
    """
    source = true.source[c]
    slot = true.slot[c]
    g = true.group[source]
    lane = true.lane[source]
    gain = scratch.gain
    shift = scratch.shift
    variance = state.variance[g, slot, 0, lane]
    for i in range(gain.shape[0]):
        shift[i] = -a * gain[i]
    P = state.sources[g, ..., lane]
    cross = state.cross[g, slot, ..., lane]
    enter(P, cross, variance, shift, 0)
    covariance = scratch.seen[g, slot, 0, lane]  # Cov(h x, c)
    return 2.0 * a * covariance + a * a * variance


@jit
def component_partial(h, signals, true, family, epoch, channel, error_in_states):
    """Return the component of an error family that enters a channel, and its partial derivative.

    The derivative is that of the innovation beyond the dependence on filter states: the true derivative minus that of
    the state which models the error.

    Parameters
    ----------
    h : Jacobian row of the measurement
    signals, true : Signals, Components
    family : error family. For a decorrelated solution the number of the component: the error itself is part of the
        error of the solution, so only the correction by the estimated state enters
    epoch, channel : indices
    error_in_states : whether the error of the measurement is in the joint states, as that of a receiver's solution

    Returns
    -------
    int, float
        Component, -1 none, and partial derivative, SI.
    """
    shared = signals.shared
    if true.noise_source[channel] < 0 and not error_in_states:  # a difference: its errors are states
        return -1, 0.0
    if error_in_states:
        extra = shared.extra[family]
        if extra < 0:
            return -1, 0.0
        return family, -h[N_ENTRY + extra]
    measured = measured_channel(signals, channel)
    block = true.shared_family[family]
    modelled = signals.partial[block, epoch, channel] if block >= 0 else 0.0
    component = shared.member[family, measured]
    partial = shared.partial[family, epoch, measured]
    return component, partial - modelled


@jit
def n_entering(signals, error_in_states):
    """Return the number of error families that may enter a measurement; of components for a decorrelated solution."""
    return signals.shared.extra.shape[0] if error_in_states else signals.shared.member.shape[0]


@jit
def measured_channel(signals, channel):
    """Return the index of a filter channel among the measured channels: sensor channels are shifted."""
    return channel + signals.shift if channel >= signals.n_receiver else channel


@jit
def _update_shared(state, scratch, h, signals, true, epoch, channel, error_in_states):
    """Add the correlated measurement errors that enter an update; return their part of the innovation variance."""
    total = 0.0
    for family in range(n_entering(signals, error_in_states)):
        m, a = component_partial(h, signals, true, family, epoch, channel, error_in_states)
        if m >= 0 and a != 0.0:
            component = true.first_shared + m
            total += _enter_component(state, scratch, true, component, a)
    return total


@jit
def _update_imus(state, scratch, true, epoch, channel):
    """Add the IMU errors that enter a measured difference of two IMUs; return their part of the innovation variance."""
    total = 0.0
    row = true.differences.of[channel]
    if row >= 0:
        for c in range(true.first_shared):
            a = true.differences.reach[row, epoch, c]
            if a != 0.0:
                total += _enter_component(state, scratch, true, c, a)
    return total


@jit
def _update_sources(state, scratch, true, h, entries, columns, source, noise):
    """Update the covariance of every source, and the cross covariances with its components, by `scratch.gain`.

    Parameters
    ----------
    state, scratch, true : JointCovariance, Scratch, Components; the first two are updated in place
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
    noise_group = true.group[source]
    noise_lane = true.lane[source]
    if noise > 0.0:
        scratch.noise[noise_group, 0, 0, noise_lane] = noise
    for g in range(true.n_slot.shape[0]):
        P = group(state.sources, g)
        spread = whole(scratch.spread)
        noise_by_source = group(scratch.noise, g)[0, 0]
        spread[0] = update_covariance(P, whole(scratch.y), gain, h, entries, columns, noise_by_source)
        total += total_of(scratch.spread)
        cross = group(state.cross, g)
        predicted = group(scratch.seen, g)
        for k in range(true.n_slot[g]):
            if true.has_cross[g, k]:
                predicted[k, 0] = update_vector(cross[k], gain, h, entries, columns)
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
    true = joint.true
    gain = scratch.gain
    n_entry = true.n_entry[channel]
    entries = true.entry[place, channel, :n_entry]
    columns = true.column[place, channel, :n_entry]
    _record(joint.tape, gain, h, epoch, channel)
    source = true.noise_source[channel]
    is_in_states = error_in_states or source < 0
    noise = 0.0 if is_in_states else signals.sigma[epoch, measured_channel(signals, channel)] ** 2
    total = _update_sources(state, scratch, true, h, entries, columns, source, noise)
    total += _update_shared(state, scratch, h, signals, true, epoch, channel, error_in_states)
    total += _update_imus(state, scratch, true, epoch, channel)
    # mean error after the update: (I - k h) m - k z, z the deterministic innovation; h m + z is the mean innovation
    mean = state.mean
    offset = update_vector(mean, gain, h, entries, columns) + innovation
    for i in range(gain.shape[0]):
        mean[i] -= gain[i] * innovation
    return total + offset * offset


@jit
def _correct_clones(gain, clone, late):
    """Extend the gain to the clones of stored states, which the filter corrects as well (DelayProcessing, or None)."""
    if late is not None:
        for place in range(late.buffered.shape[0]):
            if late.buffered[place]:
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
        late = case.options.late
        gain = joint.scratch.gain
        out = joint.out
        _set_gain(gain, work, weight, case.options.gains, model.n_estimated, epoch, channel)
        _correct_clones(gain, joint.true.clone, late)
        error_in_states = has_reported_covariance(model, channel)
        place = place_of_channel(late, channel, epoch)
        h = work.H[row]
        innovation = work.z[row]
        square = _update_truth(joint, h, innovation, case.signals, place, epoch, channel, error_in_states)
        _clear(work.x)
        square = square * weight  # expected square of the normalised innovation
        out.expected_nis[epoch] += square
        out.row_ratio[epoch, row] = max(out.row_ratio[epoch, row], square)
        out.n_row[epoch] += 1


@jit
def _clear(x):
    """Set a vector to zero."""
    for i in range(x.shape[0]):
        x[i] = 0.0


@jit
def follow_clock(joint, work, case, weight, epoch, row, kind):
    """Update every source and the mean as the filter does when a reference satellite determines the clock.

    Parameters
    ----------
    joint, work, case, weight, epoch, row : as in `follow_update`
    kind : index of the observable of the satellite
    """
    if joint is not None and weight > 0.0:
        model = case.model
        signals = case.signals
        gain = joint.scratch.gain
        for i in range(gain.shape[0]):
            gain[i] = model.clock_gain[kind, i] if i < model.n_state else 0.0
        satellite = signals.used[epoch, row // model.n_kind]
        channel = model.n_kind * satellite + kind
        place = place_of_channel(case.options.late, channel, epoch)
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
            error_in_states = case.model.has_covariance
            for row in range(6):
                state = POS + row if row < 3 else VEL + row - 3
                for i in range(gain.shape[0]):
                    gain[i] = 1.0 if i == state else 0.0
                _correct_clones(gain, joint.true.clone, case.options.late)
                place = place_of_channel(case.options.late, row, epoch)
                h = work.H[row]
                innovation = work.z[row]
                _update_truth(joint, h, innovation, case.signals, place, epoch, row, error_in_states)


@jit
def innovation_of(joint, work, late, epoch, row, channel):
    """Return the innovation of a scalar measurement for tests, before its prediction by the error state is subtracted.

    In a run it is `work.z`. In the joint covariance it is the mean, the innovation of a run without noise.

    Parameters
    ----------
    joint : Joint; None in a run
    work : Work or Nominal
    late : DelayProcessing, or None
    epoch, row, channel : indices
    """
    if joint is None:
        return work.z[row]
    place = place_of_channel(late, channel, epoch)
    mean_innovation = _mean_innovation(joint, work.H[row], place, channel)
    return work.z[row] + mean_innovation


@jit
def _mean_innovation(joint, h, place, channel):
    """Return the mean of an innovation by the mean of the joint states, h m."""
    true = joint.true
    mean = joint.state.mean
    total = 0.0
    for k in range(true.n_entry[channel]):
        total += h[true.entry[place, channel, k]] * mean[true.column[place, channel, k]]
    return total
