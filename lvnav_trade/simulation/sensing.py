"""Truth side of a run: initial errors, receiver and sensor measurements (one run or eight lanes)."""

import numpy as np

from lvnav_trade.filter.receivers.carrier_smoothing import smooth
from lvnav_trade.filter.receivers.ekf_gnss import solve
from lvnav_trade.filter.receivers.receiver import switch_on
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.attitude import from_rotation, multiply, normalise
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import number_like
from lvnav_trade.kernels.random import normals
from lvnav_trade.kernels.strapdown import Q, R, V
from lvnav_trade.sensors import ranges, receiver_solution
from lvnav_trade.sensors.family import measure
from lvnav_trade.simulation.imu_array import begin_units, take_difference
from lvnav_trade.simulation.imu_sensing import gather_tables

_ZERO = np.uint64(0)
_ONE = np.uint64(1)


@jit
def begin(work, imu_array_work, case, truth, key):
    """Initialise a run at tick 0: draw true IMU parameters, clock and correlated errors, and the initial error.

    Parameters
    ----------
    work : Work, updated in place
    imu_array_work : ImuArrayWork of an IMU array; None for one IMU
    case, truth : FilterCase, Truth
    key : (2,) key words of the seed
    """
    run = work.run[0]
    imu_truth = truth.unit
    k0, k1 = key
    _begin_estimate(work, truth.start, case.model, k0, k1, run)
    processes.zero_all(work.true_par)
    processes.start(work.true_par, imu_truth.sigma, imu_truth.sources, k0, k1, run)
    begin_units(imu_array_work, case.options.imu_array)
    gather_tables(work, imu_array_work, imu_truth, case.options.imu_array)
    _begin_receiver(work, case.signals, k0, k1, run)
    zero = number_like(work.clock[0], 0.0)
    work.clock_hat[0] = zero
    work.clock_hat[1] = zero
    for e in range(case.model.extra_offset.shape[0]):
        work.extra[e] = zero
    work.failed[0] = zero
    work.t_failed[0] = number_like(zero, np.nan)


@jit
def _initial_error(start, block, k0, k1, run):
    """Return the drawn initial error (3) of a block, frame i: rad, m/s or m.

    Parameters
    ----------
    start : InitialState, with the square roots of the covariance and the keys of the draws
    block : 0 attitude, 1 velocity, 2 position
    k0, k1, run : key words of the seed; run, one or eight lanes
    """
    n0, n1, n2, _ = normals(k0, k1, start.source_keys[block], run, _ZERO, _ZERO)
    root = start.roots[block]
    x_row = root[0]
    y_row = root[1]
    z_row = root[2]
    x = x_row[0] * n0 + x_row[1] * n1 + x_row[2] * n2
    y = y_row[0] * n0 + y_row[1] * n1 + y_row[2] * n2
    z = z_row[0] * n0 + z_row[1] * n1 + z_row[2] * n2
    return x, y, z


@jit
def _begin_estimate(work, start, model, k0, k1, run):
    """Set the initial estimate: truth minus drawn errors, no estimated IMU parameters, initial covariance.

    Parameters
    ----------
    work : Work, updated in place
    start, model : InitialState, FilterModel
    k0, k1, run : key words of the seed; run, one or eight lanes
    """
    q0, q1, q2, q3 = draw_initial_state(work, start, k0, k1, run)
    work.nav[Q] = q0
    work.nav[Q + 1] = q1
    work.nav[Q + 2] = q2
    work.nav[Q + 3] = q3
    zero = number_like(q0, 0.0)
    for i in range(6):
        work.previous[i] = zero
        work.remainder[i] = zero
    for i in range(model.n_state):
        work.x[i] = zero
        for j in range(model.n_state):
            work.P[i, j] = number_like(q0, start.P[i, j])
    processes.zero_all(work.par)
    processes.zero_all(work.tables)


@jit
def _begin_receiver(work, signals, k0, k1, run):
    """Draw the true clock and the correlated measurement errors at tick 0."""
    n0, n1, _, _ = normals(k0, k1, signals.source_keys[3], run, _ZERO, _ZERO)
    work.clock[0] = signals.clock_start[0] * n0
    work.clock[1] = signals.clock_start[1] * n1
    correlated_errors = signals.correlated_errors
    for m in range(correlated_errors.initial_sigma.shape[0]):
        if not correlated_errors.is_recorded[m]:
            source = correlated_errors.source_keys[m]
            satellite = correlated_errors.satellite_keys[m]
            s0, _, _, _ = normals(k0, k1, source, run, _ZERO, satellite)
            work.correlated_errors[m] = correlated_errors.initial_sigma[m] * s0


