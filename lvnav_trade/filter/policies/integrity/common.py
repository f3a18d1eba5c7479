"""Faults common to all satellites: isolation of a failed IMU or clock, and recovery from it.

A fault of the IMU or of the clock shifts all innovations. Just after its onset, the innovation of one satellite may
exceed its limit while the fitted shift does not yet exceed its own limit: a vertical shift is hard to distinguish from
a clock shift. The test is then whether the prediction agrees with the other satellites. If it does not, the fault is
common to all, and no satellite is excluded. Otherwise a persistent IMU error would exclude one satellite after the
other.
"""

from lvnav_trade.filter.policies.integrity.state import N_FIT, fit, invert
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, where
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
            monitor.A[i, j] = like(monitor.fit[0], 1.0 if i == j else 0.0)
    # with the fourth row and column of the identity, the 4 x 4 inverse contains that of the 3 x 3 block
    for i in range(3):
        for j in range(3):
            monitor.A[i, j] = P[first + i, first + j] + monitor.inverse[i, j]
    invert(monitor.inverse, monitor.A)
    total = like(monitor.fit[0], 0.0)
    for i in range(3):
        for j in range(3):
            total = total + monitor.fit[i] * monitor.inverse[i, j] * monitor.fit[j]
    return total


@jit
def compare(monitor, tests, P, first, clock):
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
    drift = offset / (tests.offset * clock_variance)
    size = x * x + y * y + z * z
    normalised_square = _shift_square(monitor, P, first)  # overwrites the inverse
    shift = normalised_square / tests.shift
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
    total = like(monitor.fit[0], 0.0)
    for i in range(N_FIT):
        for j in range(N_FIT):
            total = total + monitor.fit[i] * monitor.spare[i, j] * monitor.fit[j]
    return total


@jit
def inflate(P, first, count, selected, variance):
    """Add a variance to `count` states from `first` on, in the runs where `selected` is 1."""
    for i in range(count):
        state = first + i
        P[state, state] = P[state, state] + where(selected > 0.0, variance, 0.0)


@jit
def _withhold(monitor, tests, model, n_row):
    """Withhold the satellite with the largest innovation from fits, unless four or fewer satellites are in use.

    A negative weight marks a withheld row. Returns the number of satellites beyond their limits, and 1 where four or
    fewer are in use.
    """
    largest = like(monitor.fit[0], 0.0)
    for row in range(n_row):
        square = monitor.square[row]
        is_larger = (monitor.weight[row] > 0.0) & (square > largest)
        largest = where(is_larger, square, largest)
    in_use = like(monitor.fit[0], 0.0)
    for row in range(0, n_row, model.n_kind):
        in_use = where(monitor.weight[row] > 0.0, in_use + 1.0, in_use)
    few = where(in_use > N_FIT, 0.0, 1.0)
    beyond = like(monitor.fit[0], 0.0)
    for first in range(0, n_row, model.n_kind):
        has_largest = like(largest, 0.0)
        fails = like(largest, 0.0)
        for row in range(first, first + model.n_kind):
            row_in_use = monitor.weight[row] > 0.0
            is_largest = row_in_use & (monitor.square[row] == largest)
            is_beyond = row_in_use & (monitor.square[row] > tests.single)
            has_largest = where(is_largest, 1.0, has_largest)
            fails = where(is_beyond, 1.0, fails)
        beyond = beyond + fails
        for row in range(first, first + model.n_kind):
            weight = monitor.weight[row]
            monitor.weight[row] = where(has_largest > few, -weight, weight)
    return beyond, few


@jit
def _largest(monitor, z, kind, model, n_row):
    """Return the square of the largest innovation of an observable, over all rows in use or withheld."""
    largest = like(monitor.fit[0], 0.0)
    for row in range(kind, n_row, model.n_kind):
        square = where(monitor.weight[row] == 0.0, 0.0, z[row] * z[row])
        largest = where(square > largest, square, largest)
    return largest


@jit
def _is_steady(monitor, tests, model, n_row):
    """Return 1 where range rates are measured and none exceeds its limit: no error of velocity is visible."""
    steady = like(monitor.fit[0], 1.0 if model.n_kind > 1 else 0.0)
    for row in range(1, n_row, model.n_kind):
        beyond = (monitor.weight[row] > 0.0) & (monitor.square[row] > tests.single)
        steady = where(beyond, 0.0, steady)
    return steady


@jit
def _restore_withheld(monitor, n_row):
    """Restore the weights of the rows that `_withhold` withheld from fits."""
    for row in range(n_row):
        weight = monitor.weight[row]
        monitor.weight[row] = where(weight < 0.0, -weight, weight)


