"""Motion over a piece of a guided ascent: a dispersed point mass in the commanded attitude of its navigation."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.earth import GM, OMEGA, gravity_j4
from lvnav_trade.kernels.jit import array_jit, jit
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.equations_of_motion import (
    Drag,
    Propulsion,
    drag_factor,
    engine_thrust,
    height_above,
    unthrottled_thrust,
)
from lvnav_trade.trajectory.ascent.steering_law import smoothstep
from lvnav_trade.trajectory.guided.explicit import LAMBDA, REFERENCE, STARTED, TGO, TURN, Target, steer
from lvnav_trade.trajectory.guided.vectors import Vector, blend, cross, unit_vector

WHOLE, CUT_OFF, EMPTY, DIVERGED = 0, 1, 2, 3
"""End of a piece: at its planned time, at the cut-off, out of propellant, or because guidance diverges."""
_REFINED = 4  # secant steps to the cut-off within a step


class AttitudeProgramme(NamedTuple):
    """The attitude programme that is stored before lift-off.

    step : s. Interval of its entries, the first of which is at lift-off.
    u : (n, 3). Direction of the thrust, frame i.
    """

    step: float
    u: Floats


class NavigationErrors(NamedTuple):
    """Navigation errors over a flight. From each of the times to the next one the error stays, and that of the position
    grows by that of the velocity: between two updates a strapdown only integrates.

    t : (n,) s since lift-off.
    error : (n, 9). Truth less estimate of attitude (rad), velocity (m/s) and position (m), frame i.
    """

    t: Floats
    error: Floats


PERFECT = NavigationErrors(np.array([0.0, 1.0]), np.zeros((2, 9)))


class Wind(NamedTuple):
    """Wind over height, linear between the entries; none above the last one.

    step : m. Interval of height, from the ellipsoid on.
    speed : (n, 2) m/s. Towards east and north.
    """

    step: float
    speed: Floats


class Cutoff(NamedTuple):
    """Conditions for the end of the last burn: the cut-off, or an empty stage.

    is_at_energy : Whether the cut-off is at an energy; otherwise it is at a time.
    energy : J/kg. Specific two-body energy of the navigated state at the cut-off.
    time : s since lift-off. Time of the cut-off.
    empty_mass : kg. Mass of the vehicle with an empty stage.
    """

    is_at_energy: bool
    energy: float
    time: float
    empty_mass: float


class GuidanceLaw(NamedTuple):
    """Explicit guidance of the last stage.

    start : s since lift-off. From then on it steers; infinite: never.
    slew : s. Time in which the command changes from the programme to its law.
    cycle : s. Interval of its passes.
    freeze_time : s. Time to go below which its law is no longer updated.
    exhaust_speed : m/s. Exhaust speed as it is known before lift-off.
    target : State at the end of the burn.
    state : (N_LAW_STATE,). State of the law from pass to pass, see `steer`; updated.
    schuler : Whether it predicts gravity by the Schuler approximation.
    """

    start: float
    slew: float
    cycle: float
    freeze_time: float
    exhaust_speed: float
    target: Target
    state: Floats
    schuler: bool = False


class AscentInputs(NamedTuple):
    """Inputs of the simulation of a piece of an ascent, apart from its propulsion.

    programme : Attitude programme.
    navigation : Navigation errors.
    drag : Drag of the vehicle.
    wind : Wind over height.
    misalignment : (2,) rad. Of the thrust, down and to the right.
    law : Explicit guidance.
    lag : s. Time constant with which the body follows its command; 0: at once. With a lag a state has ten numbers, the
        last three the direction of the body.
    """

    programme: AttitudeProgramme
    navigation: NavigationErrors
    drag: Drag
    wind: Wind
    misalignment: Floats
    law: GuidanceLaw
    lag: float = 0.0


@jit
def _entry_index(t: float, navigation: NavigationErrors) -> int:
    """Return the index of the entry whose errors apply at a time (s)."""
    return max(0, int(np.searchsorted(navigation.t, t, side="right")) - 1)


@jit
def attitude_error_at(t: float, navigation: NavigationErrors) -> Vector:
    """Return the attitude error (rad, frame i) at a time (s)."""
    error = navigation.error[_entry_index(t, navigation)]
    return error[0], error[1], error[2]


@array_jit
def error_at(t: float, navigation: NavigationErrors) -> Floats:
    """Return the navigation errors (9,) at a time (s)."""
    k = _entry_index(t, navigation)
    out = navigation.error[k].copy()
    span = max(0.0, t - navigation.t[k])
    for i in range(3):
        out[6 + i] += span * out[3 + i]
    return out


@jit
def commanded_direction(t: float, inputs: AscentInputs) -> Vector:
    """Return the direction (frame i) of the thrust that guidance commands at a time (s)."""
    programme, law = inputs.programme, inputs.law
    last = programme.u.shape[0] - 1
    x = min(max(t / programme.step, 0.0), last - 1e-9)
    k = int(x)
    u, next_u = programme.u[k], programme.u[k + 1]
    previous_u = (u[0], u[1], u[2])
    following_u = (next_u[0], next_u[1], next_u[2])
    programme_u = blend(x - k, previous_u, following_u)
    if law.state[STARTED] == 0.0:
        return programme_u
    state = law.state
    span = t - state[REFERENCE]
    # Linear-tangent law: lambda + lambda_dot (t - t_reference)
    explicit = unit_vector(
        state[LAMBDA] + span * state[TURN],
        state[LAMBDA + 1] + span * state[TURN + 1],
        state[LAMBDA + 2] + span * state[TURN + 2],
    )
    weight = smoothstep((t - law.start) / law.slew)
    return blend(weight, programme_u, explicit)


@jit
def held_direction(t: float, inputs: AscentInputs) -> Vector:
    """Return the true direction of a body that has the commanded attitude by its navigation.

    C_true = (1 + [error x]) C_estimated.
    """
    u = commanded_direction(t, inputs)
    error = attitude_error_at(t, inputs.navigation)
    return unit_vector(
        u[0] + error[1] * u[2] - error[2] * u[1],
        u[1] + error[2] * u[0] - error[0] * u[2],
        u[2] + error[0] * u[1] - error[1] * u[0],
    )


@jit
def misaligned_direction(u: Vector, r: Vector, misalignment: Floats) -> Vector:
    """Return the direction of the thrust of a body that points along u: turned down and to the right by (2,) rad."""
    down = misalignment[0]
    right = misalignment[1]
    if down == 0.0 and right == 0.0:
        return u
    across = cross(u, r)
    right_axis = unit_vector(across[0], across[1], across[2])
    up_axis = cross(right_axis, u)
    return unit_vector(
        u[0] + right * right_axis[0] - down * up_axis[0],
        u[1] + right * right_axis[1] - down * up_axis[1],
        u[2] + right * right_axis[2] - down * up_axis[2],
    )


@jit
def thrust_direction(t: float, r: Vector, inputs: AscentInputs) -> Vector:
    """Return the true direction of the thrust of a body in its commanded attitude, with its misalignment."""
    return misaligned_direction(held_direction(t, inputs), r, inputs.misalignment)


@jit
def air_velocity(r: Vector, wind: Wind) -> Vector:
    """Return the velocity of the air over the ground, frame i."""
    x = height_above(r[0], r[1], r[2]) / wind.step
    last = wind.speed.shape[0] - 1
    if last < 1 or x >= last:
        return 0.0, 0.0, 0.0
    x = max(x, 0.0)
    k = int(x)
    weight = x - k
    lower_speed, upper_speed = wind.speed[k], wind.speed[k + 1]
    east = lower_speed[0] + weight * (upper_speed[0] - lower_speed[0])
    north = lower_speed[1] + weight * (upper_speed[1] - lower_speed[1])
    # Unit vectors on a sphere: east (-y, x, 0) / axial, north (-z x / axial, -z y / axial, axial) / radius
    x_i, y_i, z_i = r[0], r[1], r[2]
    axial = math.sqrt(x_i * x_i + y_i * y_i)
    radius = math.sqrt(axial * axial + z_i * z_i)
    east_x = -y_i / axial
    east_y = x_i / axial
    inward = north * z_i / radius
    return (
        east * east_x - inward * x_i / axial,
        east * east_y - inward * y_i / axial,
        north * axial / radius,
    )


@array_jit
def rates(t: float, y: Floats, engine: Propulsion, inputs: AscentInputs) -> Floats:
    """Return the time derivative of y (7 or 10,): inertial position (m), velocity (m/s), mass (kg), and with a lag the
    direction of the body.
    """
    r = (y[0], y[1], y[2])
    wind = air_velocity(r, inputs.wind)
    airspeed = (
        y[3] + OMEGA * r[1] - wind[0],
        y[4] - OMEGA * r[0] - wind[1],
        y[5] - wind[2],
    )
    drag_per_speed, pressure = drag_factor(r, airspeed, inputs.drag)
    motor_thrust, motor_flow = unthrottled_thrust(t, pressure, engine.unthrottled_motors)
    thrust, throttle = engine_thrust(y[6], pressure, engine, motor_thrust)
    thrust += motor_thrust
    gravity = gravity_j4(r[0], r[1], r[2])
    out = np.empty(y.size)
    direction = (0.0, 0.0, 0.0)
    if inputs.lag > 0.0:
        command = held_direction(t, inputs)
        body = (y[7], y[8], y[9])
        for i in range(3):
            out[7 + i] = (command[i] - body[i]) / inputs.lag
        direction = misaligned_direction(unit_vector(body[0], body[1], body[2]), r, inputs.misalignment)
    elif thrust > 0.0:
        direction = thrust_direction(t, r, inputs)
    for i in range(3):
        out[i] = y[3 + i]
        out[3 + i] = gravity[i] + (thrust * direction[i] - drag_per_speed * airspeed[i]) / y[6]
    out[6] = -engine.mass_flow * throttle - motor_flow
    return out


@array_jit
def step(t: float, h: float, y: Floats, engine: Propulsion, inputs: AscentInputs) -> Floats:
    """Return y (7 or 10,) advanced by h with the classical Runge-Kutta step of fourth order."""
    half = 0.5 * h
    mid_t = t + half
    end_t = t + h
    k1 = rates(t, y, engine, inputs)
    k2 = rates(mid_t, y + half * k1, engine, inputs)
    k3 = rates(mid_t, y + half * k2, engine, inputs)
    k4 = rates(end_t, y + h * k3, engine, inputs)
    slope = k1 + 2.0 * (k2 + k3) + k4
    return y + h / 6.0 * slope


@array_jit
def navigated_energy(t: float, y: Floats, navigation: NavigationErrors) -> float:
    """Return the specific energy (J/kg) of the navigated state, two-body."""
    error = error_at(t, navigation)
    v = y[3:6] - error[3:6]
    r = y[:3] - error[6:9]
    kinetic = 0.5 * np.dot(v, v)
    radius = math.sqrt(np.dot(r, r))
    return kinetic - GM / radius


@array_jit
def fly_piece(t: float, end: float, longest_step: float, y: Floats, engine: Propulsion, inputs: AscentInputs) -> Floats:
    """Return the state (7 or 10,) after a piece from t to `end` without cut-off, in at least eight steps.

    longest_step : s. The longest step.
    """
    n_step = max(8, math.ceil((end - t) / longest_step))
    h = (end - t) / n_step
    for k in range(n_step):
        y = step(t + k * h, h, y, engine, inputs)
    return y


@array_jit
def guide(t: float, y: Floats, engine: Propulsion, inputs: AscentInputs) -> bool:
    """Update explicit guidance at a true state y (7,); return whether it converges."""
    law = inputs.law
    error = error_at(t, inputs.navigation)
    is_frozen = law.state[STARTED] > 0.0 and law.state[TGO] < law.freeze_time
    if t < law.start or is_frozen:
        return True
    slope = rates(t, y, engine, inputs)
    gravity = gravity_j4(y[0], y[1], y[2])
    force_x = slope[3] - gravity[0]
    force_y = slope[4] - gravity[1]
    force_z = slope[5] - gravity[2]
    specific_force = math.sqrt(force_x**2 + force_y**2 + force_z**2)
    navigated_r = y[:3] - error[6:9]
    navigated_v = y[3:6] - error[3:6]
    return steer(law.state, t, navigated_r, navigated_v, specific_force, law.exhaust_speed, law.target, law.schuler)


@array_jit
def _distance_to_end(t: float, h: float, y: Floats, inputs: AscentInputs, cutoff: Cutoff, end: int) -> float:
    """Return the distance of a state y (7,), h seconds after t, to the end of the burn; negative after it.

    end : CUT_OFF (distance in energy, J/kg, or time, s) or EMPTY (mass, kg).
    """
    if end == EMPTY:
        return y[6] - cutoff.empty_mass
    if cutoff.is_at_energy:
        return cutoff.energy - navigated_energy(t + h, y, inputs.navigation)
    return cutoff.time - t - h


@array_jit
def _step_to_end(
    t: float, h: float, y: Floats, engine: Propulsion, inputs: AscentInputs, cutoff: Cutoff
) -> tuple[float, Floats, int]:
    """Return length (s) and final state of a step of at most h (s), and the reason for its end.

    The reason is CUT_OFF, EMPTY or WHOLE. Cut-off and depletion within the step are found by the secant method on its
    length.
    """
    length = h
    state = step(t, h, y, engine, inputs)
    outcome = WHOLE
    for end in (CUT_OFF, EMPTY):
        start_distance = _distance_to_end(t, 0.0, y, inputs, cutoff, end)
        end_distance = _distance_to_end(t, length, state, inputs, cutoff, end)
        if end_distance > 0.0:
            continue
        trial_length = length * start_distance / (start_distance - end_distance)
        for _ in range(_REFINED):
            trial = step(t, trial_length, y, engine, inputs)
            end_distance = _distance_to_end(t, trial_length, trial, inputs, cutoff, end)
            if start_distance == end_distance:
                break
            secant = trial_length * start_distance / (start_distance - end_distance)
            trial_length = min(length, max(0.0, secant))
        length = trial_length
        state = step(t, trial_length, y, engine, inputs)
        outcome = end
    return length, state, outcome


@array_jit
def fly_last(
    t: float, end: float, longest_step: float, y: Floats, engine: Propulsion, inputs: AscentInputs, cutoff: Cutoff
) -> tuple[float, Floats, int]:
    """Return time (s), state (7 or 10,) and reason at the end of a piece of the last burn.

    t, end : s since lift-off. Start, and latest end.
    longest_step : s. The longest step.

    The reason is WHOLE, CUT_OFF, EMPTY or DIVERGED.
    """
    law = inputs.law
    next_pass = t
    while t < end - 1e-9:
        if law.start < math.inf and t >= next_pass - 1e-9:
            if not guide(t, y, engine, inputs):
                return t, y, DIVERGED
            next_pass = t + law.cycle
        h, y, outcome = _step_to_end(t, min(longest_step, end - t), y, engine, inputs, cutoff)
        t += h
        if outcome != WHOLE:
            return t, y, outcome
    return t, y, WHOLE
