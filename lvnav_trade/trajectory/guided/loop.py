"""The closed loop of a turning launcher, tick by tick: gusts, gyro, rate filter, controller, nozzle, body.

Both axes (pitch, yaw) are computed at the ticks of the IMU. A command is constant over a tick. Nozzle, gusts and
command lags are stepped exactly, the body by Runge-Kutta steps of half a tick. Forces and air (`LateralForces`)
are those of the flight, see `turning.py`.
"""

import numpy as np

from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.random import normals, source_word
from lvnav_trade.trajectory.guided.autopilot import (
    COAST,
    IDEAL,
    JUST_IGNITED,
    MODELLED,
    MOTOR,
    NEXT,
    OF_THE_RUN,
    RAW,
    TRUE,
)
from lvnav_trade.trajectory.guided.axis import (
    body_step,
    command_step,
    filter_gain,
    gust_output,
    gust_step,
    lag_step,
    lateral_force,
    nozzle_step,
    thruster_sense,
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
    close,
    draw_pair,
    record,
)

# Sources of the random numbers
_GYRO_NOISE = source_word("rotation gyro noise")
_REFERENCE_NOISE = source_word("rotation attitude reference")
_GUIDANCE_SPEED = source_word("rotation guidance speed")
_GUIDANCE_COMMAND = source_word("rotation guidance command")
_ZERO = np.uint64(0)


@inline_jit
def _controller_angle(state, feed):
    """Return the attitude that the controller uses."""
    return state[ANGLE_NOW] if feed.attitude == IDEAL else state[NAVIGATED_ANGLE]


@inline_jit
def _capture(state, course, k, axis, feed):
    """Start the command at the vehicle's attitude and rate when a motor ignites; the state of the axis is updated.

    In a coast the nominal attitude moves on without the vehicle. A jump of the command would drive the nozzle to its
    limit.

    k, axis : index of the tick; 0 for pitch, 1 for yaw
    """
    angle = _controller_angle(state, feed)
    rate = state[FED_RATE]
    state[OFFSET] = angle - course.turn[k, axis]
    state[OFFSET_RATE] = rate - course.rate[k, axis] - course.turn_rate[k, axis]
    state[COMMANDED_RATE] = rate


@inline_jit
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
        rotation = 0.0
    else:
        rotation = state[ANGLE_NOW] - state[PREVIOUS_ANGLE]
        nominal_rate = 0.5 * (course.rate[k - 1, axis] + course.rate[k, axis])
        mean_rate = nominal_rate + rotation / dt
    error = state[BIAS] + noise
    measured_rate = mean_rate + error
    # The filter models the rate as a random walk, with the bound as its standard deviation per second.
    walk_variance = (dt * bound) ** 2
    state[RATE_VARIANCE], gain = filter_gain(state[RATE_VARIANCE], walk_variance, feed.gyro**2)
    innovation = measured_rate - state[RATE_ESTIMATE]
    state[RATE_ESTIMATE] += gain * innovation
    if not first:
        state[NAVIGATED_ANGLE] += rotation + dt * error
    state[PREVIOUS_ANGLE] = state[ANGLE_NOW]
    if feed.rate == TRUE:
        state[FED_RATE] = course.rate[k, axis] + state[RATE_NOW]
    elif feed.rate == RAW:
        state[FED_RATE] = measured_rate
    else:
        state[FED_RATE] = state[RATE_ESTIMATE]
    return state[FED_RATE]


@inline_jit
def _command(state, course, k, axis, settings, rate, dt, motor):
    """Return the thrusters' sense; the nozzle's command and the integral are updated in the state of the axis.

    rate : rad/s. Rate fed to the controller.
    dt : s. Interval of the ticks.
    motor : number of the burning stage; 0: none, and the thrusters control the attitude
    """
    plant = settings.plant
    angle = _controller_angle(state, settings.feed)
    error = angle - course.turn[k, axis] - state[OFFSET]
    rate_error = rate - state[COMMANDED_RATE]
    if motor == 0:
        state[COMMAND_NOW] = 0.0
        switching_error = error + plant.lead * rate_error
        return thruster_sense(state[THRUSTER_SENSE], switching_error, plant.dead_band, plant.release)
    gains = settings.law.gains[motor - 1]
    attitude_gain = gains[0]
    rate_gain = gains[1]
    integral_gain = gains[2]
    demand = attitude_gain * error + rate_gain * rate_error + integral_gain * state[INTEGRAL]
    state[COMMAND_NOW] = min(max(demand, -plant.limit), plant.limit)
    if state[COMMAND_NOW] == demand:  # no integration at the limit (anti-windup)
        state[INTEGRAL] += dt * error
    return 0.0


