"""Filter with angular rate and specific force as states: IMU samples as measurements, covariance over a tick.

Errors are truth minus estimate. With C = C_b_i, the errors x_w of the mean rate and x_f of the mean specific force of a
tick of dt seconds change attitude, velocity and position errors as

    att+ = att + C dt x_w,   vel+ = vel - [C f dt x] att + C dt x_f,   pos+ = pos + dt (vel + vel+) / 2.

The samples of gyro and accelerometer are measurements: sample - estimate = x_w + x_bg + noise, x_f + x_ba + noise. The
noise of a sample enters nowhere else. Functions here read and write the upper triangle of a covariance only; `mirror`
restores the lower triangle. States are attitude at 0, velocity at 3, position at 6, parameters, and at the end angular
rate at `motion` and specific force at `motion` + 3.
"""

from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import number_like
from lvnav_trade.kernels.strapdown import SUM_V
from lvnav_trade.kernels.transition import sensed_driver
from lvnav_trade.kernels.vehicle_tick import add_changes, velocity_error

N_SAMPLE = 6
"""Scalar measurements of a tick: three of the gyro, three of the accelerometer."""


@jit
def fill_samples(h, blocks, rate, force):
    """Set the Jacobian rows of the samples: 1 for the motion state, then the driver of each parameter block.

    Parameters
    ----------
    h : (6, 1 + n_block) set here
    blocks : (2, n_block, 2) int, number and driver of each parameter block of gyro and accelerometer; number -1 none
    rate, force : (3,) rad/s and m/s^2, body axes
    """
    for r in range(N_SAMPLE):
        h[r, 0] = number_like(rate[0], 1.0)
    for sensor in range(2):
        for k in range(blocks.shape[1]):
            block_number = blocks[sensor, k, 0]
            block_driver = blocks[sensor, k, 1]
            u = sensed_driver(sensor, block_driver, rate, force)
            for axis in range(3):
                row = 3 * sensor + axis
                h[row, 1 + k] = u[axis] if block_number >= 0 else number_like(rate[0], 0.0)


@inline_jit
def _upper(P, i, j):
    """Return the entry (i, j) of a symmetric matrix stored as its upper triangle."""
    row = min(i, j)
    column = max(i, j)
    return P[row, column]


@jit
def update_samples(P, x, K, weight, residual, z, variance, h, columns, n_estimated):
    """Update error state and covariance by the six scalar measurements of a tick.

    Gains are computed in sequence, as for six scalar updates, but the covariance is updated in one pass. States from
    `n_estimated` on are considered: their gain is zero, but their correlations are updated.

    Parameters
    ----------
    P, x : (n, n) upper triangle and (n,) error state, both updated in place
    K : (6, n) set to P h' of each measurement after the earlier updates
    weight : (6,) set to 1 / innovation variance
    residual : (6,) set to the innovation after the previous measurements
    z : (6,) sample minus predicted sample
    variance : (6,) noise variance of the samples
    h, columns : (6, n_entry) Jacobian entries and their states
    n_estimated : number of estimated states
    """
    n = P.shape[0]
    n_entry = columns.shape[1]
    for r in range(N_SAMPLE):
        # the motion state and, if there is one, a bias in one pass
        second = min(1, n_entry - 1)
        motion_state = columns[r, 0]
        bias_state = columns[r, second]
        bias_entry = h[r, second] * float(second)
        for i in range(n):
            motion_covariance = _upper(P, i, motion_state)
            bias_covariance = _upper(P, i, bias_state)
            K[r, i] = motion_covariance + bias_entry * bias_covariance
        for k in range(2, n_entry):
            state = columns[r, k]
            entry = h[r, k]
            for i in range(n):
                K[r, i] += entry * _upper(P, i, state)
        # K_r = P h_r' of the covariance after the updates before it: P h_r' - sum over q of K_q weight_q (K_q' h_r').
        # The gain of considered states is zero, so estimated states get the whole of K_q' h_r', and considered states
        # only its part over estimated states.
        for q in range(r):
            estimated_projection, total_projection = _projections(K, h, columns, r, q, n_estimated)
            estimated_factor = total_projection * weight[q]
            for i in range(n_estimated):
                K[r, i] -= estimated_factor * K[q, i]
            considered_factor = estimated_projection * weight[q]
            for i in range(n_estimated, n):
                K[r, i] -= considered_factor * K[q, i]
        innovation_variance = number_like(x[0], variance[r])
        innovation = z[r]
        for k in range(n_entry):
            state = columns[r, k]
            entry = h[r, k]
            innovation_variance += entry * K[r, state]
            innovation -= entry * x[state]
        weight[r] = 1.0 / innovation_variance
        residual[r] = innovation
        step = innovation * weight[r]
        for i in range(n_estimated):
            x[i] += K[r, i] * step
    _subtract_updates(P, K, weight, n_estimated, n)


