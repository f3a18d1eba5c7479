"""The closed loop of a turning launcher, tick by tick: gusts, gyro, rate filter, controller, nozzle, body.

Both axes (pitch, yaw) are computed at the ticks of the IMU. A command is constant over a tick. Nozzle, gusts and
command lags are stepped exactly, the body by Runge-Kutta steps of half a tick. Forces and air (`LateralForces`)
are those of the flight, see `turning.py`.
"""

import numpy as np

from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.random import normals, source_word
from lvnav_trade.trajectory.guided.autopilot import (
    AIR,
    ANGLE,
    ASKED,
    COAST,
    ERROR,
    FORCE,
    FORMAL,
    FRESH,
    IDEAL,
    INSIDE_JERK,
    INSIDE_TURNING,
    JERK,
    JERK_BOUND,
    JERK_RATIO,
    MODELLED,
    MOTOR,
    MOVED,
    NEXT,
    NOZZLE,
    OF_THE_RUN,
    RATE,
    RATE_ERROR,
    RAW,
    SQUARE_ERROR,
    SQUARE_RATE,
    STACK,
    STEPPED,
    TICKS,
    TRUE,
    TURNING,
    TURNING_BOUND,
    TURNING_RATIO,
    AxisMotion,
)
from lvnav_trade.trajectory.guided.axis import (
    body_step,
    command_step,
    filter_gain,
    gust_of,
    gust_step,
    lag_step,
    lateral_force,
    nozzle_step,
    thruster_of,
)

# What an axis remembers from tick to tick.
(
    ANGLE_NOW,
    RATE_NOW,
    PUSH_NOW,
    MISALIGNED,
    GUST_NOW,
    TARGET,
    _INTEGRAL,
    _GUST_1,
    _GUST_2,
    _OFFSET,
    _OFFSET_RATE,
    _SENSE,
    _ESTIMATE,
    _VARIANCE,
    _ATTITUDE,
    _BIAS,
    _COMMAND,
    _TURN_LAG,
    _JERK_LAG,
    _COMMANDED,
    _ANGLE_BEFORE,
    _FORCE_BEFORE,
    _MOVEMENT,
    _FED,
    _TURNING_BOUND,
    _JERK,
    _JERK_BOUND,
    _ERROR,
    _RATE_ERROR,
    _RATE_BEFORE,
    N_MEMORY,
) = range(31)

_GYRO, _BIASES = source_word("rotation gyro noise"), source_word("rotation gyro bias")
_GUSTS, _PROFILE = source_word("rotation gust"), source_word("rotation wind profile")
_REFERENCE, _START = source_word("rotation attitude reference"), source_word("rotation attitude start")
_SPEED, _MISALIGNMENT = source_word("rotation guidance speed"), source_word("rotation thrust misalignment")
_STEPS = source_word("rotation guidance command")
_ZERO = np.uint64(0)


@jit
def begin(control):
    """Draw the initial state of a run; memory and counters of `control` are set."""
    memory, course, feed = control.memory, control.course, control.settings.feed
    k0, k1, run = control.draws
    memory[:] = 0.0
    g0, g1, g2, g3 = normals(k0, k1, _GUSTS, run, _ZERO, _ZERO)
    half = np.sqrt(0.5)
    memory[0, _GUST_1], memory[0, _GUST_2] = g0, half * (g0 + g1)
    memory[1, _GUST_1], memory[1, _GUST_2] = g2, half * (g2 + g3)
    b0, b1, _, _ = normals(k0, k1, _BIASES, run, _ZERO, _ZERO)
    memory[0, _BIAS], memory[1, _BIAS] = feed.bias * b0, feed.bias * b1
    a0, a1, _, _ = normals(k0, k1, _START, run, _ZERO, _ZERO)
    memory[0, _ATTITUDE], memory[1, _ATTITUDE] = feed.start * a0, feed.start * a1
    for axis in range(2):
        memory[axis, _COMMANDED] = course.rate[0, axis] + course.turn_rate[0, axis]
        memory[axis, _VARIANCE] = feed.gyro**2
        memory[axis, _ESTIMATE] = course.rate[0, axis]
    control.counts[NEXT], control.counts[MOTOR], control.counts[FRESH], control.counts[STACK] = 0, -1, 0, 1


@jit
def profile_draws(draws):
    """Return a run's two draws of the steady wind: along its profile, and across."""
    w0, w1, _, _ = normals(draws.k0, draws.k1, _PROFILE, draws.run, _ZERO, _ZERO)
    return w0, w1


