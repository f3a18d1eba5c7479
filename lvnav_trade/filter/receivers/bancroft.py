"""Position, velocity and clock from one epoch's ranges and range rates: Bancroft's closed form, least squares, a test.

With the product <a, b> = a1 b1 + a2 b2 + a3 b3 - a4 b4, a satellite at s with pseudorange rho is a = (s, rho), and the
unknown y = (r, b) fulfils <a, a> / 2 - <a, y> + <y, y> / 2 = 0 for every satellite. So y = M (L u + v) with B u = 1,
B v = <a, a> / 2 (rows of B are the a, M = diag(1, 1, 1, -1)) and L = <y, y> / 2 a root of <u, u> L^2 +
2 (<u, v> - 1) L + <v, v> = 0. Bancroft, IEEE Trans. AES-21(1), 1985. Satellite positions are relative to
`position_guess`, which keeps y small and the equations as well conditioned as the geometry is.

With more than four satellites the closed form weights measurements by the square of their distance; Newton steps then
give the least-squares solution to which the covariance belongs. A run with fewer than four satellites, or with all
satellites in one cone, has no fix.
"""

import numpy as np

from lvnav_trade.filter.receivers.receiver import (
    CONSISTENT,
    FIX_BIAS,
    FIX_DRIFT,
    FIX_POS,
    FIX_VEL,
    INCONSISTENT,
    N_FIX,
    NO_FIX,
    UNTESTED,
)
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import number_like, sqrt, where
from lvnav_trade.quantities.line_of_sight import line_of_sight

# A pivot below this fraction of its diagonal element corresponds to a DOP beyond 1e5.
_SINGULAR = 1e-10
# A root is chosen if its squared residuals are smaller by this factor; otherwise the root nearer to `position_guess`.
_DECIDED = 100.0


@jit
def slot_measurement(ranges, slot):
    """Return weight, pseudorange and range rate of a slot; zeros in runs in which either is NaN."""
    rho = ranges[slot, 0]
    rate = ranges[slot, 1]
    measurement_sum = rho + rate
    is_measured = measurement_sum == measurement_sum
    weight = where(is_measured, 1.0, 0.0)
    return weight, where(is_measured, rho, 0.0), where(is_measured, rate, 0.0)


@jit
def factorise(A):
    """Replace the lower triangle of the symmetric A (4, 4) by L D L'; return the smallest pivot over its diagonal.

    A pivot that is not positive is replaced by 1, so that the results are finite, and its ratio by zero.
    """
    smallest_ratio = number_like(A[0, 0], np.inf)
    for i in range(4):
        pivot = A[i, i]
        for k in range(i):
            pivot = pivot - A[i, k] * A[i, k] * A[k, k]
        is_positive = pivot > 0.0
        diagonal = where(is_positive, A[i, i], 1.0)
        ratio = where(is_positive, pivot / diagonal, 0.0)
        smallest_ratio = where(ratio < smallest_ratio, ratio, smallest_ratio)
        pivot = where(is_positive, pivot, 1.0)
        A[i, i] = pivot
        for j in range(i + 1, 4):
            value = A[j, i]
            for k in range(i):
                value = value - A[j, k] * A[i, k] * A[k, k]
            A[j, i] = value / pivot
    return smallest_ratio


@jit
def solve(A, b):
    """Replace b (4,) by the solution with the factors of `factorise`."""
    for i in range(4):
        for k in range(i):
            b[i] = b[i] - A[i, k] * b[k]
    for step in range(4):
        i = 3 - step
        b[i] = b[i] / A[i, i]
        for k in range(i + 1, 4):
            b[i] = b[i] - A[k, i] * b[k]


@jit
def _clear(receiver):
    zero = number_like(receiver.position_guess[0], 0.0)
    for i in range(4):
        receiver.sides[0, i] = zero
        receiver.sides[1, i] = zero
        for j in range(4):
            receiver.normal[i, j] = zero


