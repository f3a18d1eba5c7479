"""Differences of two epochs in the joint covariance: measurement errors are states until the next epoch.

The error of a range that no filter state models is a state of the joint vector, and so is that of the previous epoch. A
difference measures the first minus the second. Its noise is thus a moving average, in every source, in the forward and
in the backward pass. The clones of the filter are joint states already; after an epoch they are set to the present
states.
"""

from typing import NamedTuple

import numpy as np

from lvnav_trade.covariance.receiver_error import advance_solution, clone_states
from lvnav_trade.filter.policies.delay import place_of
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import group, like
from lvnav_trade.quantities.records import Floats, Ints
from lvnav_trade.quantities.state_layout import OF_OBSERVABLES
from lvnav_trade.sensors.receiver_observables import DIFFERENCES, OF_ONE, PHASES
from lvnav_trade.simulation.epoch.joint import N_CLONE
from lvnav_trade.simulation.preparation.prepare import Prepared

N_ENTRIES = 2
"""Jacobian entries for the measurement error at this epoch and at the previous one."""


class SuccessiveErrors(NamedTuple):
    """Measurement errors of n channels as m = 2 n joint states: at this epoch, and at the previous epoch.

    move : (n_epoch, m, m). Transition from the previous epoch, as in `solution.SolutionErrorModel`.
    white : (n_epoch, m, n). Effect of the noise of each channel on the states.
    variance : (n_epoch, n) SI squared. Variance of that noise.
    kind : (n,). Channel.
    shared : (n_epoch, m, n_component). Effect of the correlated measurement errors.
    push : (n_epoch, m). Deterministic change; zero here.
    renewed : (n_epoch, n_extra) SI squared. True variance to which an extra state is reset, -1: no reset.
    renewed_source : (n_extra,). Source of that variance.
    """

    move: Floats
    white: Floats
    variance: Floats
    kind: Ints
    shared: Floats
    push: Floats
    renewed: Floats
    renewed_source: Ints


def noise_of(observable: str) -> str:
    """Return the noise source of an observable; for a difference, that of the differenced observable."""
    if observable in PHASES:
        return "carrier-phase noise"
    return "range-rate noise" if observable == "range_rate" else "pseudorange noise"


def difference_channels(prepared: Prepared) -> list[int]:
    """Return the channels that are differences of two epochs, for satellites that are tracked at any time."""
    channels = prepared.channels
    if prepared.options.delayed is None:
        return []
    return [
        int(channel)
        for name in channels.observables
        if name in DIFFERENCES
        for channel, seen in zip(np.arange(channels.n_channel)[channels.of(name)], channels.seen, strict=True)
        if seen
    ]


def successive_of(prepared: Prepared, names: list[str], families: list[int]) -> SuccessiveErrors | None:
    """Return the errors of successive measurements; None without further observables.

    Parameters
    ----------
    prepared
        Prepared case.
    names
        Names of the error sources.
    families
        For each family of correlated errors, the block of extra states that models it, -1 none.
    """
    if prepared.options.delayed is None:
        return None
    signals, frozen = prepared.signals, prepared.signals.frozen
    channels = difference_channels(prepared)
    n, n_epoch, n_kind = len(channels), prepared.t_epoch.size, prepared.model.n_kind
    observables = [prepared.channels.observables[channel % n_kind] for channel in channels]
    used = np.zeros((n_epoch, len(prepared.sky.names)), dtype=np.bool_)
    for epoch in range(n_epoch):
        used[epoch, signals.used[epoch, : signals.n_used[epoch]]] = True
    new = used & ~frozen[:, None]
    move, white = np.zeros((n_epoch, 2 * n, 2 * n)), np.zeros((n_epoch, 2 * n, n))
    variance, shared = np.zeros((n_epoch, n)), np.zeros((n_epoch, 2 * n, signals.shared.start.size))
    is_state = prepared.scenario.filter.previous_noise == "estimated"
    for i, (channel, name) in enumerate(zip(channels, observables, strict=True)):
        satellite = channel // n_kind
        move[:, n + i, i], move[:, i, i] = 1.0, frozen
        white[:, i, i] = 1.0
        if not is_state:
            variance[:, i] = np.where(new[:, satellite], signals.sigma[:, channel] ** 2, 0.0)
        true = channel if name in PHASES else n_kind * satellite
        for family, block in enumerate(families):
            m = signals.shared.member[family, true]
            if m >= 0:
                assumed = signals.partial[block, :, channel] if block >= 0 else 0.0
                beyond = signals.shared.partial[family, :, true] - assumed
                shared[:, i, m] += np.where(new[:, satellite], beyond, 0.0)
    return SuccessiveErrors(
        move,
        white,
        variance,
        np.array(channels, dtype=np.int64),
        shared,
        np.zeros((n_epoch, 2 * n)),
        *_renewed(prepared, names),
    )


