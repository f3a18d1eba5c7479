"""Further satellite observables: carrier phases, and differences of two epochs."""

import numpy as np

from lvnav_trade.filter.policies.epoch_differences import DifferenceProcessing
from lvnav_trade.gnss.fault_cards import missing_satellite
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.kernels.random import source_word
from lvnav_trade.quantities.error_sources import PHASE_NOISE
from lvnav_trade.quantities.errors import InputError, Mistake
from lvnav_trade.quantities.records import Bools, Floats, Ints, Sky
from lvnav_trade.scenario.filter_models import filter_models
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.jacobian_row import D_EXTRA
from lvnav_trade.sensors.receiver_observables import DIFFERENCES, OBSERVABLE_STATES, PHASES
from lvnav_trade.sensors.sensor import CorrelatedError
from lvnav_trade.simulation.preparation.filtering import CaseFilter
from lvnav_trade.simulation.preparation.inputs import FurtherObservables
from lvnav_trade.simulation.preparation.signals.noise import assumed_sigma
from lvnav_trade.simulation.preparation.signals.receiver_measurements import UsedSatellites, freeze_output
from lvnav_trade.simulation.preparation.true_flight import TrueFlight

L1 = 1.57542e9  # Hz; of a receiver without a link


def wavelength(scenario: Scenario) -> float:
    """Return the wavelength of the carrier (m): that of the link card, or L1 without one."""
    link = scenario.receiver.link
    return SPEED_OF_LIGHT / L1 if link is None else link.wavelength


def phase_continuity(sky: Sky, signals: UsedSatellites) -> tuple[Bools, Bools, Bools]:
    """Return the continuity of the carrier phases, (n_epoch, n_sat) each.

    Returns
    -------
    is_restarted
        Whether the carrier is newly acquired: its tracking was interrupted since the satellite was last used.
    was_measured
        Whether the satellite was measured at the previous epoch too.
    is_continuous
        Whether its phase is continuous since then; a frozen output repeats itself.
    """
    n_epoch, n_sat = sky.is_tracked.shape
    is_restarted = np.zeros((n_epoch, n_sat), np.bool_)
    was_measured = np.zeros((n_epoch, n_sat), np.bool_)
    is_continuous = np.zeros((n_epoch, n_sat), np.bool_)
    is_interrupted = np.ones(n_sat, np.bool_)  # since the satellite was last used
    was_used = np.zeros(n_sat, np.bool_)
    for epoch in range(n_epoch):
        is_interrupted |= ~sky.continuous[epoch]
        n_used = signals.n_used[epoch]
        satellites = signals.satellite_by_slot[epoch, :n_used]
        is_used = np.zeros(n_sat, np.bool_)
        is_used[satellites] = True
        is_frozen = bool(signals.is_frozen[epoch])
        is_continued = ~is_interrupted | is_frozen
        is_restarted[epoch] = is_used & is_interrupted & (not is_frozen)
        was_measured[epoch] = is_used & was_used
        is_continuous[epoch] = is_used & was_used & is_continued
        is_interrupted &= ~is_used | is_frozen
        was_used = is_used
    return is_restarted, was_measured, is_continuous


def further_observables(
    scenario: Scenario,
    flight: TrueFlight,
    signals: UsedSatellites,
    errors: tuple[CorrelatedError, ...],
    offsets: Floats,
) -> FurtherObservables | None:
    """Return the truth of the further observables; None without any.

    Parameters
    ----------
    scenario, flight
        Validated model of the case, and its true flight.
    signals
        Satellites in use.
    errors
        Correlated errors of the case.
    offsets
        (n_epoch, n_sat) m. Offsets of satellite clocks and system times.
    """
    channels = flight.channels
    sky = flight.sky
    if not channels.further:
        return None
    distance = flight.lines.sight.distance
    phase_range = distance + flight.fault_errors[..., 0] + flight.atmospheric_delays.phase_residual + offsets
    slip = wavelength(scenario) * flight.failures.slip
    phase = np.asarray(phase_range + slip)
    freeze_output(signals.is_frozen, phase)
    is_restarted, _, _ = phase_continuity(sky, signals)
    return FurtherObservables(
        phase=phase,
        is_phase=np.array([name in PHASES for name in channels.observables]),
        is_difference=np.array([name in DIFFERENCES for name in channels.observables]),
        is_restarted=is_restarted,
        ambiguity=_ambiguity_components(errors, sky.names),
        source=source_word(PHASE_NOISE),
    )


def _ambiguity_components(errors: tuple[CorrelatedError, ...], satellites: tuple[str, ...]) -> Ints:
    """Return the component of the correlated errors that is the ambiguity of each satellite, (n_sat,), -1 none."""
    ambiguity = np.full(len(satellites), -1, dtype=np.int64)
    first = 0
    for error in errors:
        if error.error_type == "ambiguity":
            for k, label in enumerate(error.labels):
                ambiguity[satellites.index(label)] = first + k
        first += len(error.labels)
    return ambiguity