@jit
def ignite(control, motor, up, right):
    """Activate the nozzle of another stage, centred, with its own misalignment.

    up, right : rad. Additional misalignment.
    """
    memory, plant = control.memory, control.settings.plant
    k0, k1, run = control.draws
    m0, m1, _, _ = normals(k0, k1, _MISALIGNMENT, run, np.uint64(motor), _ZERO)
    for axis in range(2):
        memory[axis, PUSH_NOW], memory[axis, _INTEGRAL], memory[axis, _COMMAND] = 0.0, 0.0, 0.0
        memory[axis, MISALIGNED] = 0.0
    if motor > 0:
        memory[0, MISALIGNED] = plant.misalignment * m0 + up
        memory[1, MISALIGNED] = plant.misalignment * m1 + right
    control.counts[MOTOR], control.counts[FRESH] = motor, 1


@inlined
def _seen(x, feed):
    """Return the attitude that the controller sees."""
    return x[ANGLE_NOW] if feed.attitude == IDEAL else x[_ATTITUDE]


@inlined
def _capture(x, course, k, axis, feed):
    """Start the command at the vehicle's attitude and rate when a motor ignites; x updated.

    In a coast the nominal attitude moves on without the vehicle. A jump of the command would drive the nozzle to its
    limit.
    """
    x[_OFFSET] = _seen(x, feed) - course.turn[k, axis]
    x[_OFFSET_RATE] = x[_FED] - course.rate[k, axis] - course.turn_rate[k, axis]
    x[_COMMANDED] = x[_FED]


@inlined
def _sense(x, course, k, axis, feed, noise, bound, first):
    """Return the rate fed to the controller; navigated attitude, rate estimate and its variance are updated in x."""
    dt = course.t[1] - course.t[0]
    if first:
        mean = course.rate[0, axis] + x[RATE_NOW]
        turned = 0.0
    else:
        turned = x[ANGLE_NOW] - x[_ANGLE_BEFORE]
        mean = 0.5 * (course.rate[k - 1, axis] + course.rate[k, axis]) + turned / dt
    error = x[_BIAS] + noise
    x[_VARIANCE], gain = filter_gain(x[_VARIANCE], (dt * bound) ** 2, feed.gyro**2)
    x[_ESTIMATE] += gain * (mean + error - x[_ESTIMATE])
    if not first:
        x[_ATTITUDE] += turned + dt * error
    x[_ANGLE_BEFORE] = x[ANGLE_NOW]
    if feed.rate == TRUE:
        x[_FED] = course.rate[k, axis] + x[RATE_NOW]
    elif feed.rate == RAW:
        x[_FED] = mean + error
    else:
        x[_FED] = x[_ESTIMATE]
    return x[_FED]


@inlined
def _command(x, course, k, axis, settings, rate, dt, motor):
    """Return the thrusters' sense; the nozzle's command and the integral are updated in x."""
    plant, law, feed = settings.plant, settings.law, settings.feed
    error = _seen(x, feed) - course.turn[k, axis] - x[_OFFSET]
    rate_error = rate - x[_COMMANDED]
    if motor == 0:
        x[_COMMAND] = 0.0
        return thruster_of(x[_SENSE], error + plant.lead * rate_error, plant.dead_band, plant.release)
    gains = law.gains[motor - 1]
    asked = gains[0] * error + gains[1] * rate_error + gains[2] * x[_INTEGRAL]
    x[_COMMAND] = min(max(asked, -plant.limit), plant.limit)
    if x[_COMMAND] == asked:  # no integration at the limit (anti-windup)
        x[_INTEGRAL] += dt * error
    return 0.0


