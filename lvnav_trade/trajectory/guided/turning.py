"""Flight of a piece of an ascent under attitude control: nozzle, air and thrusters turn the body, thrust follows it.

Forces, air, wind, events, the law of the last stage and the cut-off are those of `guided_dynamics.py`. Each tick of the
inertial unit the axes of `loop.py` turn the body, and a step of second order moves it.
"""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.earth import OMEGA, gravity_j4
from lvnav_trade.kernels.jit import inlined, making_arrays
from lvnav_trade.kernels.media.atmosphere import atmosphere
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.equations_of_motion import (
    Propulsion,
    coefficient_at,
    height_above,
    thrust_beside,
    thrust_of,
)
from lvnav_trade.trajectory.guided.autopilot import MOTOR, NEXT, OF_THE_RUN, STACK, ControlledAttitude, LateralForces
from lvnav_trade.trajectory.guided.explicit import STARTED
from lvnav_trade.trajectory.guided.guided_dynamics import (
    CUT_OFF,
    DIVERGED,
    EMPTY,
    WHOLE,
    AscentInputs,
    Cutoff,
    commanded,
    error_at,
    guide,
    navigated_energy,
    velocity_of_air,
)
from lvnav_trade.trajectory.guided.loop import ANGLE_NOW, GUST_NOW, MISALIGNED, PUSH_NOW, TARGET, ignite, move, tick

_REFINED = 3  # secant steps to the cut-off within a tick
NEVER = Cutoff(False, 0.0, math.inf, 0.0)
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
    """Attitude control, body and gusts of a run; its surroundings are separate.

    control : The controlled attitude.
    craft : The body.
    gusts : Gusts over height.
    path : (n_record, 7). True state at every recorded tick; without rows if nothing is recorded; set.
    """

    control: ControlledAttitude
    craft: RotationalModel
    gusts: Gusts
    path: Floats


@inlined
def _gust_at(height, gusts):
    """Return sigma (m/s) and length (m) of the gusts at a height (m)."""
    last = gusts.sigma.size - 1
    x = min(max(height / gusts.step, 0.0), float(last))
    k = min(int(x), max(last - 1, 0))
    n, w = min(k + 1, last), x - k
    sigma = gusts.sigma[k] + w * (gusts.sigma[n] - gusts.sigma[k])
    return sigma, gusts.length[k] + w * (gusts.length[n] - gusts.length[k])


@inlined
def _axis_at(rows, k, w):
    """Return a direction between two ticks."""
    a, b = rows[k], rows[k + 1]
    return a[0] + w * (b[0] - a[0]), a[1] + w * (b[1] - a[1]), a[2] + w * (b[2] - a[2])


@inlined
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def axes_at(t, course):
    """Return the commanded directions ahead, up and right of the body at a time (s), frame i.

    After the last tick, the directions of that tick are returned.
    """
    x = t / (course.t[1] - course.t[0])
    k = min(int(x + 1e-6), course.t.size - 2)
    w = min(max(x - k, 0.0), 1.0)
    return _axis_at(course.ahead, k, w), _axis_at(course.up, k, w), _axis_at(course.right, k, w)


