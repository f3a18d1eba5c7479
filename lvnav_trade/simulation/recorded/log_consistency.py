"""Consistency of a log: its sources compared with each other, and residuals of its ranges.

Between two solutions, the velocity increments of the IMU, rotated by its rates to the axes at the start of a window,
equal the velocity gained by the receiver beyond gravitation, apart from one unknown attitude per window. That attitude
is fitted window by window (Wahba's problem); the residuals are errors of IMU and receiver. Solutions with impossible
residuals are omitted, and logs with impossible units of measure are refused.
"""

from collections import Counter
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.kernels.earth import OMEGA, gravity_along
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_angle, ecef_from_geodetic, eci_from_ecef, gmst, rotation_e_n
from lvnav_trade.quantities.line_of_sight import sight
from lvnav_trade.quantities.records import Bools, Floats, Ints
from lvnav_trade.simulation.preparation.prepare import Prepared
from lvnav_trade.simulation.recorded.alignment import increments_to
from lvnav_trade.simulation.recorded.navigation_log import NavigationData, NavigationLog

_LONGEST = 2.0  # s, largest interval between solutions that are compared
_WINDOW, _FEWEST = 10.0, 6  # length (s) and smallest number of intervals of a window with one attitude
_FINEST = 100.0  # Hz, largest rate at which increments are integrated
_JUMP, _SCATTERS = 1.0, 15.0  # limit of a residual: m/s, and multiple of the median residual
_MOST_WILD = 0.1  # largest fraction of solutions that may be omitted
_STEP, _SEARCHED = 1.0, 600.0  # s between solutions, and s from the rest on, for the check of units of measure
_UNFIT = 0.3
_BETTER = 1.0 / 3.0  # m/s, median residual that needs an explanation; fraction left by a better unit
_IMPOSSIBLE = 5.0  # m/s, median residual that no error of an IMU explains
_PASSES = 4
_UNITS = (
    (np.full(3, np.pi / 180.0), "if the rates were deg/s (rad/s are stated)"),
    (np.full(3, 180.0 / np.pi), "if the rates were rad/s (deg/s are stated)"),
    (np.full(3, 3600.0), "if the rates were 3600 times as large (deg/h for deg/s)"),
    (np.full(3, 1.0 / 3600.0), "if the rates were 3600 times as small (deg/s for deg/h)"),
)
_SIGNS = tuple(
    (np.array(signs), f"with the sign of the rates about {names} reversed")
    for signs, names in (
        ((-1.0, 1.0, 1.0), "x"),
        ((1.0, -1.0, 1.0), "y"),
        ((1.0, 1.0, -1.0), "z"),
        ((-1.0, -1.0, 1.0), "x and y"),
        ((-1.0, 1.0, -1.0), "x and z"),
        ((1.0, -1.0, -1.0), "y and z"),
        ((-1.0, -1.0, -1.0), "x, y and z"),
    )
)


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
    residuals, rows = _unexplained(intervals, log.t_fix)
    if not rows.size:
        return log
    size = np.full(intervals.first.size, np.nan)
    size[rows] = residuals
    allowed = max(_JUMP, _SCATTERS * float(np.median(residuals)))
    bad = np.nan_to_num(size) > allowed
    if not bad.any():
        return log
    wild = _both_sides(intervals, bad, log.t_fix.size)
    explained = wild[intervals.first] | wild[intervals.last]
    worst = float(np.nanmax(np.where(bad, size, np.nan)))
    if np.count_nonzero(wild) > max(1.0, _MOST_WILD * wild.size) or (bad & ~explained).any():
        k = int(np.argmax(bad if explained.all() else bad & ~explained))
        row = intervals.last[k]
        step = log.t_fix[row] - log.t_fix[intervals.first[k]]
        raise InputError(
            f"{log.fixes}:{log.lines[row] if log.lines else row}: in the {step:.3g} s before it the velocity "
            f"gains {size[k]:.3g} m/s that the unit ({card.imu.file}) does not show: are times, units and axes of both "
            "right, and has neither a jump?"
        )
    note = (
        f"velocities of {np.count_nonzero(wild)} of {wild.size} solutions contradict the unit, by up to {worst:.3g} "
        f"m/s: left out ({card.gnss.file}:{', '.join(log.lines[k] for k in np.flatnonzero(wild)[:5])})"
    )
    return _kept(log, np.logical_not(wild))._replace(notes=(*log.notes, note))


