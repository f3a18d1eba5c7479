"""Faults common to all satellites: isolation of a failed IMU or clock, and recovery from it.

A fault of the IMU or of the clock shifts all innovations. Just after its onset, the innovation of one satellite may
exceed its limit while the fitted shift does not yet exceed its own limit: a vertical shift is hard to distinguish from
a clock shift. The test is then whether the prediction agrees with the other satellites. If it does not, the fault is
common to all, and no satellite is excluded. Otherwise a persistent IMU error would exclude one satellite after the
other.
"""

from lvnav_trade.filter.policies.integrity.state import N_FIT, fit, invert
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import number_like, where
from lvnav_trade.kernels.transition import ACCEL, CONSTANT, POS, VEL
from lvnav_trade.quantities.records import OF_CLOCK, OF_INERTIAL
from lvnav_trade.sensors.jacobian_row import H_POS, H_VEL

N_PERSISTENT = 3.0
"""Number of successive inertial decisions, each within the hold time of the previous one, from which on an IMU error
counts as persistent."""


@jit
def _shift_square(monitor, P, first):
    """Return the square of the fitted shift of three states, normalised by the covariance of prediction plus fit."""
    for i in range(N_FIT):
        for j in range(N_FIT):
            monitor.A[i, j] = number_like(monitor.fit[0], 1.0 if i == j else 0.0)
    # with the fourth row and column of the identity, the 4 x 4 inverse contains that of the 3 x 3 block
    for i in range(3):
        for j in range(3):
            monitor.A[i, j] = P[first + i, first + j] + monitor.inverse[i, j]
    invert(monitor.inverse, monitor.A)
    total = number_like(monitor.fit[0], 0.0)
    for i in range(3):
        for j in range(3):
            total = total + monitor.fit[i] * monitor.inverse[i, j] * monitor.fit[j]
    return total


@jit
def compare_shifts(monitor, tests, P, first, clock):
    """Compare the fitted shift of motion and clock with their limits.

    Parameters
    ----------
    monitor, tests : Monitor, with a fit; FaultTests
    P : (n, n) covariance of the prediction
    first : first of the three states, position or velocity
    clock : clock state, bias or drift

    Returns
    -------
    shift, drift : squares of the normalised shifts divided by their limits; above 1: a fault
    size, offset : squares of the shifts, m^2 or (m/s)^2
    """
    x = monitor.fit[0]
    y = monitor.fit[1]
    z = monitor.fit[2]
    clock_shift = monitor.fit[3]
    clock_variance = P[clock, clock] + monitor.inverse[3, 3]
    offset = clock_shift * clock_shift
    drift = offset / (tests.clock_limit * clock_variance)
    size = x * x + y * y + z * z
    normalised_square = _shift_square(monitor, P, first)  # overwrites the inverse
    shift = normalised_square / tests.shift_limit
    return shift, drift, size, offset


@jit
def _joint_square(monitor, P, first, clock):
    """Return the square of the fitted shift of three states and clock together, normalised by the covariance of
    prediction plus fit.
    """
    for i in range(N_FIT):
        row = first + i if i < 3 else clock
        for j in range(N_FIT):
            column = first + j if j < 3 else clock
            monitor.A[i, j] = P[row, column] + monitor.inverse[i, j]
    invert(monitor.spare, monitor.A)
    total = number_like(monitor.fit[0], 0.0)
    for i in range(N_FIT):
        for j in range(N_FIT):
            total = total + monitor.fit[i] * monitor.spare[i, j] * monitor.fit[j]
    return total


@jit
def inflate(P, first, count, selection, variance):
    """Add a variance to `count` states from `first` on, in the runs where `selection` is 1."""
    for i in range(count):
        state = first + i
        P[state, state] = P[state, state] + where(selection > 0.0, variance, 0.0)