@jit
def find_common(monitor, work, case, suspected, excluded, n_row):
    """Isolate a fault that is common to all satellites and recover from it, in the runs where `suspected` is 1.

    The fault is common if the prediction disagrees with all satellites except the one with the largest innovation. With
    four or fewer satellites in use it is common if more than one of them disagrees, excluded satellites included.

    Four satellites fit exactly. Their ranges are attributed to a clock jump if the range rates show no velocity error
    and the shift of position, with the clock free, is not significant.

    Parameters
    ----------
    monitor : Monitor, with innovations and weights of the epoch
    work, case : arrays of the run, FilterCase
    suspected : 1 in the runs where a fault was detected and not yet isolated
    excluded : number of excluded satellites
    n_row : number of rows

    Returns
    -------
    isolated : OF_INERTIAL or OF_CLOCK; 0 if the fault is not common
    speed : (m/s)^2. Square of the shift of velocity
    """
    tests, model = case.options.integrity, case.model
    P, z = work.P, monitor.z
    zero = like(monitor.fit[0], 0.0)
    factor = tests.recovery * tests.recovery
    beyond, few = _withhold(monitor, tests, model, n_row)
    several = where(few * (beyond + excluded) > 1.0, suspected, 0.0)
    steady = _is_steady(monitor, tests, model, n_row)
    isolated = zero
    speed = zero
    jumped = zero  # 1 where four or fewer ranges are attributed to a clock jump
    for kind in range(2):
        first, state = (H_POS, POS) if kind == 0 else (H_VEL, VEL)
        clock_state = model.clock + kind
        _, dof = fit(monitor, work.H, z, first, kind, model.n_kind, n_row)
        joint = _joint_square(monitor, P, state, clock_state)
        shift, drift, size, offset = compare(monitor, tests, P, state, clock_state)
        common_to_few = where(jumped > 0.0, 0.0, several)
        common_to_many = where(joint > tests.joint, suspected, 0.0)
        common = where(few > 0.0, common_to_few, common_to_many)
        no_motion_shift = (dof >= 0.0) & (shift <= 1.0)
        few_fit_clock = steady * where(no_motion_shift, 1.0, 0.0)
        is_clock = where(few > 0.0, few_fit_clock, drift - shift) > 0.0
        # within the hold time of an inertial decision the fault counts as inertial again
        clock_fault = where(is_clock & (monitor.waited[0] <= 0.0), common, 0.0)
        motion_fault = common - clock_fault
        # four or fewer satellites cannot separate motion and clock: the largest innovation bounds the shift of either
        largest = _largest(monitor, z, kind, model, n_row)
        size = where(few > 0.0, largest, size)
        offset = where(few > 0.0, largest, offset)
        jumped = where(few > 0.0, clock_fault, jumped)
        inflate(P, state, 3, motion_fault, factor * size)
        inflate(P, clock_state, 1, clock_fault, factor * offset)
        isolated = where((clock_fault > 0.0) & (isolated == 0.0), OF_CLOCK, isolated)
        isolated = where(motion_fault > 0.0, OF_INERTIAL, isolated)
        if kind == 1:
            speed = where(motion_fault > 0.0, size, speed)
    _restore_withheld(monitor, n_row)
    return isolated, speed


@jit
def persists(monitor):
    """Return 1 while an IMU error counts as persistent."""
    is_recent = monitor.waited[0] > 0.0
    is_repeated = monitor.waited[1] >= N_PERSISTENT
    return where(is_recent & is_repeated, 1.0, 0.0)


@jit
def learn(monitor, tests, P, model, inertial, speed):
    """Count successive inertial decisions, and inflate the accelerometer biases if the IMU error persists.

    From the third decision on, each within the hold time of the previous one, the variance of an accelerometer bias
    grows by the square of the velocity shift divided by the interval of the epochs.

    Parameters
    ----------
    monitor, tests, model : Monitor, FaultTests, FilterModel
    P : (n, n) covariance, updated in place
    inertial : 1 in the runs with an inertial decision at this epoch
    speed : (m/s)^2. Square of the velocity shift
    """
    remaining = monitor.waited[0]
    earlier_count = where(remaining > 0.0, monitor.waited[1], 0.0)
    count = earlier_count + inertial
    remaining_after = where(remaining > 0.0, remaining - 1.0, 0.0)
    monitor.waited[0] = where(inertial > 0.0, tests.hold, remaining_after)
    monitor.waited[1] = count
    persistent = where((inertial > 0.0) & (count >= N_PERSISTENT), 1.0, 0.0)
    scale = tests.recovery / tests.interval
    variance = scale * scale * speed
    for b in range(model.par_offset.shape[0]):
        first = model.par_offset[b]
        is_bias = model.par_sensor[b] == ACCEL and model.par_driver[b] == CONSTANT
        if is_bias and first < model.n_estimated:
            inflate(P, first, 3, persistent, variance)
