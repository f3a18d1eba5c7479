"""Flight of a point mass in phases, attitude laws of its body, and the splines of both."""

import copy
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Self

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import BSpline, PPoly

from lvnav_trade.kernels.earth import OMEGA, gravity_along, gravity_j4
from lvnav_trade.kernels.media.atmosphere import atmosphere
from lvnav_trade.quantities import frames
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.equations_of_motion import Drag
from lvnav_trade.trajectory.ascent.steering_law import smoothsteps
from lvnav_trade.trajectory.attitude_algebra import body_axes, product, rotation_quaternions
from lvnav_trade.trajectory.truth import Phase, join_samples, spline_phase

Axes = Callable[[Floats, Floats], Floats]  # times (n,) and states (n, 6 or more) to C_b_i (n, 3, 3)
Law = Callable[[float, Floats], Floats]  # time and state (7,) to the unit vector of the thrust, or to a rate (7,)
_TOLERANCE = 1e-11  # relative, of the integration; 1e-12 moves the end of an orbit by millimetres
_LONGEST_STEP = 20.0  # s; so that the integrator does not step over a thin layer of air


class AttitudeLaw(NamedTuple):
    """An attitude law.

    start : s since lift-off. Start of the law.
    slew : s. Duration of the turn from the previous law.
    axes : Function of times and states that returns the attitude.
    nose : Function of time and state that returns the x axis alone, (3,), frame i; None: it is taken from `axes`.
    """

    start: float
    slew: float
    axes: Axes
    nose: Law | None = None


def attitude(modes: Sequence[AttitudeLaw], t: Floats, y: Floats) -> Floats:
    """Return the attitude by successive laws.

    A turn is about the axis of the rotation from one law's attitude to that of the next, with the angle a quintic in
    time, and takes the shorter way. For half a turn, where both ways are equal, successive times use the same way.

    Parameters
    ----------
    modes : sequence of AttitudeLaw
        Laws in order of their start.
    t : (n,) s
        Increasing times since lift-off.
    y : (n, 6 or more) m, m/s
        Position and velocity, frame i, in the first six columns.

    Returns
    -------
    (n, 4)
        Quaternions q_b_i, scalar first, of continuous sign.
    """
    q = frames.quaternions(modes[0].axes(t, y))
    for mode in modes[1:]:
        first = int(np.searchsorted(t, mode.start, side="right"))
        if first == t.size:
            continue
        later_times = slice(first, None)
        next_axes = mode.axes(t[later_times], y[later_times])
        next_q = frames.quaternions(next_axes)
        if mode.slew > 0.0:
            span = t[later_times] - mode.start
            progress = smoothsteps(span / mode.slew)
        else:
            progress = np.ones(t.size - first)
        rotation = _partial_rotation(q[later_times], next_q, progress)
        q[later_times] = product(q[later_times], rotation)
    return q


def _partial_rotation(q: Floats, next_q: Floats, progress: Floats) -> Floats:
    """Return the rotation from one attitude towards another, by a part of its angle.

    q, next_q : (n, 4). Quaternions, scalar first.
    progress : (n,). Part of the angle, 0 to 1.
    """
    inverse = q * [1.0, -1.0, -1.0, -1.0]
    rotation = product(inverse, next_q)
    rotation *= np.where(rotation[0, 0] < 0.0, -1.0, 1.0)  # the shorter way at the first time
    scalar = rotation[:, 0].copy()
    vector = rotation[:, 1:]
    length = np.linalg.norm(vector, axis=1)
    angle = 2.0 * np.arctan2(length, scalar)
    divisor = np.where(length > 0.0, length, 1.0)
    axis = vector / divisor[:, None]
    partial_angle = progress * angle
    return rotation_quaternions(partial_angle[:, None] * axis)


def nose_direction(modes: Sequence[AttitudeLaw], t: float, y: Floats) -> Floats:
    """Return the direction of the body x axis, (3,), frame i, at a single time.

    modes : laws in order of their start
    t : s since lift-off
    y : (6 or more,) m, m/s. Position and velocity, frame i.
    """
    active_modes = [modes[0], *(mode for mode in modes[1:] if mode.start < t)]
    latest = active_modes[-1]
    has_turned = len(active_modes) == 1 or t >= latest.start + latest.slew
    if has_turned and latest.nose is not None:
        return latest.nose(t, y)
    times = np.array([t])
    states = y[None]
    if has_turned:
        axes = latest.axes(times, states)
    else:
        axes = frames.matrices(attitude(active_modes, times, states))
    return np.asarray(axes[0, :, 0])