@inlined
def move(control, met, h):
    """Step nozzle and body of both axes over h seconds, a tick or a part of it."""
    course, plant, motor = control.course, control.settings.plant, control.counts[MOTOR]
    k = min(max(control.counts[NEXT] - 1, 0), course.t.size - 2)
    dt, quarter = course.t[1] - course.t[0], 0.25 * h
    for axis in range(2):
        x = control.memory[axis]
        alpha = (course.rate[k + 1, axis] - course.rate[k, axis]) / dt
        c = (
            met.effectiveness,
            met.thrust_load,
            met.moment,
            met.force,
            met.airspeed,
            met.wind[axis] + x[GUST_NOW] - met.slip[axis],
            met.thruster * x[_SENSE] - alpha,
        )
        before, drift = x[PUSH_NOW], 0.0
        for _ in range(2):
            if motor > 0:
                mid = nozzle_step(x[PUSH_NOW], x[_COMMAND], plant.time_constant, plant.rate_limit, quarter)
                end = nozzle_step(mid, x[_COMMAND], plant.time_constant, plant.rate_limit, quarter)
            else:
                mid, end = 0.0, 0.0
            off = x[MISALIGNED]
            x[ANGLE_NOW], x[RATE_NOW], drift = body_step(
                x[ANGLE_NOW], x[RATE_NOW], drift, x[PUSH_NOW] + off, mid + off, end + off, c, 2.0 * quarter
            )
            x[PUSH_NOW] = end
        x[_MOVEMENT] += abs(x[PUSH_NOW] - before)


@inlined
def _force(x, axis, met):
    """Return the lateral specific force at a tick."""
    air = met.wind[axis] + x[GUST_NOW] - met.slip[axis]
    c = (0.0, met.thrust_load, 0.0, met.force, met.airspeed, air, 0.0)
    return lateral_force(x[ANGLE_NOW], 0.0, x[PUSH_NOW] + x[MISALIGNED], c)


@inlined
def _steer(control, met, k, dt):
    """Set the targets of guidance, and step the commanded offsets and rates over the tick before."""
    law, motor, memory = control.settings.law, control.counts[MOTOR], control.memory
    k0, k1, run = control.draws
    if law.guided_from > 0 and k % law.guidance_ticks == 0 and motor >= law.guided_from:
        s0, s1, _, _ = normals(k0, k1, _SPEED, run, np.uint64(k), _ZERO)
        c0, c1, _, _ = normals(k0, k1, _STEPS, run, np.uint64(k), _ZERO)
        scale = 1.0 / (met.thrust_load * law.guidance_time)
        for axis in range(2):
            speed = met.drift[axis] + law.velocity_sigma * (s0 if axis == 0 else s1)
            asked = law.command_sigma * (c0 if axis == 0 else c1) - speed * scale
            memory[axis, TARGET] = min(max(asked, -law.guidance_limit), law.guidance_limit)
    for axis in range(2):
        x = memory[axis]
        if k > 0:
            x[_OFFSET], x[_OFFSET_RATE] = command_step(x[_OFFSET], x[_OFFSET_RATE], x[TARGET], law.command_time, dt)


@inlined
def _account(row, found):
    """Add the reaction of a tick to the sums (N_SUM,) of an axis in a phase; row updated."""
    row[TICKS] += 1.0
    row[INSIDE_TURNING] += 1.0 if abs(found.turning) <= found.turning_bound else 0.0
    row[INSIDE_JERK] += 1.0 if abs(found.jerk) <= found.jerk_bound else 0.0
    row[TURNING_RATIO] = max(row[TURNING_RATIO], abs(found.turning) / found.turning_bound)
    row[JERK_RATIO] = max(row[JERK_RATIO], abs(found.jerk) / found.jerk_bound)
    row[SQUARE_ERROR] += found.error * found.error
    row[SQUARE_RATE] += found.rate_error * found.rate_error


@inlined
def close(control):
    """Add the previous tick to the sums; its angular acceleration is known only at its end."""
    course, before = control.course, control.counts[NEXT] - 1
    last = course.t.size - 1
    if before < 0 or before >= last:
        return
    dt, number = course.t[1] - course.t[0], before // control.every
    for axis in range(2):
        x = control.memory[axis]
        turning = (course.rate[before + 1, axis] + x[RATE_NOW] - x[_RATE_BEFORE]) / dt
        found = AxisMotion(turning, x[_TURNING_BOUND], x[_JERK], x[_JERK_BOUND], x[_ERROR], x[_RATE_ERROR])
        _account(control.sums[axis, course.phase[before]], found)
        if before % control.every == 0 and number < control.history.shape[0]:
            control.history[number, axis, TURNING] = turning


