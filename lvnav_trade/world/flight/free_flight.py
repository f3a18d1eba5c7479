"""Flight of a point mass through stretches that end at a time or on a condition, and the splines of what was flown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import BSpline, PPoly

from lvnav_trade.frames import earth_angle, earth_velocity, ecef_from_eci, geodetic_from_ecef
from lvnav_trade.kernels.earth import gravity_along, gravity_j4
from lvnav_trade.kernels.media.atmosphere import atmosphere
from lvnav_trade.world.truth import Phase, position_spline

Floats = NDArray[np.float64]
Law = Callable[[float, Floats], Floats]  # time and state (7,) to the unit vector of the thrust, or to a rate (7,)
Condition = Callable[[float, Floats], float]

_TOLERANCE = 1e-11  # relative, of the integration; 1e-12 moves the end of an orbit by millimetres

_LONGEST_STEP = 20.0  # s; a thin layer of air must not be stepped over


class Thrust(NamedTuple):
    """A motor at work: vacuum thrust (N), mass flow (kg/s), exit area (m^2), unit vector of its push in frame i."""

    vacuum: float
    flow: float
    exit_area: float
    direction: Law


class Aerodynamics(NamedTuple):
    """Reference area (m^2) and drag coefficient over Mach number, held constant outside the table."""

    area: float
    mach: Floats
    coefficient: Floats


class Stretch(NamedTuple):
    """A stretch that was flown: times (n,), states (n, 7) of r_i, v_i and mass, inertial acceleration (2, 3) at its
    ends, and what gives the rate of the state.
    """

    name: str
    t: Floats
    y: Floats
    a_ends: Floats
    rate: Law


def newton(aerodynamics: Aerodynamics | None, thrust: Thrust | None, theta0: float) -> Law:
    """Return the rate (7,) of position, velocity and mass as a function of time and state: gravitation to J4, drag in
    air that turns with the Earth, thrust.
    """

    def rate(t: float, y: Floats) -> Floats:
        out = np.empty(7)
        out[:3], out[6] = y[3:6], 0.0
        a = np.array(gravity_j4(y[0], y[1], y[2]))
        pressure = 0.0
        if aerodynamics is not None or (thrust is not None and thrust.exit_area > 0.0):
            density, pressure, _, sound = atmosphere(height(t, y, theta0))
            if aerodynamics is not None and density > 0.0:
                a += drag(aerodynamics, density, sound, y)
        if thrust is not None:
            a += (thrust.vacuum - pressure * thrust.exit_area) / y[6] * thrust.direction(t, y)
            out[6] = -thrust.flow
        out[3:6] = a
        return out

    return rate


def drag(aerodynamics: Aerodynamics, density: float, sound: float, y: Floats) -> Floats:
    """Return the acceleration (3,) by drag at a density (kg/m^3), speed of sound (m/s) and state."""
    wind = earth_velocity(y[:3], y[3:6])
    speed = float(np.linalg.norm(wind))
    coefficient = np.interp(speed / sound, aerodynamics.mach, aerodynamics.coefficient)
    return np.asarray(-0.5 * density * speed * coefficient * aerodynamics.area / y[6] * wind)


def height(t: float, y: Floats, theta0: float) -> float:
    """Return the height (m) over the ellipsoid at time t, state y."""
    return float(geodetic_from_ecef(ecef_from_eci(y[:3], earth_angle(theta0, t)))[2])


def climb(y: Floats) -> float:
    """Return the rate of climb (m/s) along the radius."""
    return float(y[:3] @ y[3:6] / np.linalg.norm(y[:3]))


def fly(
    name: str, t0: float, y0: Floats, rate: Law, longest: float, step: float, until: Condition | None = None
) -> Stretch:
    """Return the stretch from t0 (s), state y0 (7,), for `longest` seconds or until a condition crosses zero.

    Knots stand `step` s apart or a little less, at least eight; where the condition is not met the stretch lasts as
    long as it may.
    """
    span = (t0, t0 + longest)
    events = None
    if until is not None:
        events = [lambda t, y: until(t, y)]
        events[0].terminal = True  # type: ignore[attr-defined]
    found = solve_ivp(rate, span, y0, "DOP853", dense_output=True, rtol=_TOLERANCE, atol=1e-9, events=events,
                      max_step=_LONGEST_STEP)  # fmt: skip
    end = float(found.t[-1])
    t = np.linspace(t0, end, max(8, int(np.ceil((end - t0) / step - 1e-9))) + 1)
    y = found.sol(t).T
    y[0] = y0
    a_ends = np.array([rate(float(t[k]), y[k])[3:6] for k in (0, -1)])
    return Stretch(name, t, y, a_ends, rate)


def phases(stretches: Sequence[Stretch], attitude: BSpline, spin: PPoly | None = None) -> list[Phase]:
    """Return the phases of truth: a spline of position for each stretch, attitude and roll angle in all."""
    found = []
    for s in stretches:
        position = position_spline(s.t, s.y[:, :3], s.y[[0, -1], 3:6], s.a_ends)
        found.append(Phase(s.name, float(s.t[0]), float(s.t[-1]), position, attitude, spin))
    return found


def knots(stretches: Sequence[Stretch]) -> tuple[Floats, Floats]:
    """Return the times (n,) and states (n, 7) of successive stretches, those at their seams once."""
    t = np.concatenate([*(s.t[:-1] for s in stretches), stretches[-1].t[-1:]])
    return t, np.concatenate([*(s.y[:-1] for s in stretches), stretches[-1].y[-1:]])


def greatest_load(stretches: Sequence[Stretch]) -> float:
    """Return the greatest specific force (m/s^2) of a flight, at its knots."""
    greatest = 0.0
    for s in stretches:
        a = np.array([s.rate(t, y)[3:6] for t, y in zip(s.t.tolist(), s.y, strict=True)])
        greatest = max(greatest, float(np.max(np.linalg.norm(a - gravity_along(s.y[:, :3].copy()), axis=1))))
    return greatest
