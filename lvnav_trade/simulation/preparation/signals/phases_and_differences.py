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
from lvnav_trade.sensors.receiver_observables import DIFFERENCES, OF_ONE, PHASES
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


def linked(sky: Sky, signals: UsedSatellites) -> tuple[Bools, Bools, Bools]:
    """Return the continuity of the carrier phases, (n_epoch, n_sat) each.

    Returns
    -------
    restart
        Whether the carrier is newly acquired: its tracking was interrupted since the satellite was last used.
    before
        Whether the satellite was measured at the previous epoch too.
    going_on
        Whether its phase is continuous since then; a frozen output repeats itself.
    """
    n_epoch, n_sat = sky.tracked.shape
    restart = np.zeros((n_epoch, n_sat), np.bool_)
    before = np.zeros((n_epoch, n_sat), np.bool_)
    going_on = np.zeros((n_epoch, n_sat), np.bool_)
    interrupted = np.ones(n_sat, np.bool_)  # since the satellite was last used
    used_last = np.zeros(n_sat, np.bool_)
    for epoch in range(n_epoch):
        interrupted |= ~sky.continuous[epoch]
        n_used = signals.n_used[epoch]
        satellites = signals.used[epoch, :n_used]
        is_used = np.zeros(n_sat, np.bool_)
        is_used[satellites] = True
        is_frozen = bool(signals.frozen[epoch])
        is_continued = ~interrupted | is_frozen
        restart[epoch] = is_used & interrupted & (not is_frozen)
        before[epoch] = is_used & used_last
        going_on[epoch] = is_used & used_last & is_continued
        interrupted &= ~is_used | is_frozen
        used_last = is_used
    return restart, before, going_on


def further_of(
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
    phase_range = distance + flight.biased[..., 0] + flight.delays.left_of_phase + offsets
    slip = wavelength(scenario) * flight.failed.slip
    phase = np.asarray(phase_range + slip)
    freeze_output(signals.frozen, phase)
    restart, _, _ = linked(sky, signals)
    return FurtherObservables(
        phase=phase,
        is_phase=np.array([name in PHASES for name in channels.observables]),
        is_difference=np.array([name in DIFFERENCES for name in channels.observables]),
        restart=restart,
        ambiguity=_ambiguity_components(errors, sky.names),
        source=source_word(PHASE_NOISE),
    )


def _ambiguity_components(errors: tuple[CorrelatedError, ...], satellites: tuple[str, ...]) -> Ints:
    """Return the component of the correlated errors that is the ambiguity of each satellite, (n_sat,), -1 none."""
    ambiguity = np.full(len(satellites), -1, dtype=np.int64)
    first = 0
    for error in errors:
        if error.kind == "ambiguity":
            for k, label in enumerate(error.labels):
                ambiguity[satellites.index(label)] = first + k
        first += len(error.labels)
    return ambiguity


def delayed_of(
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
    restart, before, going_on = linked(flight.sky, signals)
    n_epoch = len(flight.sky.tracked)
    present = np.ones((n_epoch, channels.n_receiver), dtype=np.bool_)
    for name in DIFFERENCES:
        if name in channels.further:
            present[:, channels.of(name)] = going_on if name in PHASES else before
    return DifferenceProcessing(
        difference=np.array([name in DIFFERENCES for name in channels.observables]),
        present=present,
        previous_entry=numbers.entry.shape[1] - D_EXTRA - len(layout.extras),
        renewed=_renewed_variances(scenario, flight, filtering, restart),
        cloned=np.array(layout.cloned, dtype=np.int64),
        clone=layout.clone,
        back=bool(layout.cloned) and scenario.filter.delayed_state == "back_propagated",
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
    n_epoch = len(sky.tracked)
    n_extra = max(1, filtering.model.extra_offset.size)
    renewed = np.full((n_epoch, n_extra), -1.0)
    first = 0
    for block in filtering.layout.extras:
        n_state = len(block.labels)
        states = slice(first, first + n_state)
        first += n_state
        if block.name not in OF_ONE:
            continue
        satellites = np.array([sky.names.index(label) for label in block.labels], dtype=np.int64)
        if block.name == "ambiguity":
            renewed[:, states] = np.where(restart[:, satellites], model.ambiguity**2, -1.0)
        else:
            observable = OF_ONE[block.name]
            sigma = assumed_sigma(scenario, model, sky, flight.lines, observable)
            renewed[:, states] = sigma[:, satellites] ** 2
    return renewed


def references_of(
    scenario: Scenario, flight: TrueFlight, signals: UsedSatellites, delayed: DifferenceProcessing | None
) -> Ints:
    """Return the slot of the reference satellite by observable, (n_epoch, n_kind), -1 none.

    Of several observables with the same clock unknown only the first has a reference: relative to it, the others do not
    depend on the clock.

    Parameters
    ----------
    scenario, flight
        Validated model of the case, and its true flight.
    signals
        Satellites in use.
    delayed
        Processing of differences of two epochs; None without.

    Raises
    ------
    InputError
        If the constellation lacks the reference satellite of the filter card.
    """
    card = scenario.filter
    channels = flight.channels
    sky = flight.sky
    n_kind = len(channels.observables)
    references = np.full((signals.n_used.size, n_kind), -1, dtype=np.int64)
    if not channels.tight or card.clock != "differenced":
        return references
    name = card.reference_satellite
    if name is not None and name not in sky.names:
        message = missing_satellite(name, sky.names)
        raise InputError(records=[Mistake(message, "filter.reference_satellite")])
    for observable in _leading(card.measurements, channels.observables):
        for epoch in np.flatnonzero(signals.n_used):
            n_used = signals.n_used[epoch]
            satellites = signals.used[epoch, :n_used]
            slots = np.arange(satellites.size)
            if delayed is not None:
                satellite_channels = n_kind * satellites + observable
                slots = slots[delayed.present[epoch, satellite_channels]]
            if not slots.size:
                continue
            named = [slot for slot in slots if sky.names[satellites[slot]] == name]
            elevation = sky.elevation[epoch, satellites[slots]]
            highest = slots[np.argmax(elevation)]
            references[epoch, observable] = named[0] if named else highest
    return references


def _leading(measurements: tuple[str, ...], observables: tuple[str, ...]) -> list[int]:
    """Return the first measured observable of each clock unknown: bias, drift, bias at the previous epoch."""
    first: dict[str, int] = {}
    for observable, name in enumerate(observables):
        if name not in measurements:
            continue
        unknown = "bias"
        if name in DIFFERENCES:
            unknown = "before"
        elif name == "range_rate":
            unknown = "drift"
        first.setdefault(unknown, observable)
    return list(first.values())