def airspeed_law(right_e: Floats, theta0: float, at_rest: Floats | None = None) -> Axes:
    """Return the attitude law of a body with its x axis along the velocity through air that rotates with the Earth.

    right_e : (3,), frame e. Direction of the y axis, before its component along x is removed.
    theta0 : rad. Earth angle at lift-off.
    at_rest : (3,), frame e. Direction of the x axis of a body at rest on the Earth; None: the body moves.
    """

    def axes(t: Floats, y: Floats) -> Floats:
        theta = frames.earth_angle(theta0, t)
        airspeed = frames.earth_velocity(y[:, :3], y[:, 3:6])
        x = frames.unit(airspeed) if at_rest is None else frames.eci_from_ecef(at_rest, theta)
        right = frames.eci_from_ecef(right_e, theta)
        no_roll = np.zeros(t.size)
        return body_axes(x, right, no_roll)

    return axes


def airspeed_direction(t: float, y: Floats) -> Floats:
    """Return the direction (3,) of the velocity through air that rotates with the Earth, frame i, at a state."""
    return frames.unit(frames.earth_velocity(y[:3], y[3:6]))


def inertial_law(C_b_i: Floats) -> Axes:
    """Return the attitude law of a body with constant inertial attitude C_b_i (3, 3)."""
    return lambda t, y: np.broadcast_to(C_b_i, (t.size, 3, 3)).copy()


def velocity_law(sign: float = 1.0) -> Axes:
    """Return the attitude law with the x axis along (sign 1) or against (-1) the inertial velocity, z axis down."""

    def axes(t: Floats, y: Floats) -> Floats:
        r = y[:, :3]
        v = y[:, 3:6]
        across = frames.unit(frames.cross(v, r))  # v x r points to the right of forward flight
        x = sign * frames.unit(v)
        right = sign * across
        no_roll = np.zeros(t.size)
        return body_axes(x, right, no_roll)

    return axes


def forward_direction(t: float, y: Floats) -> Floats:
    """Return the direction (3,) of the inertial velocity, frame i, at a state."""
    return frames.unit(y[3:6])


def backward_direction(t: float, y: Floats) -> Floats:
    """Return the direction (3,) against the inertial velocity, frame i, at a state."""
    return -frames.unit(y[3:6])


def level_attitude(t: Floats, y: Floats) -> Floats:
    """Return the attitude (n, 3, 3) with x axis horizontal in the orbital plane, forward, and z axis to the centre."""
    r = y[:, :3]
    v = y[:, 3:6]
    across = frames.unit(frames.cross(v, r))
    forward = frames.unit(frames.cross(r, across))
    no_roll = np.zeros(t.size)
    return body_axes(forward, across, no_roll)


def rotate_law(axes: Axes, pitch: float, yaw: float) -> Axes:
    """Return an attitude law that is rotated from another law about body axes.

    axes : the other law
    pitch, yaw : rad. Yaw to the right, followed by pitch up.
    """
    if pitch == 0.0 and yaw == 0.0:
        return axes
    yaw_rotation = rotation_quaternions(np.array([[0.0, 0.0, yaw]]))
    pitch_rotation = rotation_quaternions(np.array([[0.0, pitch, 0.0]]))
    rotation = product(yaw_rotation, pitch_rotation)
    offset = frames.matrices(rotation)[0]
    return lambda t, y: axes(t, y) @ offset


Condition = Callable[[float, Floats], float]


class Thrust(NamedTuple):
    """A burning motor.

    vacuum : N. Vacuum thrust.
    flow : kg/s. Mass flow.
    exit_area : m^2. Exit area of the nozzle.
    direction : Function of time and state that returns the unit vector of the thrust, frame i.
    """

    vacuum: float
    flow: float
    exit_area: float
    direction: Law


