"""Measurement updates of the joint covariance: the filter's gain, and with it every source and the mean."""

import numpy as np

from lvnav_trade.engines.lincov.receiver_error import N_CLONE, N_NAV
from lvnav_trade.filters.integrity.state import permitted
from lvnav_trade.filters.late import place_of_channel
from lvnav_trade.kernels.covariance import enter, update_covariance, update_scalar, update_vector, update_with_gain
from lvnav_trade.kernels.groups import group, total_of, whole
from lvnav_trade.kernels.jit import jit
from lvnav_trade.observables.base import N_ENTRY


@jit
def _record(tape, gain, h, epoch, channel):
    at = tape.used[0]
    for i in range(gain.shape[0]):
        tape.gain[at, i] = gain[i]
    for i in range(h.shape[0]):
        tape.h[at, i] = h[i]
    tape.epoch[at], tape.channel[at] = epoch, channel
    tape.used[0] = at + 1


@jit
def _enter(joint, scratch, gain, true, c, a):
    """Let a component enter an update by the partial a, after the update of the states; return what it adds to the
    innovation's variance.
    """
    source, k, b = true.source[c], true.slot[c], scratch.shift
    g, lane = true.group[source], true.lane[source]
    variance = joint.variance[g, k, 0, lane]
    for i in range(gain.shape[0]):
        b[i] = -a * gain[i]
    enter(joint.sources[g, ..., lane], joint.cross[g, k, ..., lane], variance, b, 0)
    return 2.0 * a * scratch.seen[g, k, 0, lane] + a * a * variance


@jit
def component_partial(h, signals, true, family, epoch, channel, whitened):
    """Return the component of a family in a channel (-1 none), and the partial of the innovation with respect to it.

    whitened: a measurement of a decorrelated solution, where `family` is the component: the error itself is in that
    of the solution, what the filter's estimate of it takes off is not. Else it is beyond what a state of the filter
    has.
    """
    shared = signals.shared
    if true.noise_source[channel] < 0 and not whitened:  # a difference: its errors are states
        return -1, 0.0
    if whitened:
        extra = shared.extra[family]
        return (family if extra >= 0 else -1), (-h[N_ENTRY + extra] if extra >= 0 else 0.0)
    measured, own = measured_channel(signals, channel), true.shared_family[family]
    known = signals.partial[own, epoch, channel] if own >= 0 else 0.0
    return shared.member[family, measured], shared.partial[family, epoch, measured] - known


@jit
def n_entering(signals, whitened):
    """Return how many families, or of a decorrelated solution components, may enter a measurement."""
    return signals.shared.extra.shape[0] if whitened else signals.shared.member.shape[0]


@jit
def measured_channel(signals, channel):
    """Return where a channel of the filter stands among those that are measured; of a solution it is none of them."""
    return channel + signals.shift if channel >= signals.n_receiver else channel


@jit
def _update_shared(joint, scratch, gain, h, signals, true, epoch, channel, whitened):
    """Let the errors that measurements share enter an update; return what they add to the innovation's variance."""
    total = 0.0
    for family in range(n_entering(signals, whitened)):
        m, a = component_partial(h, signals, true, family, epoch, channel, whitened)
        if m >= 0 and a != 0.0:
            total += _enter(joint, scratch, gain, true, true.first_shared + m, a)
    return total


@jit
def _update_units(joint, scratch, gain, true, epoch, channel):
    """Let errors of inertial units enter an update by what two units differ by; return what they add to the
    innovation's variance.
    """
    total, row = 0.0, true.differences.of[channel]
    if row >= 0:
        for c in range(true.first_shared):
            a = true.differences.reach[row, epoch, c]
            if a != 0.0:
                total += _enter(joint, scratch, gain, true, c, a)
    return total


@jit
def _set_gain(gain, K, weight, n_estimated, true, late, epoch):
    """Set the gain on the joint vector: what the filter corrects it also takes off the stored states that measurements
    on their way will be compared with.
    """
    for i in range(gain.shape[0]):
        gain[i] = K[i] * weight if i < n_estimated else 0.0
    if late is not None:
        for place in range(late.buffered.shape[0]):
            if late.buffered[place]:
                for i in range(N_NAV):
                    gain[true.clone + N_CLONE * place + i] = gain[i]


@jit
def _update_formal(joint, scratch, gains, h, entries, columns, epoch, channel, variance, beta, model):
    """Update the filter's own covariance; return the weight. The gain, `scratch.K` times weight, is its own, or stored
    (Gains).
    """
    if gains is None:
        _, weight = update_scalar(
            joint.formal, scratch.x, scratch.K, h, entries, columns, 0.0, variance, np.inf, model.n_estimated,
            model.joseph, beta,
        )  # fmt: skip
        return weight
    gain = gains.gain[epoch, channel]
    _, weight = update_with_gain(
        joint.formal, scratch.x, scratch.K, h, entries, columns, gain, 0.0, variance, np.inf, model.n_estimated, beta
    )
    for i in range(model.n_estimated):
        scratch.K[i] = gain[i] / weight
    return weight