@jit
def _withhold(monitor, tests, model, n_row):
    """Withhold the satellite with the largest innovation from fits, unless four or fewer satellites are in use.

    A negative weight marks a withheld row. Returns the number of satellites beyond their limits, and 1 where four or
    fewer are in use.
    """
    largest = number_like(monitor.fit[0], 0.0)
    for row in range(n_row):
        square = monitor.square[row]
        is_larger = (monitor.weight[row] > 0.0) & (square > largest)
        largest = where(is_larger, square, largest)
    active_count = number_like(monitor.fit[0], 0.0)
    for row in range(0, n_row, model.n_observable):
        active_count = where(monitor.weight[row] > 0.0, active_count + 1.0, active_count)
    is_few = where(active_count > N_FIT, 0.0, 1.0)
    beyond_count = number_like(monitor.fit[0], 0.0)
    for first in range(0, n_row, model.n_observable):
        has_largest = number_like(largest, 0.0)
        satellite_fault = number_like(largest, 0.0)
        for row in range(first, first + model.n_observable):
            row_is_active = monitor.weight[row] > 0.0
            is_largest = row_is_active & (monitor.square[row] == largest)
            is_beyond = row_is_active & (monitor.square[row] > tests.single_limit)
            has_largest = where(is_largest, 1.0, has_largest)
            satellite_fault = where(is_beyond, 1.0, satellite_fault)
        beyond_count = beyond_count + satellite_fault
        for row in range(first, first + model.n_observable):
            weight = monitor.weight[row]
            monitor.weight[row] = where(has_largest > is_few, -weight, weight)
    return beyond_count, is_few


@jit
def _largest(monitor, z, observable, model, n_row):
    """Return the square of the largest innovation of an observable, over all rows in use or withheld."""
    largest = number_like(monitor.fit[0], 0.0)
    for row in range(observable, n_row, model.n_observable):
        square = where(monitor.weight[row] == 0.0, 0.0, z[row] * z[row])
        largest = where(square > largest, square, largest)
    return largest


@jit
def _is_steady(monitor, tests, model, n_row):
    """Return 1 where range rates are measured and none exceeds its limit: no error of velocity is visible."""
    is_steady = number_like(monitor.fit[0], 1.0 if model.n_observable > 1 else 0.0)
    for row in range(1, n_row, model.n_observable):
        is_beyond_limit = (monitor.weight[row] > 0.0) & (monitor.square[row] > tests.single_limit)
        is_steady = where(is_beyond_limit, 0.0, is_steady)
    return is_steady


@jit
def _restore_withheld(monitor, n_row):
    """Restore the weights of the rows that `_withhold` withheld from fits."""
    for row in range(n_row):
        weight = monitor.weight[row]
        monitor.weight[row] = where(weight < 0.0, -weight, weight)


