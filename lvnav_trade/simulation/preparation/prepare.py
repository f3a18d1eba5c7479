"""Preparation of a scenario for both engines: everything that all runs share, computed once."""

from lvnav_trade.quantities.records import Floats, Reference
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.filtering import CaseFilter, filtering_of, initial_state, layout_of
from lvnav_trade.simulation.preparation.imu import TrueImu, imu_of
from lvnav_trade.simulation.preparation.inputs import Options
from lvnav_trade.simulation.preparation.measurements import Measurements, measurements_of
from lvnav_trade.simulation.preparation.mode_rules import integrity_of
from lvnav_trade.simulation.preparation.options import delay_processing, iteration_settings
from lvnav_trade.simulation.preparation.prepared_case import PreparedCase as PreparedCase
from lvnav_trade.simulation.preparation.reporting import Reporting, reporting_of, solution_of
from lvnav_trade.simulation.preparation.schedule import Times, times_of
from lvnav_trade.simulation.preparation.sensors import sensor_arrays
from lvnav_trade.simulation.preparation.true_flight import TrueFlight, flight_of
from lvnav_trade.simulation.preparation.vehicle_model import samples_of, vehicle_of
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent
from lvnav_trade.trajectory.flight import Trajectory
from lvnav_trade.trajectory.guided.guidance_plan import GuidancePlan, plan_ascent

GUIDED_HISTORY = 1.0
"""Longest step (s) between history times of a guided ascent. Guidance runs once per second and reads the navigation
errors at these times.
"""


def prepare(
    scenario: Scenario,
    history: float = 1.0,
    additional_times: Floats | None = None,
    given_flight: tuple[Trajectory, Reference] | None = None,
) -> PreparedCase:
    """Prepare a scenario in four stages, each with one record: flight, schedule, filter, measurements.

    Records of the IMUs, of the receiver's solution and of the results follow from these.

    Parameters
    ----------
    scenario
        Validated model of the case.
    history
        s. Interval of the history times; every event time is added to them.
    additional_times
        s. History times of a block of runs, for a replay of one of them. Every covariance step is recorded in addition.
        Windows are divided as in the block, so the run has the same bits.
    given_flight
        Trajectory and its samples, in place of those of the scenario.
    """
    flight = flight_of(scenario, given_flight)
    layout = layout_of(scenario, flight)
    if _is_guided(scenario):
        history = min(history, GUIDED_HISTORY)
    times = times_of(scenario, flight, layout, history, additional_times)
    filtering = filtering_of(scenario, flight, layout, times)
    measurements = measurements_of(scenario, flight, filtering)
    imu = imu_of(scenario, flight, layout)
    solution = solution_of(scenario, measurements.chain, flight.channels, layout, measurements.solver)
    reporting = reporting_of(scenario, flight, times, layout, solution)
    return PreparedCase(
        scenario=scenario,
        trajectory=flight.trajectory,
        reference=flight.reference,
        sky=flight.sky,
        outputs=reporting.outputs,
        layout=layout,
        model=filtering.model,
        sources=imu.terms,
        families=measurements.errors,
        schedule=times.schedule,
        unit=imu.unit,
        signals=measurements.signals,
        initial_state=initial_state(scenario, flight.reference, filtering),
        record=reporting.record,
        motion=reporting.motion,
        t_hist=times.t_hist,
        t_epoch=flight.epochs.t,
        lengths=times.lengths,
        atmospheric_delays=flight.atmospheric_delays,
        recorded_errors=measurements.recorded_errors,
        options=_options(scenario, flight, times, filtering, measurements, imu, reporting),
        chain=measurements.chain,
        devices=flight.devices,
        sensors=sensor_arrays(flight.devices, flight.channels, flight.epochs.t.size) if flight.devices else None,
        channels=flight.channels,
        channel_names=reporting.channel_names,
        failed_check=measurements.failed_check,
        plan=_plan(scenario),
    )


def _is_guided(scenario: Scenario) -> bool:
    """Return whether guidance steers each run by its own navigation errors."""
    card = scenario.trajectory
    return isinstance(card, VehicleAscent) and card.guidance != "nominal"


def _plan(scenario: Scenario) -> GuidancePlan | None:
    """Return the guidance plan computed before lift-off; None if every run has the nominal ascent."""
    card = scenario.trajectory
    return plan_ascent(card) if isinstance(card, VehicleAscent) and _is_guided(scenario) else None


def _options(
    scenario: Scenario,
    flight: TrueFlight,
    times: Times,
    filtering: CaseFilter,
    measurements: Measurements,
    imu: TrueImu,
    reporting: Reporting,
) -> Options:
    """Return the optional features of a case; None for each feature that it lacks."""
    card, layout, model, ref = scenario.filter, filtering.layout, filtering.model, flight.reference
    integrity = card.integrity
    return Options(
        solver=measurements.solver,
        rules=measurements.rules,
        delay_processing=delay_processing(scenario, times.delays, times.clone_times, times.schedule, flight.channels),
        gains=filtering.gains,
        vehicle=vehicle_of(scenario, flight.trajectory, ref, layout),
        reported_samples=samples_of(scenario, ref, layout),
        reported_solution=reporting.solution,
        imu_array=imu.units,
        direct=True if card.feedback == "direct" else None,
        backup=reporting.backup,
        further_observables=measurements.further,
        differences=measurements.differences,
        has_sigma_points=True if card.algorithm == "unscented" else None,
        fault_tests=None
        if integrity is None
        else integrity_of(integrity, measurements.signals, model, card.update_rate),
        iteration_settings=iteration_settings(card, layout),
    )
