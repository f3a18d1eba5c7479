"""One axis of a launcher that turns: nozzle, body, gusts, shaped commands, and the filter of a random-walk rate.

Angles and rates are deviations from the nominal attitude; "lateral" is the direction that a positive angle moves the
nose to. A nozzle deflected by a positive angle pushes laterally, behind the centre of mass, and so turns the body back.
"""

import math

from lvnav_trade.kernels.jit import jit

_ROOT_2, _ROOT_3 = math.sqrt(2.0), math.sqrt(3.0)
_GUST_1, _GUST_2 = math.sqrt(1.5), 0.5 * (1.0 - _ROOT_3)


@jit
def nozzle_step(angle, command, time_constant, rate_limit, h):
    """Return the nozzle angle after a constant command: first-order lag with a rate limit, exact.

    A distant command is approached at the rate limit until the lag requires a smaller rate. The approach is monotone,
    so the movement in a step is the difference of its ends.

    Parameters
    ----------
    angle, command : float
        Nozzle angle at the start, and commanded angle (rad).
    time_constant : float
        Time constant of the lag (s).
    rate_limit : float
        Rate limit (rad/s).
    h : float
        Length of the step (s).
    """
    distance = command - angle
    knee = rate_limit * time_constant  # distance at which the lag requires the rate limit
    if abs(distance) > knee:
        limited_time = (abs(distance) - knee) / rate_limit
        if h <= limited_time:
            movement = math.copysign(rate_limit * h, distance)
            return angle + movement
        lag_time = h - limited_time
        lag_distance = math.copysign(knee, distance)
        return command - lag_distance * math.exp(-lag_time / time_constant)
    return command - distance * math.exp(-h / time_constant)


@jit
def command_step(value, slope, target, time_constant, h):
    """Return a command and its slope after a critically damped second-order lag towards a constant target.

    value, target : rad. Command at the start, and its target.
    slope : rad/s. Slope of the command at the start.
    time_constant, h : s. Time constant of the lag, and length of the step.
    """
    x = value - target
    rise = slope + x / time_constant
    decay = math.exp(-h / time_constant)
    next_value = target + (x + rise * h) * decay
    next_slope = (slope - rise * h / time_constant) * decay
    return next_value, next_slope


@jit
def lag_step(value, drive, time_constant, h):
    """Return the output of a first-order lag after a constant input.

    value, drive : output at the start, and input
    time_constant, h : s. Time constant of the lag, and length of the step.
    """
    distance = value - drive
    decay = math.exp(-h / time_constant)
    return drive + distance * decay


@jit
def gust_step(first, second, x, n0, n1):
    """Return the two states of a Dryden gust across the path after a step.

    The discretisation is exact. The states have unit variance, however V / L varies from step to step. The gust is
    `gust_output` times its sigma.

    Parameters
    ----------
    first, second : float
        States at the start.
    x : float
        h V / L: the step h divided by the time L / V in which the vehicle travels a scale length L at the airspeed V.
    n0, n1 : float
        Standard normal draws.
    """
    decay = math.exp(-x)
    square = decay * decay
    # Stationary covariance propagated over the step, without its decay
    propagated_12 = _ROOT_2 * x + 1.0 / _ROOT_2
    propagated_22 = 1.0 + 2.0 * x + 2.0 * x * x
    # Covariance of the process noise over the step, and its Cholesky factor
    q11 = 1.0 - square
    q12 = 1.0 / _ROOT_2 - square * propagated_12
    q22 = 1.0 - square * propagated_22
    l11 = math.sqrt(q11)
    l21 = q12 / l11 if l11 > 0.0 else 0.0
    remaining_variance = q22 - l21 * l21
    l22 = math.sqrt(max(0.0, remaining_variance))
    next_first = decay * first + l11 * n0
    second_and_coupling = second + _ROOT_2 * x * first
    next_second = decay * second_and_coupling + l21 * n0 + l22 * n1
    return next_first, next_second


