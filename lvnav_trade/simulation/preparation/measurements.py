"""Measurements of a case: true values, noise model of the filter, and the receiver's solution."""

from typing import NamedTuple

import numpy as np

from lvnav_trade.filter.policies.epoch_differences import DifferenceProcessing
from lvnav_trade.filter.policies.mode_logic import ModeRules
from lvnav_trade.filter.receivers.receiver import Solver
from lvnav_trade.gnss.satellites import time_offsets
from lvnav_trade.quantities.line_of_sight import pdop
from lvnav_trade.quantities.records import Floats, Ints
from lvnav_trade.scenario.filter_models import epoch_interval, filter_models, has_covariance
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.sensor import CorrelatedError
from lvnav_trade.simulation.preparation.correlated import EnteringError, correlated_errors_of, entering_errors
from lvnav_trade.simulation.preparation.filtering import CaseFilter
from lvnav_trade.simulation.preparation.inputs import FurtherObservables, Signals
from lvnav_trade.simulation.preparation.mode_rules import failed_checks, mode_rules_of, used_satellite_count
from lvnav_trade.simulation.preparation.options import solver_of
from lvnav_trade.simulation.preparation.signals.doppler import doppler_residual, relativity_residual
from lvnav_trade.simulation.preparation.signals.phases_and_differences import (
    difference_processing,
    further_observables,
    reference_slots,
)
from lvnav_trade.simulation.preparation.signals.receiver_measurements import (
    AssumedNoise,
    TrueSignals,
    UsedSatellites,
    assumed_noise_of,
    geometry_of,
    signals_of,
    true_signals_of,
)
from lvnav_trade.simulation.preparation.signals.recorded_solution import RecordedErrors, recorded_solution_errors
from lvnav_trade.simulation.preparation.signals.smoothing import smoothing_gains, smoothing_numbers, smoothing_offsets
from lvnav_trade.simulation.preparation.signals.solution import SolutionErrorModel, solution_error_model
from lvnav_trade.simulation.preparation.true_flight import TrueFlight


class Measurements(NamedTuple):
    """Measurements of a case.

    signals : Satellites and receiver for the kernels.
    errors : Correlated measurement errors.
    recorded_errors : Recorded errors of the receiver's solution.
    failed_check : (n_epoch,). Number of the input check that the receiver's sample fails, 0 none.
    rules : Mode logic of the filter; None without.
    solver : Settings by which the receiver computes its solution; None if it does not.
    chain : Error propagation of its solution; None without a reported covariance.
    further : True carrier phases and differences of two epochs; None without.
    differences : Processing of these in the filter; None without.
    """

    signals: Signals
    errors: tuple[CorrelatedError, ...]
    recorded_errors: RecordedErrors
    failed_check: Ints
    rules: ModeRules | None
    solver: Solver | None
    chain: SolutionErrorModel | None
    further: FurtherObservables | None
    differences: DifferenceProcessing | None


class _Ranging(NamedTuple):
    """Measurements of the receiver before the filter uses them.

    true_signals : True side.
    error_entries : Correlated errors and the measurements that they enter.
    recorded_errors : Recorded errors of the solution.
    smoothing : (n_epoch, n_sat). Gains of carrier smoothing; None without.
    offsets : (n_epoch, n_sat, 2) m, m/s. Offsets of satellite clocks and system times.
    """

    true_signals: TrueSignals
    error_entries: tuple[EnteringError, ...]
    recorded_errors: RecordedErrors
    smoothing: Floats | None
    offsets: Floats


def measurements_of(scenario: Scenario, flight: TrueFlight, filtering: CaseFilter) -> Measurements:
    """Return the measurements of a case: of the receiver and of the sensors that its filter uses.

    Parameters
    ----------
    scenario, flight
        Validated model of the case, and its true flight.
    filtering
        Filter of the case.
    """
    card = scenario.filter
    channels = flight.channels
    sky = flight.sky
    ranging = _ranging(scenario, flight, filtering)
    true_signals = ranging.true_signals
    assumed_noise = assumed_noise_of(scenario, flight, filtering)

    def dilution() -> Floats:
        return pdop(flight.lines.sight.direction, sky.is_tracked)

    check = failed_checks(card, flight.failures, true_signals.n_used, channels, dilution)
    rules = mode_rules_of(card, check, channels, filtering.P)
    smoothing = smoothing_numbers(scenario, ranging.smoothing, sky, flight.lines, ranging.error_entries)
    _, receiver, _ = filter_models(scenario)
    solver = solver_of(scenario, receiver, true_signals.satellite_by_slot.shape[1], smoothing)
    chain = solution_error_model(solver, has_covariance(scenario), true_signals, assumed_noise, flight.lines)
    n_used = used_satellite_count(rules, true_signals.n_used, chain)
    in_use = UsedSatellites(true_signals.satellite_by_slot, n_used, true_signals.is_frozen)
    errors = tuple(item.error for item in ranging.error_entries)
    differences = difference_processing(scenario, flight, filtering, in_use)
    reference = reference_slots(scenario, flight, in_use, differences)
    if solver is not None and chain is not None:
        assumed_noise = _add_reported_variance(assumed_noise, chain)
    return Measurements(
        signals=signals_of(flight, true_signals, assumed_noise, in_use, reference),
        errors=errors,
        recorded_errors=ranging.recorded_errors,
        failed_check=check,
        rules=rules,
        solver=solver,
        chain=chain,
        further=further_observables(scenario, flight, in_use, errors, ranging.offsets[..., 0]),
        differences=differences,
    )


def _ranging(scenario: Scenario, flight: TrueFlight, filtering: CaseFilter) -> _Ranging:
    """Return the measurements of the receiver; of the filter only the states that model errors are used."""
    sky = flight.sky
    line = flight.lines
    delays = flight.atmospheric_delays
    failures = flight.failures
    trajectory = flight.trajectory
    channels = flight.ranging
    geometry = geometry_of(line, sky.is_tracked, delays.troposphere, delays.ionosphere)
    drawn_errors = entering_errors(scenario, geometry, channels, failures, flight.devices)
    recorded_errors = recorded_solution_errors(scenario, trajectory.theta0, line, sky, channels, failures.is_frozen)
    error_entries = (*drawn_errors, *recorded_errors.errors)
    shape = (flight.epochs.t.size, channels.n_channel)
    correlated_errors = correlated_errors_of(error_entries, filtering.layout, epoch_interval(scenario), shape)
    offsets = time_offsets(scenario.constellation, sky.systems, trajectory.epoch, sky.t)
    offsets = offsets + relativity_residual(scenario, flight)
    gain = smoothing_gains(scenario, sky)
    residual = delays.residual + offsets + doppler_residual(scenario, flight)
    code_delay = delays.ionosphere[:, :, 0]
    residual = residual + smoothing_offsets(scenario, gain, code_delay, failures.slip, line)
    return _Ranging(
        true_signals=true_signals_of(scenario, flight, correlated_errors, residual, recorded_errors.mean),
        error_entries=error_entries,
        recorded_errors=recorded_errors,
        smoothing=gain,
        offsets=offsets,
    )


def _add_reported_variance(assumed_noise: AssumedNoise, chain: SolutionErrorModel) -> AssumedNoise:
    """Return the noise model of the filter with the variances that the receiver reports for its solution."""
    variance = assumed_noise.variance.copy()
    variance[:, :6] = np.diagonal(chain.reported_covariance, axis1=1, axis2=2)
    return AssumedNoise(variance, assumed_noise.scale, assumed_noise.beta, assumed_noise.partial)
