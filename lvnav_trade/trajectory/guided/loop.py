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
    COAST,
    ERROR,
    FORCE,
    FORMAL,
    IDEAL,
    INSIDE_JERK,
    INSIDE_TURNING,
    JERK,
    JERK_BOUND,
    JERK_RATIO,
    JUST_IGNITED,
    MODELLED,
    MOTOR,
    MOVED,
    NEXT,
    NOZZLE,
    NOZZLE_COMMAND,
    OF_THE_RUN,
    RATE,
    RATE_ERROR,
    RAW,
    SQUARE_ERROR,
    SQUARE_RATE,
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
from lvnav_trade.trajectory.guided.axis_state import (
    ANGLE_NOW,
    BIAS,
    COMMAND_NOW,
    COMMANDED_RATE,
    ERROR_NOW,
    FED_RATE,
    GUST_1,
    GUST_2,
    GUST_NOW,
    GUSTS,
    INTEGRAL,
    JERK_BOUND_NOW,
    JERK_LAG,
    JERK_NOW,
    MISALIGNMENT_NOW,
    NAVIGATED_ANGLE,
    NOZZLE_NOW,
    NOZZLE_TRAVEL,
    OFFSET,
    OFFSET_RATE,
    PREVIOUS_ANGLE,
    PREVIOUS_FORCE,
    PREVIOUS_RATE,
    RATE_ERROR_NOW,
    RATE_ESTIMATE,
    RATE_NOW,
    RATE_VARIANCE,
    TARGET,
    THRUSTER_SENSE,
    TURN_LAG,
    TURNING_BOUND_NOW,
    draw_pair,
)

# Sources of the random numbers
_GYRO_NOISE = source_word("rotation gyro noise")
_REFERENCE_NOISE = source_word("rotation attitude reference")
_GUIDANCE_SPEED = source_word("rotation guidance speed")
_GUIDANCE_COMMAND = source_word("rotation guidance command")
_ZERO = np.uint64(0)


@inlined
def _controller_angle(state, feed):
    """Return the attitude that the controller uses."""
    return state[ANGLE_NOW] if feed.attitude == IDEAL else state[NAVIGATED_ANGLE]


@inlined
def _capture(state, course, k, axis, feed):
    """Start the command at the vehicle's attitude and rate when a motor ignites; the state of the axis is updated.

    In a coast the nominal attitude moves on without the vehicle. A jump of the command would drive the nozzle to its
    limit.

    k, axis : index of the tick; 0 for pitch, 1 for yaw
    """
    state[OFFSET] = _controller_angle(state, feed) - course.turn[k, axis]
    state[OFFSET_RATE] = state[FED_RATE] - course.rate[k, axis] - course.turn_rate[k, axis]
    state[COMMANDED_RATE] = state[FED_RATE]


@inlined
def _sense(state, course, k, axis, feed, noise, bound, first):
    """Return the rate (rad/s) fed to the controller; navigated attitude, rate estimate and its variance are updated.

    k, axis : index of the tick; 0 for pitch, 1 for yaw
    noise : rad/s. Noise of the gyro sample.
    bound : rad/s^2. Largest angular acceleration that the rate filter expects.
    first : whether this is the first tick, which has no earlier sample
    """
    dt = course.t[1] - course.t[0]
    # A gyro measures the mean rate since the last tick.
    if first:
        mean_rate = course.rate[0, axis] + state[RATE_NOW]
        turned = 0.0
    else:
        turned = state[ANGLE_NOW] - state[PREVIOUS_ANGLE]
        nominal_rate = 0.5 * (course.rate[k - 1, axis] + course.rate[k, axis])
        mean_rate = nominal_rate + turned / dt
    error = state[BIAS] + noise
    # The filter models the rate as a random walk, with the bound as its standard deviation per second.
    state[RATE_VARIANCE], gain = filter_gain(state[RATE_VARIANCE], (dt * bound) ** 2, feed.gyro**2)
    state[RATE_ESTIMATE] += gain * (mean_rate + error - state[RATE_ESTIMATE])
    if not first:
        state[NAVIGATED_ANGLE] += turned + dt * error
    state[PREVIOUS_ANGLE] = state[ANGLE_NOW]
    if feed.rate == TRUE:
        state[FED_RATE] = course.rate[k, axis] + state[RATE_NOW]
    elif feed.rate == RAW:
        state[FED_RATE] = mean_rate + error
    else:
        state[FED_RATE] = state[RATE_ESTIMATE]
    return state[FED_RATE]