@inlined
def meet(t, y, engine, around, turning):
    """Return forces and air (`LateralForces`) at a true state y (7,), and the time derivative of the state.

    Thrust acts along the body, turned by the nozzle angle and the misalignment. Drag acts along the body, and the
    normal force along `up` and `right`. The drag term is written against the airspeed; its component lateral to the
    body is subtracted from the lift, so that the sum acts along the body.

    Long because force, moment and derivative share every intermediate quantity.
    """
    control, craft = turning.control, turning.craft
    r, mass = (y[0], y[1], y[2]), y[6]
    air = velocity_of_air(r, around.wind)
    ground = (y[3] + OMEGA * r[1], y[4] - OMEGA * r[0], y[5])
    w = (ground[0] - air[0], ground[1] - air[1], ground[2] - air[2])
    speed = math.sqrt(_dot(w, w))
    height = height_above(r[0], r[1], r[2])
    air_density, pressure, _, sound = atmosphere(height)
    area = around.drag.area
    push = 0.5 * air_density * speed * coefficient_at(speed / sound, around.drag) * area
    other, flow = thrust_beside(t, pressure, engine.beside)
    thrust, throttle = thrust_of(mass, pressure, engine, other)
    thrust += other
    ahead, up, right = axes_at(t, control.course)
    k = control.counts[STACK] - 1
    gyration, nozzle, normal, arm = craft.stacks[k, 0], craft.stacks[k, 1], craft.stacks[k, 2], craft.stacks[k, 3]
    force = 0.5 * craft.density * air_density * speed * area * normal / mass
    sigma, length = _gust_at(height, turning.gusts)
    slip, wind = (_dot(ground, up), _dot(ground, right)), (_dot(air, up), _dot(air, right))
    pitch, yaw = control.memory[0], control.memory[1]
    off_up = pitch[ANGLE_NOW] + pitch[PUSH_NOW] + pitch[MISALIGNED]
    off_right = yaw[ANGLE_NOW] + yaw[PUSH_NOW] + yaw[MISALIGNED]
    size = thrust / mass / math.sqrt(1.0 + off_up * off_up + off_right * off_right)
    back = push / mass
    calm_up = speed * pitch[ANGLE_NOW] + wind[0] - slip[0]  # of the air without gusts
    calm_right = speed * yaw[ANGLE_NOW] + wind[1] - slip[1]
    lift_up = size * off_up + force * (calm_up + pitch[GUST_NOW]) - back * calm_up
    lift_right = size * off_right + force * (calm_right + yaw[GUST_NOW]) - back * calm_right
    g = gravity_j4(r[0], r[1], r[2])
    slope = (
        y[3],
        y[4],
        y[5],
        g[0] + size * ahead[0] + lift_up * up[0] + lift_right * right[0] - back * w[0],
        g[1] + size * ahead[1] + lift_up * up[1] + lift_right * right[1] - back * w[1],
        g[2] + size * ahead[2] + lift_up * up[2] + lift_right * right[2] - back * w[2],
        -engine.mass_flow * throttle - flow,
    )
    at = min(control.counts[NEXT], control.course.t.size - 1)
    nominal = control.course.velocity[at]
    past = (y[3] - nominal[0], y[4] - nominal[1], y[5] - nominal[2])
    met = LateralForces(
        thrust / mass * nozzle / gyration,
        thrust / mass,
        force * arm / gyration,
        force,
        speed,
        slip,
        wind,
        (_dot(past, up), _dot(past, right)),
        sigma,
        speed / length,
        craft.thruster / (mass * gyration),
    )
    return met, slope


@making_arrays
def _tilt(t, around, turning):
    """Return the navigation's attitude error in pitch and yaw (rad); zero if the controller does not use it."""
    if turning.control.settings.feed.attitude != OF_THE_RUN:
        return 0.0, 0.0
    e = error_at(t, around.navigation)
    ahead, up, right = axes_at(t, turning.control.course)
    moved = (
        e[1] * ahead[2] - e[2] * ahead[1],
        e[2] * ahead[0] - e[0] * ahead[2],
        e[0] * ahead[1] - e[1] * ahead[0],
    )
    return _dot(moved, up), _dot(moved, right)


@making_arrays
def _aim(t, around, turning):
    """Set the targets of both axes to the direction of explicit guidance, after its first pass."""
    if around.law.kept[STARTED] == 0.0:
        return
    u, (ahead, up, right) = commanded(t, around), axes_at(t, turning.control.course)
    along = _dot(u, ahead)
    turning.control.memory[0, TARGET] = _dot(u, up) / along
    turning.control.memory[1, TARGET] = _dot(u, right) / along