def difference_processing(
    scenario: Scenario, flight: TrueFlight, filtering: CaseFilter, signals: UsedSatellites
) -> DifferenceProcessing | None:
    """Return the processing of further observables in the filter; None without any.

    Parameters
    ----------
    scenario, flight
        Validated model of the case, and its true flight.
    filtering
        Filter of the case.
    signals
        Satellites in use.
    """
    channels, layout, numbers = flight.channels, filtering.layout, filtering.model
    if not channels.further:
        return None
    restart, was_measured, is_continuous = phase_continuity(flight.sky, signals)
    n_epoch = len(flight.sky.is_tracked)
    present = np.ones((n_epoch, channels.n_receiver), dtype=np.bool_)
    for name in DIFFERENCES:
        if name in channels.further:
            present[:, channels.observable_slice(name)] = is_continuous if name in PHASES else was_measured
    return DifferenceProcessing(
        is_difference=np.array([name in DIFFERENCES for name in channels.observables]),
        is_present=present,
        previous_entry=numbers.entry.shape[1] - D_EXTRA - len(layout.extras),
        reset_variance=_renewed_variances(scenario, flight, filtering, restart),
        cloned_states=np.array(layout.cloned_states, dtype=np.int64),
        clone=layout.clone,
        is_back_propagated=bool(layout.cloned_states) and scenario.filter.delayed_state == "back_propagated",
    )


def _renewed_variances(scenario: Scenario, flight: TrueFlight, filtering: CaseFilter, restart: Bools) -> Floats:
    """Return the variance to which extra states are reset at an epoch, (n_epoch, n_extra) SI squared.

    It is -1 without a reset. An ambiguity is reset with a newly acquired carrier, the noise of an observable at every
    epoch.

    Parameters
    ----------
    scenario, flight
        Validated model of the case, and its true flight.
    filtering
        Filter of the case.
    restart
        (n_epoch, n_sat). Whether the carrier is newly acquired.
    """
    sky = flight.sky
    _, model, _ = filter_models(scenario)
    n_epoch = len(sky.is_tracked)
    n_extra = max(1, filtering.model.extra_offset.size)
    reset_variance = np.full((n_epoch, n_extra), -1.0)
    first = 0
    for block in filtering.layout.extras:
        n_state = len(block.labels)
        states = slice(first, first + n_state)
        first += n_state
        if block.name not in OBSERVABLE_STATES:
            continue
        satellites = np.array([sky.names.index(label) for label in block.labels], dtype=np.int64)
        if block.name == "ambiguity":
            reset_variance[:, states] = np.where(restart[:, satellites], model.ambiguity**2, -1.0)
        else:
            observable = OBSERVABLE_STATES[block.name]
            sigma = assumed_sigma(scenario, model, sky, flight.lines, observable)
            reset_variance[:, states] = sigma[:, satellites] ** 2
    return reset_variance


def reference_slots(
    scenario: Scenario, flight: TrueFlight, signals: UsedSatellites, differences: DifferenceProcessing | None
) -> Ints:
    """Return the slot of the reference satellite by observable, (n_epoch, n_observable), -1 none.

    Of several observables with the same clock unknown only the first has a reference: relative to it, the others do not
    depend on the clock.

    Parameters
    ----------
    scenario, flight
        Validated model of the case, and its true flight.
    signals
        Satellites in use.
    differences
        Processing of differences of two epochs; None without.

    Raises
    ------
    InputError
        If the constellation lacks the reference satellite of the filter card.
    """
    card = scenario.filter
    channels = flight.channels
    sky = flight.sky
    n_observable = len(channels.observables)
    references = np.full((signals.n_used.size, n_observable), -1, dtype=np.int64)
    if not channels.tight or card.clock != "differenced":
        return references
    name = card.reference_satellite
    if name is not None and name not in sky.names:
        message = missing_satellite(name, sky.names)
        raise InputError(records=[Mistake(message, "filter.reference_satellite")])
    for observable in _clock_observables(card.measurements, channels.observables):
        for epoch in np.flatnonzero(signals.n_used):
            n_used = signals.n_used[epoch]
            satellites = signals.satellite_by_slot[epoch, :n_used]
            slots = np.arange(satellites.size)
            if differences is not None:
                satellite_channels = n_observable * satellites + observable
                slots = slots[differences.is_present[epoch, satellite_channels]]
            if not slots.size:
                continue
            preferred_slots = [slot for slot in slots if sky.names[satellites[slot]] == name]
            elevation = sky.elevation[epoch, satellites[slots]]
            highest = slots[np.argmax(elevation)]
            references[epoch, observable] = preferred_slots[0] if preferred_slots else highest
    return references


def _clock_observables(measurements: tuple[str, ...], observables: tuple[str, ...]) -> list[int]:
    """Return the first measured observable of each clock unknown: bias, drift, bias at the previous epoch."""
    first: dict[str, int] = {}
    for observable, name in enumerate(observables):
        if name not in measurements:
            continue
        clock_unknown = "bias"
        if name in DIFFERENCES:
            clock_unknown = "before"
        elif name == "range_rate":
            clock_unknown = "drift"
        first.setdefault(clock_unknown, observable)
    return list(first.values())