@inline_jit
def _subtract_updates(P, K, weight, n_estimated, n):
    """P <- P - sum over r of K_r weight_r K_r', in one pass.

    Parameters
    ----------
    P : (n, n) upper triangle, updated in place
    K : (6, n) P h' of each measurement after the earlier updates
    weight : (6,) 1 / innovation variance
    n_estimated, n : number of estimated states and of states
    """
    for i in range(n_estimated):
        g0 = K[0, i] * weight[0]
        g1 = K[1, i] * weight[1]
        g2 = K[2, i] * weight[2]
        g3 = K[3, i] * weight[3]
        g4 = K[4, i] * weight[4]
        g5 = K[5, i] * weight[5]
        for j in range(i, n):
            reduction = g0 * K[0, j] + g1 * K[1, j] + g2 * K[2, j]
            reduction = reduction + g3 * K[3, j] + g4 * K[4, j] + g5 * K[5, j]
            P[i, j] -= reduction


@inline_jit
def _projections(K, h, columns, r, q, n_estimated):
    """Return the projection h_r K_q over the estimated states, and over all states.

    Parameters
    ----------
    K : (6, n) P h' of each measurement
    h, columns : (6, n_entry) Jacobian entries and their states
    r, q : numbers of the later and of the earlier measurement
    n_estimated : number of estimated states
    """
    estimated_projection = number_like(K[q, 0], 0.0)
    considered_projection = number_like(K[q, 0], 0.0)
    for k in range(columns.shape[1]):
        state = columns[r, k]
        if state < n_estimated:
            estimated_projection += h[r, k] * K[q, state]
        elif n_estimated < K.shape[1]:
            considered_projection += h[r, k] * K[q, state]
    total = estimated_projection + considered_projection
    return estimated_projection, total


@jit
def advance(P, changes, sums, dt, motion):
    """Propagate the covariance over a tick, without process noise: P <- Phi P Phi'.

    Parameters
    ----------
    P : (n, n) upper triangle, updated in place
    changes : (9, n) scratch
    sums : (18,) integrals of the strapdown over the tick: C_b_i (9), velocity gained (3)
    dt : s, of the tick
    motion : first motion state
    """
    n = P.shape[0]
    w = motion
    f = motion + 3
    half = 0.5 * dt
    # first nine rows of M = (Phi - I) P, column by column; the other rows are zero
    for j in range(n):
        a0 = P[0, j]
        a1 = _upper(P, 1, j)
        a2 = _upper(P, 2, j)
        w0 = _upper(P, w, j)
        w1 = _upper(P, w + 1, j)
        w2 = _upper(P, w + 2, j)
        f0 = _upper(P, f, j)
        f1 = _upper(P, f + 1, j)
        f2 = _upper(P, f + 2, j)
        velocity_change = velocity_error(sums, a0, a1, a2, f0, f1, f2)
        for i in range(3):
            velocity = _upper(P, 3 + i, j)
            changes[i, j] = sums[3 * i] * w0 + sums[3 * i + 1] * w1 + sums[3 * i + 2] * w2
            changes[3 + i, j] = velocity_change[i]
            changes[6 + i, j] = dt * velocity + half * velocity_change[i]
    add_changes(P, changes, sums, dt, motion, n)


@jit
def advance_vector(y, sums, dt, motion):
    """Replace a vector of the error state by Phi y of a tick.

    Parameters
    ----------
    y : (n,) error state, updated in place
    sums : (18,) integrals of the strapdown over the tick
    dt : s, of the tick
    motion : first motion state
    """
    w = motion
    f = motion + 3
    half = 0.5 * dt
    w0 = y[w]
    w1 = y[w + 1]
    w2 = y[w + 2]
    velocity_change = velocity_error(sums, y[0], y[1], y[2], y[f], y[f + 1], y[f + 2])
    for i in range(3):
        position_change = dt * y[3 + i]
        y[i] = y[i] + sums[3 * i] * w0 + sums[3 * i + 1] * w1 + sums[3 * i + 2] * w2
        y[6 + i] = y[6 + i] + position_change + half * velocity_change[i]
        y[3 + i] += velocity_change[i]


@jit
def mirror(P):
    """Copy the upper triangle of P (n, n) to the lower triangle."""
    n = P.shape[0]
    for i in range(n):
        for j in range(i + 1, n):
            P[j, i] = P[i, j]


@jit
def joint_gain(G, K, weight, h, columns, n_estimated):
    """Set the joint gain of the six measurements of a tick, from the sequential gains of `update_samples`.

    Each sequential gain g_r reduces the gains before it: G_q <- (I - g_r h_r) G_q for q < r.

    Parameters
    ----------
    G : (6, n) joint gain, transposed, set here
    K : (6, n) P h' of each measurement after the earlier updates
    weight : (6,) 1 / innovation variance
    h, columns : (6, n_entry) Jacobian entries and their states
    n_estimated : number of estimated states; the gain of the others is zero
    """
    n = K.shape[1]
    for r in range(N_SAMPLE):
        for i in range(n):
            G[r, i] = K[r, i] * weight[r] if i < n_estimated else 0.0
        for q in range(r):
            projection = 0.0  # h_r G_q
            for k in range(columns.shape[1]):
                state = columns[r, k]
                projection += h[r, k] * G[q, state]
            for i in range(n_estimated):
                G[q, i] -= G[r, i] * projection