@inline_jit
def move(control, forces, h):
    """Step nozzle and body of both axes over h seconds, at most a tick."""
    course, plant, motor = control.course, control.settings.plant, control.counts[MOTOR]
    k = min(max(control.counts[NEXT] - 1, 0), course.t.size - 2)
    dt = course.t[1] - course.t[0]
    quarter = 0.25 * h
    for axis in range(2):
        state = control.memory[axis]
        # Angles are deviations from the nominal attitude, whose own acceleration acts in the other sense.
        nominal_rate_change = course.rate[k + 1, axis] - course.rate[k, axis]
        nominal_acceleration = nominal_rate_change / dt
        crosswind = forces.wind[axis] + state[GUST_NOW] - forces.slip[axis]
        thruster_acceleration = forces.thruster * state[THRUSTER_SENSE]
        coefficients = (
            forces.effectiveness,
            forces.thrust_load,
            forces.moment,
            forces.force,
            forces.airspeed,
            crosswind,
            thruster_acceleration - nominal_acceleration,
        )
        nozzle_before = state[NOZZLE_NOW]
        misalignment = state[MISALIGNMENT_NOW]
        drift = 0.0
        for _ in range(2):
            if motor > 0:
                command, lag, rate_limit = state[COMMAND_NOW], plant.time_constant, plant.rate_limit
                nozzle_mid = nozzle_step(state[NOZZLE_NOW], command, lag, rate_limit, quarter)
                nozzle_end = nozzle_step(nozzle_mid, command, lag, rate_limit, quarter)
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
        movement_in_step = state[NOZZLE_NOW] - nozzle_before
        state[NOZZLE_TRAVEL] += abs(movement_in_step)


@inline_jit
def _lateral_specific_force(state, axis, forces):
    """Return the lateral specific force (m/s^2) at a tick."""
    crosswind = forces.wind[axis] + state[GUST_NOW] - forces.slip[axis]
    coefficients = (
        0.0,
        forces.thrust_load,
        0.0,
        forces.force,
        forces.airspeed,
        crosswind,
        0.0,
    )
    nozzle = state[NOZZLE_NOW] + state[MISALIGNMENT_NOW]
    return lateral_force(state[ANGLE_NOW], 0.0, nozzle, coefficients)


@inline_jit
def _steer(control, forces, k, dt):
    """Set the targets of guidance, and step the commanded offsets and rates over the previous tick.

    k, dt : index of the tick, and interval of the ticks (s)
    """
    law = control.settings.law
    motor = control.counts[MOTOR]
    memory = control.memory
    if law.guided_from > 0 and k % law.guidance_ticks == 0 and motor >= law.guided_from:
        draw_index = np.uint64(k)
        speed_pitch, speed_yaw = draw_pair(control, _GUIDANCE_SPEED, draw_index)
        command_pitch, command_yaw = draw_pair(control, _GUIDANCE_COMMAND, draw_index)
        # A turn by speed / (thrust acceleration x time) removes a lateral speed within that time.
        scale = 1.0 / (forces.thrust_load * law.guidance_time)
        for axis in range(2):
            speed_draw = speed_pitch if axis == 0 else speed_yaw
            command_draw = command_pitch if axis == 0 else command_yaw
            speed = forces.drift[axis] + law.velocity_sigma * speed_draw
            noise = law.command_sigma * command_draw
            target = noise - speed * scale
            memory[axis, TARGET] = min(max(target, -law.guidance_limit), law.guidance_limit)
    for axis in range(2):
        state = memory[axis]
        if k > 0:
            offset, offset_rate, target = state[OFFSET], state[OFFSET_RATE], state[TARGET]
            state[OFFSET], state[OFFSET_RATE] = command_step(offset, offset_rate, target, law.command_time, dt)


@inline_jit
def _update_reference(state, feed, draw):
    """Correct the navigated attitude by a measurement of the attitude reference."""
    measurement = state[ANGLE_NOW] + feed.reference * draw
    innovation = measurement - state[NAVIGATED_ANGLE]
    state[NAVIGATED_ANGLE] += feed.reference_gain * innovation


