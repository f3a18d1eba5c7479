"""Consistency of a log: velocities of IMU and receiver compared with each other.

Between two solutions, the velocity increments of the IMU, rotated by its rates to the axes at the start of a window,
equal the velocity gained by the receiver beyond gravitation, apart from one unknown attitude per window. That attitude
is fitted window by window (Wahba's problem); the residuals are errors of IMU and receiver. Solutions with impossible
residuals are omitted, and logs with impossible units of measure are refused.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from lvnav_trade.kernels.earth import OMEGA, gravity_along
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_angle, ecef_from_geodetic, eci_from_ecef, gmst, rotation_e_n
from lvnav_trade.quantities.records import Bools, Floats, Ints
from lvnav_trade.simulation.recorded.alignment import interpolated_increments
from lvnav_trade.simulation.recorded.navigation_log import NavigationData, NavigationLog

_LONGEST = 2.0  # s, largest interval between solutions that are compared
_WINDOW = 10.0  # s, length of a window with one attitude
_FEWEST = 6  # smallest number of intervals of a window
_FINEST = 100.0  # Hz, largest rate at which increments are integrated
_JUMP = 1.0  # m/s, limit of a residual
_SCATTERS = 15.0  # limit of a residual as a multiple of the median residual
_MOST_WILD = 0.1  # largest fraction of solutions that may be omitted
_STEP = 1.0  # s between solutions for the check of units of measure
_SEARCHED = 600.0  # s from the rest on, for the check of units of measure
_UNFIT = 0.3  # m/s, median residual that needs an explanation
_BETTER = 1.0 / 3.0  # fraction of the median residual that a better unit may leave
_IMPOSSIBLE = 5.0  # m/s, median residual that no error of an IMU explains
_PASSES = 4
_UNITS = (
    (np.full(3, np.pi / 180.0), "if the rates were deg/s (rad/s are stated)"),
    (np.full(3, 180.0 / np.pi), "if the rates were rad/s (deg/s are stated)"),
    (np.full(3, 3600.0), "if the rates were 3600 times as large (deg/h for deg/s)"),
    (np.full(3, 1.0 / 3600.0), "if the rates were 3600 times as small (deg/s for deg/h)"),
)
_REVERSED_AXES = (
    ((-1.0, 1.0, 1.0), "x"),
    ((1.0, -1.0, 1.0), "y"),
    ((1.0, 1.0, -1.0), "z"),
    ((-1.0, -1.0, 1.0), "x and y"),
    ((-1.0, 1.0, -1.0), "x and z"),
    ((1.0, -1.0, -1.0), "y and z"),
    ((-1.0, -1.0, -1.0), "x, y and z"),
)
_SIGNS = tuple((np.array(signs), f"with the sign of the rates about {axes} reversed") for signs, axes in _REVERSED_AXES)


class _Intervals(NamedTuple):
    """Intervals between solutions.

    first : (n,). Solution at the start.
    last : (n,). Solution at the end.
    receiver_dvel : (n, 3) m/s. Velocity gained by the receiver beyond gravitation, frame i.
    imu_dvel : (n, 3) m/s. Velocity increments of the IMU, body axes at the start.
    turn : (n, 3, 3). Rotation from body axes at the end to those at the start.
    """

    first: Ints
    last: Ints
    receiver_dvel: Floats
    imu_dvel: Floats
    turn: Floats


def inertial_fixes(log: NavigationData, start: float, theta0: float) -> tuple[Floats, Floats, Floats]:
    """Return the solutions of a log in the inertial frame.

    Parameters
    ----------
    log
        Recorded log.
    start
        s. Time in the log from which times count.
    theta0
        rad. Earth rotation angle at that time.

    Returns
    -------
    t, r_i, v_i
        (m,) s, (m, 3) m and (m, 3) m/s. Times, positions and velocities, frame i.
    """
    t = log.t_fix - start
    theta = earth_angle(theta0, t)
    latitude = log.place[:, 0]
    longitude = log.place[:, 1]
    r_e = ecef_from_geodetic(*log.place.T)
    r_i = eci_from_ecef(r_e, theta)
    C_e_n = rotation_e_n(latitude, longitude)
    v_e = np.einsum("nji,nj->ni", C_e_n, log.velocity_ned)
    earth_rotation_velocity = np.cross([0.0, 0.0, OMEGA], r_i)
    v_i = eci_from_ecef(v_e, theta) + earth_rotation_velocity
    return t, r_i, v_i


def remove_wild_solutions(log: NavigationData, card: NavigationLog, lever: Floats) -> NavigationData:
    """Return a log without the solutions whose velocities contradict the IMU.

    Parameters
    ----------
    log, card
        Recorded log, and its card.
    lever
        (3,) m. Antenna relative to the IMU, body axes.

    Raises
    ------
    InputError
        If IMU and receiver contradict each other throughout the log, or in more than single solutions.
    """
    bias = _rest_rate(log, card.still)
    _refuse_units(log, card, lever, bias)
    intervals = _intervals(log, lever, bias, 0.0)
    residuals, compared_intervals = _interval_residuals(intervals, log.t_fix)
    if not compared_intervals.size:
        return log
    size = np.full(intervals.first.size, np.nan)
    size[compared_intervals] = residuals
    typical_residual = float(np.median(residuals))
    residual_limit = max(_JUMP, _SCATTERS * typical_residual)
    bad = np.nan_to_num(size) > residual_limit
    if not bad.any():
        return log
    wild = _both_sides(intervals, bad, log.t_fix.size)
    n_wild = np.count_nonzero(wild)
    is_explained = wild[intervals.first] | wild[intervals.last]
    most_wild = max(1.0, _MOST_WILD * wild.size)
    is_unexplained = bad & ~is_explained
    if n_wild > most_wild or is_unexplained.any():
        k = int(np.argmax(bad if is_explained.all() else is_unexplained))
        previous_row = intervals.first[k]
        row = intervals.last[k]
        step = log.t_fix[row] - log.t_fix[previous_row]
        line = log.lines[row] if log.lines else row
        raise InputError(
            f"{log.solution_file}:{line}: in the {step:.3g} s before it the velocity gains {size[k]:.3g} m/s that the "
            f"unit ({card.imu.file}) does not show: are times, units and axes of both right, and has neither a jump?"
        )
    bad_sizes = np.where(bad, size, np.nan)
    worst = float(np.nanmax(bad_sizes))
    first_wild = np.flatnonzero(wild)[:5]
    first_lines = ", ".join(log.lines[k] for k in first_wild)
    note = (
        f"velocities of {n_wild} of {wild.size} solutions contradict the unit, by up to {worst:.3g} "
        f"m/s: left out ({card.gnss.file}:{first_lines})"
    )
    return _select_solutions(log, np.logical_not(wild))._replace(notes=(*log.notes, note))


def _both_sides(intervals: _Intervals, bad: Bools, n: int) -> Bools:
    """Return whether solutions (n,) have a contradiction on both sides, or on the only side that is compared."""
    n_compared = np.zeros(n, dtype=int)
    n_wrong = np.zeros(n, dtype=int)
    bad_count = bad.astype(int)
    for ends in (intervals.first, intervals.last):
        np.add.at(n_compared, ends, 1)
        np.add.at(n_wrong, ends, bad_count)
    all_wrong = (n_wrong == n_compared) & (n_wrong > 0)
    index = np.arange(n)
    is_end_of_log = index % (n - 1) == 0
    is_sufficient = (n_compared > 1) | is_end_of_log
    return np.asarray(all_wrong & is_sufficient)


def _select_solutions(log: NavigationData, selection: Bools) -> NavigationData:
    """Return a log with the selected solutions (m,) only."""
    lines = tuple(line for line, is_selected in zip(log.lines, selection, strict=False) if is_selected)
    return log._replace(
        t_fix=log.t_fix[selection],
        place=log.place[selection],
        velocity_ned=log.velocity_ned[selection],
        sigma=log.sigma[selection],
        lines=lines,
    )


def _rest_rate(log: NavigationData, still: tuple[float, float]) -> Floats:
    """Return the mean rate (3,) rad/s of the log during its rest."""
    t_begin, t_end = still
    angles_begin, angles_end = interpolated_increments(log, np.array(still), log.angle_sums)
    return np.asarray((angles_end - angles_begin) / (t_end - t_begin))


def _refuse_units(log: NavigationData, card: NavigationLog, lever: Floats, bias: Floats) -> None:
    """Raise InputError if rates in another unit or with another sign fit the receiver, and those of the log do not."""
    first_solutions = _select_solutions(log, np.asarray(log.t_fix <= card.still[1] + _SEARCHED))
    stated_residual = _typical_residual(first_solutions, lever, bias, np.ones(3))
    if stated_residual <= _UNFIT:
        return
    candidates = []
    for factor, explanation in (*_UNITS, *_SIGNS):
        candidates.append((_typical_residual(first_solutions, lever, bias, factor), explanation))
    best, explanation = min(candidates, key=lambda candidate: candidate[0])
    if best <= _BETTER * stated_residual:
        raise InputError(
            f"{card.imu.file}: the rates contradict the receiver's velocities, which gain {stated_residual:.2g} m/s in "
            f"some {_STEP:g} s that they do not explain; {best:.2g} m/s {explanation}: are units and axes right?"
        )
    if stated_residual > _IMPOSSIBLE:
        raise InputError(
            f"{card.imu.file}: the unit contradicts the receiver's velocities, which gain {stated_residual:.2g} m/s in "
            f"some {_STEP:g} s that it does not explain: are units, axes and times of both right?"
        )


def _typical_residual(log: NavigationData, lever: Floats, bias: Floats, factor: Floats) -> float:
    """Return the median residual (m/s) between solutions a step or more apart, with rates multiplied by a factor.

    Parameters
    ----------
    log
        Log of the flight.
    lever
        (3,) m. Vector from the IMU to the antenna, body axes.
    bias
        (3,) rad/s. Bias of the gyros, from the rest.
    factor
        (3,). Factor on the rates, by axis.
    """
    scaled_log = log._replace(angle_sums=log.angle_sums * factor)
    intervals = _intervals(scaled_log, lever, bias * factor, _STEP)
    residuals, _ = _interval_residuals(intervals, log.t_fix)
    return float(np.median(residuals)) if residuals.size else 0.0


def _intervals(log: NavigationData, lever: Floats, bias: Floats, step: float) -> _Intervals:
    """Return the intervals between solutions that are at least a step, and not too far, apart.

    Parameters
    ----------
    log
        Log of the flight.
    lever
        (3,) m. Vector from the IMU to the antenna, body axes.
    bias
        (3,) rad/s. Bias of the gyros.
    step
        s. Shortest interval.
    """
    first, last = _interval_ends(log, step)
    if not first.size:
        no_velocities = np.zeros((0, 3))
        no_rotations = np.zeros((0, 3, 3))
        return _Intervals(first, last, receiver_dvel=no_velocities, imu_dvel=no_velocities, turn=no_rotations)
    start = log.t_fix[first]
    dt = log.t_fix[last] - start
    dtheta, dvel = _interval_increments(log, start, dt)
    n_part = dtheta.shape[1]
    part_length = (dt / n_part)[:, None, None]
    dtheta = dtheta - bias * part_length
    C = np.tile(np.eye(3), (dt.size, 1, 1))
    imu_dvel = np.zeros((dt.size, 3))
    for k in range(n_part):
        angle = dtheta[:, k]
        velocity = dvel[:, k]
        in_middle = velocity + 0.5 * np.cross(angle, velocity)  # rotation during the step
        imu_dvel += np.einsum("nij,nj->ni", C, in_middle)
        C = C @ Rotation.from_rotvec(angle).as_matrix()
    # the velocity of the antenna includes that by the lever arm, w x r
    per_second = (n_part / dt)[:, None]
    rate_at_start = dtheta[:, 0] * per_second
    rate_at_end = dtheta[:, -1] * per_second
    lever_at_start = np.cross(rate_at_start, lever)
    lever_at_end = np.cross(rate_at_end, lever)
    imu_dvel += np.einsum("nij,nj->ni", C, lever_at_end) - lever_at_start
    theta0 = gmst(log.epoch)
    _, r_i, v_i = inertial_fixes(log, 0.0, theta0)
    middle_r_i = 0.5 * (r_i[first] + r_i[last])
    gravitation = gravity_along(middle_r_i)
    by_gravitation = gravitation * dt[:, None]
    receiver_dvel = v_i[last] - v_i[first] - by_gravitation
    return _Intervals(first, last, receiver_dvel=receiver_dvel, imu_dvel=imu_dvel, turn=C)


def _interval_increments(log: NavigationData, start: Floats, dt: Floats) -> tuple[Floats, Floats]:
    """Return angle (rad) and velocity (m/s) increments of parts of the intervals, (n, n_part, 3) each.

    All intervals have the same number of equal parts.

    Parameters
    ----------
    log
        Log of the flight.
    start, dt
        (n,) s. Start and length of each interval.
    """
    log_length = float(log.t[-1] - log.t[0])
    log_rate = (log.t.size - 1) / log_length
    part_rate = min(log_rate, _FINEST)
    longest = float(dt.max())
    n_part = max(2, int(np.ceil(longest * part_rate)))
    edges = np.arange(n_part + 1)
    grid = start[:, None] + dt[:, None] * edges / n_part
    times = grid.ravel()
    shape = (*grid.shape, 3)
    angle_sums = interpolated_increments(log, times, log.angle_sums).reshape(shape)
    velocity_sums = interpolated_increments(log, times, log.velocity_sums).reshape(shape)
    dtheta = np.diff(angle_sums, axis=1)
    dvel = np.diff(velocity_sums, axis=1)
    return dtheta, dvel


def _interval_ends(log: NavigationData, step: float) -> tuple[Ints, Ints]:
    """Return first and last solutions (n,) of intervals of at least a step (s), without those that are too long."""
    t_fix = log.t_fix
    in_log = (t_fix >= log.t[0]) & (t_fix <= log.t[-1])
    inside = np.flatnonzero(in_log)
    bounds = inside[:1].tolist()
    for k in inside[1:].tolist():
        previous_bound = bounds[-1]
        if t_fix[k] - t_fix[previous_bound] >= step - 1e-6:
            bounds.append(k)
    index = np.array(bounds, dtype=np.int64)
    lengths = np.diff(t_fix[index])
    is_short = lengths <= max(_LONGEST, 1.5 * step)
    first = index[:-1]
    last = index[1:]
    return first[is_short], last[is_short]


def _interval_residuals(intervals: _Intervals, t_fix: Floats) -> tuple[Floats, Ints]:
    """Return the residuals (n,) m/s of the intervals that lie in windows, and their indices (n,)."""
    blocks = _blocks(intervals, t_fix)
    if not blocks.size:
        return np.zeros(0), np.zeros(0, dtype=np.int64)
    # velocity increments of the IMU in the axes at the start of each window
    C = np.tile(np.eye(3), (len(blocks), 1, 1))
    imu_dvel = np.empty((*blocks.shape, 3))
    for k in range(blocks.shape[1]):
        interval = blocks[:, k]
        imu_dvel[:, k] = np.einsum("nij,nj->ni", C, intervals.imu_dvel[interval])
        C = C @ intervals.turn[interval]
    receiver_dvel = intervals.receiver_dvel[blocks]
    weight = np.ones(blocks.shape)
    size = weight
    for _ in range(_PASSES):  # reweighting, so that a wild solution does not bias the attitude
        # Wahba's problem: the attitude is U V' of the weighted sum of receiver_dvel imu_dvel', with determinant 1
        correlation = np.einsum("nk,nki,nkj->nij", weight, receiver_dvel, imu_dvel)
        U, _singular, Vt = np.linalg.svd(correlation)
        determinant = np.linalg.det(U @ Vt)
        U[:, :, 2] *= np.sign(determinant)[:, None]
        attitude = U @ Vt
        residual = receiver_dvel - np.einsum("nij,nkj->nki", attitude, imu_dvel)
        size = np.linalg.norm(residual, axis=2)
        typical_size = np.median(size, axis=1, keepdims=True)
        scale = np.maximum(typical_size, 1e-6)
        normalised_residual = size / (3.0 * scale)
        weight = 1.0 / (1.0 + normalised_residual**2)
    indices, first_place = np.unique(blocks.ravel(), return_index=True)  # the last two windows may overlap
    residuals = size.ravel()[first_place]
    return residuals, indices


def _blocks(intervals: _Intervals, t_fix: Floats) -> Ints:
    """Return the intervals (n_block, n) of each window; no window spans a gap, and the last before a gap ends there."""
    if not intervals.first.size:
        return np.zeros((0, 0), dtype=np.int64)
    lengths = t_fix[intervals.last] - t_fix[intervals.first]
    typical_interval = float(np.median(lengths))
    n = max(_FEWEST, round(_WINDOW / typical_interval))
    is_after_gap = intervals.first[1:] != intervals.last[:-1]
    gaps = np.flatnonzero(is_after_gap) + 1
    edges = [0, *gaps.tolist(), intervals.first.size]
    starts: list[int] = []
    for begin, end in pairwise(edges):
        if end - begin >= n:
            starts += range(begin, end - n + 1, n)
            starts.append(end - n)
    block_starts = np.unique(np.array(starts, dtype=np.int64))
    return np.add.outer(block_starts, np.arange(n))
