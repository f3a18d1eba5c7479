"""Measurement updates of the joint covariance: the filter's gain, and with it every source and the mean."""

from __future__ import annotations

import numpy as np

from lvnav_trade.engines.lincov.receiver_error import N_CLONE, N_NAV
from lvnav_trade.kernels.covariance import update_covariance, update_scalar, update_vector, update_with_gain
from lvnav_trade.kernels.groups import group, total_of, whole
from lvnav_trade.kernels.jit import inlined, jit
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
def shared_partial(signals, true, family, epoch, channel):
    """Return the partial of the innovation with respect to a shared error, beyond what a state of the filter has."""
    own = true.shared_family[family]
    known = signals.partial[own, epoch, channel] if own >= 0 else 0.0
    return signals.shared.partial[family, epoch, measured_channel(signals, channel)] - known


@jit
def measured_channel(signals, channel):
    """Return where a channel of the filter stands among those that are measured; of a solution it is none of them."""
    return channel + signals.shift if channel >= signals.n_receiver else channel


@jit
def _enter(joint, scratch, gain, true, m, a):
    """Let a component enter an update by the partial a, after the update of the states; return what it adds to the
    innovation's variance.
    """
    source, k, n = true.shared_source[m], true.shared_slot[m], gain.shape[0]
    g, lane, P, y = true.group[source], true.lane[source], joint.sources, joint.cross
    variance = joint.variance[g, k, 0, lane]
    for i in range(n):
        if gain[i] != 0.0:
            for j in range(n):
                # with y = Cov(x, c) after the update: -(g (a y)' + (a y) g') + (a^2 var) g g'
                value = a * gain[i] * y[g, k, j, lane]
                P[g, i, j, lane] -= value
                P[g, j, i, lane] -= value
                P[g, i, j, lane] += a * a * variance * gain[i] * gain[j]
    for i in range(n):
        y[g, k, i, lane] += -gain[i] * a * variance
    return 2.0 * a * scratch.seen[g, k, 0, lane] + a * a * variance


@jit
def _update_shared(joint, scratch, gain, signals, true, epoch, channel):
    """Let the errors that measurements share enter an update; return what they add to the innovation's variance."""
    total, member = 0.0, signals.shared.member
    for family in range(member.shape[0]):
        m = member[family, measured_channel(signals, channel)]
        if m >= 0:
            a = shared_partial(signals, true, family, epoch, channel)
            if a != 0.0:
                total += _enter(joint, scratch, gain, true, m, a)
    return total


@jit
def known_partial(h, signals, m):
    """Return the partial of a decorrelated measurement with respect to component m: the error itself is in that of the
    solution, what the filter's estimate of it takes off is not.
    """
    e = signals.shared.extra[m]
    return -h[N_ENTRY + e] if e >= 0 else 0.0


@jit
def _update_known(joint, scratch, gain, h, signals, true):
    """Let errors of a decorrelated solution that the filter has states for enter an update; see `known_partial`."""
    total = 0.0
    for m in range(true.shared_source.shape[0]):
        a = known_partial(h, signals, m)
        if a != 0.0:
            total += _enter(joint, scratch, gain, true, m, a)
    return total


@jit
def _set_gain(gain, K, weight, n_estimated, true, late, epoch):
    """Set the gain on the joint vector: what the filter corrects it also takes off the stored states that measurements
    on their way will be compared with.
    """
    for i in range(gain.shape[0]):
        gain[i] = K[i] * weight if i < n_estimated else 0.0
    if late is not None and true.buffered:
        for ring in range(late.n_ring):
            for i in range(N_NAV):
                gain[true.clone + N_CLONE * ring + i] = gain[i]


