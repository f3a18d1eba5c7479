"""Equations of motion of a point-mass launch vehicle, and their integration over a leg."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.earth import ECCENTRICITY_2, OMEGA, SEMI_MAJOR, gravity_j4
from lvnav_trade.kernels.jit import array_jit, jit
from lvnav_trade.kernels.media.atmosphere import atmosphere
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.steering_law import Steering, direction

Rates = tuple[float, float, float, float, float, float, float]


class UnthrottledMotors(NamedTuple):
    """Total of the burning motors that cannot be throttled: thrust and mass flow linear in time.

    Vacuum thrust (N) and mass flow (kg/s) at `reference_time` (s), their slopes (N/s, kg/s^2), and the exit area (m^2).
    """

    reference_time: float
    thrust: float
    thrust_slope: float
    mass_flow: float
    flow_slope: float
    exit_area: float


NOTHING = UnthrottledMotors(
    reference_time=0.0,
    thrust=0.0,
    thrust_slope=0.0,
    mass_flow=0.0,
    flow_slope=0.0,
    exit_area=0.0,
)


class Propulsion(NamedTuple):
    """Propulsion of a leg: an engine that can be throttled, and motors that cannot.

    Of the engine: vacuum thrust (N), mass flow (kg/s), exit area (m^2), and limit of thrust over mass (m/s^2, infinite
    for none).
    """

    thrust: float
    mass_flow: float
    exit_area: float
    max_load: float
    unthrottled_motors: UnthrottledMotors = NOTHING


class Drag(NamedTuple):
    """Reference area (m^2) and drag coefficients over Mach number, constant outside the table."""

    area: float
    mach: Floats
    coefficient: Floats


@jit
def height_above(x: float, y: float, z: float) -> float:
    """Return the height (m) above the ellipsoid along the radius, within 0.2 % of the geodetic height during a launch.

    x, y, z : m. Position, frame i or e.
    """
    p2 = x * x + y * y
    r2 = p2 + z * z
    # Radius of the ellipsoid along the same direction, over the semi-major axis
    square_ratio = (1.0 - ECCENTRICITY_2) * r2 / (r2 - ECCENTRICITY_2 * p2)
    ellipsoid_radius = SEMI_MAJOR * math.sqrt(square_ratio)
    radius = math.sqrt(r2)
    return radius - ellipsoid_radius


@jit
def engine_thrust(mass: float, pressure: float, engine: Propulsion, other_thrust: float = 0.0) -> tuple[float, float]:
    """Return thrust and throttle of the engine that can be throttled.

    The limit, less the thrust of other motors, is a smooth minimum over 2 % of it: the load bends within a second or so
    and stays below the limit.

    Parameters
    ----------
    mass : float
        Mass of the vehicle (kg).
    pressure : float
        Ambient pressure (Pa).
    engine : Propulsion
        The engine, with its limit of thrust over mass.
    other_thrust : float
        Thrust of other motors (N).

    Returns
    -------
    thrust : float
        Thrust (N) at this pressure.
    throttle : float
        Thrust over full thrust.
    """
    if engine.thrust == 0.0:
        return 0.0, 0.0
    full = engine.thrust - pressure * engine.exit_area
    limit = engine.max_load * mass
    if limit == math.inf:
        return full, 1.0
    width = 0.02 * limit
    limit = limit - other_thrust
    distance = abs(full - limit)
    rounding = width * math.log1p(math.exp(-distance / width))
    thrust = min(full, limit) - rounding
    if other_thrust > 0.0:
        thrust = max(0.0, thrust)  # the others alone may exceed the limit
    return thrust, thrust / full


@jit
def unthrottled_thrust(t: float, pressure: float, motors: UnthrottledMotors) -> tuple[float, float]:
    """Return thrust and mass flow of motors that cannot be throttled.

    Parameters
    ----------
    t : float
        Time since lift-off (s).
    pressure : float
        Ambient pressure (Pa).
    motors : UnthrottledMotors
        Total of the motors.

    Returns
    -------
    thrust, mass_flow : float
        N, kg/s. The thrust is never negative.
    """
    if motors.thrust == 0.0:
        return 0.0, 0.0
    span = t - motors.reference_time
    vacuum_thrust = motors.thrust + motors.thrust_slope * span
    thrust = vacuum_thrust - pressure * motors.exit_area
    mass_flow = motors.mass_flow + motors.flow_slope * span
    return max(0.0, thrust), mass_flow


@jit
def interpolate_drag(mach: float, drag: Drag) -> float:
    """Return the drag coefficient at a Mach number, as `np.interp`, which takes 3 s to compile."""
    last = drag.mach.size - 1
    if mach >= drag.mach[last]:
        return drag.coefficient[last]
    if mach <= drag.mach[0]:
        return drag.coefficient[0]
    k = 0
    while mach >= drag.mach[k + 1]:
        k += 1
    rise = drag.coefficient[k + 1] - drag.coefficient[k]
    width = drag.mach[k + 1] - drag.mach[k]
    slope = rise / width
    distance = mach - drag.mach[k]
    return slope * distance + drag.coefficient[k]


@jit
def drag_factor(r: tuple[float, float, float], w: tuple[float, float, float], drag: Drag) -> tuple[float, float]:
    """Return the drag force divided by airspeed, and the ambient pressure.

    Parameters
    ----------
    r : (3,) m
        Position, frame i.
    w : (3,) m/s
        Velocity relative to the air.
    drag : Drag
        Reference area and drag coefficients.

    Returns
    -------
    drag_per_speed, pressure : float
        N s/m, Pa.
    """
    height = height_above(r[0], r[1], r[2])
    density, pressure, _, sound = atmosphere(height)
    square_speed = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    speed = math.sqrt(square_speed)
    mach = speed / sound
    coefficient = interpolate_drag(mach, drag)
    drag_per_speed = 0.5 * density * speed * coefficient * drag.area
    return drag_per_speed, pressure


@jit
def rates(t: float, y: Floats, steering: Steering, engine: Propulsion, drag: Drag) -> Rates:
    """Return the time derivative of the state of a point mass.

    Forces are gravitation to J4, thrust along the steering direction, and drag in air that rotates with the Earth.

    Parameters
    ----------
    t : float
        Time since lift-off (s).
    y : (7,)
        Position (m) and velocity (m/s) in frame i, mass (kg).
    steering : Steering
        Steering laws.
    engine : Propulsion
        Propulsion of the leg.
    drag : Drag
        Reference area and drag coefficients.

    Returns
    -------
    tuple of 7 floats
        m/s, m/s^2, kg/s.
    """
    r = (y[0], y[1], y[2])
    v = (y[3], y[4], y[5])
    mass = y[6]
    airspeed = (
        v[0] + OMEGA * r[1],
        v[1] - OMEGA * r[0],
        v[2],
    )
    drag_per_speed, pressure = drag_factor(r, airspeed, drag)
    motor_thrust, motor_flow = unthrottled_thrust(t, pressure, engine.unthrottled_motors)
    thrust, throttle = engine_thrust(mass, pressure, engine, motor_thrust)
    thrust += motor_thrust
    u = direction(t, r, v, steering)
    gravity = gravity_j4(r[0], r[1], r[2])
    return (
        v[0],
        v[1],
        v[2],
        gravity[0] + (thrust * u[0] - drag_per_speed * airspeed[0]) / mass,
        gravity[1] + (thrust * u[1] - drag_per_speed * airspeed[1]) / mass,
        gravity[2] + (thrust * u[2] - drag_per_speed * airspeed[2]) / mass,
        -engine.mass_flow * throttle - motor_flow,
    )


@array_jit
def _euler_step(y: Floats, h: float, k: Rates) -> Floats:
    """Return y + h k (7,). Loops over scalars here: array expressions compile for seconds."""
    out = np.empty(7)
    for i in range(7):
        out[i] = y[i] + h * k[i]
    return out


@array_jit
def step(t: float, h: float, y: Floats, steering: Steering, engine: Propulsion, drag: Drag) -> Floats:
    """Return the state after a classical Runge-Kutta step of fourth order.

    Parameters
    ----------
    t, h : float
        Time at the start of the step, and its length (s).
    y : (7,)
        State at the start, as in `rates`.
    steering, engine, drag
        As in `rates`.

    Returns
    -------
    (7,)
        State at t + h.
    """
    half = 0.5 * h
    mid_t = t + half
    end_t = t + h
    k1 = rates(t, y, steering, engine, drag)
    y2 = _euler_step(y, half, k1)
    k2 = rates(mid_t, y2, steering, engine, drag)
    y3 = _euler_step(y, half, k2)
    k3 = rates(mid_t, y3, steering, engine, drag)
    y4 = _euler_step(y, h, k3)
    k4 = rates(end_t, y4, steering, engine, drag)
    out = np.empty(7)
    for i in range(7):
        slope = k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]
        out[i] = y[i] + h / 6.0 * slope
    return out


@array_jit
def fly(
    t0: float, duration: float, n_step: int, y0: Floats, steering: Steering, engine: Propulsion, drag: Drag
) -> tuple[Floats, Floats]:
    """Integrate a leg in equal steps.

    Parameters
    ----------
    t0, duration : float
        Time at the start (s since lift-off), and duration (s).
    n_step : int
        Number of steps.
    y0 : (7,)
        State at the start, as in `rates`.
    steering, engine, drag
        As in `rates`.

    Returns
    -------
    t : (n_step + 1,) s
        Times, both ends included.
    y : (n_step + 1, 7)
        States.
    """
    t = np.empty(n_step + 1)
    y = np.empty((n_step + 1, 7))
    for k in range(n_step + 1):
        t[k] = t0 + duration * k / n_step
    state = y0
    for k in range(n_step + 1):
        if k > 0:
            begin = t[k - 1]
            length = t[k] - begin
            state = step(begin, length, state, steering, engine, drag)
        for i in range(7):
            y[k, i] = state[i]
    return t, y


@array_jit
def time_to_mass(
    t0: float, mass: float, h: float, y0: Floats, steering: Steering, engine: Propulsion, drag: Drag
) -> float:
    """Return the burn time (s) from a state to a remaining mass.

    Parameters
    ----------
    t0 : float
        Time at the start (s since lift-off).
    mass : float
        Remaining mass (kg), smaller than that of `y0`.
    h : float
        Step of the integration (s).
    y0 : (7,)
        State at the start, as in `rates`.
    steering, engine, drag
        As in `rates`.
    """
    t, y = t0, y0
    while y[6] > mass:
        previous_y = y
        y = step(t, h, y, steering, engine, drag)
        t += h
    t -= h
    last_step = h
    for _ in range(4):  # secant on the last step, where the flow hardly changes
        last_step *= (previous_y[6] - mass) / (previous_y[6] - y[6])
        y = step(t, last_step, previous_y, steering, engine, drag)
    return t + last_step - t0


@array_jit
def accelerations(t: Floats, y: Floats, steering: Steering, engine: Propulsion, drag: Drag) -> Floats:
    """Return the inertial acceleration at states of a leg.

    Parameters
    ----------
    t : (n,) s
        Times since lift-off.
    y : (n, 7)
        States, as in `rates`.
    steering, engine, drag
        As in `rates`.

    Returns
    -------
    (n, 3) m/s^2
        Acceleration including gravitation, frame i.
    """
    out = np.empty((t.size, 3))
    for k in range(t.size):
        rate = rates(t[k], y[k], steering, engine, drag)
        out[k, 0] = rate[3]
        out[k, 1] = rate[4]
        out[k, 2] = rate[5]
    return out
