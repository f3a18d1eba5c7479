"""What satellites have in common: shifts of motion and clock, whose failure it is, and recovery from it.

A fault of the inertial unit, or of the clock, moves all innovations. Just after it begins, that of one satellite may
be beyond its limit while the shift is not yet beyond its own, for the fit has to tell a vertical shift from one of the
clock. What is then asked is whether the prediction would agree with the other satellites. If not, the failure is common
to all, and none is excluded: a unit whose error persists would otherwise have them excluded one after the other.
"""

from lvnav_trade.filters.integrity.fit import fit, invert
from lvnav_trade.filters.integrity.state import N_FIT
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, where
from lvnav_trade.kernels.transition import ACCEL, CONSTANT, POS, VEL
from lvnav_trade.observables.base import H_POS, H_VEL
from lvnav_trade.records import OF_CLOCK, OF_INERTIAL

N_PERSISTENT = 3.0
"""Number of successive inertial decisions, each within the hold time of the one before, from which on an error of the
unit is taken for persistent."""


@jit
def _shift_square(own, P, at):
    """Return the square of the fitted shift of three states over its covariance, prediction and fit together."""
    for i in range(N_FIT):
        for j in range(N_FIT):
            own.A[i, j] = like(own.fit[0], 1.0 if i == j else 0.0)
    # the fourth row and column stay those of the identity: the inverse of the first three is that of their block
    for i in range(3):
        for j in range(3):
            own.A[i, j] = P[at + i, at + j] + own.inverse[i, j]
    invert(own.inverse, own.A)
    total = like(own.fit[0], 0.0)
    for i in range(3):
        for j in range(3):
            total = total + own.fit[i] * own.inverse[i, j] * own.fit[j]
    return total


@jit
def compare(own, tests, P, at, clock):
    """Return the squares of the fitted shift of three states, and of that of the clock's state, over their limits, and
    their sizes squared.
    """
    offset = own.fit[3] * own.fit[3]
    of_clock = offset / (tests.offset * (P[clock, clock] + own.inverse[3, 3]))
    size = own.fit[0] * own.fit[0] + own.fit[1] * own.fit[1] + own.fit[2] * own.fit[2]
    return _shift_square(own, P, at) / tests.shift, of_clock, size, offset


@jit
def _joint_square(own, P, at, clock):
    """Return the square of the fitted shift of three states and the clock's over their covariance, prediction and fit
    together.
    """
    for i in range(N_FIT):
        for j in range(N_FIT):
            own.A[i, j] = P[at + i if i < 3 else clock, at + j if j < 3 else clock] + own.inverse[i, j]
    invert(own.spare, own.A)
    total = like(own.fit[0], 0.0)
    for i in range(N_FIT):
        for j in range(N_FIT):
            total = total + own.fit[i] * own.spare[i, j] * own.fit[j]
    return total


@jit
def inflate(P, at, count, wanted, variance):
    """Add a variance to some states in the runs that want it (1)."""
    for i in range(count):
        P[at + i, at + i] = P[at + i, at + i] + where(wanted > 0.0, variance, 0.0)


@jit
def _withhold(own, tests, model, n_row):
    """Leave the satellite with the largest innovation out of fits, unless four or fewer are in use: its weights change
    sign. Return how many satellites are beyond their limits, and 1 where four or fewer are in use.
    """
    worst, beyond, used = like(own.fit[0], 0.0), like(own.fit[0], 0.0), like(own.fit[0], 0.0)
    for row in range(n_row):
        worst = where((own.weight[row] > 0.0) & (own.square[row] > worst), own.square[row], worst)
    for row in range(0, n_row, model.n_kind):
        used = where(own.weight[row] > 0.0, used + 1.0, used)
    few = where(used > N_FIT, 0.0, 1.0)
    for base in range(0, n_row, model.n_kind):
        this, fails = like(worst, 0.0), like(worst, 0.0)
        for row in range(base, base + model.n_kind):
            this = where((own.weight[row] > 0.0) & (own.square[row] == worst), 1.0, this)
            fails = where((own.weight[row] > 0.0) & (own.square[row] > tests.single), 1.0, fails)
        beyond = beyond + fails
        for row in range(base, base + model.n_kind):
            own.weight[row] = where(this > few, -own.weight[row], own.weight[row])
    return beyond, few