@jit
def _update_sources(joint, scratch, true, gain, h, entries, columns, source, noise):
    """Update every source's covariance and those with the components; return the innovation's true variance."""
    total = noise
    if noise > 0.0:
        scratch.noise[true.group[source], 0, 0, true.lane[source]] = noise
    for g in range(true.n_slot.shape[0]):
        P, spread = group(joint.sources, g), whole(scratch.spread)
        spread[0] = update_covariance(P, whole(scratch.y), gain, h, entries, columns, group(scratch.noise, g)[0, 0])
        total += total_of(scratch.spread)
        cross, seen = group(joint.cross, g), group(scratch.seen, g)
        for k in range(true.n_slot[g]):
            if true.followed[g, k]:
                seen[k, 0] = update_vector(cross[k], gain, h, entries, columns)
    if noise > 0.0:
        scratch.noise[true.group[source], 0, 0, true.lane[source]] = 0.0
    return total


@jit
def _update_truth(joint, scratch, tape, late, h, innovation, epoch, channel, whitened, signals, true):
    """Update every source and the mean with the gain `scratch.gain`; return the expected square of the innovation."""
    gain, m, place = scratch.gain, true.n_entry[channel], 0
    if late is not None:
        place = place_of_channel(late, channel, epoch)
    entries, columns = true.entry[place, channel, :m], true.column[place, channel, :m]
    if tape.channel.shape[0] > 0:
        _record(tape, gain, h, epoch, channel)
    is_in_states = whitened or true.noise_source[channel] < 0
    noise = 0.0 if is_in_states else signals.sigma[epoch, measured_channel(signals, channel)] ** 2
    total = _update_sources(joint, scratch, true, gain, h, entries, columns, true.noise_source[channel], noise)
    total += _update_shared(joint, scratch, gain, h, signals, true, epoch, channel, whitened)
    total += _update_units(joint, scratch, gain, true, epoch, channel)
    offset = update_vector(joint.mean, gain, h, entries, columns) + innovation
    for i in range(gain.shape[0]):
        joint.mean[i] -= gain[i] * innovation
    return total + offset * offset


@jit
def replace_state(joint, scratch, tape, late, at, h, innovation, epoch, channel, whitened, signals, true):
    """Replace the error of one state by that of a measurement of it: an update with the gain one, in every source and
    in the mean. The filter's own covariance is set elsewhere.
    """
    for i in range(scratch.gain.shape[0]):
        scratch.gain[i] = 1.0 if i == at else 0.0
    _update_truth(joint, scratch, tape, late, h, innovation, epoch, channel, whitened, signals, true)


@jit
def update_joint(
    joint, scratch, tape, late, gains, h, innovation, epoch, channel, variance, whitened, signals, true, model
):
    """Update the filter's covariance by one scalar measurement, and with that gain every source and the mean.

    innovation: that of the nominal flight, what the truth's measurement holds in every run and the filter's model
    of it does not (an uncompensated latency). variance: that the filter assumes of its noise. whitened: one of a
    decorrelated solution, whose errors are states already. Returns the expected square of the normalised innovation.
    """
    n = model.n_entry[channel]
    weight = _update_formal(
        joint, scratch, gains, h, model.entry[channel, :n], model.column[channel, :n], epoch, channel, variance,
        signals.beta[epoch, channel], model,
    )  # fmt: skip
    _set_gain(scratch.gain, scratch.K, weight, model.n_estimated, true, late, epoch)
    return _update_truth(joint, scratch, tape, late, h, innovation, epoch, channel, whitened, signals, true) * weight


@jit
def is_left_out(starts, delayed, model, row):
    """Return whether a row is a difference with the epoch before the filter starts."""
    return delayed is not None and starts and delayed.difference[row % model.n_kind]


@jit
def take_reference(joint, scratch, tape, nominal, signals, true, model, late, delayed, monitor, epoch, n_row, starts):
    """Make the clock what the reference satellite says, as the filter does, unless that is excluded (Monitor)."""
    for k in range(signals.reference.shape[1]):
        if n_row > 0 and signals.reference[epoch, k] >= 0:
            slot = signals.reference[epoch, k]
            row, channel = model.n_kind * slot + k, model.n_kind * signals.used[epoch, slot] + k
            excluded = permitted(monitor, channel, 1.0) <= 0.0
            if model.measured[channel] and not excluded and not is_left_out(starts, delayed, model, row):
                n, h = model.n_entry[channel], nominal.H[row]
                update_with_gain(
                    joint.formal, scratch.x, scratch.K, h, model.entry[channel, :n], model.column[channel, :n],
                    model.clock_gain[k], 0.0, signals.variance[epoch, channel], np.inf, model.n_state,
                )  # fmt: skip
                for i in range(scratch.gain.shape[0]):
                    scratch.gain[i] = model.clock_gain[k, i] if i < model.n_state else 0.0
                _update_truth(joint, scratch, tape, late, h, nominal.z[row], epoch, channel, False, signals, true)