@jit
def update_together(P, Y, S, G, h, columns, noise):
    """P <- (I - G H) P (I - G H)' + G R G' for any joint gain of the six measurements of a tick.

    With S = H P H' + R and Y = P H' - G S / 2, this is P - G Y' - Y G'.

    Parameters
    ----------
    P : (N, N) upper triangle, updated in place
    Y, S : (6, N) and (6, 6) scratch; S is set to H P H' + R before the update
    G : (6, N) joint gain, transposed
    h, columns : (6, n_entry) Jacobian entries and their states
    noise : (6,) diagonal of R
    """
    n = P.shape[0]
    n_entry = columns.shape[1]
    for r in range(N_SAMPLE):  # Y = P H'
        for i in range(n):
            state_covariance = h[r, 0] * _upper(P, i, columns[r, 0])
            for k in range(1, n_entry):
                state = columns[r, k]
                state_covariance += h[r, k] * _upper(P, i, state)
            Y[r, i] = state_covariance
    for r in range(N_SAMPLE):  # S = H Y + R
        for q in range(N_SAMPLE):
            innovation_covariance = h[r, 0] * Y[q, columns[r, 0]]
            for k in range(1, n_entry):
                state = columns[r, k]
                innovation_covariance += h[r, k] * Y[q, state]
            S[r, q] = innovation_covariance
        S[r, r] += noise[r]
    for r in range(N_SAMPLE):  # Y <- Y - G S / 2
        for i in range(n):
            value = Y[r, i]
            for q in range(N_SAMPLE):
                value -= 0.5 * G[q, i] * S[q, r]
            Y[r, i] = value
    _subtract_products(P, Y, G, n)


@inline_jit
def _subtract_products(P, Y, G, n):
    """P <- P - G Y' - Y G', in one pass; parameters as in `update_together`, with n states."""
    for i in range(n):
        g0 = G[0, i]
        g1 = G[1, i]
        g2 = G[2, i]
        g3 = G[3, i]
        g4 = G[4, i]
        g5 = G[5, i]
        y0 = Y[0, i]
        y1 = Y[1, i]
        y2 = Y[2, i]
        y3 = Y[3, i]
        y4 = Y[4, i]
        y5 = Y[5, i]
        for j in range(i, n):
            reduction = g0 * Y[0, j] + g1 * Y[1, j] + g2 * Y[2, j]
            reduction = reduction + g3 * Y[3, j] + g4 * Y[4, j] + g5 * Y[5, j]
            reduction = reduction + y0 * G[0, j] + y1 * G[1, j] + y2 * G[2, j]
            reduction = reduction + y3 * G[3, j] + y4 * G[4, j] + y5 * G[5, j]
            P[i, j] -= reduction


@jit
def update_vector_together(y, projections, gain, h, columns):
    """Apply the joint update of the six measurements of a tick to one vector, or to lanes: y <- (I - G H) y.

    Parameters
    ----------
    y : (n,) error state, updated in place
    projections : (6,) set to H y before the update
    gain : (6, n) joint gain, transposed
    h, columns : (6, n_entry) Jacobian entries and their states
    """
    for r in range(N_SAMPLE):
        projection = number_like(y[0], 0.0)
        for k in range(columns.shape[1]):
            state = columns[r, k]
            projection += h[r, k] * y[state]
        projections[r] = projection
    for i in range(y.shape[0]):
        value = y[i]
        for r in range(N_SAMPLE):
            value -= gain[r, i] * projections[r]
        y[i] = value


@jit
def advance_vector_transposed(y, sums, dt, motion):
    """Replace the vector y by Phi' y of a tick, as an adjoint is propagated backwards.

    Parameters
    ----------
    y : (n,) adjoint of the error state, updated in place
    sums : (18,) integrals of the strapdown over the tick
    dt : s, of the tick
    motion : first motion state
    """
    w = motion
    f = motion + 3
    half = 0.5 * dt
    vx = sums[SUM_V]
    vy = sums[SUM_V + 1]
    vz = sums[SUM_V + 2]
    # a velocity gain enters velocity, and with half of the tick position
    p0 = y[3] + half * y[6]
    p1 = y[4] + half * y[7]
    p2 = y[5] + half * y[8]
    a0 = y[0]
    a1 = y[1]
    a2 = y[2]
    for k in range(3):
        # column k of the integral of C
        c0 = sums[k]
        c1 = sums[3 + k]
        c2 = sums[6 + k]
        y[w + k] = y[w + k] + c0 * a0 + c1 * a1 + c2 * a2
        y[f + k] = y[f + k] + c0 * p0 + c1 * p1 + c2 * p2
        y[3 + k] += dt * y[6 + k]
    # the transpose of p = (vz a1 - vy a2, vx a2 - vz a0, vy a0 - vx a1)
    y[0] = a0 - vz * p1 + vy * p2
    y[1] = a1 + vz * p0 - vx * p2
    y[2] = a2 - vy * p0 + vx * p1