@jit
def _largest(own, z, kind, model, n_row):
    """Return the square of the largest innovation of a kind that is in use, or withheld."""
    largest = like(own.fit[0], 0.0)
    for row in range(kind, n_row, model.n_kind):
        square = where(own.weight[row] == 0.0, 0.0, z[row] * z[row])
        largest = where(square > largest, square, largest)
    return largest


@jit
def _is_steady(own, tests, model, n_row):
    """Return 1 where range rates are measured and none of them is beyond its limit: no motion is seen."""
    steady = like(own.fit[0], 1.0 if model.n_kind > 1 else 0.0)
    for row in range(1, n_row, model.n_kind):
        steady = where((own.weight[row] > 0.0) & (own.square[row] > tests.single), 0.0, steady)
    return steady


@jit
def find_common(own, work, case, wanted, excluded, n_row):
    """Isolate and recover, in the runs that want it (1), what makes the prediction disagree with the other satellites
    than the one with the largest innovation; of four or fewer, with more than one, the excluded ones among them. Return
    OF_INERTIAL or OF_CLOCK, 0 where nothing is common, and the square of the shift of velocity.

    Four fit exactly. Their ranges have jumped with the clock where range rates see no motion and nothing is left beyond
    chance once the offset of the clock is free: what is left then is the square of the shift of position alone.
    """
    tests, P, model, z = case.options.integrity, work.P, case.model, own.z
    zero, factor = like(own.fit[0], 0.0), tests.recovery * tests.recovery
    beyond, few = _withhold(own, tests, model, n_row)
    several, steady = where(few * (beyond + excluded) > 1.0, wanted, 0.0), _is_steady(own, tests, model, n_row)
    found, speed, jumped = zero, zero, zero
    for kind in range(2):
        first, at = (H_POS, POS) if kind == 0 else (H_VEL, VEL)
        _, dof = fit(own, work.H, z, first, kind, model.n_kind, n_row)
        joint = _joint_square(own, P, at, model.clock + kind)
        shift, drift, size, offset = compare(own, tests, P, at, model.clock + kind)
        together = where(few > 0.0, where(jumped > 0.0, 0.0, several), where(joint > tests.joint, wanted, 0.0))
        # what is not clear is taken for what it has been within the hold time
        larger = where(few > 0.0, steady * where((dof >= 0.0) & (shift <= 1.0), 1.0, 0.0), drift - shift) > 0.0
        of_clock = where(larger & (own.waited[0] <= 0.0), together, 0.0)
        largest = _largest(own, z, kind, model, n_row)
        motion, size = together - of_clock, where(few > 0.0, largest, size)
        jumped = where(few > 0.0, of_clock, jumped)
        inflate(P, at, 3, motion, factor * size)
        inflate(P, model.clock + kind, 1, of_clock, factor * where(few > 0.0, largest, offset))
        found = where(motion > 0.0, OF_INERTIAL, where((of_clock > 0.0) & (found == 0.0), OF_CLOCK, found))
        speed = where(motion > 0.0, size, speed) if kind == 1 else speed
    for row in range(n_row):
        own.weight[row] = where(own.weight[row] < 0.0, -own.weight[row], own.weight[row])
    return found, speed


@jit
def persists(own):
    """Return 1 while an error of the unit is taken for persistent."""
    return where((own.waited[0] > 0.0) & (own.waited[1] >= N_PERSISTENT), 1.0, 0.0)


@jit
def learn(own, tests, P, model, inertial, speed):
    """Count successive inertial decisions, each within the hold time of the one before. From the third on the error of
    the unit persists: the variances of the accelerometer biases grow by the shift of velocity over an interval.
    """
    left, count = own.waited[0], own.waited[1]
    count = where(left > 0.0, count, 0.0) + inertial
    own.waited[0] = where(inertial > 0.0, tests.hold, where(left > 0.0, left - 1.0, 0.0))
    own.waited[1] = count
    wanted = where((inertial > 0.0) & (count >= N_PERSISTENT), 1.0, 0.0)
    size = tests.recovery / tests.interval
    for b in range(model.par_offset.shape[0]):
        if model.par_sensor[b] == ACCEL and model.par_driver[b] == CONSTANT and model.par_offset[b] < model.n_estimated:
            inflate(P, model.par_offset[b], 3, wanted, size * size * speed)
