"""Motion over a piece of an ascent under attitude control: nozzle, air and thrusters turn the body and its thrust.

Forces, air, wind, events, the law of the last stage and the cut-off are those of `guided_dynamics.py`. At each tick of
the IMU, `loop.py` turns the body about both axes, and a step of second order moves it.
"""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.earth import OMEGA, gravity_j4
from lvnav_trade.kernels.jit import array_jit, inline_jit
from lvnav_trade.kernels.media.atmosphere import atmosphere
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.equations_of_motion import (
    Propulsion,
    engine_thrust,
    height_above,
    interpolate_drag,
    unthrottled_thrust,
)
from lvnav_trade.trajectory.guided.autopilot import MOTOR, NEXT, OF_THE_RUN, STACK, ControlledAttitude, LateralForces
from lvnav_trade.trajectory.guided.axis_state import ANGLE_NOW, GUST_NOW, MISALIGNMENT_NOW, NOZZLE_NOW, TARGET, ignite
from lvnav_trade.trajectory.guided.explicit import STARTED
from lvnav_trade.trajectory.guided.guided_dynamics import (
    CUT_OFF,
    DIVERGED,
    EMPTY,
    WHOLE,
    AscentInputs,
    Cutoff,
    air_velocity,
    commanded_direction,
    error_at,
    guide,
    navigated_energy,
)
from lvnav_trade.trajectory.guided.loop import move, tick

_REFINED = 3  # secant steps to the cut-off within a tick
NEVER = Cutoff(
    is_at_energy=False,
    energy=0.0,
    time=math.inf,
    empty_mass=0.0,
)
"""A piece without cut-off, and without an empty stage."""


class RotationalModel(NamedTuple):
    """Rotational properties of the vehicle.

    stacks : (n_stage, 4). Of the stack with each stage the lowest: square of the radius of gyration (m^2), arm of the
        nozzle (m), slope of the normal force (1/rad), arm of the pressure (m).
    density : Factor on the density of the air.
    thruster : N m. Moment of a pair of thrusters.
    """

    stacks: Floats
    density: float
    thruster: float


class Gusts(NamedTuple):
    """Gusts over height, linear between the entries, constant above the last entry.

    step : m. Interval of height, from the ellipsoid on.
    sigma : (n,) m/s.
    length : (n,) m. Scale.
    """

    step: float
    sigma: Floats
    length: Floats


class AttitudeControl(NamedTuple):
    """Attitude control, body and gusts of a run; its `AscentInputs` are separate.

    control : The controlled attitude.
    craft : The body.
    gusts : Gusts over height.
    path : (n_tick, 7). True state at every tick, as in `forces_and_rates`; no rows if the path is not recorded; set.
    """

    control: ControlledAttitude
    craft: RotationalModel
    gusts: Gusts
    path: Floats


@inline_jit
def _gust_statistics(height, gusts):
    """Return sigma (m/s) and length (m) of the gusts at a height (m)."""
    last = gusts.sigma.size - 1
    x = min(max(height / gusts.step, 0.0), float(last))
    lower = min(int(x), max(last - 1, 0))
    upper = min(lower + 1, last)
    weight = x - lower
    sigma_below = gusts.sigma[lower]
    length_below = gusts.length[lower]
    sigma = sigma_below + weight * (gusts.sigma[upper] - sigma_below)
    length = length_below + weight * (gusts.length[upper] - length_below)
    return sigma, length


@inline_jit
def _interpolate_axis(rows, k, weight):
    """Return a direction between ticks k and k + 1.

    rows : (n, 3). Directions at the ticks.
    weight : part of the interval after tick k, 0 to 1
    """
    a, b = rows[k], rows[k + 1]
    return (
        a[0] + weight * (b[0] - a[0]),
        a[1] + weight * (b[1] - a[1]),
        a[2] + weight * (b[2] - a[2]),
    )