@jit
def draw_initial_state(work, start, k0, k1, run):
    """Set estimated velocity and position to truth minus drawn errors; return the estimated attitude (4) likewise.

    Parameters
    ----------
    work : Work, of which `nav` is updated in place
    start : InitialState
    k0, k1, run : key words of the seed; run, one or eight lanes
    """
    true = start.nav
    dv = _initial_error(start, 1, k0, k1, run)
    dr = _initial_error(start, 2, k0, k1, run)
    for i in range(3):
        work.nav[V + i] = true[V + i] - dv[i]
        work.nav[R + i] = true[R + i] - dr[i]
    x, y, z = _initial_error(start, 0, k0, k1, run)
    e0, e1, e2, e3 = from_rotation(-x, -y, -z)
    t0 = true[Q]
    t1 = true[Q + 1]
    t2 = true[Q + 2]
    t3 = true[Q + 3]
    q0, q1, q2, q3 = multiply(e0, e1, e2, e3, t0, t1, t2, t3)
    return normalise(q0, q1, q2, q3)


@jit
def step_clock(clock, step, interval, jump, n0, n1):
    """Step bias (m) and drift (m/s) of a clock over an interval.

    Parameters
    ----------
    clock : (2,) m, m/s, updated in place
    step : (3,) Cholesky factor of the noise, as from `clock.clock_step`
    interval : s
    jump : (2,) m, m/s, jumps by faults
    n0, n1 : standard normals
    """
    bias_noise = step[0] * n0
    clock[0] = clock[0] + interval * clock[1] + bias_noise + jump[0]
    clock[1] = clock[1] + step[1] * n0 + step[2] * n1 + jump[1]


@jit
def _step_receiver(work, signals, word, epoch, key):
    """Step the receiver's clock and the correlated measurement errors to an epoch.

    Parameters
    ----------
    work : Work, updated in place
    signals : Signals
    word : epoch + 1, the number of the step in the keys of the draws
    epoch : index
    key : (2,) key words of the seed
    """
    k0, k1 = key
    run = work.run[0]
    n0, n1, _, _ = normals(k0, k1, signals.source_keys[0], run, word, _ZERO)
    jump = signals.clock_jump[epoch]
    step_clock(work.clock, signals.clock_step, signals.interval, jump, n0, n1)
    correlated_errors = signals.correlated_errors
    for m in range(correlated_errors.walk.shape[0]):
        walk = correlated_errors.walk[m]
        if walk > 0.0:
            source = correlated_errors.source_keys[m]
            satellite = correlated_errors.satellite_keys[m]
            s0, _, _, _ = normals(k0, k1, source, run, word, satellite)
            decayed_error = correlated_errors.decay[m] * work.correlated_errors[m]
            work.correlated_errors[m] = decayed_error + walk * s0


@jit
def _correlated_error(work, correlated_errors, epoch, channel):
    """Return the sum of the correlated errors in the measurement of a channel at an epoch, SI.

    Parameters
    ----------
    work : Work, with the errors `correlated_errors`
    correlated_errors : correlated errors of the case, with components and partial derivatives by family and channel
    epoch, channel : indices
    """
    total = number_like(work.clock[0], 0.0)
    for family in range(correlated_errors.member.shape[0]):
        m = correlated_errors.member[family, channel]
        if m >= 0:
            partial = correlated_errors.partial[family, epoch, channel]
            total = total + partial * work.correlated_errors[m]
    return total


@jit
def begin_solver(work, receiver, solver):
    """Switch on a receiver that computes its solution (Solver, or None), with the estimate as its first guess."""
    if solver is not None:
        switch_on(receiver, work.nav[R], work.nav[R + 1], work.nav[R + 2])