@inlined
def _command(state, course, k, axis, settings, rate, dt, motor):
    """Return the thrusters' sense; the nozzle's command and the integral are updated in the state of the axis.

    rate : rad/s. Rate fed to the controller.
    dt : s. Interval of the ticks.
    motor : number of the burning stage; 0: none, and the thrusters control the attitude
    """
    plant, law, feed = settings.plant, settings.law, settings.feed
    error = _controller_angle(state, feed) - course.turn[k, axis] - state[OFFSET]
    rate_error = rate - state[COMMANDED_RATE]
    if motor == 0:
        state[COMMAND_NOW] = 0.0
        switching_error = error + plant.lead * rate_error
        return thruster_of(state[THRUSTER_SENSE], switching_error, plant.dead_band, plant.release)
    gains = law.gains[motor - 1]
    demand = gains[0] * error + gains[1] * rate_error + gains[2] * state[INTEGRAL]
    state[COMMAND_NOW] = min(max(demand, -plant.limit), plant.limit)
    if state[COMMAND_NOW] == demand:  # no integration at the limit (anti-windup)
        state[INTEGRAL] += dt * error
    return 0.0


@inlined
def move(control, forces, h):
    """Step nozzle and body of both axes over h seconds, at most a tick."""
    course, plant, motor = control.course, control.settings.plant, control.counts[MOTOR]
    k = min(max(control.counts[NEXT] - 1, 0), course.t.size - 2)
    dt = course.t[1] - course.t[0]
    quarter = 0.25 * h
    for axis in range(2):
        state = control.memory[axis]
        # Angles are deviations from the nominal attitude, whose own acceleration acts in the other sense.
        nominal_acceleration = (course.rate[k + 1, axis] - course.rate[k, axis]) / dt
        coefficients = (
            forces.effectiveness,
            forces.thrust_load,
            forces.moment,
            forces.force,
            forces.airspeed,
            forces.wind[axis] + state[GUST_NOW] - forces.slip[axis],
            forces.thruster * state[THRUSTER_SENSE] - nominal_acceleration,
        )
        nozzle_before = state[NOZZLE_NOW]
        misalignment = state[MISALIGNMENT_NOW]
        drift = 0.0
        for _ in range(2):
            if motor > 0:
                nozzle_mid = nozzle_step(
                    state[NOZZLE_NOW], state[COMMAND_NOW], plant.time_constant, plant.rate_limit, quarter
                )
                nozzle_end = nozzle_step(nozzle_mid, state[COMMAND_NOW], plant.time_constant, plant.rate_limit, quarter)
            else:
                nozzle_mid = 0.0
                nozzle_end = 0.0
            state[ANGLE_NOW], state[RATE_NOW], drift = body_step(
                state[ANGLE_NOW],
                state[RATE_NOW],
                drift,
                state[NOZZLE_NOW] + misalignment,
                nozzle_mid + misalignment,
                nozzle_end + misalignment,
                coefficients,
                2.0 * quarter,
            )
            state[NOZZLE_NOW] = nozzle_end
        state[NOZZLE_TRAVEL] += abs(state[NOZZLE_NOW] - nozzle_before)


@inlined
def _lateral_specific_force(state, axis, forces):
    """Return the lateral specific force (m/s^2) at a tick."""
    crosswind = forces.wind[axis] + state[GUST_NOW] - forces.slip[axis]
    coefficients = (0.0, forces.thrust_load, 0.0, forces.force, forces.airspeed, crosswind, 0.0)
    return lateral_force(state[ANGLE_NOW], 0.0, state[NOZZLE_NOW] + state[MISALIGNMENT_NOW], coefficients)


