"""Transition matrix of the error state over a window, as a list of 3 x 3 blocks.

Errors are truth minus estimate; the attitude error is the small rotation from estimate to truth, in frame i. With C =
C_b_i, f_i the specific force, G the gravity gradient, and p an error parameter of the IMU with driver u (1, angular
rate, specific force or its square, per axis):

    d(att)/dt = -C diag(u) p_gyro,  d(vel)/dt = -[f_i x] att + G pos - C diag(u) p_accel,  d(pos)/dt = vel

Phi is a product: each block in turn adds itself times three states to three others. Position is propagated with
velocity over half of the window. Velocity and then attitude are propagated over the whole window, with the integrals of
C and f_i from the strapdown, so thrust may vary within it. Position is propagated over the other half. The error is of
third order in the window length (Strang, SIAM J. Numer. Anal. 5, 1968), with half of the blocks that Phi written as a
sum would need.
"""

from lvnav_trade.kernels.attitude import cross, from_rotation, matrix, multiply, normalise, rotate
from lvnav_trade.kernels.earth import gravity_gradient
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.strapdown import N_SUM, SUM_C, SUM_F, SUM_TH, SUM_V, Q, R, V

ATT, VEL, POS = 0, 3, 6

# Kinds of blocks: the states that it changes, and the states or parameters that they depend on.
(POS_VEL, POS_VEL_HALF, VEL_VEL, VEL_ATT, VEL_POS, ATT_GYRO, VEL_GYRO, VEL_ACCEL) = range(8)

GYRO, ACCEL = 0, 1

# Drivers: the quantity that an error parameter multiplies, per axis of its sensor.
CONSTANT, OWN_0, OWN_1, OWN_2, OTHER_0, OTHER_1, OTHER_2, SQUARE = range(8)


@jit
def driver(driver_code, own_x, own_y, own_z, other_x, other_y, other_z):
    """Return the quantity that an error parameter multiplies, for each axis of its sensor.

    Parameters
    ----------
    driver_code : CONSTANT: 1 (bias). OWN_k: input of the sensor itself, rolled by k axes (scale factor, two
        misalignments). OTHER_k: input of the other sensor on its axis k, on all axes (g-sensitivity). SQUARE: square of
        the input
    own_x, own_y, own_z : mean input of the sensor: rad/s of a gyro, m/s^2 of an accelerometer
    other_x, other_y, other_z : mean input of the other sensor
    """
    if driver_code == CONSTANT:
        unity = 0.0 * own_x + 1.0  # one number, or eight lanes
        return unity, unity, unity
    if OWN_0 <= driver_code and driver_code <= OWN_2:
        inputs = (own_x, own_y, own_z)
        first = driver_code - OWN_0
        second = (first + 1) % 3
        third = (first + 2) % 3
        return inputs[first], inputs[second], inputs[third]
    if OTHER_0 <= driver_code and driver_code <= OTHER_2:
        inputs = (other_x, other_y, other_z)
        other_input = inputs[driver_code - OTHER_0]
        return other_input, other_input, other_input
    square_x = own_x * own_x
    square_y = own_y * own_y
    square_z = own_z * own_z
    return square_x, square_y, square_z


@jit
def sensed_driver(sensor, driver_code, rate, force):
    """Return the driver (3) of a parameter of gyro or accelerometer, per axis.

    Parameters
    ----------
    sensor : GYRO or ACCEL
    driver_code : code of the driver, see `driver`
    rate : (3,) rad/s, angular rate, body axes
    force : (3,) m/s^2, specific force, body axes
    """
    wx = rate[0]
    wy = rate[1]
    wz = rate[2]
    fx = force[0]
    fy = force[1]
    fz = force[2]
    if sensor == GYRO:
        return driver(driver_code, wx, wy, wz, fx, fy, fz)
    return driver(driver_code, fx, fy, fz, wx, wy, wz)


