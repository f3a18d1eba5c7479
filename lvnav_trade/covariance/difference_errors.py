"""Differences of two epochs in the joint covariance: measurement errors are states until the next epoch.

The error of a range that no filter state models is a state of the joint vector, and so is that of the previous epoch. A
difference measures the first minus the second. Its noise is thus a moving average, in every source, in the forward and
in the backward pass. The clones of the filter are joint states already; after an epoch they are set to the present
states.
"""

from typing import NamedTuple

import numpy as np

from lvnav_trade.covariance.receiver_error import advance_solution, clone_states
from lvnav_trade.filter.policies.delay import ring_index
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import group, number_like
from lvnav_trade.quantities.records import Bools, Floats, Ints
from lvnav_trade.quantities.state_layout import OF_OBSERVABLES
from lvnav_trade.sensors.receiver_observables import DIFFERENCES, OBSERVABLE_STATES, PHASES
from lvnav_trade.simulation.epoch.joint import N_CLONE
from lvnav_trade.simulation.preparation.prepare import PreparedCase

N_ENTRIES = 2
"""Jacobian entries for the measurement error at this epoch and at the previous one."""


class SuccessiveErrors(NamedTuple):
    """Measurement errors of n channels as m = 2 n joint states: at this epoch, and at the previous epoch.

    transition : (n_epoch, m, m). Transition from the previous epoch, as in `solution.SolutionErrorModel`.
    noise_input : (n_epoch, m, n). Effect of the noise of each channel on the states.
    variance : (n_epoch, n) SI squared. Variance of that noise.
    noise_type : (n,). Channel.
    correlated_input : (n_epoch, m, n_component). Effect of the correlated measurement errors.
    deterministic_error : (n_epoch, m). Deterministic change; zero here.
    reset_variance : (n_epoch, n_extra) SI squared. True variance to which an extra state is reset, -1: no reset.
    reset_source : (n_extra,). Source of that variance.
    """

    transition: Floats
    noise_input: Floats
    variance: Floats
    noise_type: Ints
    correlated_input: Floats
    deterministic_error: Floats
    reset_variance: Floats
    reset_source: Ints


def observable_noise_source(observable: str) -> str:
    """Return the noise source of an observable; for a difference, that of the differenced observable."""
    if observable in PHASES:
        return "carrier-phase noise"
    return "range-rate noise" if observable == "range_rate" else "pseudorange noise"


def difference_channels(prepared_case: PreparedCase) -> list[int]:
    """Return the channels that are differences of two epochs, for satellites that are tracked at any time."""
    channels = prepared_case.channels
    if prepared_case.options.differences is None:
        return []
    tracked_channels = []
    for name in channels.observables:
        if name in DIFFERENCES:
            by_satellite = np.arange(channels.n_channel)[channels.observable_slice(name)]
            tracked_channels += by_satellite[np.asarray(channels.is_tracked, dtype=bool)].tolist()
    return tracked_channels


def build_successive_errors(
    prepared_case: PreparedCase, names: list[str], families: list[int]
) -> SuccessiveErrors | None:
    """Return the errors of successive measurements; None without further observables.

    Parameters
    ----------
    prepared_case
        Prepared case.
    names
        Names of the error sources.
    families
        For each family of correlated errors, the block of extra states that models it, -1 none.
    """
    if prepared_case.options.differences is None:
        return None
    signals = prepared_case.signals
    observables = prepared_case.channels.observables
    channels = difference_channels(prepared_case)
    n = len(channels)
    n_epoch = prepared_case.t_epoch.size
    n_observable = prepared_case.model.n_observable
    is_new = _new_measurements(prepared_case)
    transition = np.zeros((n_epoch, 2 * n, 2 * n))
    noise_input = np.zeros((n_epoch, 2 * n, n))
    variance = np.zeros((n_epoch, n))
    correlated_input = np.zeros((n_epoch, 2 * n, signals.correlated_errors.initial_sigma.size))
    is_state = prepared_case.scenario.filter.previous_noise == "estimated"
    for i, channel in enumerate(channels):
        satellite = channel // n_observable
        is_new_epoch = is_new[:, satellite]
        transition[:, n + i, i] = 1.0  # the present error becomes that of the previous epoch
        transition[:, i, i] = signals.is_frozen  # a frozen measurement keeps its error
        noise_input[:, i, i] = 1.0
        if not is_state:
            variance[:, i] = np.where(is_new_epoch, signals.sigma[:, channel] ** 2, 0.0)
        is_phase = observables[channel % n_observable] in PHASES
        true_channel = channel if is_phase else n_observable * satellite
        for family, block in enumerate(families):
            member = signals.correlated_errors.member[family, true_channel]
            if member >= 0:
                model_partial = signals.partial[block, :, channel] if block >= 0 else 0.0
                partial_residual = signals.correlated_errors.partial[family, :, true_channel] - model_partial
                correlated_input[:, i, member] += np.where(is_new_epoch, partial_residual, 0.0)
    reset_variance, reset_source = _reset_states(prepared_case, names)
    return SuccessiveErrors(
        transition=transition,
        noise_input=noise_input,
        variance=variance,
        noise_type=np.array(channels, dtype=np.int64),
        correlated_input=correlated_input,
        deterministic_error=np.zeros((n_epoch, 2 * n)),
        reset_variance=reset_variance,
        reset_source=reset_source,
    )