@inline_jit
def tick(control, forces, tilt):
    """Sense, steer and command both axes at the next tick.

    tilt : rad. Attitude error of the run's navigation, truth less estimate, of pitch and yaw.

    Long because a tick is one sequence of steps, in the order in which they happen on board.
    """
    course = control.course
    settings = control.settings
    count = control.counts
    feed = settings.feed
    envelope = settings.model
    tick_index = count[NEXT]
    motor = count[MOTOR]
    k = min(tick_index, course.t.size - 1)  # a flight longer than the nominal flight keeps the last commanded attitude
    dt = course.t[1] - course.t[0]
    epoch = np.uint64(tick_index + 1)  # epoch 0 has the initial draws
    is_ignition_tick = count[JUST_IGNITED] == 1
    close(control)
    count[JUST_IGNITED] = 0
    count[NEXT] = tick_index + 1
    k0, k1, run = control.draws
    noise_pitch, noise_yaw = draw_pair(control, _GYRO_NOISE, epoch)
    g0, g1, g2, g3 = normals(k0, k1, GUSTS, run, epoch, _ZERO)
    _steer(control, forces, tick_index, dt)
    reference_pitch, reference_yaw = 0.0, 0.0
    uses_reference = feed.attitude == MODELLED and feed.reference_gain > 0.0
    has_reference = uses_reference and tick_index > 0 and tick_index % feed.reference_ticks == 0
    if has_reference:
        reference_pitch, reference_yaw = draw_pair(control, _REFERENCE_NOISE, epoch)
    for axis in range(2):
        state = control.memory[axis]
        nominal_rate = course.rate[k, axis]
        first_draw, second_draw = (g0, g1) if axis == 0 else (g2, g3)
        if tick_index > 0:
            scaled_step = dt * forces.gust_rate
            state[GUST_1], state[GUST_2] = gust_step(state[GUST_1], state[GUST_2], scaled_step, first_draw, second_draw)
        unit_gust = gust_output(state[GUST_1], state[GUST_2])
        state[GUST_NOW] = forces.gust * unit_gust
        if is_ignition_tick and motor > 0 and tick_index > 0:
            _capture(state, course, k, axis, feed)
        # Envelope of commanded motion: response to the last commands, plus the unknown motion of the phase
        turning_margin = envelope.coast if course.phase[k] == COAST else envelope.burn
        turning_bound = abs(state[TURN_LAG]) + turning_margin
        state[JERK_BOUND_NOW] = abs(state[JERK_LAG]) + envelope.lateral
        state[TURNING_BOUND_NOW] = turning_bound
        commanded_rate = nominal_rate + course.turn_rate[k, axis] + state[OFFSET_RATE]
        rate_step = commanded_rate - state[COMMANDED_RATE]
        turn_drive = envelope.turn_gain * rate_step / dt
        state[TURN_LAG] = lag_step(state[TURN_LAG], turn_drive, envelope.turn_time, dt)
        state[COMMANDED_RATE] = commanded_rate
        gyro_draw = noise_pitch if axis == 0 else noise_yaw
        noise = feed.gyro * gyro_draw
        rate = _sense(state, course, k, axis, feed, noise, turning_bound, tick_index == 0)
        if has_reference:
            reference_draw = reference_pitch if axis == 0 else reference_yaw
            _update_reference(state, feed, reference_draw)
        if feed.attitude == OF_THE_RUN:
            state[NAVIGATED_ANGLE] = state[ANGLE_NOW] - tilt[axis]
        previous_command = state[COMMAND_NOW]
        state[THRUSTER_SENSE] = _command(state, course, k, axis, settings, rate, dt, motor)
        command_change = state[COMMAND_NOW] - previous_command
        jerk_drive = envelope.nozzle_gain * command_change / dt
        state[JERK_LAG] = lag_step(state[JERK_LAG], jerk_drive, envelope.nozzle_time, dt)
        force = _lateral_specific_force(state, axis, forces)
        state[JERK_NOW] = (force - state[PREVIOUS_FORCE]) / dt if tick_index > 0 else 0.0
        state[PREVIOUS_FORCE] = force
        state[ERROR_NOW] = state[ANGLE_NOW] - course.turn[k, axis] - state[OFFSET]
        state[RATE_ERROR_NOW] = rate - nominal_rate - state[RATE_NOW]
        state[PREVIOUS_RATE] = nominal_rate + state[RATE_NOW]
        record(control, tick_index, axis, rate_step, force, forces.wind[axis])


@jit
def movement(control):
    """Return how far the nozzle has moved in pitch and in yaw, rad."""
    pitch = control.memory[0, NOZZLE_TRAVEL]
    yaw = control.memory[1, NOZZLE_TRAVEL]
    return pitch, yaw