@jit
def _add_row(receiver, weight, row, first, second):
    """Add a weighted row (4,) to the normal matrix and its two right-hand sides."""
    sides = receiver.sides
    for i in range(4):
        weighted_entry = weight * row[i]
        sides[0, i] = sides[0, i] + weighted_entry * first
        sides[1, i] = sides[1, i] + weighted_entry * second
        for j in range(i + 1):
            receiver.normal[i, j] = receiver.normal[i, j] + weighted_entry * row[j]


@jit
def _closed_form(receiver, satellite, slot_satellites, n_used, ranges):
    """Set up and solve the equations of B for u and v, in `sides`; return number of satellites and smallest pivot."""
    _clear(receiver)
    count = number_like(receiver.position_guess[0], 0.0)
    for slot in range(n_used):
        weight, rho, _ = slot_measurement(ranges, slot)
        s = satellite[slot_satellites[slot]]
        x = s[0] - receiver.position_guess[0]
        y = s[1] - receiver.position_guess[1]
        z = s[2] - receiver.position_guess[2]
        half = 0.5 * (x * x + y * y + z * z - rho * rho)
        _add_row(receiver, weight, (x, y, z, rho), number_like(half, 1.0), half)
        count = count + weight
    smallest_ratio = factorise(receiver.normal)
    solve(receiver.normal, receiver.sides[0])
    solve(receiver.normal, receiver.sides[1])
    return count, smallest_ratio


@jit
def _product(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] - a[3] * b[3]


@jit
def _candidate(receiver, root):
    """Return position relative to `position_guess`, and clock bias, that belong to a root."""
    u = receiver.sides[0]
    v = receiver.sides[1]
    x = root * u[0] + v[0]
    y = root * u[1] + v[1]
    z = root * u[2] + v[2]
    clock_bias = -(root * u[3] + v[3])
    return x, y, z, clock_bias


@jit
def _misfit(receiver, y, satellite, slot_satellites, n_used, ranges):
    """Return the sum of squared residuals of pseudoranges at y, a square metre per satellite added."""
    total = number_like(y[0], 0.0)
    for slot in range(n_used):
        weight, rho, _ = slot_measurement(ranges, slot)
        s = satellite[slot_satellites[slot]]
        dx = s[0] - receiver.position_guess[0] - y[0]
        dy = s[1] - receiver.position_guess[1] - y[1]
        dz = s[2] - receiver.position_guess[2] - y[2]
        distance = sqrt(dx * dx + dy * dy + dz * dz)
        residual = rho - y[3] - distance
        total = total + weight * (residual * residual + 1.0)
    return total


@jit
def _square(y):
    """Return the square of the distance of a candidate from `position_guess`."""
    return y[0] * y[0] + y[1] * y[1] + y[2] * y[2]


@jit
def _choose(receiver, satellite, slot_satellites, n_used, ranges):
    """Set position and clock of the root with small residuals, or else of the root nearer to `position_guess`.

    Returns whether the roots are real.
    """
    u = receiver.sides[0]
    v = receiver.sides[1]
    # a L^2 + 2 b L + c = 0
    a = _product(u, u)
    b = _product(u, v) - 1.0
    c = _product(v, v)
    discriminant = b * b - a * c
    is_real = discriminant >= 0.0
    root = sqrt(where(is_real, discriminant, 0.0))
    # the roots are c / q and q / a: without the difference of nearly equal numbers
    q = where(b < 0.0, root - b, -root - b)
    divisor = where(a == 0.0, 1.0, a)
    first = _candidate(receiver, c / q)
    second = _candidate(receiver, q / divisor)
    first_misfit = _misfit(receiver, first, satellite, slot_satellites, n_used, ranges)
    second_misfit = _misfit(receiver, second, satellite, slot_satellites, n_used, ranges)
    is_nearer = _square(second) < _square(first)
    is_similar = second_misfit < _DECIDED * first_misfit
    is_better = _DECIDED * second_misfit < first_misfit
    is_second = is_better | (is_similar & is_nearer)
    for i in range(3):
        offset = where(is_second, second[i], first[i])
        receiver.fix[FIX_POS + i] = receiver.position_guess[i] + offset
    receiver.fix[FIX_BIAS] = where(is_second, second[3], first[3])
    return is_real