def _new_measurements(prepared_case: PreparedCase) -> Bools:
    """Return whether the filter uses a satellite with a new measurement at an epoch, (n_epoch, n_satellite)."""
    signals = prepared_case.signals
    is_used = np.zeros((prepared_case.t_epoch.size, len(prepared_case.sky.names)), dtype=np.bool_)
    for epoch in range(len(is_used)):
        n_used = signals.n_used[epoch]
        satellites = signals.satellite_by_slot[epoch, :n_used]
        is_used[epoch, satellites] = True
    return is_used & ~signals.is_frozen[:, None]


def _reset_states(prepared_case: PreparedCase, names: list[str]) -> tuple[Floats, Ints]:
    """Return `reset_variance` and `reset_source` of `SuccessiveErrors`."""
    differences = prepared_case.options.differences
    reset_variance = np.full(differences.reset_variance.shape, -1.0)
    n_extra = differences.reset_variance.shape[1]
    source = np.zeros(n_extra, dtype=np.int64)
    state = 0
    for block in prepared_case.layout.extras:
        for label in block.labels:
            if block.name in OF_OBSERVABLES:
                name, sigma = _reset_noise(prepared_case, block.name, label)
                is_reset = differences.reset_variance[:, state] >= 0.0
                reset_variance[is_reset, state] = sigma[is_reset] ** 2
                source[state] = names.index(name) if name in names else 0
            state += 1
    return reset_variance, source


def _reset_noise(prepared_case: PreparedCase, block: str, satellite: str) -> tuple[str, Floats]:
    """Return the error source of a renewed state, and the sigma (n_epoch,) to which it is reset."""
    observable = OBSERVABLE_STATES[block]
    if block == "ambiguity":
        sigma = prepared_case.scenario.receiver.carrier_ambiguity
        return "carrier ambiguity", np.full(prepared_case.t_epoch.size, sigma)
    satellite_number = prepared_case.sky.names.index(satellite)
    channel = prepared_case.model.n_observable * satellite_number
    channel += prepared_case.channels.observables.index(observable)
    return observable_noise_source(observable), prepared_case.signals.sigma[:, channel]


@jit
def measure_further_observables(nominal, further_observables, signals, epoch):
    """Set the further observables (phases, differences) of the nominal flight at an epoch.

    Parameters
    ----------
    nominal : Nominal, of which `ranges` is updated in place
    further_observables : FurtherObservables, or None
    signals : Signals
    epoch : index
    """
    if further_observables is not None:
        for slot in range(signals.n_used[epoch]):
            satellite = signals.satellite_by_slot[epoch, slot]
            ranges = nominal.ranges[slot]
            for observable in range(2, further_observables.is_phase.shape[0]):
                values = further_observables.phase if further_observables.is_phase[observable] else signals.range
                ranges[observable] = values[epoch, satellite]
                if further_observables.is_difference[observable] and epoch > 0:
                    ranges[observable] -= values[epoch - 1, satellite]


@jit
def _clear_state(P, state):
    """Set the row and the column of a state in a covariance to zero."""
    zero = number_like(P[0, 0], 0.0)
    for i in range(P.shape[0]):
        P[state, i] = zero
        P[i, state] = zero


