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
from lvnav_trade.simulation.recorded.alignment import increments_to
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
    gained : (n, 3) m/s. Velocity gained by the receiver beyond gravitation, frame i.
    pushed : (n, 3) m/s. Velocity increments of the IMU, body axes at the start.
    turn : (n, 3, 3). Rotation from body axes at the end to those at the start.
    """

    first: Ints
    last: Ints
    gained: Floats
    pushed: Floats
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
    r_i = eci_from_ecef(ecef_from_geodetic(*log.place.T), theta)
    v_e = np.einsum("nji,nj->ni", rotation_e_n(log.place[:, 0], log.place[:, 1]), log.moving)
    return t, r_i, eci_from_ecef(v_e, theta) + np.cross([0.0, 0.0, OMEGA], r_i)


def consistent(log: NavigationData, card: NavigationLog, lever: Floats) -> NavigationData:
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
    residuals, compared_intervals = _unexplained(intervals, log.t_fix)
    if not compared_intervals.size:
        return log
    size = np.full(intervals.first.size, np.nan)
    size[compared_intervals] = residuals
    allowed = max(_JUMP, _SCATTERS * float(np.median(residuals)))
    bad = np.nan_to_num(size) > allowed
    if not bad.any():
        return log
    wild = _both_sides(intervals, bad, log.t_fix.size)
    n_wild = np.count_nonzero(wild)
    explained = wild[intervals.first] | wild[intervals.last]
    if n_wild > max(1.0, _MOST_WILD * wild.size) or (bad & ~explained).any():
        k = int(np.argmax(bad if explained.all() else bad & ~explained))
        row = intervals.last[k]
        step = log.t_fix[row] - log.t_fix[intervals.first[k]]
        raise InputError(
            f"{log.fixes}:{log.lines[row] if log.lines else row}: in the {step:.3g} s before it the velocity "
            f"gains {size[k]:.3g} m/s that the unit ({card.imu.file}) does not show: are times, units and axes of both "
            "right, and has neither a jump?"
        )
    worst = float(np.nanmax(np.where(bad, size, np.nan)))
    first_lines = ", ".join(log.lines[k] for k in np.flatnonzero(wild)[:5])
    note = (
        f"velocities of {n_wild} of {wild.size} solutions contradict the unit, by up to {worst:.3g} "
        f"m/s: left out ({card.gnss.file}:{first_lines})"
    )
    return _selected(log, np.logical_not(wild))._replace(notes=(*log.notes, note))


def _both_sides(intervals: _Intervals, bad: Bools, n: int) -> Bools:
    """Return whether solutions (n,) have a contradiction on both sides, or on the only side that is compared."""
    n_compared = np.zeros(n, dtype=int)
    n_wrong = np.zeros(n, dtype=int)
    for ends in (intervals.first, intervals.last):
        np.add.at(n_compared, ends, 1)
        np.add.at(n_wrong, ends, bad.astype(int))
    all_wrong = (n_wrong == n_compared) & (n_wrong > 0)
    is_end_of_log = np.arange(n) % (n - 1) == 0
    return np.asarray(all_wrong & ((n_compared > 1) | is_end_of_log))


def _selected(log: NavigationData, selected: Bools) -> NavigationData:
    """Return a log with the selected solutions (m,) only."""
    lines = tuple(line for line, is_selected in zip(log.lines, selected, strict=False) if is_selected)
    return log._replace(
        t_fix=log.t_fix[selected],
        place=log.place[selected],
        moving=log.moving[selected],
        sigma=log.sigma[selected],
        lines=lines,
    )


def _rest_rate(log: NavigationData, still: tuple[float, float]) -> Floats:
    """Return the mean rate (3,) rad/s of the log during its rest."""
    begin, end = increments_to(log, np.array(still), log.turned)
    return np.asarray((end - begin) / (still[1] - still[0]))


def _refuse_units(log: NavigationData, card: NavigationLog, lever: Floats, bias: Floats) -> None:
    """Raise InputError if rates in another unit or with another sign fit the receiver, and those of the log do not."""
    first_solutions = _selected(log, np.asarray(log.t_fix <= card.still[1] + _SEARCHED))
    stated = _typical_residual(first_solutions, lever, bias, np.ones(3))
    if stated <= _UNFIT:
        return
    candidates = []
    for factor, explanation in (*_UNITS, *_SIGNS):
        candidates.append((_typical_residual(first_solutions, lever, bias, factor), explanation))
    best, explanation = min(candidates, key=lambda candidate: candidate[0])
    if best <= _BETTER * stated:
        raise InputError(
            f"{card.imu.file}: the rates contradict the receiver's velocities, which gain {stated:.2g} m/s in some "
            f"{_STEP:g} s that they do not explain; {best:.2g} m/s {explanation}: are units and axes right?"
        )
    if stated > _IMPOSSIBLE:
        raise InputError(
            f"{card.imu.file}: the unit contradicts the receiver's velocities, which gain {stated:.2g} m/s in some "
            f"{_STEP:g} s that it does not explain: are units, axes and times of both right?"
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
    scaled = log._replace(turned=log.turned * factor)
    intervals = _intervals(scaled, lever, bias * factor, _STEP)
    residuals, _ = _unexplained(intervals, log.t_fix)
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
        none = np.zeros((0, 3))
        return _Intervals(first, last, gained=none, pushed=none, turn=np.zeros((0, 3, 3)))
    dt = log.t_fix[last] - log.t_fix[first]
    dtheta, dvel = _interval_increments(log, log.t_fix[first], dt)
    n_part = dtheta.shape[1]
    dtheta = dtheta - bias * (dt / n_part)[:, None, None]
    C = np.tile(np.eye(3), (dt.size, 1, 1))
    pushed = np.zeros((dt.size, 3))
    for k in range(n_part):
        angle = dtheta[:, k]
        in_middle = dvel[:, k] + 0.5 * np.cross(angle, dvel[:, k])  # rotation during the step
        pushed += np.einsum("nij,nj->ni", C, in_middle)
        C = C @ Rotation.from_rotvec(angle).as_matrix()
    # the velocity of the antenna includes that by the lever arm, w x r
    per_second = (n_part / dt)[:, None]
    lever_at_start = np.cross(dtheta[:, 0] * per_second, lever)
    lever_at_end = np.cross(dtheta[:, -1] * per_second, lever)
    pushed += np.einsum("nij,nj->ni", C, lever_at_end) - lever_at_start
    _, r_i, v_i = inertial_fixes(log, 0.0, gmst(log.epoch))
    middle_r_i = 0.5 * (r_i[first] + r_i[last])
    by_gravitation = gravity_along(middle_r_i) * dt[:, None]
    gained = v_i[last] - v_i[first] - by_gravitation
    return _Intervals(first, last, gained=gained, pushed=pushed, turn=C)


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
    log_rate = (log.t.size - 1) / float(log.t[-1] - log.t[0])
    n_part = max(2, int(np.ceil(float(dt.max()) * min(log_rate, _FINEST))))
    grid = start[:, None] + dt[:, None] * np.arange(n_part + 1) / n_part
    shape = (*grid.shape, 3)
    angle_sums = increments_to(log, grid.ravel(), log.turned).reshape(shape)
    velocity_sums = increments_to(log, grid.ravel(), log.pushed).reshape(shape)
    return np.diff(angle_sums, axis=1), np.diff(velocity_sums, axis=1)


def _interval_ends(log: NavigationData, step: float) -> tuple[Ints, Ints]:
    """Return first and last solutions (n,) of intervals of at least a step (s), without those that are too long."""
    inside = np.flatnonzero((log.t_fix >= log.t[0]) & (log.t_fix <= log.t[-1]))
    bounds = inside[:1].tolist()
    for k in inside[1:].tolist():
        if log.t_fix[k] - log.t_fix[bounds[-1]] >= step - 1e-6:
            bounds.append(k)
    index = np.array(bounds, dtype=np.int64)
    is_short = np.diff(log.t_fix[index]) <= max(_LONGEST, 1.5 * step)
    return index[:-1][is_short], index[1:][is_short]


def _unexplained(intervals: _Intervals, t_fix: Floats) -> tuple[Floats, Ints]:
    """Return the residuals (n,) m/s of the intervals that lie in windows, and their indices (n,)."""
    blocks = _blocks(intervals, t_fix)
    if not blocks.size:
        return np.zeros(0), np.zeros(0, dtype=np.int64)
    # velocity increments of the IMU in the axes at the start of each window
    C = np.tile(np.eye(3), (len(blocks), 1, 1))
    pushed = np.empty((*blocks.shape, 3))
    for k in range(blocks.shape[1]):
        pushed[:, k] = np.einsum("nij,nj->ni", C, intervals.pushed[blocks[:, k]])
        C = C @ intervals.turn[blocks[:, k]]
    gained = intervals.gained[blocks]
    weight = np.ones(blocks.shape)
    size = weight
    for _ in range(_PASSES):  # reweighting, so that a wild solution does not bias the attitude
        # Wahba's problem: the attitude is U V' of the weighted sum of gained pushed', with determinant 1
        U, _singular, Vt = np.linalg.svd(np.einsum("nk,nki,nkj->nij", weight, gained, pushed))
        U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
        residual = gained - np.einsum("nij,nkj->nki", U @ Vt, pushed)
        size = np.linalg.norm(residual, axis=2)
        scale = np.maximum(np.median(size, axis=1, keepdims=True), 1e-6)
        weight = 1.0 / (1.0 + (size / (3.0 * scale)) ** 2)
    indices, first_place = np.unique(blocks.ravel(), return_index=True)  # the last two windows may overlap
    return size.ravel()[first_place], indices


def _blocks(intervals: _Intervals, t_fix: Floats) -> Ints:
    """Return the intervals (n_block, n) of each window; no window spans a gap, and the last before a gap ends there."""
    if not intervals.first.size:
        return np.zeros((0, 0), dtype=np.int64)
    typical_interval = float(np.median(t_fix[intervals.last] - t_fix[intervals.first]))
    n = max(_FEWEST, round(_WINDOW / typical_interval))
    gaps = np.flatnonzero(intervals.first[1:] != intervals.last[:-1]) + 1
    edges = [0, *gaps.tolist(), intervals.first.size]
    starts: list[int] = []
    for begin, end in pairwise(edges):
        if end - begin >= n:
            starts += range(begin, end - n + 1, n)
            starts.append(end - n)
    return np.add.outer(np.unique(np.array(starts, dtype=np.int64)), np.arange(n))
