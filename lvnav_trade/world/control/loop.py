"""The closed loop of a turning launcher, one run from lift-off on: gusts, gyro, rate filter, controller, nozzle.

Axis by axis (pitch, yaw) on the ticks of the inertial unit. A command holds for a tick; nozzle, gust and command lags
are stepped exactly, the body by Runge-Kutta steps of half a tick.
"""

from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.jit import jit, making_arrays
from lvnav_trade.kernels.random import normals, source_word
from lvnav_trade.records import Floats
from lvnav_trade.world.control.axis import (
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

TRUE, RAW, FILTERED = 0, 1, 2
BURN, COAST, CHANGE, N_PHASE = 0, 1, 2, 3

# What is recorded of an axis at a tick.
(
    NOZZLE,
    ASKED,
    MOVED,
    ERROR,
    RATE_ERROR,
    TURNING,
    TURNING_BOUND,
    JERK,
    JERK_BOUND,
    AIR,
    FORMAL,
    ANGLE,
    RATE,
    FORCE,
    STEPPED,
    N_RECORD,
) = range(16)
# What is added up of an axis in a phase.
(TICKS, INSIDE_TURNING, INSIDE_JERK, TURNING_RATIO, JERK_RATIO, SQUARE_ERROR, SQUARE_RATE, N_SUM) = range(8)
# What an axis carries from tick to tick.
(
    _ANGLE,
    _RATE,
    _DRIFT,
    _PUSH,
    _INTEGRAL,
    _GUST_1,
    _GUST_2,
    _OFFSET,
    _OFFSET_RATE,
    _TARGET,
    _SENSE,
    _ESTIMATE,
    _VARIANCE,
    _ATTITUDE,
    _BIAS,
    _MISALIGNED,
    _COMMAND,
    _TURN_LAG,
    _JERK_LAG,
    _COMMANDED,
    _ANGLE_BEFORE,
    _FORCE_BEFORE,
    _MOVEMENT,
    _FED,
    _N,
) = range(25)

_GYRO, _BIASES = source_word("rotation gyro noise"), source_word("rotation gyro bias")
_GUSTS, _PROFILE = source_word("rotation gust"), source_word("rotation wind profile")
_REFERENCE, _START = source_word("rotation attitude reference"), source_word("rotation attitude start")
_SPEED, _MISALIGNMENT = source_word("rotation guidance speed"), source_word("rotation thrust misalignment")
_STEPS = source_word("rotation guidance command")
_ZERO = np.uint64(0)


class Plant(NamedTuple):
    """Nozzle (s, rad/s, rad, rad) and thrusters (rad, s, part) of a vehicle."""

    time_constant: float
    rate_limit: float
    limit: float
    misalignment: float
    dead_band: float
    lead: float
    release: float


class Law(NamedTuple):
    """Controller: gains (n_stage, 3) of attitude, rate (s), integral (1/s); guidance from a stage on (0: none)."""

    gains: Floats
    command_time: float
    guided_from: int
    guidance_ticks: int
    guidance_time: float
    guidance_limit: float
    velocity_sigma: float
    command_sigma: float


class Feed(NamedTuple):
    """What the controller sees: source of the rate, whether attitude is the navigation's, noises, reference's gain."""

    rate: int
    navigated: bool
    gyro: float
    bias: float
    reference: float
    reference_ticks: int
    reference_gain: float
    start: float


class CommandedEnvelope(NamedTuple):
    """The part of the motion envelope that depends on commanded rate and nozzle angle, see `EnvelopeCard`."""

    burn: float
    coast: float
    turn_gain: float
    turn_time: float
    lateral: float
    nozzle_gain: float
    nozzle_time: float


class Settings(NamedTuple):
    """What is the same in all runs of a launch."""

    plant: Plant
    law: Law
    feed: Feed
    model: CommandedEnvelope
    spread: float  # of the steady wind, part of its profile


class Draws(NamedTuple):
    """What the draws of a run depend on: two words of the seed, the number of the run."""

    k0: np.uint64
    k1: np.uint64
    run: np.uint64


class Reaction(NamedTuple):
    """What an axis does at a tick, with the bounds of the envelope of commanded motion."""

    turning: float  # angular acceleration, rad/s^2
    turning_bound: float  # rad/s^2
    jerk: float  # of the lateral specific force, m/s^3
    jerk_bound: float  # m/s^3
    error: float  # of the attitude, rad
    rate_error: float  # rad/s


@jit
def _begin(state, body, plant, feed, k0, k1, run):
    """Draw what a run starts with; state updated. Return the factors of the wind profile along and across."""
    g0, g1, g2, g3 = normals(k0, k1, _GUSTS, run, _ZERO, _ZERO)
    half = np.sqrt(0.5)
    state[0, _GUST_1], state[0, _GUST_2] = g0, half * (g0 + g1)
    state[1, _GUST_1], state[1, _GUST_2] = g2, half * (g2 + g3)
    b0, b1, _, _ = normals(k0, k1, _BIASES, run, _ZERO, _ZERO)
    state[0, _BIAS], state[1, _BIAS] = feed.bias * b0, feed.bias * b1
    a0, a1, _, _ = normals(k0, k1, _START, run, _ZERO, _ZERO)
    state[0, _ATTITUDE], state[1, _ATTITUDE] = feed.start * a0, feed.start * a1
    for axis in range(2):
        state[axis, _COMMANDED] = body.rate[0, axis] + body.turn_rate[0, axis]
        state[axis, _VARIANCE] = feed.gyro**2
        state[axis, _ESTIMATE] = body.rate[0, axis]
    w0, w1, _, _ = normals(k0, k1, _PROFILE, run, _ZERO, _ZERO)
    return w0, w1


@jit
def _ignite(state, plant, motor, k0, k1, run):
    """Let the nozzle of another stage take over, centred, with a misalignment of its own; state updated."""
    m0, m1, _, _ = normals(k0, k1, _MISALIGNMENT, run, np.uint64(motor), _ZERO)
    for axis in range(2):
        state[axis, _PUSH], state[axis, _INTEGRAL], state[axis, _COMMAND] = 0.0, 0.0, 0.0
    on = plant.misalignment if motor > 0 else 0.0
    state[0, _MISALIGNED], state[1, _MISALIGNED] = on * m0, on * m1


@jit
def _capture(x, body, k, axis, feed):
    """Let the command begin where the vehicle points, and how it turns, when a motor lights; x updated.

    While no motor burnt the ascent's attitude went on without it. A command that jumped would slam the nozzle.
    """
    attitude = x[_ATTITUDE] if feed.navigated else x[_ANGLE]
    x[_OFFSET] = attitude - body.turn[k, axis]
    x[_OFFSET_RATE] = x[_FED] - body.rate[k, axis] - body.turn_rate[k, axis]
    x[_COMMANDED] = x[_FED]


@jit
def _sense(x, body, k, axis, feed, dt, noise, bound):
    """Return the rate that is fed; attitude of the navigation, filter's estimate and variance updated in x."""
    if k == 0:
        mean = body.rate[0, axis] + x[_RATE]
        turned = 0.0
    else:
        turned = x[_ANGLE] - x[_ANGLE_BEFORE]
        mean = 0.5 * (body.rate[k - 1, axis] + body.rate[k, axis]) + turned / dt
    error = x[_BIAS] + noise
    x[_VARIANCE], gain = filter_gain(x[_VARIANCE], (dt * bound) ** 2, feed.gyro**2)
    x[_ESTIMATE] += gain * (mean + error - x[_ESTIMATE])
    if k > 0:
        x[_ATTITUDE] += turned + dt * error
    if feed.rate == TRUE:
        x[_FED] = body.rate[k, axis] + x[_RATE]
    elif feed.rate == RAW:
        x[_FED] = mean + error
    else:
        x[_FED] = x[_ESTIMATE]
    return x[_FED]


@jit
def _command(x, body, k, axis, settings, rate, dt):
    """Return the thrusters' sense; the nozzle's command and the integral are updated in x."""
    plant, law, feed = settings.plant, settings.law, settings.feed
    attitude = x[_ATTITUDE] if feed.navigated else x[_ANGLE]
    error = attitude - body.turn[k, axis] - x[_OFFSET]
    rate_error = rate - x[_COMMANDED]
    motor = body.motor[k]
    if motor == 0:
        x[_COMMAND] = 0.0
        return thruster_of(x[_SENSE], error + plant.lead * rate_error, plant.dead_band, plant.release)
    gains = law.gains[motor - 1]
    asked = gains[0] * error + gains[1] * rate_error + gains[2] * x[_INTEGRAL]
    x[_COMMAND] = min(max(asked, -plant.limit), plant.limit)
    if x[_COMMAND] == asked:  # what is limited is not integrated
        x[_INTEGRAL] += dt * error
    return 0.0


@jit
def _move(x, body, k, axis, plant, wind, dt):
    """Step nozzle and body over the tick; x updated."""
    alpha = (body.rate[k + 1, axis] - body.rate[k, axis]) / dt
    other = body.thruster[k] * x[_SENSE] - alpha
    c = (
        body.effectiveness[k],
        body.thrust_load[k],
        body.moment[k],
        body.force[k],
        body.airspeed[k],
        wind - body.slip[k, axis],
        other,
    )
    before = x[_PUSH]
    quarter = 0.25 * dt
    x[_ANGLE_BEFORE] = x[_ANGLE]
    for _ in range(2):
        if body.motor[k] > 0:
            mid = nozzle_step(x[_PUSH], x[_COMMAND], plant.time_constant, plant.rate_limit, quarter)
            end = nozzle_step(mid, x[_COMMAND], plant.time_constant, plant.rate_limit, quarter)
        else:
            mid, end = 0.0, 0.0
        off = x[_MISALIGNED]
        x[_ANGLE], x[_RATE], x[_DRIFT] = body_step(
            x[_ANGLE], x[_RATE], x[_DRIFT], x[_PUSH] + off, mid + off, end + off, c, 2.0 * quarter
        )
        x[_PUSH] = end
    x[_MOVEMENT] += abs(x[_PUSH] - before)


@jit
def _force(x, body, k, axis, wind):
    """Return the lateral specific force at a tick."""
    c = (0.0, body.thrust_load[k], 0.0, body.force[k], body.airspeed[k], wind - body.slip[k, axis], 0.0)
    return lateral_force(x[_ANGLE], x[_DRIFT], x[_PUSH] + x[_MISALIGNED], c)


@jit
def _steer(state, body, k, law, dt, k0, k1, run):
    """Set the targets of guidance, and step the commanded offsets and rates over the tick before; state updated."""
    motor = body.motor[k]
    if law.guided_from > 0 and k % law.guidance_ticks == 0 and motor >= law.guided_from:
        s0, s1, _, _ = normals(k0, k1, _SPEED, run, np.uint64(k), _ZERO)
        c0, c1, _, _ = normals(k0, k1, _STEPS, run, np.uint64(k), _ZERO)
        scale = 1.0 / (body.thrust_load[k] * law.guidance_time)
        for axis in range(2):
            speed = state[axis, _DRIFT] + law.velocity_sigma * (s0 if axis == 0 else s1)
            asked = law.command_sigma * (c0 if axis == 0 else c1) - speed * scale
            state[axis, _TARGET] = min(max(asked, -law.guidance_limit), law.guidance_limit)
    for axis in range(2):
        x = state[axis]
        if k > 0:
            x[_OFFSET], x[_OFFSET_RATE] = command_step(x[_OFFSET], x[_OFFSET_RATE], x[_TARGET], law.command_time, dt)


@jit
def _account(row, found):
    """Add the reaction of a tick to the sums (N_SUM,) of an axis in a phase; row updated."""
    row[TICKS] += 1.0
    row[INSIDE_TURNING] += 1.0 if abs(found.turning) <= found.turning_bound else 0.0
    row[INSIDE_JERK] += 1.0 if abs(found.jerk) <= found.jerk_bound else 0.0
    row[TURNING_RATIO] = max(row[TURNING_RATIO], abs(found.turning) / found.turning_bound)
    row[JERK_RATIO] = max(row[JERK_RATIO], abs(found.jerk) / found.jerk_bound)
    row[SQUARE_ERROR] += found.error * found.error
    row[SQUARE_RATE] += found.rate_error * found.rate_error


@making_arrays
def fly_run(body, phase, settings, draws, every, history, sums):
    """Fly one run of the closed loop; history and sums are set.

    Long because a tick is one sequence of steps, in the order in which they happen on board.

    Parameters
    ----------
    body : Body along the ascent, n ticks
    phase : (n,) BURN, COAST or CHANGE
    settings : Settings
    draws : Draws
    every : ticks from record to record
    history : (n_record, 2, N_RECORD), with n_record = (n - 1) // every + 1
    sums : (2, N_PHASE, N_SUM)
    """
    plant, law, feed, model, spread = settings
    k0, k1, run = draws
    n_tick = body.t.size - 1
    dt = body.t[1] - body.t[0]
    state = np.zeros((2, _N))
    along, across = _begin(state, body, plant, feed, k0, k1, run)
    motor = -1
    for k in range(n_tick):
        changed = body.motor[k] != motor
        if changed:
            motor = body.motor[k]
            _ignite(state, plant, motor, k0, k1, run)
        epoch = np.uint64(k + 1)
        n0, n1, _, _ = normals(k0, k1, _GYRO, run, epoch, _ZERO)
        g0, g1, g2, g3 = normals(k0, k1, _GUSTS, run, epoch, _ZERO)
        _steer(state, body, k, law, dt, k0, k1, run)
        r0, r1 = 0.0, 0.0
        fixed = feed.navigated and feed.reference_gain > 0.0 and k > 0 and k % feed.reference_ticks == 0
        if fixed:
            r0, r1, _, _ = normals(k0, k1, _REFERENCE, run, epoch, _ZERO)
        for axis in range(2):
            x = state[axis]
            h0, h1 = (g0, g1) if axis == 0 else (g2, g3)
            if k > 0:
                x[_GUST_1], x[_GUST_2] = gust_step(x[_GUST_1], x[_GUST_2], dt * body.gust_rate[k], h0, h1)
            wind = (
                (1.0 + spread * along) * body.wind[k, axis, 0]
                + spread * across * body.wind[k, axis, 1]
                + body.gust[k] * gust_of(x[_GUST_1], x[_GUST_2])
            )
            if changed and motor > 0 and k > 0:
                _capture(x, body, k, axis, feed)
            commanded = body.rate[k, axis] + body.turn_rate[k, axis] + x[_OFFSET_RATE]
            turning_bound = abs(x[_TURN_LAG]) + (model.coast if phase[k] == COAST else model.burn)
            jerk_bound = abs(x[_JERK_LAG]) + model.lateral
            stepped = commanded - x[_COMMANDED]
            drive = model.turn_gain * stepped / dt
            x[_TURN_LAG] = lag_step(x[_TURN_LAG], drive, model.turn_time, dt)
            x[_COMMANDED] = commanded
            rate = _sense(x, body, k, axis, feed, dt, feed.gyro * (n0 if axis == 0 else n1), turning_bound)
            if fixed:
                seen = x[_ANGLE] + feed.reference * (r0 if axis == 0 else r1)
                x[_ATTITUDE] += feed.reference_gain * (seen - x[_ATTITUDE])
            asked = x[_COMMAND]
            x[_SENSE] = _command(x, body, k, axis, settings, rate, dt)
            drive = model.nozzle_gain * (x[_COMMAND] - asked) / dt
            x[_JERK_LAG] = lag_step(x[_JERK_LAG], drive, model.nozzle_time, dt)
            force = _force(x, body, k, axis, wind)
            jerk = (force - x[_FORCE_BEFORE]) / dt if k > 0 else 0.0
            x[_FORCE_BEFORE] = force
            error = x[_ANGLE] - body.turn[k, axis] - x[_OFFSET]
            rate_error = rate - body.rate[k, axis] - x[_RATE]
            before = body.rate[k, axis] + x[_RATE]
            push, moved, angle, turned = x[_PUSH], x[_MOVEMENT], x[_ANGLE], x[_RATE]
            _move(x, body, k, axis, plant, wind, dt)
            turning = (body.rate[k + 1, axis] + x[_RATE] - before) / dt
            _account(sums[axis, phase[k]], Reaction(turning, turning_bound, jerk, jerk_bound, error, rate_error))
            if k % every == 0:
                row = history[k // every, axis]
                row[NOZZLE], row[ASKED], row[MOVED] = push, x[_COMMAND], moved
                row[ERROR], row[RATE_ERROR] = error, rate_error
                row[TURNING], row[TURNING_BOUND], row[JERK], row[JERK_BOUND] = turning, turning_bound, jerk, jerk_bound
                row[AIR], row[FORMAL] = wind, np.sqrt(x[_VARIANCE])
                row[ANGLE], row[RATE], row[FORCE], row[STEPPED] = angle, turned, force, stepped
    return state[0, _MOVEMENT], state[1, _MOVEMENT]