@jit
def _begin_phases(work, further, signals, word, epoch, key):
    """Draw the ambiguities of newly acquired carriers."""
    k0, k1 = key
    correlated_errors = signals.correlated_errors
    for s in range(further.ambiguity.shape[0]):
        m = further.ambiguity[s]
        if m >= 0 and further.is_restarted[epoch, s]:
            source = correlated_errors.source_keys[m]
            satellite = correlated_errors.satellite_keys[m]
            n0, _, _, _ = normals(k0, k1, source, work.run[0], word, satellite)
            work.correlated_errors[m] = correlated_errors.initial_sigma[m] * n0


@jit
def _measure_further(work, previous_observables, further, signals, word, epoch, key):
    """Set the further observables of all satellites; pseudorange and range rate are set already.

    Parameters
    ----------
    work : Work, of which `ranges` is updated in place
    previous_observables : (n_sat, n_observable) observables of the previous epoch, for differences; updated in place
    further : FurtherObservables
    signals : Signals
    word : epoch + 1, the number of the step in the keys of the draws
    epoch : index
    key : (2,) key words of the seed
    """
    k0, k1 = key
    _begin_phases(work, further, signals, word, epoch, key)
    n_observable = further.is_phase.shape[0]
    run = work.run[0]
    correlated_errors = signals.correlated_errors
    sigma = signals.sigma[epoch]
    for slot in range(signals.n_used[epoch]):
        s = signals.satellite_by_slot[epoch, slot]
        satellite = signals.satellite_keys[s]
        m0, _, _, _ = normals(k0, k1, further.source, run, word, satellite)
        for observable in range(2, n_observable):
            channel = n_observable * s + observable
            value = work.ranges[slot, 0]
            if further.is_phase[observable]:
                correlated_error = _correlated_error(work, correlated_errors, epoch, channel)
                true_phase = further.phase[epoch, s] + correlated_error
                value = ranges.observe(true_phase, work.clock[0], sigma[channel], m0)
            work.ranges[slot, observable] = value
            if further.is_difference[observable]:
                work.ranges[slot, observable] = value - previous_observables[s, observable]
                previous_observables[s, observable] = value


@jit
def _repeat(work, further, signals, epoch):
    """Set the differences of a frozen output to zero."""
    if further is not None:
        zero = number_like(work.clock[0], 0.0)
        for slot in range(signals.n_used[epoch]):
            for observable in range(2, further.is_phase.shape[0]):
                if further.is_difference[observable]:
                    work.ranges[slot, observable] = zero


@jit
def _measure_ranges(work, n_observable, signals, word, epoch, key):
    """Set pseudorange (m) and range rate (m/s) of every satellite in use.

    Parameters
    ----------
    work : Work, of which `ranges` is updated in place
    n_observable : number of channels of a satellite
    signals : Signals
    word : epoch + 1, the number of the step in the keys of the draws
    epoch : index
    key : (2,) key words of the seed
    """
    k0, k1 = key
    run = work.run[0]
    correlated_errors = signals.correlated_errors
    sigma = signals.sigma[epoch]
    for slot in range(signals.n_used[epoch]):
        s = signals.satellite_by_slot[epoch, slot]
        range_channel = n_observable * s
        rate_channel = range_channel + 1
        satellite = signals.satellite_keys[s]
        m0, m1, _, _ = normals(k0, k1, signals.source_keys[1], run, word, satellite)
        range_error = _correlated_error(work, correlated_errors, epoch, range_channel)
        rate_error = _correlated_error(work, correlated_errors, epoch, rate_channel)
        true_range = signals.range[epoch, s] + range_error
        true_rate = signals.rate[epoch, s] + rate_error
        range_sigma = sigma[range_channel]
        rate_sigma = sigma[rate_channel]
        work.ranges[slot, 0] = ranges.observe(true_range, work.clock[0], range_sigma, m0)
        work.ranges[slot, 1] = ranges.observe(true_rate, work.clock[1], rate_sigma, m1)


@jit
def _measure_directly(work, signals, word, epoch, key):
    """Set position and velocity of a directly simulated solution."""
    k0, k1 = key
    run = work.run[0]
    correlated_errors = signals.correlated_errors
    sigma = signals.sigma[epoch]
    source = signals.source_keys[2]
    p0, p1, p2, _ = normals(k0, k1, source, run, word, _ZERO)
    v0, v1, v2, _ = normals(k0, k1, source, run, word, _ONE)
    normal = (p0, p1, p2, v0, v1, v2)
    for i in range(6):
        true_value = signals.position[epoch, i] if i < 3 else signals.velocity[epoch, i - 3]
        true_value = true_value + _correlated_error(work, correlated_errors, epoch, i)
        work.solution[i] = receiver_solution.observe(true_value, sigma[i], normal[i])


