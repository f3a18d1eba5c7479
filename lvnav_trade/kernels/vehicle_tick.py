"""Changes over a tick in the filter with angular rate and specific force as states: velocity error, covariance."""

from lvnav_trade.kernels.jit import inline_jit
from lvnav_trade.kernels.strapdown import SUM_V

N_NAV = 9


@inline_jit
def velocity_error(sums, a0, a1, a2, f0, f1, f2):
    """Return the velocity error (3) m/s, frame i, that errors of attitude and mean specific force cause over a tick.

    It is (integral of C) f - [velocity gained x] a.

    Parameters
    ----------
    sums : (18,) integrals of the strapdown over the tick
    a0, a1, a2 : rad, attitude error, frame i
    f0, f1, f2 : m/s^2, error of the mean specific force, body axes
    """
    vx = sums[SUM_V]
    vy = sums[SUM_V + 1]
    vz = sums[SUM_V + 2]
    # -[velocity gained x] a
    turned_x = vz * a1 - vy * a2
    turned_y = vx * a2 - vz * a0
    turned_z = vy * a0 - vx * a1
    # plus (integral of C) f
    error_x = turned_x + sums[0] * f0 + sums[1] * f1 + sums[2] * f2
    error_y = turned_y + sums[3] * f0 + sums[4] * f1 + sums[5] * f2
    error_z = turned_z + sums[6] * f0 + sums[7] * f1 + sums[8] * f2
    return error_x, error_y, error_z


@inline_jit
def add_changes(P, changes, sums, dt, motion, n):
    """P <- P + M + M' + M (Phi - I)' with the first nine rows `changes` of M = (Phi - I) P.

    Parameters
    ----------
    P : (n, n) upper triangle, updated in place
    changes : (9, n) first rows of M
    sums, dt, motion : as in `advance`
    n : number of states
    """
    w = motion
    f = motion + 3
    half = 0.5 * dt
    for i in range(N_NAV):
        for j in range(N_NAV, n):
            P[i, j] += changes[i, j]
        for j in range(i, N_NAV):
            P[i, j] = P[i, j] + changes[i, j] + changes[j, i]
        # row i of M (Phi - I)'
        a0 = changes[i, 0]
        a1 = changes[i, 1]
        a2 = changes[i, 2]
        w0 = changes[i, w]
        w1 = changes[i, w + 1]
        w2 = changes[i, w + 2]
        f0 = changes[i, f]
        f1 = changes[i, f + 1]
        f2 = changes[i, f + 2]
        velocity_change = velocity_error(sums, a0, a1, a2, f0, f1, f2)
        for k in range(3):
            velocity = 3 + k
            position = 6 + k
            if i <= k:
                P[i, k] = P[i, k] + sums[3 * k] * w0 + sums[3 * k + 1] * w1 + sums[3 * k + 2] * w2
            if i <= velocity:
                P[i, velocity] += velocity_change[k]
            if i <= position:
                P[i, position] = P[i, position] + dt * changes[i, velocity] + half * velocity_change[k]
