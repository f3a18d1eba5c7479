"""Settings with an effect on a case: those that are read, minus those that are read without effect."""

from collections.abc import Collection, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.gnss.fault_cards import (
    ClockDrift,
    ClockJump,
    CycleSlip,
    DegradedNoise,
    Jamming,
    JumpFault,
    RangeBias,
    SatelliteOutage,
    Spoofing,
    WildSamples,
)
from lvnav_trade.gnss.receiver_cards import DirectSolution
from lvnav_trade.quantities.per_axis import rms
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.quantities.shared_cards import idle_tables
from lvnav_trade.quantities.state_layout import PARAMETERS, ExtraBlock
from lvnav_trade.scenario.filter_models import carrier_smoothing, has_receiver_solution
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.family import RANGES, SENSOR_STATES
from lvnav_trade.sensors.receiver_observables import DIFFERENCES, PHASES
from lvnav_trade.simulation.preparation.cache import cached_sky
from lvnav_trade.simulation.preparation.prepare import PreparedCase

_FLIGHT_LOOP = ("filter.feedback",)
_CONTROL = ("control", "filter.envelope", "trajectory")


class EffectiveSettings(NamedTuple):
    """Settings with an effect on a case, by dotted path in the scenario.

    read : Fields that were read during preparation.
    complete_settings : Settings that are read completely after that.
    idle : Settings without effect although they were read, with the reason.
    exact : Filter states that are known exactly; a card may name them for IMUs with larger errors.
    """

    read: frozenset[str]
    complete_settings: tuple[str, ...]
    idle: Mapping[str, str]
    exact: frozenset[str] = frozenset()


def effective_settings(prepared_case: PreparedCase, read: Collection[str]) -> EffectiveSettings:
    """Return the settings with an effect on a case; read: paths of the fields that its preparation read.

    The simulation and the vehicle under control read further cards later. These are listed here, and a test simulates a
    case to check that the list is complete.
    """
    scenario = prepared_case.scenario
    complete = list(_FLIGHT_LOOP)
    if scenario.control is not None:
        complete += _CONTROL
        for name, card in scenario.sensors.items():
            if card and card.measurement == "attitude":
                complete.append(f"sensors.{name}")
    if prepared_case.plan is not None:
        complete.append("trajectory.control")  # simulated in every run
    exact = dict(_exact_states(prepared_case))
    idle = dict(
        [
            *_unmeasured_states(prepared_case),
            *_unused_delay_compensation(prepared_case),
            *_unused_ranges(scenario),
            *_unused_noise_factors(scenario),
            *_unused_phases(prepared_case),
            *_unused_clock_noise(scenario),
            *_empty_faults(scenario),
            *_unnoticed_outages(prepared_case),
            *_unused_fault_tests(scenario),
        ]
    )
    return EffectiveSettings(
        read=frozenset(read),
        complete_settings=tuple(complete),
        idle=exact | idle,
        exact=frozenset(exact.keys() - idle.keys()),
    )


def _named_states(prepared_case: PreparedCase) -> Iterator[tuple[str, str]]:
    """Yield path and name of the states that the filter card names."""
    for field in ("extra_states", "consider", "as_noise"):
        for number, name in enumerate(getattr(prepared_case.scenario.filter, field)):
            yield f"filter.{field}.{number}", name


def _uncertain_states(prepared_case: PreparedCase) -> set[str]:
    """Return the names of the states with an initial sigma or with driving noise."""
    names = set()
    blocks: list[Any] = [*prepared_case.layout.extras, *prepared_case.layout.parameters]
    for block in blocks:
        if rms(block.sigma) > 0.0 or rms(block.walk) > 0.0:
            names.add(block.name)
    return names


def _unmeasured_states(prepared_case: PreparedCase) -> Iterator[tuple[str, str]]:
    """Yield the states on which no measurement depends: their Jacobian column is zero at every epoch."""
    measured_states = set()
    for block, partial in zip(prepared_case.layout.extras, prepared_case.signals.partial, strict=True):
        enters = _entered_channels(prepared_case, block, partial) & (block.member >= 0)
        if np.any(enters & prepared_case.model.is_processed):
            measured_states.add(block.name)
    for path, name in _named_states(prepared_case):
        if name in SENSOR_STATES and name not in measured_states & _uncertain_states(prepared_case):
            yield path, f"{name}: no sensor has such an error"
        elif name not in PARAMETERS and name not in measured_states:
            yield path, f"{name}: no measurement of the filter depends on it"


def _entered_channels(prepared_case: PreparedCase, block: ExtraBlock, partial: Floats) -> Bools:
    """Return whether a block of states enters the channels, (n_channel,); a constant does not enter a difference."""
    enters = np.asarray(np.any(partial != 0.0, axis=0))
    if np.isinf(block.time_constant) and block.walk == 0.0:
        for name in prepared_case.scenario.filter.differences:
            channels = prepared_case.channels.observable_slice(name)
            difference = np.diff(partial[:, channels], axis=0)
            enters[channels] &= np.any(difference != 0.0, axis=0)
    return enters


def _exact_states(prepared_case: PreparedCase) -> Iterator[tuple[str, str]]:
    for path, name in _named_states(prepared_case):
        if name not in _uncertain_states(prepared_case):
            yield path, f"{name}: its one-sigma is zero, and nothing drives it"


def _unused_delay_compensation(prepared_case: PreparedCase) -> Iterator[tuple[str, str]]:
    """Yield delay compensation without a delay, and settings that only an extrapolated solution has."""
    card = prepared_case.scenario.filter.delay_compensation
    if card is None:
        return
    processing = prepared_case.options.delay_processing
    delays = [] if processing is None else [processing.delay, *(device.delay for device in prepared_case.devices)]
    if not any(np.any(delay > 0.0) for delay in delays):
        yield "filter.delay_compensation", "nothing arrives late: no latency of the receiver or of a sensor"
    elif card.kind == "buffered":
        for field in ("delay_sigma", "acceleration_sigma", "base"):
            yield f"filter.delay_compensation.{field}", "applies to extrapolated solutions only; this one is buffered"


