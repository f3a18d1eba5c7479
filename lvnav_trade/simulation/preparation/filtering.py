"""Filter of a case: state layout, model as arrays, initial covariance."""

from typing import NamedTuple

import numpy as np

from lvnav_trade.filter.initial_covariance import initial_covariance
from lvnav_trade.filter.model import FilterModel, build_filter_model
from lvnav_trade.filter.policies.stored_gains import StoredGains
from lvnav_trade.filter.states import FilterMeasurements, state_layout
from lvnav_trade.filter.strapdown_algorithm import build_strapdown
from lvnav_trade.kernels.random import source_word
from lvnav_trade.kernels.strapdown import Strapdown
from lvnav_trade.quantities.frames import earth_angle, reporting_axes
from lvnav_trade.quantities.records import Floats, Reference
from lvnav_trade.quantities.shared_cards import EnvelopeCard
from lvnav_trade.quantities.state_layout import StateLayout
from lvnav_trade.scenario.filter_models import filter_measurements, filter_models, has_covariance, has_receiver_solution
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.inputs import InitialState
from lvnav_trade.simulation.preparation.options import epochs_per_update, gains_of
from lvnav_trade.simulation.preparation.schedule import Times
from lvnav_trade.simulation.preparation.true_flight import TrueFlight


class CaseFilter(NamedTuple):
    """Filter of a case.

    layout : States of the filter.
    model : The filter as arrays.
    gains : Stored gains; None if the filter computes its gains.
    C_n_i : (3, 3). Rotation from north, east, down at the start to frame i.
    P : (n_state, n_state) SI squared. Initial covariance.
    """

    layout: StateLayout
    model: FilterModel
    gains: StoredGains | None
    C_n_i: Floats
    P: Floats


def filter_measurements_of(scenario: Scenario, flight: TrueFlight) -> FilterMeasurements:
    """Return sensor models, channels and measurements that the filter of a case is built from."""
    imu, receiver, initial = filter_models(scenario)
    lever_b = np.array(scenario.receiver.lever_b)
    return FilterMeasurements(
        imu=imu,
        receiver=receiver,
        channels=flight.channels,
        measurements=filter_measurements(scenario),
        lever_arms=flight.sky.lever_arms if flight.channels.tight else lever_b[None, :],
        decimation=epochs_per_update(scenario),
        has_covariance=has_covariance(scenario),
        has_solver=has_receiver_solution(scenario),
        clock_drift=initial.clock_drift,
    )


def layout_of(scenario: Scenario, flight: TrueFlight) -> StateLayout:
    """Return the states of the filter of a case."""
    return state_layout(scenario.filter, filter_measurements_of(scenario, flight))


def filtering_of(scenario: Scenario, flight: TrueFlight, layout: StateLayout, times: Times) -> CaseFilter:
    """Return the filter of a case for the windows of its schedule."""
    card, ref, trajectory = scenario.filter, flight.reference, flight.trajectory
    gains = gains_of(scenario, layout, flight.channels, flight.epochs.t, trajectory.events)
    model = build_filter_model(
        card,
        layout,
        filter_measurements_of(scenario, flight),
        times.lengths,
        _strapdown(scenario, flight),
        times.injected_variance,
        None if gains is None else gains.is_stored,
    )
    C_n_i = reporting_axes("ned", ref.t[:1], ref.r_i[:1], ref.v_i[:1], trajectory.theta0)[0].T
    _, _, initial = filter_models(scenario)
    P = initial_covariance(layout, initial, C_n_i, card.envelope or EnvelopeCard())
    return CaseFilter(layout, model, gains, C_n_i, P)


def initial_state(scenario: Scenario, ref: Reference, filtering: CaseFilter) -> InitialState:
    """Return the true state at tick 0, and the covariances of the initial error."""
    initial = scenario.initial
    attitude_n = np.diag([initial.tilt, initial.tilt, initial.heading])
    attitude = filtering.C_n_i @ attitude_n
    velocity = np.eye(3) * initial.velocity
    position = np.eye(3) * initial.position
    roots = np.array([attitude, velocity, position])
    source_keys = [source_word(f"initial {name}") for name in ("attitude", "velocity", "position")]
    return InitialState(
        nav=np.concatenate([ref.q_b_i[0], ref.v_i[0], ref.r_i[0]]),
        roots=roots,
        source_keys=np.array(source_keys, dtype=np.uint64),
        P=filtering.P,
    )


def _strapdown(scenario: Scenario, flight: TrueFlight) -> Strapdown:
    """Return the strapdown algorithm, with Earth rotation angle and position at the start of the flight."""
    card = scenario.filter
    ref = flight.reference
    initial_r_i = ref.r_i[0]
    earth_rotation = float(earth_angle(flight.trajectory.theta0, ref.t[0]))
    squared_increments = np.sum(ref.dtheta * ref.dtheta, axis=1)
    largest_increment = float(np.sqrt(np.max(squared_increments)))
    return build_strapdown(
        card.strapdown, card.gravity, card.mechanisation, earth_rotation, initial_r_i, largest_increment
    )