@inlined
def replace_state(joint, scratch, tape, late, at, h, innovation, epoch, channel, mixed, signals, true, model):
    """Replace the error of one state by that of a measurement of it: an update with the gain one, in every source and
    in the mean. The filter's own covariance is set elsewhere.
    """
    gain, source, m, ring = scratch.gain, true.noise_source[channel], true.n_entry[channel], 0
    if late is not None:
        ring = epoch % late.n_ring
    for i in range(gain.shape[0]):
        gain[i] = 1.0 if i == at else 0.0
    entries, columns = true.entry[ring, channel, :m], true.column[ring, channel, :m]
    if tape.channel.shape[0] > 0:
        _record(tape, gain, h, epoch, channel)
    noise = 0.0 if mixed else signals.sigma[epoch, measured_channel(signals, channel)] ** 2
    _update_sources(joint, scratch, true, gain, h, entries, columns, source if noise > 0.0 else -1, noise)
    if mixed:
        _update_known(joint, scratch, gain, h, signals, true)
    else:
        _update_shared(joint, scratch, gain, signals, true, epoch, channel)
    update_vector(joint.mean, gain, h, entries, columns)
    joint.mean[at] -= innovation


@inlined
def _update_formal(joint, scratch, gains, h, entries, columns, epoch, channel, variance, model):
    """Update the filter's own covariance; return the weight. The gain, `scratch.K` times weight, is its own, or stored
    (Gains).
    """
    if gains is None:
        _, weight = update_scalar(
            joint.formal, scratch.x, scratch.K, h, entries, columns, 0.0, variance, np.inf, model.n_estimated,
            model.joseph,
        )  # fmt: skip
        return weight
    gain = gains.gain[epoch, channel]
    _, weight = update_with_gain(
        joint.formal, scratch.x, scratch.K, h, entries, columns, gain, 0.0, variance, np.inf, model.n_estimated
    )
    for i in range(model.n_estimated):
        scratch.K[i] = gain[i] / weight
    return weight


@inlined
def _update_sources(joint, scratch, true, gain, h, entries, columns, source, noise):
    """Update every source's covariance and those with the components; return the innovation's true variance."""
    total = noise
    if source >= 0:
        scratch.noise[true.group[source], 0, 0, true.lane[source]] = noise
    for g in range(true.n_slot.shape[0]):
        P, spread = group(joint.sources, g), whole(scratch.spread)
        spread[0] = update_covariance(P, whole(scratch.y), gain, h, entries, columns, group(scratch.noise, g)[0, 0])
        total += total_of(scratch.spread)
        cross, seen = group(joint.cross, g), group(scratch.seen, g)
        for k in range(true.n_slot[g]):
            if true.followed[g, k]:
                seen[k, 0] = update_vector(cross[k], gain, h, entries, columns)
    if source >= 0:
        scratch.noise[true.group[source], 0, 0, true.lane[source]] = 0.0
    return total


@inlined
def update_joint(
    joint, scratch, tape, late, gains, h, innovation, epoch, channel, variance, mixed, signals, true, model
):
    """Update the filter's covariance by one scalar measurement, and with that gain every source and the mean.

    innovation: that of the nominal flight, what the truth's measurement holds in every run and the filter's model
    of it does not (an uncompensated latency). variance: that the filter assumes of its noise. mixed: one of a
    decorrelated solution, whose errors are states already. Returns the expected square of the normalised innovation.
    """
    n, source, gain = model.n_entry[channel], true.noise_source[channel], scratch.gain
    weight = _update_formal(
        joint, scratch, gains, h, model.entry[channel, :n], model.column[channel, :n], epoch, channel, variance,
        model,
    )  # fmt: skip
    _set_gain(gain, scratch.K, weight, model.n_estimated, true, late, epoch)
    ring, m = 0, true.n_entry[channel]
    if late is not None:
        ring = epoch % late.n_ring
    entries, columns = true.entry[ring, channel, :m], true.column[ring, channel, :m]
    if tape.channel.shape[0] > 0:
        _record(tape, gain, h, epoch, channel)
    noise = 0.0 if mixed else signals.sigma[epoch, measured_channel(signals, channel)] ** 2
    total = _update_sources(joint, scratch, true, gain, h, entries, columns, source if noise > 0.0 else -1, noise)
    if mixed:
        total += _update_known(joint, scratch, gain, h, signals, true)
    else:
        total += _update_shared(joint, scratch, gain, signals, true, epoch, channel)
    offset = update_vector(joint.mean, gain, h, entries, columns) + innovation
    for i in range(gain.shape[0]):
        joint.mean[i] -= gain[i] * innovation
    return (total + offset * offset) * weight
