"""State of the axes of a turning launcher from tick to tick: its numbers, initial draws, ignition of a motor."""

import numpy as np

from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.random import normals, source_word
from lvnav_trade.trajectory.guided.autopilot import JUST_IGNITED, MOTOR, NEXT, STACK

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


@inlined
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
    memory, course, feed = control.memory, control.course, control.settings.feed
    k0, k1, run = control.draws
    memory[:] = 0.0
    # Both states of the Dryden filter have unit variance and a correlation of 1 / sqrt(2).
    g0, g1, g2, g3 = normals(k0, k1, GUSTS, run, _ZERO, _ZERO)
    half = np.sqrt(0.5)
    memory[0, GUST_1] = g0
    memory[0, GUST_2] = half * (g0 + g1)
    memory[1, GUST_1] = g2
    memory[1, GUST_2] = half * (g2 + g3)
    bias_pitch, bias_yaw = draw_pair(control, _GYRO_BIAS, _ZERO)
    memory[0, BIAS] = feed.bias * bias_pitch
    memory[1, BIAS] = feed.bias * bias_yaw
    angle_pitch, angle_yaw = draw_pair(control, _INITIAL_ATTITUDE, _ZERO)
    memory[0, NAVIGATED_ANGLE] = feed.start * angle_pitch
    memory[1, NAVIGATED_ANGLE] = feed.start * angle_yaw
    for axis in range(2):
        memory[axis, COMMANDED_RATE] = course.rate[0, axis] + course.turn_rate[0, axis]
        memory[axis, RATE_VARIANCE] = feed.gyro**2
        memory[axis, RATE_ESTIMATE] = course.rate[0, axis]
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