@inline_jit
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inline_jit
def axes_at(t, course):
    """Return the commanded directions ahead, up and right of the body at a time (s), frame i.

    After the last tick, the directions of that tick are returned.
    """
    interval = course.t[1] - course.t[0]
    x = t / interval
    k = min(int(x + 1e-6), course.t.size - 2)
    weight = min(max(x - k, 0.0), 1.0)
    ahead = _interpolate_axis(course.ahead, k, weight)
    up = _interpolate_axis(course.up, k, weight)
    right = _interpolate_axis(course.right, k, weight)
    return ahead, up, right


@inline_jit
def forces_and_rates(t, y, engine, inputs, turning):
    """Return forces and air (`LateralForces`) at a true state, and the time derivative of the state.

    Thrust acts along the body, turned by the nozzle angle and the misalignment. Drag acts along the body, and the
    normal force along `up` and `right`. The drag term is written against the airspeed; its component lateral to the
    body is subtracted from the lift, so that the sum acts along the body.

    t : s since lift-off
    y : (7,). Position (m) and velocity (m/s) in frame i, mass (kg).

    Long because force, moment and derivative share every intermediate quantity.
    """
    control = turning.control
    craft = turning.craft
    r = (y[0], y[1], y[2])
    mass = y[6]
    air = air_velocity(r, inputs.wind)
    ground = (
        y[3] + OMEGA * r[1],
        y[4] - OMEGA * r[0],
        y[5],
    )
    airspeed = (
        ground[0] - air[0],
        ground[1] - air[1],
        ground[2] - air[2],
    )
    speed = math.sqrt(_dot(airspeed, airspeed))
    height = height_above(r[0], r[1], r[2])
    density, pressure, _, sound = atmosphere(height)
    area = inputs.drag.area
    drag_coefficient = interpolate_drag(speed / sound, inputs.drag)
    drag_per_speed = 0.5 * density * speed * drag_coefficient * area
    motor_thrust, motor_flow = unthrottled_thrust(t, pressure, engine.unthrottled_motors)
    thrust, throttle = engine_thrust(mass, pressure, engine, motor_thrust)
    thrust += motor_thrust
    ahead, up, right = axes_at(t, control.course)

    # Lateral acceleration per lateral airspeed, from the slope of the normal force: q A slope / (V m)
    stack = control.counts[STACK] - 1
    square_gyration = craft.stacks[stack, 0]
    nozzle_arm = craft.stacks[stack, 1]
    normal_slope = craft.stacks[stack, 2]
    pressure_arm = craft.stacks[stack, 3]
    half_density = 0.5 * craft.density * density
    normal_force = half_density * speed * area * normal_slope / mass
    gust_sigma, gust_length = _gust_statistics(height, turning.gusts)
    slip = (_dot(ground, up), _dot(ground, right))
    wind = (_dot(air, up), _dot(air, right))

    # The thrust is along (1, angle + nozzle + misalignment in pitch, the same in yaw).
    pitch, yaw = control.memory[0], control.memory[1]
    thrust_up = pitch[ANGLE_NOW] + pitch[NOZZLE_NOW] + pitch[MISALIGNMENT_NOW]
    thrust_right = yaw[ANGLE_NOW] + yaw[NOZZLE_NOW] + yaw[MISALIGNMENT_NOW]
    thrust_norm = math.sqrt(1.0 + thrust_up * thrust_up + thrust_right * thrust_right)
    thrust_load = thrust / mass
    thrust_ahead = thrust_load / thrust_norm
    drag = drag_per_speed / mass
    calm_up = speed * pitch[ANGLE_NOW] + wind[0] - slip[0]  # lateral airspeed without gusts
    calm_right = speed * yaw[ANGLE_NOW] + wind[1] - slip[1]
    gusty_up = calm_up + pitch[GUST_NOW]
    gusty_right = calm_right + yaw[GUST_NOW]
    lift_up = thrust_ahead * thrust_up + normal_force * gusty_up - drag * calm_up
    lift_right = thrust_ahead * thrust_right + normal_force * gusty_right - drag * calm_right
    gravity = gravity_j4(r[0], r[1], r[2])
    slope = (
        y[3],
        y[4],
        y[5],
        gravity[0] + thrust_ahead * ahead[0] + lift_up * up[0] + lift_right * right[0] - drag * airspeed[0],
        gravity[1] + thrust_ahead * ahead[1] + lift_up * up[1] + lift_right * right[1] - drag * airspeed[1],
        gravity[2] + thrust_ahead * ahead[2] + lift_up * up[2] + lift_right * right[2] - drag * airspeed[2],
        -engine.mass_flow * throttle - motor_flow,
    )
    course = control.course
    tick_index = min(control.counts[NEXT], course.t.size - 1)
    nominal = course.velocity[tick_index]
    deviation = (
        y[3] - nominal[0],
        y[4] - nominal[1],
        y[5] - nominal[2],
    )
    forces = LateralForces(
        effectiveness=thrust_load * nozzle_arm / square_gyration,
        thrust_load=thrust_load,
        moment=normal_force * pressure_arm / square_gyration,
        force=normal_force,
        airspeed=speed,
        slip=slip,
        wind=wind,
        drift=(_dot(deviation, up), _dot(deviation, right)),
        gust=gust_sigma,
        gust_rate=speed / gust_length,
        thruster=craft.thruster / (mass * square_gyration),
    )
    return forces, slope