@inline_jit
def _skew(block, x, y, z):
    """Set a block to the cross-product matrix [x, y, z] x."""
    block[0] = 0.0 * x
    block[1] = -z
    block[2] = y
    block[3] = z
    block[4] = 0.0 * x
    block[5] = -x
    block[6] = -y
    block[7] = x
    block[8] = 0.0 * x


@inline_jit
def _gradient(block, factor, x, y, z):
    """Set a block to a factor times the gravity gradient.

    Parameters
    ----------
    block : (9,) by rows, set here
    factor : multiplies the gradient
    x, y, z : m, position, frame i
    """
    xx, xy, xz, yy, yz, zz = gravity_gradient(x, y, z)
    block[0] = factor * xx
    block[1] = factor * xy
    block[2] = factor * xz
    block[3] = factor * xy
    block[4] = factor * yy
    block[5] = factor * yz
    block[6] = factor * xz
    block[7] = factor * yz
    block[8] = factor * zz


@inline_jit
def _column(block, factor, sums, ux, uy, uz):
    """Set a block to factor * (integral of C) diag(u).

    Parameters
    ----------
    block : (9,) by rows, set here
    factor : number without unit
    sums : (18,) integrals of the strapdown over the window
    ux, uy, uz : driver of the parameter, body axes
    """
    for i in range(0, 9, 3):
        block[i] = factor * sums[SUM_C + i] * ux
        block[i + 1] = factor * sums[SUM_C + i + 1] * uy
        block[i + 2] = factor * sums[SUM_C + i + 2] * uz


@inline_jit
def _cross_column(block, factor, sums, ux, uy, uz):
    """Set a block to factor * [velocity gained x] (integral of C) diag(u); arguments as in `_column`."""
    vx = sums[SUM_V]
    vy = sums[SUM_V + 1]
    vz = sums[SUM_V + 2]
    for column in range(3):
        u = (ux, uy, uz)[column]
        cx = sums[SUM_C + column]
        cy = sums[SUM_C + 3 + column]
        cz = sums[SUM_C + 6 + column]
        x, y, z = cross(vx, vy, vz, cx, cy, cz)
        block[column] = factor * u * x
        block[3 + column] = factor * u * y
        block[6 + column] = factor * u * z


@inline_jit
def parameter_block(block, block_kind, driver_code, sums, seconds):
    """Set the block of an IMU parameter, of a type from ATT_GYRO to VEL_ACCEL.

    Attitude: -(integral of C) diag(u). Velocity by an accelerometer parameter: the same. Velocity by a gyro parameter:
    the attitude error grows linearly over the window, so half of [velocity gained x] (integral of C) diag(u).

    Parameters
    ----------
    block : (9,) by rows, set here
    block_kind : ATT_GYRO, VEL_GYRO or VEL_ACCEL
    driver_code : code of the parameter's driver
    sums : (18,) integrals of the strapdown over the window
    seconds : s, length of the window
    """
    # mean angular rate and specific force of the window
    wx = sums[SUM_TH] / seconds
    wy = sums[SUM_TH + 1] / seconds
    wz = sums[SUM_TH + 2] / seconds
    fx = sums[SUM_F] / seconds
    fy = sums[SUM_F + 1] / seconds
    fz = sums[SUM_F + 2] / seconds
    if block_kind == VEL_ACCEL:
        ux, uy, uz = driver(driver_code, fx, fy, fz, wx, wy, wz)
        _column(block, -1.0, sums, ux, uy, uz)
    else:
        ux, uy, uz = driver(driver_code, wx, wy, wz, fx, fy, fz)
        if block_kind == ATT_GYRO:
            _column(block, -1.0, sums, ux, uy, uz)
        else:
            _cross_column(block, 0.5, sums, ux, uy, uz)