def _both_sides(intervals: _Intervals, bad: Bools, n: int) -> Bools:
    """Return whether solutions (n,) have a contradiction on both sides, or on the only side that is compared."""
    sides = np.zeros(n, dtype=int)
    wrong = np.zeros(n, dtype=int)
    for ends in (intervals.first, intervals.last):
        np.add.at(sides, ends, 1)
        np.add.at(wrong, ends, bad.astype(int))
    return np.asarray((wrong == sides) & (wrong > 0) & ((sides > 1) | (np.arange(n) % (n - 1) == 0)))


def _kept(log: NavigationData, kept: Bools) -> NavigationData:
    lines = tuple(line for line, is_kept in zip(log.lines, kept, strict=False) if is_kept)
    return log._replace(
        t_fix=log.t_fix[kept],
        place=log.place[kept],
        moving=log.moving[kept],
        sigma=log.sigma[kept],
        lines=lines,
    )


def _rest_rate(log: NavigationData, still: tuple[float, float]) -> Floats:
    begin, end = increments_to(log, np.array(still), log.turned)
    return np.asarray((end - begin) / (still[1] - still[0]))


def _refuse_units(log: NavigationData, card: NavigationLog, lever: Floats, bias: Floats) -> None:
    """Raise InputError if rates in another unit or with another sign fit the receiver, and those of the log do not."""
    part = _kept(log, np.asarray(log.t_fix <= card.still[1] + _SEARCHED))
    stated = _typical(part, lever, bias, np.ones(3))
    if stated <= _UNFIT:
        return
    candidates = [(_typical(part, lever, bias, factor), explanation) for factor, explanation in (*_UNITS, *_SIGNS)]
    best, explanation = min(candidates, key=lambda one: one[0])
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


def _typical(log: NavigationData, lever: Floats, bias: Floats, factor: Floats) -> float:
    """Return the median residual (m/s) between solutions a step or more apart, with rates multiplied by a factor."""
    scaled = log._replace(turned=log.turned * factor)
    intervals = _intervals(scaled, lever, bias * factor, _STEP)
    residuals, _ = _unexplained(intervals, log.t_fix)
    return float(np.median(residuals)) if residuals.size else 0.0


def _intervals(log: NavigationData, lever: Floats, bias: Floats, step: float) -> _Intervals:
    """Return the intervals between solutions that are at least a step (s), and not too far, apart."""
    inside = np.flatnonzero((log.t_fix >= log.t[0]) & (log.t_fix <= log.t[-1]))
    picked = inside[:1].tolist()
    for k in inside[1:].tolist():
        if log.t_fix[k] - log.t_fix[picked[-1]] >= step - 1e-6:
            picked.append(k)
    at = np.array(picked, dtype=np.int64)
    dt = np.diff(log.t_fix[at])
    near = dt <= max(_LONGEST, 1.5 * step)
    first = at[:-1][near]
    last = at[1:][near]
    dt = dt[near]
    if not dt.size:
        none = np.zeros((0, 3))
        return _Intervals(first, last, none, none, np.zeros((0, 3, 3)))
    log_rate = (log.t.size - 1) / float(log.t[-1] - log.t[0])
    count = max(2, int(np.ceil(float(dt.max()) * min(log_rate, _FINEST))))
    grid = log.t_fix[first][:, None] + dt[:, None] * np.arange(count + 1) / count
    turned, pushed = (
        np.diff(increments_to(log, grid.ravel(), part).reshape(*grid.shape, 3), axis=1)
        for part in (log.turned, log.pushed)
    )
    turned = turned - bias * (dt / count)[:, None, None]
    C = np.tile(np.eye(3), (dt.size, 1, 1))
    total = np.zeros((dt.size, 3))
    for k in range(count):
        half = pushed[:, k] + 0.5 * np.cross(turned[:, k], pushed[:, k])
        total += np.einsum("nij,nj->ni", C, half)
        C = C @ Rotation.from_rotvec(turned[:, k]).as_matrix()
    ends = [np.cross(turned[:, k] * (count / dt)[:, None], lever) for k in (0, -1)]
    total += np.einsum("nij,nj->ni", C, ends[1]) - ends[0]
    _, r_i, v_i = inertial_fixes(log, 0.0, gmst(log.epoch))
    fallen = gravity_along(0.5 * (r_i[first] + r_i[last])) * dt[:, None]
    return _Intervals(first, last, v_i[last] - v_i[first] - fallen, total, C)