@array_jit
def _attitude_error(t, inputs, turning):
    """Return the navigation's attitude error in pitch and yaw (rad); zero if the controller does not use it."""
    if turning.control.settings.feed.attitude != OF_THE_RUN:
        return 0.0, 0.0
    error = error_at(t, inputs.navigation)
    ahead, up, right = axes_at(t, turning.control.course)
    nose_motion = (
        error[1] * ahead[2] - error[2] * ahead[1],
        error[2] * ahead[0] - error[0] * ahead[2],
        error[0] * ahead[1] - error[1] * ahead[0],
    )
    error_up = _dot(nose_motion, up)
    error_right = _dot(nose_motion, right)
    return error_up, error_right


@array_jit
def _set_targets(t, inputs, turning):
    """Set the targets of both axes to the direction of explicit guidance, after its first pass."""
    if inputs.law.state[STARTED] == 0.0:
        return
    control = turning.control
    command = commanded_direction(t, inputs)
    ahead, up, right = axes_at(t, control.course)
    along = _dot(command, ahead)
    command_up = _dot(command, up)
    command_right = _dot(command, right)
    control.memory[0, TARGET] = command_up / along
    control.memory[1, TARGET] = command_right / along


@inline_jit
def _advance(t, h, y, engine, inputs, turning, end):
    """Turn the body about both axes and move it over h seconds.

    The velocity changes by the mean of the accelerations at both ends (Heun). The second acceleration is evaluated at
    the state predicted with the first.

    t, h : s. Time since lift-off, and length of the step.
    y, end : (7,). State at the start, and at the end (set).
    """
    half = 0.5 * h
    forces, slope = forces_and_rates(t, y, engine, inputs, turning)
    move(turning.control, forces, h)
    for i in range(3):
        velocity = y[3 + i]
        acceleration = slope[3 + i]
        mean_velocity = velocity + half * acceleration
        end[i] = y[i] + h * mean_velocity
        end[3 + i] = velocity + h * acceleration
    end[6] = y[6] + h * slope[6]
    _, next_slope = forces_and_rates(t + h, end, engine, inputs, turning)
    for i in range(3):
        velocity = y[3 + i]
        acceleration = slope[3 + i]
        next_acceleration = next_slope[3 + i]
        mean_velocity = velocity + h / 6.0 * (2.0 * acceleration + next_acceleration)
        end[i] = y[i] + h * mean_velocity
        end[3 + i] = velocity + half * (acceleration + next_acceleration)
    end[6] = y[6] + half * (slope[6] + next_slope[6])


