"""True trajectory of a solved ascent: splines over pad and legs, events, facts for the report."""

import numpy as np
from scipy.interpolate import BSpline, PPoly

from lvnav_trade.kernels.earth import SEMI_MAJOR, gravity_along
from lvnav_trade.kernels.media.atmosphere import atmosphere
from lvnav_trade.quantities import frames
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.dispersion import dispersed_ascent
from lvnav_trade.trajectory.ascent.equations_of_motion import accelerations
from lvnav_trade.trajectory.ascent.legs import AscentLeg, SimulatedAscent, TargetingUnknowns, pad_state, site_axes
from lvnav_trade.trajectory.ascent.record import differences
from lvnav_trade.trajectory.ascent.steering_law import ascent_attitude, directions
from lvnav_trade.trajectory.ascent.targeting import flight_propellant_left
from lvnav_trade.trajectory.ascent.vehicle_cards import STANDARD_GRAVITY, Site, VehicleAscent
from lvnav_trade.trajectory.truth import Phase, Trajectory, join_samples, pad_phase, spline_phase


def build_ascent(card: VehicleAscent) -> Trajectory:
    """Return the true trajectory of a vehicle card; InputError if it cannot reach the orbit."""
    vehicle, aim, flight = dispersed_ascent(card)
    theta0 = flight.steering.theta0
    attitude = _attitude(card, aim, flight)
    ends = [0, -1]  # end values of a phase's acceleration are from the equations of motion
    phases = []
    for leg in flight.legs:
        end_accelerations = _accelerations(flight, leg, ends)
        phases.append(spline_phase(leg.name, leg.t, leg.y[:, :3], leg.y[ends, 3:6], end_accelerations, attitude))
    pad = site_phase(card.site, theta0, card.pad_hold, attitude)
    max_q_time, max_q = _max_q(flight)
    trajectory = Trajectory(
        phases=(*pad, *phases),
        events={**flight.events, "max_q": max_q_time},
        theta0=theta0,
        epoch=card.epoch,
        facts=_facts(vehicle, aim, flight, max_q),
    )
    if card.recorded is not None:
        trajectory.facts.update(differences(card.recorded, trajectory, card.site))
    return trajectory


def site_phase(
    site: Site, theta0: float, hold: float, attitude: BSpline, roll_angle: PPoly | None = None
) -> tuple[Phase, ...]:
    """Return the phase at rest on the pad before lift-off, in a tuple; an empty tuple without a hold.

    Parameters
    ----------
    site : Site
        Launch site.
    theta0 : float
        Earth angle at lift-off (rad).
    hold : float
        Duration of the phase (s).
    attitude, roll_angle
        As in `Phase`.
    """
    r_i, _ = pad_state(site, theta0)
    r_e = frames.ecef_from_eci(r_i, theta0)
    return pad_phase(r_e, theta0, 0.0, hold, attitude, roll_angle)


def pad_knots(hold: float, step: float) -> Floats:
    """Return the knots of the attitude on the pad, `hold` s before lift-off and about `step` s apart."""
    n_interval = int(np.ceil(hold / step))
    knots = np.linspace(-hold, 0.0, n_interval + 1)
    return knots[:-1]


def _accelerations(flight: SimulatedAscent, leg: AscentLeg, samples: list[int] | slice = slice(None)) -> Floats:
    t = leg.t[samples]
    y = leg.y[samples]
    return accelerations(t, y, flight.steering, leg.engine, flight.drag)


