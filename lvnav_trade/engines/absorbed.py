"""One row of the nominal flight: absorbed in the filter's covariance, and with that gain in every source's."""

from __future__ import annotations

import numpy as np

from lvnav_trade.engines.chained import N_NAV
from lvnav_trade.kernels.covariance import absorb, absorb_with
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.joint import update_covariance, update_vector


@jit
def _keep_row(tape, gain, h, epoch, channel):
    at = tape.used[0]
    for i in range(gain.shape[0]):
        tape.gain[at, i] = gain[i]
    for i in range(h.shape[0]):
        tape.h[at, i] = h[i]
    tape.epoch[at], tape.channel[at] = epoch, channel
    tape.used[0] = at + 1


@jit
def shared_partial(signals, true, family, epoch, channel):
    """Return what of a shared error is in the innovation beyond what the filter's own state of it (in e) takes off."""
    own = true.shared_family[family]
    known = signals.partial[own, epoch, channel] if own >= 0 else 0.0
    return signals.shared.partial[family, epoch, channel] - known


@jit
def _absorb_shared(joint, gain, h, entries, columns, signals, true, judged, epoch, channel):
    """Take the errors that measurements share through a row, after the sources' own update; return what they add to
    the innovation's variance.
    """
    spread, n = 0.0, gain.shape[0]
    member = signals.shared.member
    n_family = 0 if judged else member.shape[0]
    for m in range(true.shared_source.shape[0]):
        y = joint.shared_cross[m]
        projected = update_vector(y, gain, h, entries, columns)
        for family in range(n_family):
            if member[family, channel] != m:
                continue
            a, P = shared_partial(signals, true, family, epoch, channel), joint.sources[true.shared_source[m]]
            variance = joint.shared_variance[m]
            spread += 2.0 * a * projected + a * a * variance
            for i in range(n):
                for j in range(n):
                    P[i, j] += a * a * variance * gain[i] * gain[j] - a * (y[i] * gain[j] + gain[i] * y[j])
            for i in range(n):
                y[i] -= gain[i] * a * variance
    return spread


@jit
def _set_gain(gain, K, weight, n_estimated, corrected):
    """Set the gain on the joint vector: the filter takes what it corrects off the kept state as well, where rows are of
    that one.
    """
    for i in range(gain.shape[0]):
        gain[i] = K[i] * weight if i < n_estimated else 0.0
    if corrected >= 0:
        for i in range(N_NAV):
            gain[corrected + i] = gain[i]


@inlined
def _absorb_formal(joint, scratch, gains, h, entries, columns, epoch, channel, variance, belief):
    """Absorb one row in the filter's own covariance; return its weight. The gain, `scratch.K` times weight, is its own,
    or that of a schedule (Gains).
    """
    if gains is None:
        _, weight = absorb(
            joint.formal, scratch.x, scratch.K, h, entries, columns, 0.0, variance, np.inf, belief.n_estimated,
            belief.joseph,
        )  # fmt: skip
        return weight
    gain = gains.gain[epoch, channel]
    _, weight = absorb_with(
        joint.formal, scratch.x, scratch.K, h, entries, columns, gain, 0.0, variance, np.inf, belief.n_estimated
    )
    for i in range(belief.n_estimated):
        scratch.K[i] = gain[i] / weight
    return weight


@inlined
def absorb_true(joint, scratch, tape, gains, h, surprise, epoch, channel, signals, true, belief):
    """Absorb one row in the filter's covariance, and with that gain in every source and in the mean; return the
    expected square of its normalised innovation. `surprise` is the innovation on the nominal flight: what the truth's
    measurement holds, in every run, that the filter's model of it does not (an uncompensated latency).
    """
    n, row_type, gain = belief.n_entry[channel], belief.row_type[channel], scratch.gain
    variance = 1.0 if belief.judged else signals.variance[epoch, channel]
    weight = _absorb_formal(
        joint, scratch, gains, h, belief.entry[channel, :n], belief.column[channel, :n], epoch, channel, variance,
        belief,
    )  # fmt: skip
    _set_gain(gain, scratch.K, weight, belief.n_estimated, true.corrected)
    entries, columns = true.entry[channel, : true.n_entry[channel]], true.column[channel, : true.n_entry[channel]]
    if tape.channel.shape[0] > 0:
        _keep_row(tape, gain, h, epoch, channel)
    # what is white in a judged solution is in the solution's own error already
    noise = 0.0 if belief.judged else signals.sigma[epoch, channel] ** 2
    spread = noise
    for i in range(joint.sources.shape[0]):
        own = noise if true.row_source[row_type] == i else 0.0
        spread += update_covariance(joint.sources[i], scratch.y, gain, h, entries, columns, own)
    for j in range(joint.cross.shape[0]):
        for axis in range(3):
            update_vector(joint.cross[j, axis], gain, h, entries, columns)
    spread += _absorb_shared(joint, gain, h, entries, columns, signals, true, belief.judged, epoch, channel)
    offset = update_vector(joint.mean, gain, h, entries, columns) + surprise
    for i in range(gain.shape[0]):
        joint.mean[i] -= gain[i] * surprise
    return (spread + offset * offset) * weight