def _renewed(prepared: Prepared, names: list[str]) -> tuple[Floats, Ints]:
    """Return `renewed` and `renewed_source` of `SuccessiveErrors`."""
    delayed, signals, n_kind = prepared.options.delayed, prepared.signals, prepared.model.n_kind
    renewed, source = np.full(delayed.renewed.shape, -1.0), np.zeros(delayed.renewed.shape[1], dtype=np.int64)
    first = 0
    for block in prepared.layout.extras:
        if block.name in OF_OBSERVABLES:
            at = prepared.channels.observables.index(OF_ONE[block.name])
            for k, label in enumerate(block.labels):
                sigma = signals.sigma[:, n_kind * prepared.sky.names.index(label) + at]
                name = noise_of(OF_ONE[block.name])
                if block.name == "ambiguity":
                    name, sigma = "carrier ambiguity", np.full(len(sigma), prepared.scenario.receiver.carrier_ambiguity)
                anew = delayed.renewed[:, first + k] >= 0.0
                renewed[anew, first + k] = sigma[anew] ** 2
                source[first + k] = names.index(name) if name in names else 0
        first += len(block.labels)
    return renewed, source


@jit
def measure_further(nominal, further, signals, epoch):
    """Set the further observables (phases, differences) of the nominal flight at an epoch; further : or None."""
    if further is not None:
        for slot in range(signals.n_used[epoch]):
            s = signals.used[epoch, slot]
            for kind in range(2, further.is_phase.shape[0]):
                values = further.phase if further.is_phase[kind] else signals.range
                nominal.ranges[slot, kind] = values[epoch, s]
                if further.is_difference[kind] and epoch > 0:
                    nominal.ranges[slot, kind] -= values[epoch - 1, s]


@jit
def _forget(P, at):
    """Set the row and the column of a state in a covariance to zero."""
    for i in range(P.shape[0]):
        P[at, i], P[i, at] = like(P[0, 0], 0.0), like(P[0, 0], 0.0)


@inlined
def _renew_joint(joint, successive, true, model, epoch):
    """Reset the error of extra states that are renewed at an epoch, in every source and in the mean."""
    if successive is not None:
        for e in range(successive.renewed.shape[1]):
            if successive.renewed[epoch, e] >= 0.0:
                at = model.extra_offset[e]
                for g in range(true.n_slot.shape[0]):
                    _forget(group(joint.sources, g), at)
                    for k in range(true.n_slot[g]):
                        if true.followed[g, k]:
                            y = group(joint.cross, g)[k]
                            y[at] = like(y[at], 0.0)
                joint.mean[at] = 0.0
                source = successive.renewed_source[e]
                joint.sources[true.group[source], at, at, true.lane[source]] = successive.renewed[epoch, e]


@inlined
def begin_successive(joint, successive, model, epoch):
    """Begin an epoch in every source (SuccessiveErrors, or None): present measurement errors become those of the
    previous epoch, and renewed states are reset.
    """
    if successive is not None:
        advance_solution(joint.state, joint.scratch, successive, joint.true, epoch)
        _renew_joint(joint.state, successive, joint.true, model, epoch)


@inlined
def renew_back(back, successive, model, epoch, time_bin):
    """Propagate the adjoint backwards through the reset of states, and add the contribution of their new variance."""
    if successive is not None:
        for e in range(successive.renewed.shape[1]):
            if successive.renewed[epoch, e] >= 0.0:
                at, source = model.extra_offset[e], successive.renewed_source[e]
                for m in range(back.e.shape[0]):
                    through = back.e[m, at]
                    back.contribution[m, source, time_bin] += through * through * successive.renewed[epoch, e]
                    back.e[m, at] = 0.0


@jit
def _origin(true, late, delayed, epoch, c):
    """Return the joint state that a clone of the filter copies; with a late receiver that of the time of validity."""
    state = delayed.cloned[c]
    if late is not None and late.receiver >= 0 and state < 9:
        return true.clone + N_CLONE * place_of(late, late.receiver, epoch) + state
    return state


@inlined
def clone_joint(joint, late, delayed, epoch):
    """Set the clones of the filter (DifferenceProcessing, or None) to the states at the end of an epoch, in every
    source and in the mean.
    """
    if delayed is not None:
        for c in range(delayed.cloned.shape[0]):
            origin = _origin(joint.true, late, delayed, epoch, c)
            clone_states(joint.state, joint.true, delayed.clone + c, origin, 1)


@inlined
def joint_back(back, true, late, delayed, epoch):
    """Propagate the adjoint backwards through `clone_joint`."""
    if delayed is not None:
        for m in range(back.e.shape[0]):
            y = back.e[m]
            for c in range(delayed.cloned.shape[0] - 1, -1, -1):
                y[_origin(true, late, delayed, epoch, c)] += y[delayed.clone + c]
                y[delayed.clone + c] = 0.0