@jit
def _linearise(receiver, satellite, satellite_velocity, slot_satellites, n_used, ranges):
    """Set and factorise the normal equations at the fix.

    The right-hand sides are the range residuals, and the range rates less those due to the satellites.
    """
    _clear(receiver)
    for slot in range(n_used):
        weight, rho, rate = slot_measurement(ranges, slot)
        s = satellite[slot_satellites[slot]]
        velocity = satellite_velocity[slot_satellites[slot]]
        ux, uy, uz, distance = line_of_sight(s, receiver.fix)
        residual = rho - distance - receiver.fix[FIX_BIAS]
        satellite_rate = ux * velocity[0] + uy * velocity[1] + uz * velocity[2]
        receiver_rate = rate - satellite_rate
        row = (-ux, -uy, -uz, number_like(ux, 1.0))
        _add_row(receiver, weight, row, residual, receiver_rate)
    return factorise(receiver.normal)


@jit
def _normalised_residuals(receiver, satellite, satellite_velocity, slot_satellites, n_used, ranges, model):
    """Return the sum of squared residuals of ranges and range rates, each normalised by its assumed sigma."""
    total = number_like(receiver.position_guess[0], 0.0)
    for slot in range(n_used):
        weight, rho, rate = slot_measurement(ranges, slot)
        s = satellite[slot_satellites[slot]]
        velocity = satellite_velocity[slot_satellites[slot]]
        ux, uy, uz, distance = line_of_sight(s, receiver.fix)
        range_residual = rho - distance - receiver.fix[FIX_BIAS]
        wx = velocity[0] - receiver.fix[FIX_VEL]
        wy = velocity[1] - receiver.fix[FIX_VEL + 1]
        wz = velocity[2] - receiver.fix[FIX_VEL + 2]
        geometric_rate = ux * wx + uy * wy + uz * wz
        rate_residual = rate - geometric_rate - receiver.fix[FIX_DRIFT]
        range_square = range_residual * range_residual / model.range_variance
        rate_square = rate_residual * rate_residual / model.rate_variance
        total = total + weight * (range_square + rate_square)
    return total


@jit
def _invert(receiver):
    """Set the inverse of the normal matrix from its factors; the first right-hand side is overwritten."""
    zero = number_like(receiver.position_guess[0], 0.0)
    for column in range(4):
        for i in range(4):
            receiver.sides[0, i] = zero
        receiver.sides[0, column] = zero + 1.0
        solve(receiver.normal, receiver.sides[0])
        for i in range(4):
            receiver.inverse[i, column] = receiver.sides[0, i]


@jit
def _refine(receiver, satellite, satellite_velocity, slot_satellites, n_used, ranges):
    """Improve position and clock bias of the fix by a Newton step of least squares."""
    _linearise(receiver, satellite, satellite_velocity, slot_satellites, n_used, ranges)
    solve(receiver.normal, receiver.sides[0])
    for i in range(3):
        receiver.fix[FIX_POS + i] = receiver.fix[FIX_POS + i] + receiver.sides[0, i]
    receiver.fix[FIX_BIAS] = receiver.fix[FIX_BIAS] + receiver.sides[0, 3]


@jit
def _test_fix(count, squares, model, n_used):
    """Return the quality of a fix by the number of satellites and the sum of squared normalised residuals."""
    limit = number_like(squares, np.inf)
    for n in range(5, n_used + 1):
        limit = where(count == float(n), model.limits[n], limit)
    quality = where(squares <= limit, CONSISTENT, INCONSISTENT)
    return where(count == 4.0, UNTESTED, quality)


