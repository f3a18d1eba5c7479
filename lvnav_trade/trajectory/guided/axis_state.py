"""State of the axes of a turning launcher from tick to tick: its numbers, initial draws, ignition, records and sums."""

import numpy as np

from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.random import normals, source_word
from lvnav_trade.trajectory.guided.autopilot import (
    AIR,
    ANGLE,
    ERROR,
    FORCE,
    FORMAL,
    INSIDE_JERK,
    INSIDE_TURNING,
    JERK,
    JERK_BOUND,
    JERK_RATIO,
    JUST_IGNITED,
    MOTOR,
    MOVED,
    NEXT,
    NOZZLE,
    NOZZLE_COMMAND,
    RATE,
    RATE_ERROR,
    SQUARE_ERROR,
    SQUARE_RATE,
    STACK,
    STEPPED,
    TICKS,
    TURNING,
    TURNING_BOUND,
    TURNING_RATIO,
    AxisMotion,
)

# State of an axis from tick to tick.
(
    ANGLE_NOW,
    RATE_NOW,
    NOZZLE_NOW,
    MISALIGNMENT_NOW,
    GUST_NOW,
    TARGET,
    INTEGRAL,
    GUST_1,
    GUST_2,
    OFFSET,
    OFFSET_RATE,
    THRUSTER_SENSE,
    RATE_ESTIMATE,
    RATE_VARIANCE,
    NAVIGATED_ANGLE,
    BIAS,
    COMMAND_NOW,
    TURN_LAG,
    JERK_LAG,
    COMMANDED_RATE,
    PREVIOUS_ANGLE,
    PREVIOUS_FORCE,
    NOZZLE_TRAVEL,
    FED_RATE,
    TURNING_BOUND_NOW,
    JERK_NOW,
    JERK_BOUND_NOW,
    ERROR_NOW,
    RATE_ERROR_NOW,
    PREVIOUS_RATE,
    N_MEMORY,
) = range(31)

# Sources of the random numbers
_GYRO_BIAS = source_word("rotation gyro bias")
GUSTS = source_word("rotation gust")
_WIND_PROFILE = source_word("rotation wind profile")
_INITIAL_ATTITUDE = source_word("rotation attitude start")
_THRUST_MISALIGNMENT = source_word("rotation thrust misalignment")
_ZERO = np.uint64(0)


@inline_jit
def draw_pair(control, source, number):
    """Return two standard normals of a source, for pitch and yaw.

    number : tick or stage of the draws
    """
    k0, k1, run = control.draws
    first, second, _, _ = normals(k0, k1, source, run, number, _ZERO)
    return first, second


@jit
def begin(control):
    """Draw the initial state of a run; memory and counters of `control` are set."""
    memory = control.memory
    course = control.course
    feed = control.settings.feed
    k0, k1, run = control.draws
    memory[:] = 0.0
    # Both states of the Dryden filter have unit variance and a correlation of 1 / sqrt(2).
    g0, g1, g2, g3 = normals(k0, k1, GUSTS, run, _ZERO, _ZERO)
    correlation = np.sqrt(0.5)
    memory[0, GUST_1] = g0
    memory[0, GUST_2] = correlation * (g0 + g1)
    memory[1, GUST_1] = g2
    memory[1, GUST_2] = correlation * (g2 + g3)
    bias_pitch, bias_yaw = draw_pair(control, _GYRO_BIAS, _ZERO)
    memory[0, BIAS] = feed.bias * bias_pitch
    memory[1, BIAS] = feed.bias * bias_yaw
    angle_pitch, angle_yaw = draw_pair(control, _INITIAL_ATTITUDE, _ZERO)
    memory[0, NAVIGATED_ANGLE] = feed.start * angle_pitch
    memory[1, NAVIGATED_ANGLE] = feed.start * angle_yaw
    for axis in range(2):
        nominal_rate = course.rate[0, axis]
        memory[axis, COMMANDED_RATE] = nominal_rate + course.turn_rate[0, axis]
        memory[axis, RATE_VARIANCE] = feed.gyro**2
        memory[axis, RATE_ESTIMATE] = nominal_rate
    control.counts[NEXT] = 0
    control.counts[MOTOR] = -1
    control.counts[JUST_IGNITED] = 0
    control.counts[STACK] = 1


