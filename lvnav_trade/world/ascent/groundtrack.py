"""A climb laid over the Earth: great-circle track, inertial splines, and the attitude along the specific force."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

from lvnav_trade.frames import earth_angle, ecef_from_geodetic, eci_from_ecef, rotation_e_n, unit
from lvnav_trade.kernels.earth import ECCENTRICITY_2, OMEGA, SEMI_MAJOR, gravity_along
from lvnav_trade.world.ascent.attitude import ascent_attitude, smoothsteps
from lvnav_trade.world.ascent.dynamics import Drag, accelerations, fly
from lvnav_trade.world.ascent.launch import pad_knots
from lvnav_trade.world.ascent.legs import COASTING, site_axes
from lvnav_trade.world.ascent.smoothing import Climb
from lvnav_trade.world.ascent.steering_law import Steering
from lvnav_trade.world.ascent.vehicle import Roll, Site
from lvnav_trade.world.truth import position_spline

Floats = NDArray[np.float64]

_STEP = 0.5  # s between knots
_UPRIGHT = (4.0, 12.0)  # s; thrust is vertical before, along the specific force after, blended between
_DAMPING = 5.0  # s, in which the turn of the body dies away after injection


class Course(NamedTuple):
    """A flight to injection as samples, one entry for each stretch between breaks: t (n,), r_i and v_i (n, 3)."""

    azimuth: float
    theta0: float
    t: list[Floats]
    r: list[Floats]
    v: list[Floats]


class Stretch(NamedTuple):
    """A stretch of a rebuilt flight and its position spline, frame i."""

    name: str
    start: float
    end: float
    position: BSpline


def course(site: Site, azimuth: float, climb: Climb, breaks: list[float], theta0: float) -> Course:
    """Return the flight over the great circle of normals that leaves the site by the azimuth (rad)."""
    edges = [0.0, *breaks, float(climb.altitude.t[-1])]
    angle = 0.0
    way = Course(azimuth, theta0, [], [], [])
    for begin, end in pairwise(edges):
        t = np.linspace(begin, end, max(8, int(np.ceil((end - begin) / _STEP))) + 1)
        inside = np.clip(t, begin + 1e-9, end - 1e-9)  # one-sided values at the breaks
        psi = _range_angle(site, azimuth, t, climb, inside, angle)
        angle = float(psi[-1])
        r_e, v_e = _on_the_way(site, azimuth, psi, climb, inside)
        theta = earth_angle(theta0, t)
        way.t.append(t)
        way.r.append(eci_from_ecef(r_e, theta))
        way.v.append(eci_from_ecef(v_e + np.cross([0.0, 0.0, OMEGA], r_e), theta))
    return way


def _normals(site: Site, azimuth: float, psi: Floats) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats]:
    """Return latitude and longitude (n,) along the circle, its direction over north and east (n,), and the radii of
    curvature of meridian and prime vertical (n,) in m, at angles psi (n,) from the site.
    """
    up, downrange, _ = site_axes(site, _azimuth_of_normals(site, azimuth))
    normal = np.cos(psi)[:, None] * up + np.sin(psi)[:, None] * downrange
    tangent = np.cos(psi)[:, None] * downrange - np.sin(psi)[:, None] * up
    latitude, longitude = np.arcsin(normal[:, 2]), np.arctan2(normal[:, 1], normal[:, 0])
    local = np.einsum("kij,kj->ki", rotation_e_n(latitude, longitude), tangent)
    across = SEMI_MAJOR / np.sqrt(1.0 - ECCENTRICITY_2 * normal[:, 2] ** 2)
    meridian = across**3 * (1.0 - ECCENTRICITY_2) / SEMI_MAJOR**2
    return latitude, longitude, local[:, 0], local[:, 1], meridian, across


def _azimuth_of_normals(site: Site, azimuth: float) -> float:
    """Return the azimuth (rad) in which the normal turns when the track leaves by `azimuth`: the radii differ."""
    sine = math.sin(site.latitude)
    ratio = (1.0 - ECCENTRICITY_2) / (1.0 - ECCENTRICITY_2 * sine * sine)  # of meridian to prime vertical
    return math.atan2(ratio * math.sin(azimuth), math.cos(azimuth))


def _range_angle(site: Site, azimuth: float, t: Floats, climb: Climb, inside: Floats, first: float) -> Floats:
    """Return the angle (n,) flown along the circle at times t (n,), `first` at the start.

    The rate is level speed over the radius of curvature, which hardly depends on the angle: four rounds of quadrature
    leave 1e-11 rad.
    """
    level, height = climb.level(inside), site.height + climb.altitude(inside)
    psi = np.full_like(t, first)
    for _ in range(4):
        _, _, north, east, meridian, across = _normals(site, azimuth, psi)
        rate = level / np.hypot((meridian + height) * north, (across + height) * east)
        psi = first + make_interp_spline(t, rate, k=5).antiderivative()(t)
    return np.asarray(psi)


def _on_the_way(site: Site, azimuth: float, psi: Floats, climb: Climb, t: Floats) -> tuple[Floats, Floats]:
    """Return position (m) and Earth-relative velocity (m/s), each (n, 3) in frame e."""
    latitude, longitude, north, east, meridian, across = _normals(site, azimuth, psi)
    height = site.height + climb.altitude(t)
    heading = np.stack([(meridian + height) * north, (across + height) * east], axis=1)
    level = climb.level(t)[:, None] * unit(heading)
    v_n = np.column_stack([level, -climb.altitude(t, 1)])
    v_e = np.einsum("kji,kj->ki", rotation_e_n(latitude, longitude), v_n)
    return ecef_from_geodetic(latitude, longitude, height), v_e


def end_state(way: Course) -> Floats:
    """Return inertial position (m) and velocity (m/s) at injection, (6,)."""
    return np.concatenate([way.r[-1][-1], way.v[-1][-1]])


def tracks_of(way: Course, coast: float) -> list[Stretch]:
    """Return the stretches to injection and the final coast of `coast` seconds.

    Velocity is interpolated and integrated to position, each stretch from the end of the one before: both are
    continuous; position leaves the fitted altitude by less than a millimetre.
    """
    stretches = []
    r = way.r[0][0]
    for number, (t, v) in enumerate(zip(way.t, way.v, strict=True), start=1):
        position = make_interp_spline(t, v, k=5).antiderivative()
        position.c += r
        r = position(t[-1])
        stretches.append(Stretch(f"stretch {number}", float(t[0]), float(t[-1]), position))
    return [*stretches, _final_coast(stretches[-1], coast)]


def _final_coast(last: Stretch, duration: float) -> Stretch:
    """Return the free fall after a stretch."""
    state = np.concatenate([last.position(last.end), last.position(last.end, 1), [1.0]])
    none = np.zeros((0, 3))
    # Without thrust and drag nothing of the steering acts.
    idle = Steering(np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), 0.0, np.inf, 1.0, 0.0, np.inf, 1.0,
                    none[:, 0].copy(), none, none[:, 0].copy(), none[:, 0].copy())  # fmt: skip
    vacuum = Drag(0.0, np.array([0.0, 1.0]), np.zeros(2))
    t, y = fly(last.end, duration, max(8, int(np.ceil(duration / _STEP))), state, idle, COASTING, vacuum)
    ends = accelerations(t[[0, -1]], y[[0, -1]], idle, COASTING, vacuum)
    return Stretch("final coast", last.end, float(t[-1]), position_spline(t, y[:, :3], y[[0, -1], 3:6], ends))


def pointing(
    site: Site, way: Course, stretches: list[Stretch], coasts: list[tuple[float, float]], roll: Roll, hold: float
) -> BSpline:
    """Return the attitude spline over pad and flight, x along the specific force of the powered stretches."""
    up_e, _, right_e = site_axes(site, way.azimuth)
    before = pad_knots(hold, _STEP)
    times, directions = [before], [np.zeros((before.size, 3))]
    free = [begin for begin, _ in coasts] + [stretches[-1].start]
    powered = [k for k in stretches if k.start not in free]
    for stretch in stretches:
        t = _knots(stretch)
        times.append(t if stretch is stretches[-1] else t[:-1])
        if stretch in powered:
            directions.append(_thrust(stretch)(times[-1]))
        else:
            earlier = [k for k in powered if k.end <= stretch.start]
            later = [k for k in powered if k.start >= stretch.end]
            directions.append(_turn(times[-1], stretch, earlier[-1], later[0] if later else None))
    t = np.concatenate(times)
    upright = eci_from_ecef(np.broadcast_to(up_e, (t.size, 3)), earth_angle(way.theta0, t))
    weight = smoothsteps((t - _UPRIGHT[0]) / (_UPRIGHT[1] - _UPRIGHT[0]))[:, None]
    x = unit((1.0 - weight) * upright + weight * np.concatenate(directions))
    return ascent_attitude(t, x, right_e, way.theta0, roll)


def _knots(stretch: Stretch) -> Floats:
    """Return the knots of a stretch, both ends included."""
    return np.linspace(stretch.start, stretch.end, max(8, int(np.ceil((stretch.end - stretch.start) / _STEP))) + 1)


def _thrust(stretch: Stretch) -> BSpline:
    """Return the spline of the direction of the specific force over a powered stretch."""
    t = _knots(stretch)
    return make_interp_spline(t, unit(stretch.position(t, 2) - gravity_along(stretch.position(t))), k=5)


def _turn(t: Floats, stretch: Stretch, earlier: Stretch, later: Stretch | None) -> Floats:
    """Return the directions (n, 3) through a coast: from the thrust before it to the thrust after it.

    Both are continued at the rate they have at the coast's edge and blended by a quintic; where no thrust follows, the
    rate dies away instead.
    """
    end = _thrust(earlier)
    lapse = (t - earlier.end)[:, None]
    if later is None:
        return unit(end(earlier.end) + _DAMPING * -np.expm1(-lapse / _DAMPING) * end(earlier.end, 1))
    begin = _thrust(later)
    weight = smoothsteps((t - stretch.start) / (stretch.end - stretch.start))[:, None]
    leaving = end(earlier.end) + lapse * end(earlier.end, 1)
    arriving = begin(later.start) + (t - later.start)[:, None] * begin(later.start, 1)
    return unit((1.0 - weight) * leaving + weight * arriving)
