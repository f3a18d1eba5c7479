"""Guided ascents, run by run: from draws and navigation errors to the state at cut-off."""

from typing import NamedTuple

import numpy as np

from lvnav_trade.quantities.reads import result_cache
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.legs import mass_above
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent
from lvnav_trade.trajectory.guided.autopilot import DrawKeys
from lvnav_trade.trajectory.guided.course import ascend
from lvnav_trade.trajectory.guided.draws import Sigmas, air_density_factor, deviations, run_vehicle
from lvnav_trade.trajectory.guided.guidance_plan import GuidancePlan
from lvnav_trade.trajectory.guided.guided_dynamics import PERFECT, NavigationErrors, error_at
from lvnav_trade.trajectory.guided.missions import Launch, attitude_control, launch_wind, steered_launch
from lvnav_trade.trajectory.guided.pilots import ADRIFT, INJECTED, GuidedPilot, TurningPilot


class Injection(NamedTuple):
    """The end of a run.

    outcome : One of `records.OUTCOMES`.
    t : s since lift-off. Time of the cut-off, or of an earlier end of the flight.
    y : (7,). True position (m), velocity (m/s), frame i, and mass (kg) at that time.
    propellant_left : kg. Remaining propellant of the last stage.
    error : (9,). Navigation errors at that time, as in `NavigationErrors`.
    """

    outcome: str
    t: float
    y: Floats
    propellant_left: float
    error: Floats


def empty_mass(vehicle: VehicleAscent) -> float:
    """Return the mass (kg) of the last stage without propellant, with its payload."""
    stages = vehicle.vehicle.stages
    return stages[-1].dry + mass_above(vehicle, len(stages))


def inject(
    plan: GuidancePlan, sigmas: Sigmas, navigation: NavigationErrors = PERFECT, draws: DrawKeys | None = None
) -> Injection:
    """Simulate one run.

    Parameters
    ----------
    plan : GuidancePlan
    sigmas : Draws of the vehicle's error sources, in sigmas, see `draws`.
    navigation : Navigation errors over the flight, from the filter on the nominal flight.
    draws : Keys of the noises, gusts and misalignments of a vehicle under attitude control; keys of zero if absent.
    """
    if not np.all(np.isfinite(navigation.error)):
        return Injection(
            outcome=ADRIFT,
            t=np.nan,
            y=np.full(7, np.nan),
            propellant_left=np.nan,
            error=np.full(9, np.nan),
        )
    vehicle = run_vehicle(plan.card, sigmas)
    pilot = _make_pilot(plan, vehicle, sigmas, navigation, draws)
    outcome = pilot.fly()
    propellant = float(pilot.y[6]) - empty_mass(vehicle)
    if outcome == INJECTED:
        pilot.push(pilot.deviations.tail_off)
    return Injection(
        outcome=outcome,
        t=pilot.t,
        y=pilot.y[:7],
        propellant_left=max(0.0, propellant),
        error=error_at(pilot.t, navigation),
    )


def _make_pilot(
    plan: GuidancePlan, vehicle: VehicleAscent, sigmas: Sigmas, navigation: NavigationErrors, draws: DrawKeys | None
) -> GuidedPilot:
    """Return the pilot that simulates a run: with attitude control, or with an attitude that follows its command.

    Parameters
    ----------
    plan : GuidancePlan
        Guidance data stored before lift-off.
    vehicle : VehicleAscent
        Card of the vehicle of the run.
    sigmas : Sigmas
        Draws of the run, in sigmas, by source.
    navigation : NavigationErrors
        Navigation errors of the run.
    draws : DrawKeys, optional
        Keys of the random draws of the controlled attitude; by default all are zero.
    """
    run_deviations = deviations(plan.card, sigmas)
    control = plan.card.control
    if control is None:
        return GuidedPilot(plan, vehicle, run_deviations, navigation)
    # The excluded settings change the runs, but not the launch that they have in common.
    content = plan.card.model_dump_json(exclude={"named_times", "cutoff", "dispersion"})
    launch = _cached_launch(content, plan.card)
    draws = draws or DrawKeys(np.uint64(0), np.uint64(0), np.uint64(0))
    density = air_density_factor(plan.card, sigmas)
    turning = attitude_control(launch, control.feedback, draws, uses_run_navigation=True, density=density)
    wind = launch_wind(launch, draws, run_deviations.wind)
    return TurningPilot(plan, vehicle, run_deviations._replace(wind=wind), navigation, turning)


@result_cache(4)
def _cached_launch(key: str, card: VehicleAscent) -> Launch:
    assert card.control is not None
    return steered_launch(ascend(card), card.control)