@jit
def profile_draws(draws):
    """Return the two standard normals of a run that scale its steady wind: along its direction, and across."""
    along, across, _, _ = normals(draws.k0, draws.k1, _WIND_PROFILE, draws.run, _ZERO, _ZERO)
    return along, across


@jit
def ignite(control, motor, up, right):
    """Activate the nozzle of another stage, centred, with its own misalignment.

    motor : number of the stage; 0: no motor burns
    up, right : rad. Additional misalignment.
    """
    memory, plant = control.memory, control.settings.plant
    draw_pitch, draw_yaw = draw_pair(control, _THRUST_MISALIGNMENT, np.uint64(motor))
    for axis in range(2):
        memory[axis, NOZZLE_NOW] = 0.0
        memory[axis, INTEGRAL] = 0.0
        memory[axis, COMMAND_NOW] = 0.0
        memory[axis, MISALIGNMENT_NOW] = 0.0
    if motor > 0:
        memory[0, MISALIGNMENT_NOW] = plant.misalignment * draw_pitch + up
        memory[1, MISALIGNMENT_NOW] = plant.misalignment * draw_yaw + right
    control.counts[MOTOR] = motor
    control.counts[JUST_IGNITED] = 1


@inline_jit
def record(control, tick, axis, rate_step, force, wind):
    """Write the record of an axis at a tick, if this tick is recorded.

    tick : index of the tick
    rate_step : rad/s. Step of the commanded rate.
    force, wind : m/s^2, m/s. Lateral specific force, and lateral wind without gusts.
    """
    if tick % control.record_interval != 0 or tick // control.record_interval >= control.history.shape[0]:
        return
    state = control.memory[axis]
    number = tick // control.record_interval
    row = control.history[number, axis]
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


@inline_jit
def _accumulate(sums, motion):
    """Add the motion of a tick to the sums (N_SUM,) of an axis in a phase."""
    turning = abs(motion.turning)
    jerk = abs(motion.jerk)
    sums[TICKS] += 1.0
    sums[INSIDE_TURNING] += 1.0 if turning <= motion.turning_bound else 0.0
    sums[INSIDE_JERK] += 1.0 if jerk <= motion.jerk_bound else 0.0
    sums[TURNING_RATIO] = max(sums[TURNING_RATIO], turning / motion.turning_bound)
    sums[JERK_RATIO] = max(sums[JERK_RATIO], jerk / motion.jerk_bound)
    sums[SQUARE_ERROR] += motion.error * motion.error
    sums[SQUARE_RATE] += motion.rate_error * motion.rate_error


@inline_jit
def close(control):
    """Add the previous tick to the sums; its angular acceleration is not available before its end."""
    course, tick = control.course, control.counts[NEXT] - 1
    last = course.t.size - 1
    if tick < 0 or tick >= last:
        return
    dt = course.t[1] - course.t[0]
    number = tick // control.record_interval
    for axis in range(2):
        state = control.memory[axis]
        rate = course.rate[tick + 1, axis] + state[RATE_NOW]
        turning = (rate - state[PREVIOUS_RATE]) / dt
        motion = AxisMotion(
            turning=turning,
            turning_bound=state[TURNING_BOUND_NOW],
            jerk=state[JERK_NOW],
            jerk_bound=state[JERK_BOUND_NOW],
            error=state[ERROR_NOW],
            rate_error=state[RATE_ERROR_NOW],
        )
        _accumulate(control.sums[axis, course.phase[tick]], motion)
        if tick % control.record_interval == 0 and number < control.history.shape[0]:
            control.history[number, axis, TURNING] = turning
