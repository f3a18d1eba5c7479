"""A solved ascent made truth: splines over pad and legs, named events, facts for the report."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from lvnav_trade.frames import (
    Elements,
    earth_angle,
    earth_velocity,
    ecef_from_eci,
    eci_from_ecef,
    elements_from_state,
    geodetic_from_ecef,
)
from lvnav_trade.kernels.earth import OMEGA, SEMI_MAJOR, gravity_along
from lvnav_trade.kernels.media.atmosphere import atmosphere
from lvnav_trade.world.ascent.attitude import ascent_attitude
from lvnav_trade.world.ascent.comparison import differences
from lvnav_trade.world.ascent.dynamics import accelerations
from lvnav_trade.world.ascent.legs import Aim, Flight, Leg, fly_ascent, pad_state, site_axes
from lvnav_trade.world.ascent.steering_law import directions
from lvnav_trade.world.ascent.targeting import propellant_left, solve
from lvnav_trade.world.ascent.vehicle import STANDARD_GRAVITY, Site, VehicleAscent
from lvnav_trade.world.truth import Phase, Trajectory, position_spline

Floats = NDArray[np.float64]

_PAD_STEP = 2.5  # s between knots on the pad; the Earth's turn is so slow that rounding is the only error


class Track(NamedTuple):
    """Samples of a stretch for its splines: times (n,), position, and at both ends velocity and acceleration (2, 3)."""

    name: str
    t: Floats
    r: Floats
    v_ends: Floats
    a_ends: Floats


def build_ascent(card: VehicleAscent) -> Trajectory:
    """Return the true flight of a vehicle card; InputError where the orbit is out of its reach."""
    aim = solve(card)
    flight = fly_ascent(card, aim)
    theta0 = flight.steering.theta0
    attitude = _attitude(card, aim, flight)
    tracks = [pad_track(card.site, theta0, card.pad_hold)] if card.pad_hold > 0.0 else []
    tracks += [_track(leg, flight) for leg in flight.legs]
    events = dict(flight.events)
    events["max_q"], pressure = _max_q(flight)
    events = dict(sorted(events.items(), key=lambda item: item[1]))
    built = Trajectory(phases_of(tracks, attitude), events, theta0, card.epoch, _facts(card, aim, flight, pressure))
    if card.recorded is not None:
        built.facts.update(differences(card.recorded, built, card.site))
    return built


def pad_track(site: Site, theta0: float, hold: float) -> Track:
    """Return the stretch on the pad, from `hold` seconds before lift-off."""
    t = np.linspace(-hold, 0.0, max(8, int(np.ceil(hold / _PAD_STEP))) + 1)
    r_e = ecef_from_eci(pad_state(site, theta0)[0], theta0)
    r = eci_from_ecef(np.broadcast_to(r_e, (t.size, 3)), earth_angle(theta0, t))
    spin = np.array([0.0, 0.0, OMEGA])
    v = np.cross(spin, r[[0, -1]])
    return Track("pad", t, r, v, np.cross(spin, v))


def phases_of(tracks: list[Track], attitude: BSpline) -> tuple[Phase, ...]:
    """Return the phases: a position spline for each stretch, the one attitude spline in all."""
    return tuple(
        Phase(track.name, float(track.t[0]), float(track.t[-1]), position_spline(*track[1:]), attitude)
        for track in tracks
    )


def pad_knots(hold: float, step: float) -> Floats:
    """Return times before lift-off, about `step` apart, at which the attitude on the pad is sampled."""
    return np.linspace(-hold, 0.0, int(np.ceil(hold / step)) + 1)[:-1]


def _track(leg: Leg, flight: Flight) -> Track:
    """Return the samples of a leg; end values from the equations of motion."""
    ends = [0, -1]
    a = accelerations(leg.t[ends], leg.y[ends], flight.steering, leg.engine, flight.drag)
    return Track(leg.name, leg.t, leg.y[:, :3], leg.y[ends, 3:6], a)


def _attitude(card: VehicleAscent, aim: Aim, flight: Flight) -> BSpline:
    """Return the attitude over pad and flight: x along the thrust, the rest by the roll programme."""
    up_e, _, right_e = site_axes(card.site, aim.azimuth)
    theta0 = flight.steering.theta0
    before = pad_knots(card.pad_hold, float(flight.legs[0].t[1]))
    legs = [directions(leg.t[:-1], leg.y[:-1], flight.steering) for leg in flight.legs]
    last = flight.legs[-1]
    final = directions(last.t[-1:], last.y[-1:], flight.steering)
    t = np.concatenate([before, *(leg.t[:-1] for leg in flight.legs), last.t[-1:]])
    upright = eci_from_ecef(np.broadcast_to(up_e, (before.size, 3)), earth_angle(theta0, before))
    return ascent_attitude(t, np.concatenate([upright, *legs, final]), right_e, theta0, card.roll)


def _heights(leg: Leg, theta0: float) -> Floats:
    """Return the geodetic heights (n,) in m along a leg."""
    return geodetic_from_ecef(ecef_from_eci(leg.y[:, :3], earth_angle(theta0, leg.t)))[2]


def _max_q(flight: Flight) -> tuple[float, float]:
    """Return time (s) and value (Pa) of the greatest dynamic pressure, by a parabola through the top samples."""
    first = [leg for leg in flight.legs if leg.t[0] < flight.events["stage1_cutoff"]]
    pressures = [_dynamic_pressure(leg, flight.steering.theta0) for leg in first]
    top = int(np.argmax([np.max(q) for q in pressures]))
    leg, q = first[top], pressures[top]
    k = int(np.clip(np.argmax(q), 1, q.size - 2))
    bend = q[k - 1] - 2.0 * q[k] + q[k + 1]
    shift = 0.5 * (q[k - 1] - q[k + 1]) / bend if bend < 0.0 else 0.0
    shift = float(np.clip(shift, -1.0, 1.0))
    return float(leg.t[k] + shift * (leg.t[1] - leg.t[0])), float(q[k])


def _dynamic_pressure(leg: Leg, theta0: float) -> Floats:
    """Return the dynamic pressure (n,) in Pa along a leg."""
    density = np.array([atmosphere(height)[0] for height in _heights(leg, theta0)])
    return np.asarray(0.5 * density * np.sum(earth_velocity(leg.y[:, :3], leg.y[:, 3:6]) ** 2, axis=1))


def _facts(card: VehicleAscent, aim: Aim, flight: Flight, max_q: float) -> dict[str, float | str]:
    """Return what the report says of the flight, SI."""
    loads = []
    for leg in flight.legs:
        a = accelerations(leg.t, leg.y, flight.steering, leg.engine, flight.drag)
        loads.append(np.max(np.linalg.norm(a - gravity_along(leg.y[:, :3].copy()), axis=1)))
    low, high, inclination = achieved(flight.legs[-1].y[0])
    return {
        "vehicle": card.vehicle.name,
        "perigee_m": low,
        "apogee_m": high,
        "inclination_rad": inclination,
        "azimuth_rad": aim.azimuth,
        "kick_rad": aim.kick,
        "max_load_g": float(max(loads)) / STANDARD_GRAVITY,
        "max_dynamic_pressure_pa": max_q,
        "propellant_left_kg": propellant_left(card, aim),
    }


def achieved(y: Floats) -> tuple[float, float, float]:
    """Return perigee and apogee altitude (m) and inclination (rad) of the orbit of a state y (6 or more)."""
    orbit: Elements = elements_from_state(y[:3], y[3:6])
    a, e = float(orbit.semi_major_axis), float(orbit.eccentricity)
    return a * (1.0 - e) - SEMI_MAJOR, a * (1.0 + e) - SEMI_MAJOR, float(orbit.inclination)