@inline_jit
def _reset_joint(joint, successive_errors, components, model, epoch):
    """Reset the error of extra states that are renewed at an epoch, in every source and in the mean.

    Parameters
    ----------
    joint : JointCovariance, updated in place
    successive_errors : SuccessiveErrors, or None
    components, model : Components, FilterModel
    epoch : index
    """
    if successive_errors is not None:
        for e in range(successive_errors.reset_variance.shape[1]):
            variance = successive_errors.reset_variance[epoch, e]
            if variance >= 0.0:
                state = model.extra_offset[e]
                for g in range(components.n_slot.shape[0]):
                    _clear_state(group(joint.sources, g), state)
                    cross_covariances = group(joint.cross, g)
                    for k in range(components.n_slot[g]):
                        if components.has_cross[g, k]:
                            y = cross_covariances[k]
                            y[state] = number_like(y[state], 0.0)
                joint.mean[state] = 0.0
                source = successive_errors.reset_source[e]
                g = components.group[source]
                lane = components.lane[source]
                joint.sources[g, state, state, lane] = variance


@inline_jit
def begin_successive_errors(joint, successive_errors, model, epoch):
    """Begin an epoch in every source.

    Present measurement errors become those of the previous epoch, and renewed states are reset.

    Parameters
    ----------
    joint : Joint, updated in place
    successive_errors : SuccessiveErrors, or None
    model : FilterModel
    epoch : index
    """
    if successive_errors is not None:
        advance_solution(joint.state, joint.scratch, successive_errors, joint.components, epoch)
        _reset_joint(joint.state, successive_errors, joint.components, model, epoch)


@inline_jit
def reset_adjoint(backward_pass, successive_errors, model, epoch, time_bin):
    """Propagate the adjoint backwards through the reset of states, and add the contribution of their new variance.

    Parameters
    ----------
    backward_pass : BackwardPass, updated in place
    successive_errors : SuccessiveErrors, or None
    model : FilterModel
    epoch : index
    time_bin : bin of the contribution
    """
    if successive_errors is not None:
        for e in range(successive_errors.reset_variance.shape[1]):
            variance = successive_errors.reset_variance[epoch, e]
            if variance >= 0.0:
                state = model.extra_offset[e]
                source = successive_errors.reset_source[e]
                for m in range(backward_pass.e.shape[0]):
                    sensitivity = backward_pass.e[m, state]
                    backward_pass.contribution[m, source, time_bin] += sensitivity * sensitivity * variance
                    backward_pass.e[m, state] = 0.0


@jit
def _clone_origin(components, delays, differences, epoch, c):
    """Return the joint state that a clone of the filter copies; with a late receiver that of the time of validity.

    Parameters
    ----------
    components : Components
    delays : DelayProcessing, or None
    differences : DifferenceProcessing
    epoch : index
    c : index of the clone
    """
    state = differences.cloned_states[c]
    if delays is not None and delays.receiver_line >= 0 and state < 9:
        return components.clone + N_CLONE * ring_index(delays, delays.receiver_line, epoch) + state
    return state


@inline_jit
def clone_joint(joint, delays, differences, epoch):
    """Set the clones of the filter to the states at the end of an epoch, in every source and in the mean.

    Parameters
    ----------
    joint : Joint, updated in place
    delays : DelayProcessing, or None
    differences : DifferenceProcessing, or None
    epoch : index
    """
    if differences is not None:
        for c in range(differences.cloned_states.shape[0]):
            origin = _clone_origin(joint.components, delays, differences, epoch, c)
            clone_states(joint.state, joint.components, differences.clone + c, origin, 1)


@inline_jit
def joint_clone_adjoint(backward_pass, components, delays, differences, epoch):
    """Propagate the adjoint backwards through `clone_joint`.

    Parameters
    ----------
    backward_pass : BackwardPass, updated in place
    components : Components
    delays : DelayProcessing, or None
    differences : DifferenceProcessing, or None
    epoch : index
    """
    if differences is not None:
        for m in range(backward_pass.e.shape[0]):
            y = backward_pass.e[m]
            for c in range(differences.cloned_states.shape[0] - 1, -1, -1):
                clone = differences.clone + c
                origin = _clone_origin(components, delays, differences, epoch, c)
                y[origin] += y[clone]
                y[clone] = 0.0