@array_jit
def _distance_to_end(t, y, inputs, cutoff, end):
    """Return the distance of a true state y (7,) to the end of the burn; negative after it.

    end : EMPTY (distance in mass, kg) or CUT_OFF (distance in navigated energy, J/kg, or in time, s).
    """
    if end == EMPTY:
        return y[6] - cutoff.empty_mass
    if cutoff.is_at_energy:
        return cutoff.energy - navigated_energy(t, y, inputs.navigation)
    return cutoff.time - t


@array_jit
def turn_piece(
    t: float, end: float, y: Floats, engine: Propulsion, inputs: AscentInputs, turning: AttitudeControl, cutoff: Cutoff
) -> tuple[float, Floats, int]:
    """Return time (s), state (7,) and reason at the end of a piece of flight, which lasts to `end` at most.

    The count of ticks continues from piece to piece. A command remains valid across the end of a piece; an engine does
    not.

    t, end : s since lift-off. Start, and latest end.
    y : (7,). True state at the start, as in `forces_and_rates`.

    The reason is WHOLE, CUT_OFF, EMPTY or DIVERGED.

    Long because guidance, ticks and cut-off alternate in one loop.
    """
    control, law = turning.control, inputs.law
    count, memory = control.counts, control.memory
    dt = control.course.t[1] - control.course.t[0]
    y = y.copy()
    next_y = y.copy()
    memory_before = memory.copy()
    motor = count[STACK] if engine.thrust > 0.0 or engine.unthrottled_motors.thrust > 0.0 else 0
    if motor != count[MOTOR]:
        ignite(control, motor, -inputs.misalignment[0], inputs.misalignment[1])
    next_pass = t
    has_cutoff = cutoff.is_at_energy or cutoff.time < math.inf or cutoff.empty_mass > 0.0
    is_guided = law.start < math.inf
    while t < end - 1e-9:
        if is_guided and t >= next_pass - 1e-9:
            if not guide(t, y, engine, inputs):
                return t, y, DIVERGED
            next_pass = t + law.cycle
        if t >= count[NEXT] * dt - 1e-9:
            forces, _ = forces_and_rates(t, y, engine, inputs, turning)
            _set_targets(t, inputs, turning)
            if count[NEXT] < turning.path.shape[0]:
                turning.path[count[NEXT]] = y
            tilt = _attitude_error(t, inputs, turning)
            tick(control, forces, tilt)
        h = min(count[NEXT] * dt, end) - t
        memory_before[:] = memory
        _advance(t, h, y, engine, inputs, turning, next_y)
        outcome = WHOLE
        for burn_end in (CUT_OFF, EMPTY):
            if not has_cutoff:
                continue
            end_distance = _distance_to_end(t + h, next_y, inputs, cutoff, burn_end)
            if end_distance > 0.0:
                continue
            start_distance = _distance_to_end(t, y, inputs, cutoff, burn_end)
            outcome = burn_end
            length = h
            for _ in range(_REFINED):  # secant on the length of the step
                if start_distance == end_distance:
                    break
                secant = length * start_distance / (start_distance - end_distance)
                length = min(h, max(0.0, secant))
                memory[:] = memory_before
                _advance(t, length, y, engine, inputs, turning, next_y)
                end_distance = _distance_to_end(t + length, next_y, inputs, cutoff, burn_end)
            h = length
        t += h
        y[:] = next_y
        if outcome != WHOLE:
            return t, y, outcome
    return t, y, WHOLE


@array_jit
def acceleration(t: float, y: Floats, engine: Propulsion, inputs: AscentInputs, turning: AttitudeControl) -> Floats:
    """Return the inertial acceleration (3,) m/s^2, frame i, at a true state y (7,) and a time t (s since lift-off)."""
    _, slope = forces_and_rates(t, y, engine, inputs, turning)
    return np.array([slope[3], slope[4], slope[5]])
