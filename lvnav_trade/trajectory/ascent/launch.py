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
from lvnav_trade.trajectory.ascent.targeting import left_in_orbit
from lvnav_trade.trajectory.ascent.vehicle_cards import STANDARD_GRAVITY, Site, VehicleAscent
from lvnav_trade.trajectory.truth import Phase, Trajectory, join_samples, pad_phase, splined


def build_ascent(card: VehicleAscent) -> Trajectory:
    """Return the true trajectory of a vehicle card; InputError if it cannot reach the orbit."""
    vehicle, aim, flight = dispersed_ascent(card)
    theta0 = flight.steering.theta0
    attitude = _attitude(card, aim, flight)
    ends = [0, -1]  # end values of a phase's acceleration are from the equations of motion
    phases = [
        splined(leg.name, leg.t, leg.y[:, :3], leg.y[ends, 3:6], _accelerations(flight, leg, ends), attitude)
        for leg in flight.legs
    ]
    pad = site_phase(card.site, theta0, card.pad_hold, attitude)
    top, pressure = _max_q(flight)
    events = {**flight.events, "max_q": top}
    built = Trajectory((*pad, *phases), events, theta0, card.epoch, _facts(vehicle, aim, flight, pressure))
    if card.recorded is not None:
        built.facts.update(differences(card.recorded, built, card.site))
    return built


def site_phase(
    site: Site, theta0: float, hold: float, attitude: BSpline, spin: PPoly | None = None
) -> tuple[Phase, ...]:
    """Return the phase at rest on the pad, from `hold` s before lift-off, in a tuple; an empty tuple without a hold."""
    return pad_phase(frames.ecef_from_eci(pad_state(site, theta0)[0], theta0), theta0, 0.0, hold, attitude, spin)


def pad_knots(hold: float, step: float) -> Floats:
    """Return the knots of the attitude on the pad, `hold` s before lift-off and about `step` s apart."""
    return np.linspace(-hold, 0.0, int(np.ceil(hold / step)) + 1)[:-1]


def _accelerations(flight: SimulatedAscent, leg: AscentLeg, at: list[int] | slice = slice(None)) -> Floats:
    return accelerations(leg.t[at], leg.y[at], flight.steering, leg.engine, flight.drag)


def _attitude(card: VehicleAscent, aim: TargetingUnknowns, flight: SimulatedAscent) -> BSpline:
    """Return the attitude over pad and flight: x along the thrust, the rest by the roll programme."""
    up_e, _, right_e = site_axes(card.site, aim.azimuth)
    theta0 = flight.steering.theta0
    before = pad_knots(card.pad_hold, float(flight.legs[0].t[1]))
    t, y = join_samples([leg.t for leg in flight.legs]), join_samples([leg.y for leg in flight.legs])
    upright = frames.eci_from_ecef(up_e, frames.earth_angle(theta0, before))
    x = np.concatenate([upright, directions(t, y, flight.steering)])
    return ascent_attitude(np.concatenate([before, t]), x, right_e, theta0, card.roll)


def _max_q(flight: SimulatedAscent) -> tuple[float, float]:
    """Return time (s) and value (Pa) of the greatest dynamic pressure, by a parabola through the top samples."""
    first = (leg for leg in flight.legs if leg.t[0] < flight.events["stage1_cutoff"])
    pressures = ((leg, _dynamic_pressure(leg, flight.steering.theta0)) for leg in first)
    leg, q = max(pressures, key=lambda pair: float(np.max(pair[1])))
    k = int(np.clip(np.argmax(q), 1, q.size - 2))
    bend = q[k - 1] - 2.0 * q[k] + q[k + 1]
    shift = float(np.clip(0.5 * (q[k - 1] - q[k + 1]) / bend, -1.0, 1.0)) if bend < 0.0 else 0.0
    return float(leg.t[k] + shift * (leg.t[1] - leg.t[0])), float(q[k])


def _dynamic_pressure(leg: AscentLeg, theta0: float) -> Floats:
    heights = frames.geodetic_from_ecef(frames.ecef_from_eci(leg.y[:, :3], frames.earth_angle(theta0, leg.t)))[2]
    density = np.array([atmosphere(height)[0] for height in heights])
    return np.asarray(0.5 * density * np.sum(frames.earth_velocity(leg.y[:, :3], leg.y[:, 3:6]) ** 2, axis=1))


def _facts(
    card: VehicleAscent, aim: TargetingUnknowns, flight: SimulatedAscent, max_q: float
) -> dict[str, float | str]:
    a = np.concatenate([_accelerations(flight, leg) for leg in flight.legs])
    force = a - gravity_along(np.concatenate([leg.y[:, :3] for leg in flight.legs]))
    return {
        "vehicle": card.vehicle.name,
        **achieved(flight.legs[-1].y[0]),
        "azimuth_rad": aim.azimuth,
        "kick_rad": aim.kick,
        "max_load_g": float(np.max(np.linalg.norm(force, axis=1))) / STANDARD_GRAVITY,
        "max_dynamic_pressure_pa": max_q,
        "propellant_left_kg": left_in_orbit(card, flight, len(card.vehicle.stages)),
    }


def achieved(y: Floats) -> dict[str, float]:
    """Return perigee and apogee altitude (m) and inclination (rad) of the orbit of a state y (6 or more)."""
    orbit = frames.elements_from_state(y[:3], y[3:6])
    a, e = float(orbit.semi_major_axis), float(orbit.eccentricity)
    low, high = a * (1.0 - e) - SEMI_MAJOR, a * (1.0 + e) - SEMI_MAJOR
    return {"perigee_m": low, "apogee_m": high, "inclination_rad": float(orbit.inclination)}