def _unexplained(intervals: _Intervals, t_fix: Floats) -> tuple[Floats, Ints]:
    """Return the residuals (n,) m/s of the intervals that lie in windows, and their indices (n,)."""
    blocks = _blocks(intervals, t_fix)
    if not blocks.size:
        return np.zeros(0), np.zeros(0, dtype=np.int64)
    C = np.tile(np.eye(3), (len(blocks), 1, 1))
    turned = np.empty((*blocks.shape, 3))
    for k in range(blocks.shape[1]):
        turned[:, k] = np.einsum("nij,nj->ni", C, intervals.pushed[blocks[:, k]])
        C = C @ intervals.turn[blocks[:, k]]
    gained = intervals.gained[blocks]
    weight = np.ones(blocks.shape)
    size = weight
    for _ in range(_PASSES):  # reweighting, so that a wild solution does not bias the attitude
        U, _s, Vt = np.linalg.svd(np.einsum("nk,nki,nkj->nij", weight, gained, turned))
        U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
        size = np.linalg.norm(gained - np.einsum("nij,nkj->nki", U @ Vt, turned), axis=2)
        scale = np.maximum(np.median(size, axis=1, keepdims=True), 1e-6)
        weight = 1.0 / (1.0 + (size / (3.0 * scale)) ** 2)
    rows, at = np.unique(blocks.ravel(), return_index=True)
    return size.ravel()[at], rows


def _blocks(intervals: _Intervals, t_fix: Floats) -> Ints:
    """Return the intervals (n_block, n) of each window; no window spans a gap, and the last before a gap ends there."""
    if not intervals.first.size:
        return np.zeros((0, 0), dtype=np.int64)
    typical = float(np.median(t_fix[intervals.last] - t_fix[intervals.first]))
    n = max(_FEWEST, round(_WINDOW / typical))
    edges = np.concatenate(
        [[0], np.flatnonzero(intervals.first[1:] != intervals.last[:-1]) + 1, [intervals.first.size]]
    )
    starts: list[int] = []
    for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        if b - a >= n:
            starts += [*range(a, b - n + 1, n), b - n]
    return np.add.outer(np.unique(np.array(starts, dtype=np.int64)), np.arange(n))


_FEWEST_RESIDUALS = 4  # smallest number of satellites of an epoch for the median that removes the receiver clock
_CONTRADICTED = (300.0, 10.0)  # m and m/s, limits of the median: above almanac and delay errors, below a wrong time
_WILD = (500.0, 10.0)
_SCATTERS_OF_RESIDUALS = 15.0  # limit of a single residual: m and m/s, and multiple of the median
_MOST_WILD_RESIDUALS = 0.1  # largest fraction of measurements that may be omitted
_FITS = 0.1  # fraction of the median residual that a fitting interpretation of the column may leave
_NAMED = 6
_WAVELENGTH = SPEED_OF_LIGHT / 1575.42e6
_READINGS = (
    (-1.0, "its sign is reversed: is it a Doppler shift in m/s?"),
    (-_WAVELENGTH, "it fits as a Doppler shift in Hz of 1575.42 MHz: multiply it by -0.190294 m"),
    (_WAVELENGTH, "it fits as a range rate in cycles of 1575.42 MHz: multiply it by 0.190294 m"),
    (1000.0, "it fits in km/s"),
    (0.001, "it fits in mm/s"),
)


class RecordedRanges(NamedTuple):
    """Recorded ranges and range rates.

    observed : (n_epoch, n_sat, 2) m, m/s. As measured.
    added : (n_epoch, n_sat, 2) m, m/s. Corrections to be added.
    tracked : (n_epoch, n_sat). Whether they are used.
    needed : Columns that the filter processes.
    """

    observed: Floats
    added: Floats
    tracked: Bools
    needed: list[int]