@jit
def gust_output(first, second):
    """Return the gust, of unit variance, of the states of `gust_step`.

    The forming filter is that of MIL-F-8785C across the path: (1 + sqrt(3) s L / V) / (1 + s L / V)^2.
    """
    return _GUST_1 * first + _GUST_2 * second


@jit
def body_step(angle, rate, drift, push, mid, end, coefficients, h):
    """Return angle, rate and lateral speed after one classical Runge-Kutta step of fourth order.

    Parameters
    ----------
    angle, rate, drift : float
        Deviations from the nominal attitude (rad), rate (rad/s) and lateral speed (m/s) at the start.
    push, mid, end : float
        Nozzle angle (rad), misalignment included, at the start, in the middle and at the end.
    coefficients : tuple of 7 floats
        Effectiveness (1/s^2), thrust over mass (m/s^2), moment and force per lateral airspeed (rad/s/m and 1/s),
        airspeed (m/s), lateral wind less nominal lateral airspeed (m/s), other angular acceleration (rad/s^2).
    h : float
        Length of the step (s).
    """
    half = 0.5 * h
    # Angular acceleration a, lateral acceleration b
    a1, b1 = _rates(angle, drift, push, coefficients)
    angle2 = angle + half * rate
    rate2 = rate + half * a1
    drift2 = drift + half * b1
    a2, b2 = _rates(angle2, drift2, mid, coefficients)
    angle3 = angle + half * rate2
    rate3 = rate + half * a2
    drift3 = drift + half * b2
    a3, b3 = _rates(angle3, drift3, mid, coefficients)
    angle4 = angle + h * rate3
    rate4 = rate + h * a3
    drift4 = drift + h * b3
    a4, b4 = _rates(angle4, drift4, end, coefficients)
    sixth = h / 6.0
    rate_sum = rate + 2.0 * (rate2 + rate3) + rate4
    a_sum = a1 + 2.0 * (a2 + a3) + a4
    b_sum = b1 + 2.0 * (b2 + b3) + b4
    next_angle = angle + sixth * rate_sum
    next_rate = rate + sixth * a_sum
    next_drift = drift + sixth * b_sum
    return next_angle, next_rate, next_drift


@jit
def _rates(angle, drift, nozzle, coefficients):
    """Return the angular acceleration (rad/s^2) and the derivative of the lateral speed (m/s^2).

    nozzle : rad. Nozzle angle, misalignment included. The other arguments are those of `body_step`.
    """
    effectiveness, thrust_load, moment, force, airspeed, wind, acceleration = coefficients
    crosswind = airspeed * angle - drift + wind
    angular_acceleration = acceleration - effectiveness * nozzle + moment * crosswind
    drift_rate = thrust_load * (nozzle + angle) + force * crosswind
    return angular_acceleration, drift_rate


@jit
def lateral_force(angle, drift, nozzle, coefficients):
    """Return the lateral specific force (m/s^2) on the body; the arguments are those of `_rates`."""
    _, thrust_load, _, force, airspeed, wind, _ = coefficients
    crosswind = airspeed * angle - drift + wind
    return thrust_load * nozzle + force * crosswind


@jit
def filter_gain(variance, step_variance, noise):
    """Return the variance after a measurement, and the gain, of the filter of a scalar random walk.

    variance : variance after the previous measurement
    step_variance : variance of a step of the walk
    noise : variance of the measurement noise
    """
    prior = variance + step_variance
    total = prior + noise
    gain = prior / total if total > 0.0 else 1.0
    return (1.0 - gain) * prior, gain


@jit
def thruster_sense(state, error, dead_band, release):
    """Return the sense (-1, 0, 1) of a thruster pair that drives an error into its dead band.

    A thruster opens outside the dead band. It closes once the error is within the part `release` of the dead band, or
    has changed sign.

    state : present sense
    error, dead_band : rad
    release : fraction of the dead band
    """
    if error > dead_band:
        return -1.0
    if error < -dead_band:
        return 1.0
    if state < 0.0 and error > release * dead_band:
        return -1.0
    if state > 0.0 and error < -release * dead_band:
        return 1.0
    return 0.0
