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
from lvnav_trade.simulation.preparation.correlated import EnteringError, entering_errors, shared_of
from lvnav_trade.simulation.preparation.filtering import CaseFilter
from lvnav_trade.simulation.preparation.inputs import FurtherObservables, Signals
from lvnav_trade.simulation.preparation.mode_rules import failing, satellites_taken, watched
from lvnav_trade.simulation.preparation.options import solver_of
from lvnav_trade.simulation.preparation.signals.doppler import doppler_left, relativity_left
from lvnav_trade.simulation.preparation.signals.phases_and_differences import delayed_of, further_of, references_of
from lvnav_trade.simulation.preparation.signals.receiver_measurements import (
    AssumedNoise,
    TrueSignals,
    UsedSatellites,
    assumed_of,
    geometry_of,
    received_of,
    signals_of,
)
from lvnav_trade.simulation.preparation.signals.recorded_solution import RecordedErrors, recorded
from lvnav_trade.simulation.preparation.signals.smoothing import smoothing_gains, smoothing_numbers, smoothing_offsets
from lvnav_trade.simulation.preparation.signals.solution import SolutionErrorModel, chain_of
from lvnav_trade.simulation.preparation.true_flight import TrueFlight


class Measurements(NamedTuple):
    """Measurements of a case.

    signals : Satellites and receiver for the kernels.
    errors : Correlated measurement errors.
    recorded : Recorded errors of the receiver's solution.
    failing : (n_epoch,). Number of the input check that the receiver's sample fails, 0 none.
    rules : Mode logic of the filter; None without.
    solver : Settings by which the receiver computes its solution; None if it does not.
    chain : Error propagation of its solution; None without a reported covariance.
    further : True carrier phases and differences of two epochs; None without.
    delayed : Processing of these in the filter; None without.
    """

    signals: Signals
    errors: tuple[CorrelatedError, ...]
    recorded: RecordedErrors
    failing: Ints
    rules: ModeRules | None
    solver: Solver | None
    chain: SolutionErrorModel | None
    further: FurtherObservables | None
    delayed: DifferenceProcessing | None


class _Ranging(NamedTuple):
    """Measurements of the receiver before the filter uses them.

    received : True side.
    entering : Correlated errors and the measurements that they enter.
    recorded : Recorded errors of the solution.
    smoothing : (n_epoch, n_sat). Gains of carrier smoothing; None without.
    offsets : (n_epoch, n_sat, 2) m, m/s. Offsets of satellite clocks and system times.
    """

    received: TrueSignals
    entering: tuple[EnteringError, ...]
    recorded: RecordedErrors
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
    received = ranging.received
    assumed = assumed_of(scenario, flight, filtering)

    def dilution() -> Floats:
        return pdop(flight.lines.sight.direction, sky.tracked)

    check = failing(card, flight.failed, received.n_used, channels, dilution)
    rules = watched(card, check, channels, filtering.P)
    smoothing = smoothing_numbers(scenario, ranging.smoothing, sky, flight.lines, ranging.entering)
    _, receiver, _ = filter_models(scenario)
    solver = solver_of(scenario, receiver, received.used.shape[1], smoothing)
    chain = chain_of(solver, has_covariance(scenario), received, assumed, flight.lines)
    n_used = satellites_taken(rules, received.n_used, chain)
    in_use = UsedSatellites(received.used, n_used, received.frozen)
    errors = tuple(item.error for item in ranging.entering)
    delayed = delayed_of(scenario, flight, filtering, in_use)
    reference = references_of(scenario, flight, in_use, delayed)
    if solver is not None and chain is not None:
        assumed = _add_reported_variance(assumed, chain)
    return Measurements(
        signals=signals_of(flight, received, assumed, in_use, reference),
        errors=errors,
        recorded=ranging.recorded,
        failing=check,
        rules=rules,
        solver=solver,
        chain=chain,
        further=further_of(scenario, flight, in_use, errors, ranging.offsets[..., 0]),
        delayed=delayed,
    )


def _ranging(scenario: Scenario, flight: TrueFlight, filtering: CaseFilter) -> _Ranging:
    """Return the measurements of the receiver; of the filter only the states that model errors are used."""
    sky = flight.sky
    line = flight.lines
    delays = flight.delays
    failed = flight.failed
    trajectory = flight.trajectory
    channels = flight.ranging
    geometry = geometry_of(line, sky.tracked, delays.troposphere, delays.ionosphere)
    drawn_errors = entering_errors(scenario, geometry, channels, failed, flight.devices)
    recorded_errors = recorded(scenario, trajectory.theta0, line, sky, channels, failed.frozen)
    entering = (*drawn_errors, *recorded_errors.errors)
    shape = (flight.epochs.t.size, channels.n_channel)
    shared = shared_of(entering, filtering.layout, epoch_interval(scenario), shape)
    offsets = time_offsets(scenario.constellation, sky.systems, trajectory.epoch, sky.t)
    offsets = offsets + relativity_left(scenario, flight)
    gain = smoothing_gains(scenario, sky)
    residual = delays.residual + offsets + doppler_left(scenario, flight)
    code_delay = delays.ionosphere[:, :, 0]
    residual = residual + smoothing_offsets(scenario, gain, code_delay, failed.slip, line)
    return _Ranging(
        received=received_of(scenario, flight, shared, residual, recorded_errors.mean),
        entering=entering,
        recorded=recorded_errors,
        smoothing=gain,
        offsets=offsets,
    )


def _add_reported_variance(assumed: AssumedNoise, chain: SolutionErrorModel) -> AssumedNoise:
    """Return the noise model of the filter with the variances that the receiver reports for its solution."""
    variance = assumed.variance.copy()
    variance[:, :6] = np.diagonal(chain.reported, axis1=1, axis2=2)
    return AssumedNoise(variance, assumed.scale, assumed.beta, assumed.partial)