@jit
def _solve(work, receiver, solver, signals, epoch):
    """Compute the receiver's solution, which the filter takes as its measurement."""
    solve(
        receiver,
        solver.point,
        solver.filter,
        signals.satellite_position[epoch],
        signals.satellite_velocity[epoch],
        signals.satellite_by_slot[epoch],
        signals.n_used[epoch],
        work.ranges,
    )
    if not signals.is_frozen[epoch]:  # while its output is frozen the receiver continues internally
        for i in range(6):
            work.solution[i] = receiver.solution[i]


@jit
def _sensor_error(work, signals, epoch, channel, normal):
    """Return the error of a scalar of a sensor, SI: white noise plus lasting errors.

    Parameters
    ----------
    work, signals : Work, Signals
    epoch, channel : indices; the channel is an index of the measured channels, as in `signals.sigma`
    normal : standard normal draw
    """
    noise = signals.sigma[epoch, channel] * normal
    correlated_error = _correlated_error(work, signals.correlated_errors, epoch, channel)
    return noise + correlated_error


@jit
def measure_sensors(work, imu_array_work, sensors, imu_array, signals, key, epoch):
    """Set the measurements of all sensors other than the receiver at an epoch.

    Parameters
    ----------
    work : Work, of which `sensor_measurements` is updated in place
    imu_array_work : ImuArrayWork of an IMU array; None for one IMU
    sensors : Sensors, or None
    imu_array : ImuArray, or None
    signals : Signals
    key : (2,) key words of the seed
    epoch : index
    """
    if sensors is not None:
        zero = number_like(work.clock[0], 0.0)
        k0, k1 = key
        run = work.run[0]
        word = np.uint64(epoch + 1)
        for k in range(sensors.code.shape[0]):
            if sensors.is_measuring[k, epoch]:
                n0, n1, n2, _ = normals(k0, k1, sensors.source_keys[k], run, word, _ZERO)
                channel = sensors.channel[k] + signals.shift
                count = sensors.scalars[k]
                truth = sensors.truth[k, epoch]
                e0 = _sensor_error(work, signals, epoch, channel, n0)
                e1 = _sensor_error(work, signals, epoch, channel + 1, n1) if count > 1 else zero
                e2 = _sensor_error(work, signals, epoch, channel + 2, n2) if count > 2 else zero
                measure(work.sensor_measurements[k], sensors.code[k], truth, e0, e1, e2)
                take_difference(work, imu_array_work, imu_array, k)


@jit
def _observe_further(work, previous_observables, case, further, key, epoch):
    """Set the further observables of satellites (FurtherObservables, or None)."""
    if further is not None:
        word = np.uint64(epoch + 1)
        _measure_further(work, previous_observables, further, case.signals, word, epoch, key)


@jit
def observe(work, optional_state, case, solver, key, epoch):
    """Step the receiver to an epoch and set its measurements; a frozen output is not changed.

    Parameters
    ----------
    work, optional_state : Work, OptionalState; updated in place
    case : FilterCase
    solver : Solver of a receiver that computes its solution; None if it is simulated directly or not used
    key : (2,) key words of the seed
    epoch : index
    """
    word = np.uint64(epoch + 1)
    signals = case.signals
    model = case.model
    further = case.options.further_observables
    _step_receiver(work, signals, word, epoch, key)
    if solver is not None:
        _measure_ranges(work, 2, signals, word, epoch, key)
        smooth(optional_state.receiver, work, solver.smoothing, signals, word, epoch, key)
        _solve(work, optional_state.receiver, solver, signals, epoch)
        return
    if signals.is_frozen[epoch]:
        _repeat(work, further, signals, epoch)
        return
    if model.tight:
        _measure_ranges(work, model.n_observable, signals, word, epoch, key)
        _observe_further(work, optional_state.previous_observables, case, further, key, epoch)
    else:
        _measure_directly(work, signals, word, epoch, key)