@inlined
def _steer(control, forces, k, dt):
    """Set the targets of guidance, and step the commanded offsets and rates over the previous tick.

    k, dt : index of the tick, and interval of the ticks (s)
    """
    law, motor, memory = control.settings.law, control.counts[MOTOR], control.memory
    if law.guided_from > 0 and k % law.guidance_ticks == 0 and motor >= law.guided_from:
        speed_pitch, speed_yaw = draw_pair(control, _GUIDANCE_SPEED, np.uint64(k))
        command_pitch, command_yaw = draw_pair(control, _GUIDANCE_COMMAND, np.uint64(k))
        # A turn by speed / (thrust acceleration x time) removes a lateral speed within that time.
        scale = 1.0 / (forces.thrust_load * law.guidance_time)
        for axis in range(2):
            speed = forces.drift[axis] + law.velocity_sigma * (speed_pitch if axis == 0 else speed_yaw)
            noise = law.command_sigma * (command_pitch if axis == 0 else command_yaw)
            target = noise - speed * scale
            memory[axis, TARGET] = min(max(target, -law.guidance_limit), law.guidance_limit)
    for axis in range(2):
        state = memory[axis]
        if k > 0:
            state[OFFSET], state[OFFSET_RATE] = command_step(
                state[OFFSET], state[OFFSET_RATE], state[TARGET], law.command_time, dt
            )


@inlined
def _accumulate(sums, motion):
    """Add the motion of a tick to the sums (N_SUM,) of an axis in a phase."""
    sums[TICKS] += 1.0
    sums[INSIDE_TURNING] += 1.0 if abs(motion.turning) <= motion.turning_bound else 0.0
    sums[INSIDE_JERK] += 1.0 if abs(motion.jerk) <= motion.jerk_bound else 0.0
    sums[TURNING_RATIO] = max(sums[TURNING_RATIO], abs(motion.turning) / motion.turning_bound)
    sums[JERK_RATIO] = max(sums[JERK_RATIO], abs(motion.jerk) / motion.jerk_bound)
    sums[SQUARE_ERROR] += motion.error * motion.error
    sums[SQUARE_RATE] += motion.rate_error * motion.rate_error


@inlined
def close(control):
    """Add the previous tick to the sums; its angular acceleration is known only at its end."""
    course, before = control.course, control.counts[NEXT] - 1
    last = course.t.size - 1
    if before < 0 or before >= last:
        return
    dt = course.t[1] - course.t[0]
    number = before // control.every
    for axis in range(2):
        state = control.memory[axis]
        turning = (course.rate[before + 1, axis] + state[RATE_NOW] - state[PREVIOUS_RATE]) / dt
        motion = AxisMotion(
            turning,
            state[TURNING_BOUND_NOW],
            state[JERK_NOW],
            state[JERK_BOUND_NOW],
            state[ERROR_NOW],
            state[RATE_ERROR_NOW],
        )
        _accumulate(control.sums[axis, course.phase[before]], motion)
        if before % control.every == 0 and number < control.history.shape[0]:
            control.history[number, axis, TURNING] = turning


@inlined
def _update_reference(state, feed, draw):
    """Correct the navigated attitude by a measurement of the attitude reference."""
    measured = state[ANGLE_NOW] + feed.reference * draw
    state[NAVIGATED_ANGLE] += feed.reference_gain * (measured - state[NAVIGATED_ANGLE])