def compared(prepared: Prepared, log: RecordedRanges, file: str) -> tuple[Bools, tuple[str, ...]]:
    """Return whether measurements are used (n_epoch, n_sat), and notes on those that contradict the solutions.

    Raises
    ------
    InputError
        If the measurements contradict the solutions throughout.
    """
    expected = _expected(prepared)
    near = _near_solution(prepared)[:, None] & log.tracked
    omitted = np.zeros_like(log.tracked)
    worst = {}
    for at in log.needed:
        residuals = _left(log.observed[:, :, at] + log.added[:, :, at] - expected[:, :, at], near)
        seen = np.abs(residuals[np.isfinite(residuals)])
        if not seen.size:
            continue
        typical = float(np.median(seen))
        if typical > _CONTRADICTED[at]:
            hint = (
                _range_hint(residuals, expected[:, :, 1])
                if at == 0
                else _rate_hint(log, expected[:, :, 1], near, typical)
            )
            raise InputError(
                f"{file}: {('pseudorange_m', 'range_rate_m_s')[at]} contradicts the solutions: without the receiver's "
                f"clock, half of them are off by more than {_sized(typical, at)}; {hint}"
            )
        wild = np.abs(np.nan_to_num(residuals)) > max(_WILD[at], _SCATTERS_OF_RESIDUALS * typical)
        omitted |= wild
        if wild.any():
            worst[at] = float(np.nanmax(np.abs(residuals)))
    count = int(np.count_nonzero(omitted))
    if not count:
        return log.tracked, ()
    sizes = " and ".join(_sized(size, at) for at, size in worst.items())
    names = Counter(prepared.sky.names[k] for k in np.nonzero(omitted)[1].tolist())
    named = ", ".join(f"{name} ({times})" for name, times in sorted(names.items())[:_NAMED])
    note = f"{count} of {np.count_nonzero(near)} ranges contradict the solutions, by up to {sizes}"
    if count > max(1.0, _MOST_WILD_RESIDUALS * np.count_nonzero(near)):
        raise InputError(f"{file}: {note}: {named}")
    return log.tracked & ~omitted, (f"{note}: left out, by satellite: {named}",)


def _sized(size: float, at: int) -> str:
    return f"{size * 1e-3:.4g} km{('', '/s')[at]}" if size >= 1e3 else f"{size:.3g} m{('', '/s')[at]}"


def _expected(prepared: Prepared) -> Floats:
    """Return the ranges and range rates (n_epoch, n_sat, 2) m and m/s by the solutions, without clocks."""
    sky, signals = prepared.sky, prepared.signals
    seen = sight(sky.r_i - signals.position[:, None, :], sky.v_i - signals.velocity[:, None, :])
    return np.stack([seen.distance, seen.rate], axis=2)


def _near_solution(prepared: Prepared) -> Bools:
    """Return whether the epochs (n_epoch,) have a solution of the log."""
    return np.asarray(prepared.signals.n_used > 0)


def _left(difference: Floats, used: Bools) -> Floats:
    """Return differences (n_epoch, n_sat) minus the median of their epoch; NaN if unused or with too few satellites."""
    residuals = np.where(used & np.isfinite(difference), difference, np.nan)
    few = np.isfinite(residuals).sum(axis=1) < _FEWEST_RESIDUALS
    residuals[few] = np.nan
    some = ~few
    residuals[some] -= np.nanmedian(residuals[some], axis=1, keepdims=True)
    return residuals


def _range_hint(left: Floats, rate: Floats) -> str:
    """Return a hint on the cause of range residuals: a time offset of the satellites if it explains them."""
    motion = _left(rate, np.isfinite(left))
    on = np.isfinite(left) & np.isfinite(motion)
    shift = float(np.sum(left[on] * motion[on]) / max(np.sum(motion[on] ** 2), 1e-9))
    rest = np.median(np.abs(left[on] - shift * motion[on]))
    if rest <= _FITS * np.median(np.abs(left[on])):
        return (
            f"the satellites fit {abs(shift):.1f} s {'later' if shift > 0.0 else 'earlier'}: is the epoch UTC, and do "
            "the columns of time count from it (leap seconds: time_scale)?"
        )
    return "are the epoch, the constellation (of that day) and the unit right?"


def _rate_hint(log: RecordedRanges, rate: Floats, near: Bools, typical: float) -> str:
    """Return a hint on the interpretation of the range-rate column that fits, if there is one."""
    for factor, hint in _READINGS:
        residuals = _left(factor * log.observed[:, :, 1] + log.added[:, :, 1] - rate, near)
        if np.nanmedian(np.abs(residuals)) <= min(_CONTRADICTED[1], _FITS * typical):
            return hint
    return "are the epoch and the unit right?"