class IntegratedPhase(NamedTuple):
    """An integrated phase of flight.

    name : Name of the phase.
    t : (n,) s. Times.
    y : (n, 7) m, m/s, kg. Position and velocity in frame i, and mass.
    rate : Function of time and state that returns the rate of the state.
    """

    name: str
    t: Floats
    y: Floats
    rate: Law


def newton(air: Drag | None, thrust: Thrust | None, theta0: float) -> Law:
    """Return the equations of motion: the rate (7,) of position, velocity and mass as a function of time and state.

    Forces are gravitation to J4, drag in air that rotates with the Earth, and thrust.

    air : Drag of the body; None: no drag.
    thrust : Burning motor; None: coast.
    theta0 : rad. Earth angle at lift-off.
    """
    needs_pressure = thrust is not None and thrust.exit_area > 0.0

    # Single numbers, because arithmetic on arrays of three takes ten times as long.
    def rate(t: float, y: Floats) -> Floats:
        r_x, r_y, r_z, v_x, v_y, v_z, mass = y.tolist()
        a_x, a_y, a_z = gravity_j4(r_x, r_y, r_z)
        mass_rate = 0.0
        pressure = 0.0
        if air is not None or needs_pressure:
            density, pressure, _, sound = atmosphere(height(t, y, theta0))
            if air is not None and density > 0.0:
                airspeed = (v_x + OMEGA * r_y, v_y - OMEGA * r_x, v_z)
                speed = float(np.linalg.norm(airspeed))
                mach = speed / sound
                coefficient = float(np.interp(mach, air.mach, air.coefficient))
                drag_per_airspeed = -0.5 * density * speed * coefficient * air.area / mass
                a_x += drag_per_airspeed * airspeed[0]
                a_y += drag_per_airspeed * airspeed[1]
                a_z += drag_per_airspeed * airspeed[2]
        if thrust is not None:
            force = thrust.vacuum - pressure * thrust.exit_area
            u_x, u_y, u_z = thrust.direction(t, y).tolist()
            thrust_acceleration = force / mass
            a_x += thrust_acceleration * u_x
            a_y += thrust_acceleration * u_y
            a_z += thrust_acceleration * u_z
            mass_rate = -thrust.flow
        return np.array([v_x, v_y, v_z, a_x, a_y, a_z, mass_rate])

    return rate


def height(t: float, y: Floats, theta0: float) -> float:
    """Return the height (m) above the ellipsoid at time t (s) and state y; theta0 : rad, Earth angle at lift-off."""
    theta = theta0 + OMEGA * t
    cosine = math.cos(theta)
    sine = math.sin(theta)
    x, y, z = y[:3].tolist()
    return frames.height_from_ecef(cosine * x + sine * y, cosine * y - sine * x, z)


def climb(y: Floats) -> float:
    """Return the rate of climb (m/s) along the radius at a state."""
    r = y[:3]
    v = y[3:6]
    radius = np.linalg.norm(r)
    return float(r @ v / radius)


def fly(
    name: str, t0: float, y0: Floats, rate: Law, longest: float, step: float, end_condition: Condition | None = None
) -> IntegratedPhase:
    """Return the integrated phase from time t0 (s) and state y0 (7,).

    Parameters
    ----------
    name : str
    t0 : float
    y0 : (7,)
    rate : Law
        Equations of motion.
    longest : float
        Longest duration (s).
    step : float
        Interval of the knots (s), slightly reduced to fit; there are at least eight intervals.
    end_condition : Condition, optional
        Function of time and state that ends the phase at its zero.
    """
    events = None if end_condition is None else [lambda t, y: end_condition(t, y)]
    if events is not None:
        events[0].terminal = True  # type: ignore[attr-defined]
    solution = solve_ivp(
        rate,
        (t0, t0 + longest),
        y0,
        "DOP853",
        dense_output=True,
        rtol=_TOLERANCE,
        atol=1e-9,
        events=events,
        max_step=_LONGEST_STEP,
    )
    end = float(solution.t[-1])
    n_interval = max(8, int(np.ceil((end - t0) / step - 1e-9)))
    t = np.linspace(t0, end, n_interval + 1)
    y = solution.sol(t).T
    y[0] = y0
    return IntegratedPhase(name, t, y, rate)


