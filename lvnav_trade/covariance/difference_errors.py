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
from lvnav_trade.quantities.records import Bools, Floats, Ints
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
    tracked = []
    for name in channels.observables:
        if name in DIFFERENCES:
            by_satellite = np.arange(channels.n_channel)[channels.of(name)]
            tracked += by_satellite[np.asarray(channels.seen, dtype=bool)].tolist()
    return tracked


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
    signals = prepared.signals
    observables = prepared.channels.observables
    channels = difference_channels(prepared)
    n = len(channels)
    n_epoch = prepared.t_epoch.size
    n_kind = prepared.model.n_kind
    is_new = _new_measurements(prepared)
    move = np.zeros((n_epoch, 2 * n, 2 * n))
    white = np.zeros((n_epoch, 2 * n, n))
    variance = np.zeros((n_epoch, n))
    shared = np.zeros((n_epoch, 2 * n, signals.shared.start.size))
    is_state = prepared.scenario.filter.previous_noise == "estimated"
    for i, channel in enumerate(channels):
        satellite = channel // n_kind
        is_renewed = is_new[:, satellite]
        move[:, n + i, i] = 1.0  # the present error becomes that of the previous epoch
        move[:, i, i] = signals.frozen  # a frozen measurement keeps its error
        white[:, i, i] = 1.0
        if not is_state:
            variance[:, i] = np.where(is_renewed, signals.sigma[:, channel] ** 2, 0.0)
        is_phase = observables[channel % n_kind] in PHASES
        true_channel = channel if is_phase else n_kind * satellite
        for family, block in enumerate(families):
            member = signals.shared.member[family, true_channel]
            if member >= 0:
                assumed = signals.partial[block, :, channel] if block >= 0 else 0.0
                unmodelled = signals.shared.partial[family, :, true_channel] - assumed
                shared[:, i, member] += np.where(is_renewed, unmodelled, 0.0)
    renewed, renewed_source = _renewed_states(prepared, names)
    return SuccessiveErrors(
        move=move,
        white=white,
        variance=variance,
        kind=np.array(channels, dtype=np.int64),
        shared=shared,
        push=np.zeros((n_epoch, 2 * n)),
        renewed=renewed,
        renewed_source=renewed_source,
    )


def _new_measurements(prepared: Prepared) -> Bools:
    """Return whether the filter uses a satellite with a new measurement at an epoch, (n_epoch, n_satellite)."""
    signals = prepared.signals
    is_used = np.zeros((prepared.t_epoch.size, len(prepared.sky.names)), dtype=np.bool_)
    for epoch in range(len(is_used)):
        n_used = signals.n_used[epoch]
        satellites = signals.used[epoch, :n_used]
        is_used[epoch, satellites] = True
    return is_used & ~signals.frozen[:, None]


def _renewed_states(prepared: Prepared, names: list[str]) -> tuple[Floats, Ints]:
    """Return `renewed` and `renewed_source` of `SuccessiveErrors`."""
    delayed = prepared.options.delayed
    renewed = np.full(delayed.renewed.shape, -1.0)
    n_extra = delayed.renewed.shape[1]
    source = np.zeros(n_extra, dtype=np.int64)
    state = 0
    for block in prepared.layout.extras:
        for label in block.labels:
            if block.name in OF_OBSERVABLES:
                name, sigma = _renewal_noise(prepared, block.name, label)
                is_renewed = delayed.renewed[:, state] >= 0.0
                renewed[is_renewed, state] = sigma[is_renewed] ** 2
                source[state] = names.index(name) if name in names else 0
            state += 1
    return renewed, source


def _renewal_noise(prepared: Prepared, block: str, satellite: str) -> tuple[str, Floats]:
    """Return the error source of a renewed state, and the sigma (n_epoch,) to which it is reset."""
    observable = OF_ONE[block]
    if block == "ambiguity":
        sigma = prepared.scenario.receiver.carrier_ambiguity
        return "carrier ambiguity", np.full(prepared.t_epoch.size, sigma)
    satellite_number = prepared.sky.names.index(satellite)
    channel = prepared.model.n_kind * satellite_number
    channel += prepared.channels.observables.index(observable)
    return noise_of(observable), prepared.signals.sigma[:, channel]