@inlined
def _record(control, due, axis, rate_step, force, wind):
    """Write the record of an axis at a tick, if this tick is recorded.

    due : index of the tick
    rate_step : rad/s. Step of the commanded rate.
    force, wind : m/s^2, m/s. Lateral specific force, and lateral wind without gusts.
    """
    if due % control.every != 0 or due // control.every >= control.history.shape[0]:
        return
    state = control.memory[axis]
    row = control.history[due // control.every, axis]
    row[NOZZLE] = state[NOZZLE_NOW]
    row[NOZZLE_COMMAND] = state[COMMAND_NOW]
    row[MOVED] = state[NOZZLE_TRAVEL]
    row[ERROR] = state[ERROR_NOW]
    row[RATE_ERROR] = state[RATE_ERROR_NOW]
    row[TURNING_BOUND] = state[TURNING_BOUND_NOW]
    row[JERK] = state[JERK_NOW]
    row[JERK_BOUND] = state[JERK_BOUND_NOW]
    row[AIR] = wind + state[GUST_NOW]
    row[FORMAL] = np.sqrt(state[RATE_VARIANCE])
    row[ANGLE] = state[ANGLE_NOW]
    row[RATE] = state[RATE_NOW]
    row[FORCE] = force
    row[STEPPED] = rate_step


@inlined
def tick(control, forces, tilt):
    """Sense, steer and command both axes at the next tick.

    tilt : rad. Attitude error of the run's navigation, truth less estimate, of pitch and yaw.

    Long because a tick is one sequence of steps, in the order in which they happen on board.
    """
    course, settings, memory, count = control.course, control.settings, control.memory, control.counts
    feed, envelope = settings.feed, settings.model
    due, motor = count[NEXT], count[MOTOR]
    k = min(due, course.t.size - 1)  # a flight longer than the nominal flight keeps the last commanded attitude
    dt = course.t[1] - course.t[0]
    epoch = np.uint64(due + 1)  # epoch 0 has the initial draws
    just_ignited = count[JUST_IGNITED] == 1
    close(control)
    count[JUST_IGNITED] = 0
    count[NEXT] = due + 1
    k0, k1, run = control.draws
    noise_pitch, noise_yaw = draw_pair(control, _GYRO_NOISE, epoch)
    g0, g1, g2, g3 = normals(k0, k1, GUSTS, run, epoch, _ZERO)
    _steer(control, forces, due, dt)
    reference_pitch, reference_yaw = 0.0, 0.0
    has_reference = feed.attitude == MODELLED and feed.reference_gain > 0.0
    has_reference = has_reference and due > 0 and due % feed.reference_ticks == 0
    if has_reference:
        reference_pitch, reference_yaw = draw_pair(control, _REFERENCE_NOISE, epoch)
    for axis in range(2):
        state = memory[axis]
        h0, h1 = (g0, g1) if axis == 0 else (g2, g3)
        if due > 0:
            state[GUST_1], state[GUST_2] = gust_step(state[GUST_1], state[GUST_2], dt * forces.gust_rate, h0, h1)
        state[GUST_NOW] = forces.gust * gust_of(state[GUST_1], state[GUST_2])
        if just_ignited and motor > 0 and due > 0:
            _capture(state, course, k, axis, feed)
        # Envelope of commanded motion: response to the last commands, plus the unknown motion of the phase
        turning_bound = abs(state[TURN_LAG]) + (envelope.coast if course.phase[k] == COAST else envelope.burn)
        state[JERK_BOUND_NOW] = abs(state[JERK_LAG]) + envelope.lateral
        state[TURNING_BOUND_NOW] = turning_bound
        commanded_rate = course.rate[k, axis] + course.turn_rate[k, axis] + state[OFFSET_RATE]
        rate_step = commanded_rate - state[COMMANDED_RATE]
        drive = envelope.turn_gain * rate_step / dt
        state[TURN_LAG] = lag_step(state[TURN_LAG], drive, envelope.turn_time, dt)
        state[COMMANDED_RATE] = commanded_rate
        noise = feed.gyro * (noise_pitch if axis == 0 else noise_yaw)
        rate = _sense(state, course, k, axis, feed, noise, turning_bound, due == 0)
        if has_reference:
            _update_reference(state, feed, reference_pitch if axis == 0 else reference_yaw)
        if feed.attitude == OF_THE_RUN:
            state[NAVIGATED_ANGLE] = state[ANGLE_NOW] - tilt[axis]
        previous_command = state[COMMAND_NOW]
        state[THRUSTER_SENSE] = _command(state, course, k, axis, settings, rate, dt, motor)
        drive = envelope.nozzle_gain * (state[COMMAND_NOW] - previous_command) / dt
        state[JERK_LAG] = lag_step(state[JERK_LAG], drive, envelope.nozzle_time, dt)
        force = _lateral_specific_force(state, axis, forces)
        state[JERK_NOW] = (force - state[PREVIOUS_FORCE]) / dt if due > 0 else 0.0
        state[PREVIOUS_FORCE] = force
        state[ERROR_NOW] = state[ANGLE_NOW] - course.turn[k, axis] - state[OFFSET]
        state[RATE_ERROR_NOW] = rate - course.rate[k, axis] - state[RATE_NOW]
        state[PREVIOUS_RATE] = course.rate[k, axis] + state[RATE_NOW]
        _record(control, due, axis, rate_step, force, forces.wind[axis])


@jit
def movement(control):
    """Return how far the nozzle has moved in pitch and in yaw, rad."""
    return control.memory[0, NOZZLE_TRAVEL], control.memory[1, NOZZLE_TRAVEL]