@inline_jit
def fill(blocks, block_kinds, drivers, sums, x, y, z, seconds):
    """Set all blocks of Phi for a window.

    Parameters
    ----------
    blocks : (n_block, 9) by rows, set here
    block_kinds, drivers : (n_block,) int, kind of each block, and code of its parameter's driver
    sums : (18,) integrals of the strapdown over the window
    x, y, z : m, position, frame i
    seconds : s, length of the window
    """
    for b in range(block_kinds.shape[0]):
        block_kind = block_kinds[b]
        block = blocks[b]
        if block_kind == VEL_ATT:
            _skew(block, -sums[SUM_V], -sums[SUM_V + 1], -sums[SUM_V + 2])
        elif block_kind == VEL_POS:
            _gradient(block, seconds, x, y, z)
        elif block_kind == VEL_VEL:
            _gradient(block, -seconds * seconds, x, y, z)
        elif block_kind in (POS_VEL, POS_VEL_HALF):
            share = 1.0 if block_kind == POS_VEL else 0.5
            zero = 0.0 * x  # one number, or eight lanes
            for i in range(9):
                block[i] = zero
            for i in range(0, 9, 4):  # the diagonal
                block[i] = share * seconds + zero
        else:
            parameter_block(block, block_kind, drivers[b], sums, seconds)


# Rates at which the transition of a window is linearised. EVERY_WINDOW: the means of the window itself, nothing is
# stored. KEPT: the stored rates. RENEWED: the estimates at the start of the window. FIRST: the means of the window,
# since no estimate exists yet.
EVERY_WINDOW, KEPT, RENEWED, FIRST = range(4)


@jit
def linearise(rates, nav, code):
    """Set the rates at which the transition is linearised, if `code` is RENEWED.

    They are the attitude at the start of the window, and the mean specific force and angular rate of the window before.

    Parameters
    ----------
    rates : (2, 18) rates of the linearisation, and means of the last window; the first is updated in place
    nav : (10,) navigation state, frame i
    code : EVERY_WINDOW, KEPT, RENEWED or FIRST
    """
    if code == RENEWED:
        c = matrix(nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
        current_rates = rates[0]
        last_means = rates[1]
        for i in range(9):
            current_rates[SUM_C + i] = c[i]
        for i in range(3):
            current_rates[SUM_TH + i] = last_means[SUM_TH + i]
            current_rates[SUM_F + i] = last_means[SUM_F + i]
        # acceleration in frame i: C f
        ax, ay, az = rotate(c, current_rates[SUM_F], current_rates[SUM_F + 1], current_rates[SUM_F + 2])
        current_rates[SUM_V] = ax
        current_rates[SUM_V + 1] = ay
        current_rates[SUM_V + 2] = az


@jit
def linearised_sums(rates, sums, seconds, code):
    """Replace the integrals of a window by those at the rates of `linearise`; store its means for the next window.

    Parameters
    ----------
    rates : (2, 18) rates of the linearisation, and means of the last window; updated in place
    sums : (18,) integrals of the strapdown over the window, updated in place
    seconds : s, length of the window
    code : EVERY_WINDOW (nothing is changed), KEPT, RENEWED or FIRST
    """
    if code != EVERY_WINDOW:
        for i in range(N_SUM):
            rates[1, i] = sums[i] / seconds
            if code == FIRST:
                rates[0, i] = rates[1, i]
            sums[i] = rates[0, i] * seconds


@jit
def correct_motion(nav, x):
    """Add the error state, truth minus estimate, to the navigation state.

    Parameters
    ----------
    nav : (10,) quaternion body to i, velocity (m/s), position (m), frame i; updated in place
    x : (n,) attitude (rad), velocity and position errors first, frame i
    """
    # attitude errors are in frame i, so the correction multiplies from the left
    e0, e1, e2, e3 = from_rotation(x[ATT], x[ATT + 1], x[ATT + 2])
    q0, q1, q2, q3 = multiply(e0, e1, e2, e3, nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    q0, q1, q2, q3 = normalise(q0, q1, q2, q3)
    nav[Q] = q0
    nav[Q + 1] = q1
    nav[Q + 2] = q2
    nav[Q + 3] = q3
    for i in range(3):
        nav[V + i] += x[VEL + i]
        nav[R + i] += x[POS + i]
