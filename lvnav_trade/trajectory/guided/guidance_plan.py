"""Guidance data stored before lift-off: attitude programme, target of the last burn, nominal cut-off."""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from lvnav_trade.kernels.earth import GM
from lvnav_trade.quantities.frames import unit
from lvnav_trade.quantities.reads import result_cache
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.dispersion import dispersed_ascent
from lvnav_trade.trajectory.ascent.dispersion_card import SOURCES
from lvnav_trade.trajectory.ascent.legs import SimulatedAscent, TargetingUnknowns
from lvnav_trade.trajectory.ascent.steering_law import directions
from lvnav_trade.trajectory.ascent.targeting import injection_point
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent
from lvnav_trade.trajectory.guided.explicit import Target
from lvnav_trade.trajectory.guided.guided_dynamics import AttitudeProgramme

_STEP = 0.05  # s, of the stored attitude: between its entries the direction is known to 1e-5 rad


class GuidancePlan(NamedTuple):
    """A guided ascent before lift-off.

    card : The ascent.
    aim : Its solved steering.
    programme : Direction of the thrust over time, to the end of the flight.
    target : Target of explicit guidance at the end of the last burn.
    energy : J/kg. Specific energy (two-body) of the nominal flight at its cut-off.
    cutoff : s since lift-off. Nominal time of the cut-off.
    nominal : (7,). State of the nominal flight at its cut-off.
    explicit : Whether the last stage steers by the navigated state.
    has_energy_cutoff : Whether it is cut off at an energy; otherwise at a time.
    spreads : Sigma of each source that is dispersed, by its name.
    lag : s. Time constant with which the body follows its command; 0: at once.
    schuler : Whether explicit guidance predicts gravity by the Schuler approximation.
    """

    card: VehicleAscent
    aim: TargetingUnknowns
    programme: AttitudeProgramme
    target: Target
    energy: float
    cutoff: float
    nominal: Floats
    explicit: bool = False
    has_energy_cutoff: bool = True
    spreads: tuple[tuple[str, float], ...] = ()
    lag: float = 0.0
    schuler: bool = False


def steering_times(plan: GuidancePlan, t: Floats) -> slice:
    """Return the part of the times (n,) of a nominal flight from which guidance takes navigation errors.

    It ends at the nominal cut-off. A run that burns longer keeps the errors of that time, because the nominal vehicle
    has no thrust afterwards and its navigation errors develop differently.
    """
    count = np.searchsorted(t, plan.cutoff + 1e-6, side="right")
    return slice(0, int(count))


def plan_ascent(card: VehicleAscent) -> GuidancePlan:
    """Return the guidance data of an ascent; InputError if its vehicle does not reach the target."""
    # Fields that do not change the solved nominal ascent
    excluded_fields = {"named_times", "guidance", "cutoff", "dispersion", "control", "attitude_lag"}
    nominal_plan = _cached_plan(card.model_dump_json(exclude=excluded_fields), card)
    return nominal_plan._replace(
        card=card,
        explicit=card.guidance in ("explicit", "schuler"),
        schuler=card.guidance == "schuler",
        has_energy_cutoff=card.cutoff == "energy",
        spreads=_spreads(card),
        lag=card.attitude_lag or 0.0,
    )


def _spreads(card: VehicleAscent) -> tuple[tuple[str, float], ...]:
    """Return name and sigma of each source that is dispersed."""
    dispersion, spreads = card.dispersion, card.vehicle.dispersions
    if dispersion is None or spreads is None:
        return ()
    dispersed_sources = (*dispersion.drawn_sources, *dispersion.sigmas)
    return tuple((name, float(getattr(spreads, name))) for name in SOURCES if name in dispersed_sources)


@result_cache(4)
def _cached_plan(key: str, card: VehicleAscent) -> GuidancePlan:
    _, aim, flight = dispersed_ascent(card)
    return plan_solved_ascent(card, aim, flight)


def plan_solved_ascent(card: VehicleAscent, aim: TargetingUnknowns, flight: SimulatedAscent) -> GuidancePlan:
    """Return the guidance data of a solved ascent: attitude programme, target and cut-off.

    Parameters
    ----------
    card : VehicleAscent
        Card of the ascent.
    aim : TargetingUnknowns
        Solution of the targeting.
    flight : SimulatedAscent
        The simulated ascent. Its last burn before injection defines the target.
    """
    injection = flight.events["injection"]
    last = next(leg for leg in reversed(flight.legs) if leg.t[-1] <= injection + 1e-9)
    cutoff_state = last.y[-1]
    r, v = cutoff_state[:3], cutoff_state[3:6]
    entry = injection_point(card)
    target = Target(
        radius=entry.radius,
        speed=entry.speed,
        flight_path_angle=entry.climb,
        normal=unit(np.cross(r, v)),
        place=r.copy(),
    )
    energy = 0.5 * float(v @ v) - GM / float(np.linalg.norm(r))
    return GuidancePlan(
        card=card,
        aim=aim,
        programme=_programme(flight),
        target=target,
        energy=energy,
        cutoff=float(last.t[-1]),
        nominal=cutoff_state.copy(),
    )


def _programme(flight: SimulatedAscent) -> AttitudeProgramme:
    """Return the direction of the thrust of a flight on even times."""
    t = np.arange(0.0, flight.legs[-1].t[-1], _STEP)
    y = np.empty((t.size, 6))
    for leg in flight.legs:
        is_begun = t >= leg.t[0]
        is_before_end = t <= leg.t[-1]
        inside = is_begun & is_before_end
        r = leg.y[:, :3]
        v = leg.y[:, 3:6]
        position = CubicHermiteSpline(leg.t, r, v)
        velocity = CubicSpline(leg.t, v)
        y[inside, :3] = position(t[inside])
        y[inside, 3:] = velocity(t[inside])
    return AttitudeProgramme(_STEP, directions(t, y, flight.steering))