@inlined
def _advance(t, h, y, engine, around, turning, end):
    """Turn the body and move it over h seconds from y (7,); end (7,) is set.

    The velocity changes by the mean of the accelerations at both ends (Heun). The second acceleration is evaluated at
    the state predicted with the first.
    """
    met, before = meet(t, y, engine, around, turning)
    move(turning.control, met, h)
    for i in range(3):
        end[i] = y[i] + h * (y[3 + i] + 0.5 * h * before[3 + i])
        end[3 + i] = y[3 + i] + h * before[3 + i]
    end[6] = y[6] + h * before[6]
    _, after = meet(t + h, end, engine, around, turning)
    for i in range(3):
        end[i] = y[i] + h * (y[3 + i] + h / 6.0 * (2.0 * before[3 + i] + after[3 + i]))
        end[3 + i] = y[3 + i] + 0.5 * h * (before[3 + i] + after[3 + i])
    end[6] = y[6] + 0.5 * h * (before[6] + after[6])


@making_arrays
def _short(t, y, around, cutoff, kind):
    """Return the distance of a state to the end of the burn: mass, energy or time; negative after it."""
    if kind == EMPTY:
        return y[6] - cutoff.empty
    if cutoff.by_energy:
        return cutoff.energy - navigated_energy(t, y, around.navigation)
    return cutoff.time - t


@making_arrays
def turn_piece(
    t: float, end: float, y: Floats, engine: Propulsion, around: AscentInputs, turning: AttitudeControl, cutoff: Cutoff
) -> tuple[float, Floats, int]:
    """Return time (s), state (7,) and how it ends, of a piece of flight that ends at `end` at the latest.

    The count of ticks continues from piece to piece. A command stays in force across the end of a piece; an engine does
    not.
    """
    control, law = turning.control, around.law
    count, memory, dt = control.counts, control.memory, control.course.t[1] - control.course.t[0]
    y, ahead, kept = y.copy(), y.copy(), memory.copy()
    motor = count[STACK] if engine.thrust > 0.0 or engine.beside.thrust > 0.0 else 0
    if motor != count[MOTOR]:
        ignite(control, motor, -around.misalignment[0], around.misalignment[1])
    due, watched = t, cutoff.by_energy or cutoff.time < math.inf or cutoff.empty > 0.0
    while t < end - 1e-9:
        if law.start < math.inf and t >= due - 1e-9:
            if not guide(t, y, engine, around):
                return t, y, DIVERGED
            due = t + law.cycle
        if t >= count[NEXT] * dt - 1e-9:
            met, _ = meet(t, y, engine, around, turning)
            _aim(t, around, turning)
            if count[NEXT] < turning.path.shape[0]:
                turning.path[count[NEXT]] = y
            tick(control, met, _tilt(t, around, turning))
        h = min(count[NEXT] * dt, end) - t
        kept[:] = memory
        _advance(t, h, y, engine, around, turning, ahead)
        why = WHOLE
        for kind in (CUT_OFF, EMPTY):
            if not watched:
                continue
            after = _short(t + h, ahead, around, cutoff, kind)
            if after > 0.0:
                continue
            before, part, why = _short(t, y, around, cutoff, kind), h, kind
            for _ in range(_REFINED):
                if before == after:
                    break
                part = min(h, max(0.0, part * before / (before - after)))
                memory[:] = kept
                _advance(t, part, y, engine, around, turning, ahead)
                after = _short(t + part, ahead, around, cutoff, kind)
            h = part
        t, y[:] = t + h, ahead
        if why != WHOLE:
            return t, y, why
    return t, y, WHOLE


@making_arrays
def acceleration(t: float, y: Floats, engine: Propulsion, around: AscentInputs, turning: AttitudeControl) -> Floats:
    """Return the acceleration (3,) in m/s^2, frame i, at a true state y (7,)."""
    _, slope = meet(t, y, engine, around, turning)
    return np.array([slope[3], slope[4], slope[5]])