@jit
def measure_further(nominal, further, signals, epoch):
    """Set the further observables (phases, differences) of the nominal flight at an epoch.

    Parameters
    ----------
    nominal : Nominal, of which `ranges` is updated in place
    further : FurtherObservables, or None
    signals : Signals
    epoch : index
    """
    if further is not None:
        for slot in range(signals.n_used[epoch]):
            satellite = signals.used[epoch, slot]
            ranges = nominal.ranges[slot]
            for observable in range(2, further.is_phase.shape[0]):
                values = further.phase if further.is_phase[observable] else signals.range
                ranges[observable] = values[epoch, satellite]
                if further.is_difference[observable] and epoch > 0:
                    ranges[observable] -= values[epoch - 1, satellite]


@jit
def _clear_state(P, state):
    """Set the row and the column of a state in a covariance to zero."""
    zero = like(P[0, 0], 0.0)
    for i in range(P.shape[0]):
        P[state, i] = zero
        P[i, state] = zero


@inlined
def _renew_joint(joint, successive, true, model, epoch):
    """Reset the error of extra states that are renewed at an epoch, in every source and in the mean.

    Parameters
    ----------
    joint : JointCovariance, updated in place
    successive : SuccessiveErrors, or None
    true, model : Components, FilterModel
    epoch : index
    """
    if successive is not None:
        for e in range(successive.renewed.shape[1]):
            variance = successive.renewed[epoch, e]
            if variance >= 0.0:
                state = model.extra_offset[e]
                for g in range(true.n_slot.shape[0]):
                    _clear_state(group(joint.sources, g), state)
                    cross_covariances = group(joint.cross, g)
                    for k in range(true.n_slot[g]):
                        if true.has_cross[g, k]:
                            y = cross_covariances[k]
                            y[state] = like(y[state], 0.0)
                joint.mean[state] = 0.0
                source = successive.renewed_source[e]
                g = true.group[source]
                lane = true.lane[source]
                joint.sources[g, state, state, lane] = variance


@inlined
def begin_successive(joint, successive, model, epoch):
    """Begin an epoch in every source.

    Present measurement errors become those of the previous epoch, and renewed states are reset.

    Parameters
    ----------
    joint : Joint, updated in place
    successive : SuccessiveErrors, or None
    model : FilterModel
    epoch : index
    """
    if successive is not None:
        advance_solution(joint.state, joint.scratch, successive, joint.true, epoch)
        _renew_joint(joint.state, successive, joint.true, model, epoch)


@inlined
def renew_back(back, successive, model, epoch, time_bin):
    """Propagate the adjoint backwards through the reset of states, and add the contribution of their new variance.

    Parameters
    ----------
    back : BackwardPass, updated in place
    successive : SuccessiveErrors, or None
    model : FilterModel
    epoch : index
    time_bin : bin of the contribution
    """
    if successive is not None:
        for e in range(successive.renewed.shape[1]):
            variance = successive.renewed[epoch, e]
            if variance >= 0.0:
                state = model.extra_offset[e]
                source = successive.renewed_source[e]
                for m in range(back.e.shape[0]):
                    through = back.e[m, state]
                    back.contribution[m, source, time_bin] += through * through * variance
                    back.e[m, state] = 0.0


@jit
def _origin(true, late, delayed, epoch, c):
    """Return the joint state that a clone of the filter copies; with a late receiver that of the time of validity.

    Parameters
    ----------
    true : Components
    late : DelayProcessing, or None
    delayed : DifferenceProcessing
    epoch : index
    c : index of the clone
    """
    state = delayed.cloned[c]
    if late is not None and late.receiver >= 0 and state < 9:
        return true.clone + N_CLONE * place_of(late, late.receiver, epoch) + state
    return state


@inlined
def clone_joint(joint, late, delayed, epoch):
    """Set the clones of the filter to the states at the end of an epoch, in every source and in the mean.

    Parameters
    ----------
    joint : Joint, updated in place
    late : DelayProcessing, or None
    delayed : DifferenceProcessing, or None
    epoch : index
    """
    if delayed is not None:
        for c in range(delayed.cloned.shape[0]):
            origin = _origin(joint.true, late, delayed, epoch, c)
            clone_states(joint.state, joint.true, delayed.clone + c, origin, 1)


@inlined
def joint_back(back, true, late, delayed, epoch):
    """Propagate the adjoint backwards through `clone_joint`.

    Parameters
    ----------
    back : BackwardPass, updated in place
    true : Components
    late : DelayProcessing, or None
    delayed : DifferenceProcessing, or None
    epoch : index
    """
    if delayed is not None:
        for m in range(back.e.shape[0]):
            y = back.e[m]
            for c in range(delayed.cloned.shape[0] - 1, -1, -1):
                clone = delayed.clone + c
                origin = _origin(true, late, delayed, epoch, c)
                y[origin] += y[clone]
                y[clone] = 0.0