def _attitude(card: VehicleAscent, aim: TargetingUnknowns, flight: SimulatedAscent) -> BSpline:
    """Return the quaternion spline over pad and flight: x axis along the thrust, roll by the roll programme.

    Parameters
    ----------
    card : VehicleAscent
        Card with site, pad hold and roll programme.
    aim : TargetingUnknowns
        Solution of the targeting, for the launch azimuth.
    flight : SimulatedAscent
        The simulated ascent.
    """
    up_e, _, right_e = site_axes(card.site, aim.azimuth)
    theta0 = flight.steering.theta0
    first_step = float(flight.legs[0].t[1])
    pad_t = pad_knots(card.pad_hold, first_step)
    pad_theta = frames.earth_angle(theta0, pad_t)
    upright = frames.eci_from_ecef(up_e, pad_theta)
    flight_t = join_samples([leg.t for leg in flight.legs])
    states = join_samples([leg.y for leg in flight.legs])
    thrust_directions = directions(flight_t, states, flight.steering)
    t = np.concatenate([pad_t, flight_t])
    x = np.concatenate([upright, thrust_directions])
    return ascent_attitude(t, x, right_e, theta0, card.roll)


def _max_q(flight: SimulatedAscent) -> tuple[float, float]:
    """Return time (s) and value (Pa) of the greatest dynamic pressure, by a parabola through the top samples."""
    theta0 = flight.steering.theta0
    first_stage = [leg for leg in flight.legs if leg.t[0] < flight.events["stage1_cutoff"]]
    pressures = [_dynamic_pressure(leg, theta0) for leg in first_stage]
    maxima = [float(np.max(pressure)) for pressure in pressures]
    highest = maxima.index(max(maxima))
    leg = first_stage[highest]
    q = pressures[highest]
    largest_sample = np.argmax(q)
    k = int(np.clip(largest_sample, 1, q.size - 2))
    previous_q, largest_q, next_q = q[k - 1], q[k], q[k + 1]
    curvature = previous_q - 2.0 * largest_q + next_q
    shift = 0.0  # of the vertex from the top sample, in intervals
    if curvature < 0.0:
        vertex = 0.5 * (previous_q - next_q) / curvature
        shift = float(np.clip(vertex, -1.0, 1.0))
    interval = leg.t[1] - leg.t[0]
    time = float(leg.t[k] + shift * interval)
    return time, float(largest_q)


def _dynamic_pressure(leg: AscentLeg, theta0: float) -> Floats:
    """Return the dynamic pressure (n,) Pa at the states of a leg."""
    r_i = leg.y[:, :3]
    v_i = leg.y[:, 3:6]
    theta = frames.earth_angle(theta0, leg.t)
    r_e = frames.ecef_from_eci(r_i, theta)
    heights = frames.geodetic_from_ecef(r_e)[2]
    density = np.array([atmosphere(height)[0] for height in heights])
    airspeed = frames.earth_velocity(r_i, v_i)
    square_speed = np.sum(airspeed**2, axis=1)
    return np.asarray(0.5 * density * square_speed)


def _facts(
    card: VehicleAscent, aim: TargetingUnknowns, flight: SimulatedAscent, max_q: float
) -> dict[str, float | str]:
    """Return the facts of an ascent for the report, SI.

    max_q : Pa. Greatest dynamic pressure.
    """
    acceleration = np.concatenate([_accelerations(flight, leg) for leg in flight.legs])
    position = np.concatenate([leg.y[:, :3] for leg in flight.legs])
    load = np.linalg.norm(acceleration - gravity_along(position), axis=1)
    return {
        "vehicle": card.vehicle.name,
        **achieved_orbit(flight.legs[-1].y[0]),
        "azimuth_rad": aim.azimuth,
        "kick_rad": aim.kick,
        "max_load_g": float(np.max(load)) / STANDARD_GRAVITY,
        "max_dynamic_pressure_pa": max_q,
        "propellant_left_kg": flight_propellant_left(card, flight, len(card.vehicle.stages)),
    }


def achieved_orbit(y: Floats) -> dict[str, float]:
    """Return perigee and apogee altitude (m) and inclination (rad) of the orbit of a state y (6 or more)."""
    orbit = frames.elements_from_state(y[:3], y[3:6])
    a, e = float(orbit.semi_major_axis), float(orbit.eccentricity)
    return {
        "perigee_m": a * (1.0 - e) - SEMI_MAJOR,
        "apogee_m": a * (1.0 + e) - SEMI_MAJOR,
        "inclination_rad": float(orbit.inclination),
    }