@inlined
def tick(control, met, tilt):
    """Sense, steer and command both axes at the next tick.

    tilt : rad. Attitude error of the run's navigation, truth less estimate, of pitch and yaw.

    Long because a tick is one sequence of steps, in the order in which they happen on board.
    """
    course, settings, memory, count = control.course, control.settings, control.memory, control.counts
    feed, model = settings.feed, settings.model
    k0, k1, run = control.draws
    due, motor = count[NEXT], count[MOTOR]
    k = min(due, course.t.size - 1)  # a flight longer than the nominal flight keeps the last commanded attitude
    dt, epoch, changed = course.t[1] - course.t[0], np.uint64(due + 1), count[FRESH] == 1
    close(control)
    count[FRESH], count[NEXT] = 0, due + 1
    n0, n1, _, _ = normals(k0, k1, _GYRO, run, epoch, _ZERO)
    g0, g1, g2, g3 = normals(k0, k1, _GUSTS, run, epoch, _ZERO)
    _steer(control, met, due, dt)
    r0, r1 = 0.0, 0.0
    fixed = feed.attitude == MODELLED and feed.reference_gain > 0.0 and due > 0 and due % feed.reference_ticks == 0
    if fixed:
        r0, r1, _, _ = normals(k0, k1, _REFERENCE, run, epoch, _ZERO)
    for axis in range(2):
        x = memory[axis]
        h0, h1 = (g0, g1) if axis == 0 else (g2, g3)
        if due > 0:
            x[_GUST_1], x[_GUST_2] = gust_step(x[_GUST_1], x[_GUST_2], dt * met.gust_rate, h0, h1)
        x[GUST_NOW] = met.gust * gust_of(x[_GUST_1], x[_GUST_2])
        if changed and motor > 0 and due > 0:
            _capture(x, course, k, axis, feed)
        commanded = course.rate[k, axis] + course.turn_rate[k, axis] + x[_OFFSET_RATE]
        turning_bound = abs(x[_TURN_LAG]) + (model.coast if course.phase[k] == COAST else model.burn)
        jerk_bound = abs(x[_JERK_LAG]) + model.lateral
        stepped = commanded - x[_COMMANDED]
        drive = model.turn_gain * stepped / dt
        x[_TURN_LAG] = lag_step(x[_TURN_LAG], drive, model.turn_time, dt)
        x[_COMMANDED] = commanded
        noise = feed.gyro * (n0 if axis == 0 else n1)
        rate = _sense(x, course, k, axis, feed, noise, turning_bound, due == 0)
        if fixed:
            seen = x[ANGLE_NOW] + feed.reference * (r0 if axis == 0 else r1)
            x[_ATTITUDE] += feed.reference_gain * (seen - x[_ATTITUDE])
        if feed.attitude == OF_THE_RUN:
            x[_ATTITUDE] = x[ANGLE_NOW] - tilt[axis]
        asked = x[_COMMAND]
        x[_SENSE] = _command(x, course, k, axis, settings, rate, dt, motor)
        drive = model.nozzle_gain * (x[_COMMAND] - asked) / dt
        x[_JERK_LAG] = lag_step(x[_JERK_LAG], drive, model.nozzle_time, dt)
        force = _force(x, axis, met)
        x[_JERK] = (force - x[_FORCE_BEFORE]) / dt if due > 0 else 0.0
        x[_FORCE_BEFORE] = force
        x[_ERROR] = x[ANGLE_NOW] - course.turn[k, axis] - x[_OFFSET]
        x[_RATE_ERROR] = rate - course.rate[k, axis] - x[RATE_NOW]
        x[_RATE_BEFORE] = course.rate[k, axis] + x[RATE_NOW]
        x[_TURNING_BOUND], x[_JERK_BOUND] = turning_bound, jerk_bound
        if due % control.every == 0 and due // control.every < control.history.shape[0]:
            row = control.history[due // control.every, axis]
            row[NOZZLE], row[ASKED], row[MOVED] = x[PUSH_NOW], x[_COMMAND], x[_MOVEMENT]
            row[ERROR], row[RATE_ERROR] = x[_ERROR], x[_RATE_ERROR]
            row[TURNING_BOUND], row[JERK], row[JERK_BOUND] = turning_bound, x[_JERK], jerk_bound
            row[AIR], row[FORMAL] = met.wind[axis] + x[GUST_NOW], np.sqrt(x[_VARIANCE])
            row[ANGLE], row[RATE], row[FORCE], row[STEPPED] = x[ANGLE_NOW], x[RATE_NOW], force, stepped


@jit
def movement(control):
    """Return how far the nozzle has moved in pitch and in yaw, rad."""
    return control.memory[0, _MOVEMENT], control.memory[1, _MOVEMENT]