def _unused_noise_factors(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield the noise factors of measurements that receiver or filter do not take."""
    model = scenario.filter.receiver
    filter_tables = () if isinstance(model, str) else model.noise_by
    observables = [DIFFERENCES.get(name, name) for name in scenario.filter.measurements]
    receiver_measurements: Collection[str] = observables
    if has_receiver_solution(scenario):
        receiver_measurements = RANGES if carrier_smoothing(scenario) is None else (*RANGES, "carrier_phase")
        observables = []
    for path, tables, measurements in (
        ("receiver", scenario.receiver.noise_by, receiver_measurements),
        ("filter.receiver", filter_tables, observables),
    ):
        for number in idle_tables(tables, measurements):
            yield f"{path}.noise_by.{number}", "no effect: none of these measurements is taken"


def _unused_ranges(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield faults of ranges and satellites if no ranges are used, and a receiver solution that is not used."""
    is_loose = scenario.filter.loose
    if scenario.filter.tight or has_receiver_solution(scenario):
        return
    if not isinstance(scenario.receiver.solution, DirectSolution):
        yield "receiver.solution", "no effect: the filter does not take the solution, and it is not reported"
    cause = "solution is simulated, not solved from ranges" if is_loose else "measurements are not taken"
    reason = f"no effect: the receiver's {cause}"
    for number, fault in enumerate(scenario.faults):
        affects_ranges = isinstance(fault, RangeBias | ClockJump | ClockDrift)
        affects_receiver = isinstance(fault, Spoofing | Jamming)
        if affects_ranges or (affects_receiver and not is_loose):
            yield f"faults.{number}", reason
        elif isinstance(fault, DegradedNoise | WildSamples):
            for field in fault.elevation_keys:
                yield f"faults.{number}.{field}", reason
            if fault.satellites:
                yield f"faults.{number}.satellites", reason
    if scenario.receiver.is_dual and scenario.atmosphere.ionosphere.kind == "none":
        yield "receiver.frequencies", f"{reason}, and there is no ionosphere"


def _unused_clock_noise(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield the process noise of a clock without memory (differences with a reference satellite)."""
    if scenario.filter.clock == "differenced":
        for number, _ in enumerate(scenario.filter.region_noise):
            for field in ("clock_bias", "clock_drift"):
                yield f"filter.region_noise.{number}.{field}", "no effect: differences forget the clock at every epoch"


def _empty_faults(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield faults of zero duration; as a level of an axis, a zero duration is the case without the fault."""
    for number, fault in enumerate(scenario.faults):
        if not isinstance(fault, JumpFault) and fault.duration == 0.0:
            yield f"faults.{number}", "no effect: it lasts no time"


def _unnoticed_outages(prepared_case: PreparedCase) -> Iterator[tuple[str, str]]:
    """Yield outages that do not change the tracked satellites.

    They keep all satellites, affect elevations without satellites, or lie within another outage.
    """
    scenario = prepared_case.scenario
    start = float(prepared_case.reference.t[0])
    for number, fault in enumerate(scenario.faults):
        if not isinstance(fault, SatelliteOutage) or fault.duration == 0.0:
            continue
        remaining = (*scenario.faults[:number], *scenario.faults[number + 1 :])
        fault_free_scenario = scenario.model_copy(update={"faults": remaining})
        sky = cached_sky(fault_free_scenario, prepared_case.trajectory, prepared_case.t_epoch, start)
        if np.array_equal(sky.is_tracked, prepared_case.sky.is_tracked):
            n_tracked = sky.is_tracked.sum(axis=1)
            max_tracked = int(n_tracked.max(initial=0))
            yield f"faults.{number}", _no_loss(fault, len(sky.names), max_tracked)


def _no_loss(fault: SatelliteOutage, n_sat: int, max_tracked: int) -> str:
    """Return the reason why an outage removes no satellite; max_tracked: most satellites tracked at once."""
    if fault.keep >= n_sat:
        return f"no effect: it keeps {fault.keep} satellites, and the constellation has {n_sat}"
    if fault.keep >= max_tracked:
        return f"no effect: it keeps {fault.keep} satellites, and the receiver tracks {max_tracked} at most"
    return "no effect: the receiver tracks the same satellites without it"


def _unused_fault_tests(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield settings of fault tests for measurements that the filter does not process."""
    if not (scenario.filter.tight or scenario.filter.loose):
        yield "filter.integrity", "no effect: it tests measurements of the receiver, and the filter uses none"
    elif scenario.filter.loose:
        for field in ("isolation", "exclusions"):
            yield f"filter.integrity.{field}", "no effect: a solution has no redundancy, only ranges are compared"


def _unused_phases(prepared_case: PreparedCase) -> Iterator[tuple[str, str]]:
    """Yield settings of carrier phases in a case that neither measures them nor smooths pseudoranges by them."""
    scenario = prepared_case.scenario
    if carrier_smoothing(scenario) is not None or any(name in PHASES for name in prepared_case.channels.further):
        return
    reason = "no effect: no carrier phase is measured (carrier_phase, tdcp), and none smooths pseudoranges (smoothing)"
    for field in ("carrier_phase_sigma", "cycle_slips"):
        yield f"receiver.{field}", reason
    for number, fault in enumerate(scenario.faults):
        if isinstance(fault, CycleSlip):
            yield f"faults.{number}", reason