def phases(stretches: Sequence[IntegratedPhase], attitude: BSpline, roll_angle: PPoly | None = None) -> list[Phase]:
    """Return the phases of the true trajectory, with a position spline for each.

    attitude, roll_angle : common quaternion spline and roll angle, as in `Phase`
    """
    result = []
    for stretch in stretches:
        t = stretch.t
        r = stretch.y[:, :3]
        end_rates = np.array([stretch.rate(float(t[k]), stretch.y[k]) for k in (0, -1)])
        v_ends = end_rates[:, :3]
        a_ends = end_rates[:, 3:6]
        result.append(spline_phase(stretch.name, t, r, v_ends, a_ends, attitude, roll_angle))
    return result


def knots(stretches: Sequence[IntegratedPhase]) -> tuple[Floats, Floats]:
    """Return the times (n,) and states (n, 7) of successive phases, with each common sample only once."""
    times = [stretch.t for stretch in stretches]
    states = [stretch.y for stretch in stretches]
    return join_samples(times), join_samples(states)


def greatest_load(stretches: Sequence[IntegratedPhase]) -> float:
    """Return the largest specific force (m/s^2) of a flight, at its knots."""
    accelerations, positions = [], []
    for stretch in stretches:
        for t, y in zip(stretch.t.tolist(), stretch.y, strict=True):
            rate = stretch.rate(t, y)
            accelerations.append(rate[3:6])
            positions.append(y[:3])
    gravity = gravity_along(np.array(positions))
    force = np.array(accelerations) - gravity
    load = np.linalg.norm(force, axis=1)
    return float(np.max(load))


class FlightIntegration:
    """A flight during its integration: time (s), state y (7,), attitude laws (`modes`), phases and events (s)."""

    def __init__(self, theta0: float, y: Floats, air: Drag | None) -> None:
        self.t = 0.0
        self.theta0 = theta0
        self.y = y
        self.air = air
        self.modes: list[AttitudeLaw] = []
        self.stretches: list[IntegratedPhase] = []
        self.events: dict[str, float] = {}

    def branch(self) -> Self:
        """Return a copy that continues from the present state independently."""
        branch = copy.copy(self)
        branch.y = self.y.copy()
        branch.modes = self.modes.copy()
        branch.stretches = self.stretches.copy()
        branch.events = self.events.copy()
        return branch

    @property
    def height(self) -> float:
        """Present height, m."""
        return height(self.t, self.y, self.theta0)

    def height_condition(self, altitude: float) -> Condition:
        """Return the condition whose zero is at the height `altitude` (m)."""
        return lambda t, y: height(t, y, self.theta0) - altitude

    def axes(self, modes: Sequence[AttitudeLaw] = ()) -> Floats:
        """Return the present attitude C_b_i (3, 3), by the laws of the flight or other laws."""
        laws = modes or self.modes
        q_b_i = attitude(laws, np.array([self.t]), self.y[None])
        C_b_i = frames.matrices(q_b_i)[0]
        return np.asarray(C_b_i)

    def integrate_phase(
        self,
        name: str,
        longest: float,
        step: float,
        thrust: Thrust | None = None,
        end_condition: Condition | None = None,
    ) -> IntegratedPhase:
        """Return the phase from the present state; `name`, `longest`, `step` and `end_condition` as in `fly`.

        thrust : burning motor; None: coast
        """
        rate = newton(self.air, thrust, self.theta0)
        return fly(name, self.t, self.y, rate, longest, step, end_condition)

    def append_phase(self, stretch: IntegratedPhase) -> None:
        """Append a phase and advance to its end."""
        self.stretches.append(stretch)
        self.t = float(stretch.t[-1])
        self.y = stretch.y[-1].copy()

    def thrust(self, vacuum: float, flow: float, exit_area: float = 0.0) -> Thrust:
        """Return a burning motor with thrust along the body x axis.

        vacuum, flow, exit_area : N, kg/s, m^2. Vacuum thrust, mass flow and exit area.
        """
        return Thrust(
            vacuum=vacuum,
            flow=flow,
            exit_area=exit_area,
            direction=lambda t, y: nose_direction(self.modes, t, y),
        )