@jit
def isolate_common_fault(monitor, work, case, open_fault, excluded_count, n_row):
    """Isolate a fault that is common to all satellites and recover from it, in the runs where `open_fault` is 1.

    The fault is common if the prediction disagrees with all satellites except the one with the largest innovation. With
    four or fewer satellites in use it is common if more than one of them disagrees, excluded satellites included.

    Four satellites fit exactly. Their ranges are attributed to a clock jump if the range rates show no velocity error
    and the shift of position, with the clock free, is not significant.

    Parameters
    ----------
    monitor : Monitor, with innovations and weights of the epoch
    work, case : arrays of the run, FilterCase
    open_fault : 1 in the runs where a fault was detected and not yet isolated
    excluded_count : number of excluded satellites
    n_row : number of rows

    Returns
    -------
    fault_type : OF_INERTIAL or OF_CLOCK; 0 if the fault is not common
    speed : (m/s)^2. Square of the shift of velocity
    """
    tests, model = case.options.fault_tests, case.model
    P, z = work.P, monitor.z
    zero = number_like(monitor.fit[0], 0.0)
    factor = tests.recovery * tests.recovery
    beyond_count, is_few = _withhold(monitor, tests, model, n_row)
    has_several = where(is_few * (beyond_count + excluded_count) > 1.0, open_fault, 0.0)
    is_steady = _is_steady(monitor, tests, model, n_row)
    fault_type = zero
    speed = zero
    clock_jump = zero  # 1 where four or fewer ranges are attributed to a clock jump
    for observable in range(2):
        first, state = (H_POS, POS) if observable == 0 else (H_VEL, VEL)
        clock_state = model.clock + observable
        _, dof = fit(monitor, work.H, z, first, observable, model.n_observable, n_row)
        joint = _joint_square(monitor, P, state, clock_state)
        shift, drift, size, offset = compare_shifts(monitor, tests, P, state, clock_state)
        common_to_few = where(clock_jump > 0.0, 0.0, has_several)
        common_to_many = where(joint > tests.joint_limit, open_fault, 0.0)
        common_fault = where(is_few > 0.0, common_to_few, common_to_many)
        no_motion_shift = (dof >= 0.0) & (shift <= 1.0)
        few_fit_clock = is_steady * where(no_motion_shift, 1.0, 0.0)
        is_clock = where(is_few > 0.0, few_fit_clock, drift - shift) > 0.0
        # within the hold time of an inertial decision the fault counts as inertial again
        clock_fault = where(is_clock & (monitor.fault_counters[0] <= 0.0), common_fault, 0.0)
        motion_fault = common_fault - clock_fault
        # four or fewer satellites cannot separate motion and clock: the largest innovation bounds the shift of either
        largest = _largest(monitor, z, observable, model, n_row)
        size = where(is_few > 0.0, largest, size)
        offset = where(is_few > 0.0, largest, offset)
        clock_jump = where(is_few > 0.0, clock_fault, clock_jump)
        inflate(P, state, 3, motion_fault, factor * size)
        inflate(P, clock_state, 1, clock_fault, factor * offset)
        fault_type = where((clock_fault > 0.0) & (fault_type == 0.0), OF_CLOCK, fault_type)
        fault_type = where(motion_fault > 0.0, OF_INERTIAL, fault_type)
        if observable == 1:
            speed = where(motion_fault > 0.0, size, speed)
    _restore_withheld(monitor, n_row)
    return fault_type, speed


@jit
def has_persistent_error(monitor):
    """Return 1 while an IMU error counts as persistent."""
    is_recent = monitor.fault_counters[0] > 0.0
    is_repeated = monitor.fault_counters[1] >= N_PERSISTENT
    return where(is_recent & is_repeated, 1.0, 0.0)


@jit
def count_inertial_faults(monitor, tests, P, model, is_inertial, speed):
    """Count successive inertial decisions, and inflate the accelerometer biases if the IMU error persists.

    From the third decision on, each within the hold time of the previous one, the variance of an accelerometer bias
    grows by the square of the velocity shift divided by the interval of the epochs.

    Parameters
    ----------
    monitor, tests, model : Monitor, FaultTests, FilterModel
    P : (n, n) covariance, updated in place
    is_inertial : 1 in the runs with an inertial decision at this epoch
    speed : (m/s)^2. Square of the velocity shift
    """
    remaining = monitor.fault_counters[0]
    earlier_count = where(remaining > 0.0, monitor.fault_counters[1], 0.0)
    count = earlier_count + is_inertial
    remaining_after = where(remaining > 0.0, remaining - 1.0, 0.0)
    monitor.fault_counters[0] = where(is_inertial > 0.0, tests.hold, remaining_after)
    monitor.fault_counters[1] = count
    is_persistent = where((is_inertial > 0.0) & (count >= N_PERSISTENT), 1.0, 0.0)
    scale = tests.recovery / tests.interval
    variance = scale * scale * speed
    for b in range(model.par_offset.shape[0]):
        first = model.par_offset[b]
        is_bias = model.par_sensor[b] == ACCEL and model.par_driver[b] == CONSTANT
        if is_bias and first < model.n_estimated:
            inflate(P, first, 3, is_persistent, variance)