@jit
def fix(receiver, model, satellite, satellite_velocity, slot_satellites, n_used, ranges):
    """Set the point solution of an epoch, its inverse normal matrix and its verdict; return its quality.

    Parameters
    ----------
    receiver : Receiver
        `fix`, `inverse` and `verdict` are set, to zeros in a run without a fix.
    model : PointModel
    satellite, satellite_velocity : (n_sat, 3) m, m/s, frame i
        Satellites at transmission.
    slot_satellites : (n_slot,) int
        Satellite of each slot.
    n_used : int
        Number of slots in use.
    ranges : (n_slot, 2) m, m/s
        Pseudorange and range rate, NaN if a run lacks them.

    Returns
    -------
    quality
        NO_FIX, INCONSISTENT (residuals), UNTESTED (four satellites), or CONSISTENT.
    """
    count, smallest_ratio = _closed_form(receiver, satellite, slot_satellites, n_used, ranges)
    has_real_roots = _choose(receiver, satellite, slot_satellites, n_used, ranges)
    is_regular = (count >= 4.0) & (smallest_ratio > _SINGULAR)
    is_sound = is_regular & has_real_roots
    for _ in range(model.refinements):
        _refine(receiver, satellite, satellite_velocity, slot_satellites, n_used, ranges)
    smallest_ratio = _linearise(receiver, satellite, satellite_velocity, slot_satellites, n_used, ranges)
    solve(receiver.normal, receiver.sides[1])
    for i in range(3):
        receiver.fix[FIX_VEL + i] = receiver.sides[1, i]
    receiver.fix[FIX_DRIFT] = receiver.sides[1, 3]
    _invert(receiver)
    squares = _normalised_residuals(receiver, satellite, satellite_velocity, slot_satellites, n_used, ranges, model)
    is_sound = is_sound & (smallest_ratio > _SINGULAR) & (squares == squares)
    tested_quality = _test_fix(count, squares, model, n_used)
    quality = where(is_sound, tested_quality, NO_FIX)
    for i in range(N_FIX):
        receiver.fix[i] = where(is_sound, receiver.fix[i], 0.0)
    for i in range(4):
        for j in range(4):
            receiver.inverse[i, j] = where(is_sound, receiver.inverse[i, j], 0.0)
    receiver.verdict[0] = quality
    receiver.verdict[1] = count
    return quality


@jit
def _report_covariance(receiver, model):
    """Set the reported covariance of the solution: that of the point solution, or constant variances."""
    settings = model.reported_covariance
    zero = number_like(receiver.position_guess[0], 0.0)
    covariance = receiver.covariance
    for i in range(3):
        for j in range(3):
            covariance[i, 3 + j] = zero
            covariance[3 + i, j] = zero
            if settings.is_computed and (settings.has_correlations or i == j):
                inverse = receiver.inverse[i, j]
                covariance[i, j] = settings.factor * model.range_variance * inverse
                covariance[3 + i, 3 + j] = settings.factor * model.rate_variance * inverse
            else:
                covariance[i, j] = zero + (settings.position_variance if i == j else 0.0)
                covariance[3 + i, 3 + j] = zero + (settings.velocity_variance if i == j else 0.0)


@jit
def solution(receiver, model, satellite, satellite_velocity, slot_satellites, n_used, ranges):
    """Set solution and covariance of a receiver to the point solution of an epoch; return its quality.

    The solution is NaN if its quality is below the lowest that is output; otherwise `position_guess` moves to the fix.
    Parameters are those of `fix`.
    """
    quality = fix(receiver, model, satellite, satellite_velocity, slot_satellites, n_used, ranges)
    is_output = quality >= model.least_quality
    for i in range(3):
        position = receiver.fix[FIX_POS + i]
        velocity = receiver.fix[FIX_VEL + i]
        receiver.position_guess[i] = where(is_output, position, receiver.position_guess[i])
        receiver.solution[i] = where(is_output, position, np.nan)
        receiver.solution[3 + i] = where(is_output, velocity, np.nan)
    _report_covariance(receiver, model)
    return quality
