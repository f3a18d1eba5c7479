"""A log's inertial unit held against the velocities of its receiver, whatever the attitude and before any filter.

Between solutions the unit's increments, turned by its own rates into the axes at the start of a window, are what the
receiver's velocity gains beyond gravitation, turned by one unknown attitude. That attitude is fitted window by window
(Wahba's problem); what is left are errors of both. Rows that cannot be true are left out, units that cannot be refused.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from lvnav_trade.engines.recorded.alignment import increments_to
from lvnav_trade.errors import InputError
from lvnav_trade.frames import earth_angle, ecef_from_geodetic, eci_from_ecef, gmst, rotation_e_n
from lvnav_trade.kernels.earth import OMEGA, gravity_along
from lvnav_trade.records import Bools, Floats, Ints
from lvnav_trade.world.user_file.navigation_log import NavigationLog, Recording

_LONGEST = 2.0  # s between solutions that are compared
_WINDOW, _FEWEST = 10.0, 6  # s and intervals of one attitude
_FINEST = 100.0  # 1/s, of the unit's increments
_JUMP, _SCATTERS = 1.0, 15.0  # m/s, and median misses, beyond which a velocity is wild
_MOST_WILD = 0.1
_STEP, _SEARCHED = 1.0, 600.0  # s between solutions, and from the rest on, where units are compared
_UNFIT, _BETTER = 0.3, 1.0 / 3.0  # m/s over a step; part of it that another unit leaves
_IMPOSSIBLE = 5.0  # m/s over a step, a median, that no error of a unit makes
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
    """Between solutions first and last (n,): gained (n, 3) m/s beyond gravitation, frame i; pushed (n, 3) m/s the
    unit's increments in body axes at the first; turn (n, 3, 3) from body axes at the last to those.
    """

    first: Ints
    last: Ints
    gained: Floats
    pushed: Floats
    turn: Floats


def inertial_fixes(log: Recording, start: float, theta0: float) -> tuple[Floats, Floats, Floats]:
    """Return times (m,) s since the start, positions and velocities (m, 3), frame i, of a log's solutions."""
    t = log.t_fix - start
    theta = earth_angle(theta0, t)
    r_i = eci_from_ecef(ecef_from_geodetic(*log.place.T), theta)
    v_e = np.einsum("nji,nj->ni", rotation_e_n(log.place[:, 0], log.place[:, 1]), log.moving)
    return t, r_i, eci_from_ecef(v_e, theta) + np.cross([0.0, 0.0, OMEGA], r_i)


def consistent(log: Recording, card: NavigationLog, lever: Floats) -> Recording:
    """Return a log without the solutions whose velocities the unit contradicts; lever (3,) m, antenna in body axes.

    InputError where unit and receiver contradict each other over all the log, or in more than single rows.
    """
    bias = _rest_rate(log, card.still)
    _refuse_units(log, card, lever, bias)
    found = _intervals(log, lever, bias, 0.0)
    left, rows = _unexplained(found, log.t_fix)
    if not rows.size:
        return log
    size = np.full(found.first.size, np.nan)
    size[rows] = left
    allowed = max(_JUMP, _SCATTERS * float(np.median(left)))
    bad = np.nan_to_num(size) > allowed
    if not bad.any():
        return log
    wild = _both_sides(found, bad, log.t_fix.size)
    explained = wild[found.first] | wild[found.last]
    worst = float(np.nanmax(np.where(bad, size, np.nan)))
    if np.count_nonzero(wild) > max(1.0, _MOST_WILD * wild.size) or (bad & ~explained).any():
        k = int(np.argmax(bad if explained.all() else bad & ~explained))
        row = found.last[k]
        step = log.t_fix[row] - log.t_fix[found.first[k]]
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


def _both_sides(found: _Intervals, bad: Bools, n: int) -> Bools:
    """Return which solutions (n,) have a contradiction before and after them, or at the only side that is compared."""
    sides, wrong = np.zeros(n, dtype=int), np.zeros(n, dtype=int)
    for ends in (found.first, found.last):
        np.add.at(sides, ends, 1)
        np.add.at(wrong, ends, bad.astype(int))
    return np.asarray((wrong == sides) & (wrong > 0) & ((sides > 1) | (np.arange(n) % (n - 1) == 0)))


def _kept(log: Recording, kept: Bools) -> Recording:
    lines = tuple(line for line, one in zip(log.lines, kept, strict=False) if one)
    return log._replace(
        t_fix=log.t_fix[kept], place=log.place[kept], moving=log.moving[kept], sigma=log.sigma[kept], lines=lines
    )


def _rest_rate(log: Recording, still: tuple[float, float]) -> Floats:
    begin, end = increments_to(log, np.array(still), log.turned)
    return np.asarray((end - begin) / (still[1] - still[0]))


def _refuse_units(log: Recording, card: NavigationLog, lever: Floats, bias: Floats) -> None:
    """InputError where rates of another unit or sign fit the receiver's velocities, and those of the log do not."""
    part = _kept(log, np.asarray(log.t_fix <= card.still[1] + _SEARCHED))
    stated = _typical(part, lever, bias, np.ones(3))
    if stated <= _UNFIT:
        return
    found = [(_typical(part, lever, bias, factor), said) for factor, said in (*_UNITS, *_SIGNS)]
    best, said = min(found, key=lambda one: one[0])
    if best <= _BETTER * stated:
        raise InputError(
            f"{card.imu.file}: the rates contradict the receiver's velocities, which gain {stated:.2g} m/s in some "
            f"{_STEP:g} s that they do not explain; {best:.2g} m/s {said}: are units and axes right?"
        )
    if stated > _IMPOSSIBLE:
        raise InputError(
            f"{card.imu.file}: the unit contradicts the receiver's velocities, which gain {stated:.2g} m/s in some "
            f"{_STEP:g} s that it does not explain: are units, axes and times of both right?"
        )


def _typical(log: Recording, lever: Floats, bias: Floats, factor: Floats) -> float:
    """Return the median of what the unit leaves unexplained between solutions a step or more apart, m/s."""
    other = log._replace(turned=log.turned * factor)
    found = _intervals(other, lever, bias * factor, _STEP)
    left, _ = _unexplained(found, log.t_fix)
    return float(np.median(left)) if left.size else 0.0


def _intervals(log: Recording, lever: Floats, bias: Floats, step: float) -> _Intervals:
    """Return the intervals between solutions that are a step (s) or more, and not too far, apart."""
    inside = np.flatnonzero((log.t_fix >= log.t[0]) & (log.t_fix <= log.t[-1]))
    picked = inside[:1].tolist()
    for k in inside[1:].tolist():
        if log.t_fix[k] - log.t_fix[picked[-1]] >= step - 1e-6:
            picked.append(k)
    at = np.array(picked, dtype=np.int64)
    dt = np.diff(log.t_fix[at])
    near = dt <= max(_LONGEST, 1.5 * step)
    first, last, dt = at[:-1][near], at[1:][near], dt[near]
    if not dt.size:
        none = np.zeros((0, 3))
        return _Intervals(first, last, none, none, np.zeros((0, 3, 3)))
    own = (log.t.size - 1) / float(log.t[-1] - log.t[0])
    count = max(2, int(np.ceil(float(dt.max()) * min(own, _FINEST))))
    grid = log.t_fix[first][:, None] + dt[:, None] * np.arange(count + 1) / count
    turned, pushed = (
        np.diff(increments_to(log, grid.ravel(), part).reshape(*grid.shape, 3), axis=1)
        for part in (log.turned, log.pushed)
    )
    turned = turned - bias * (dt / count)[:, None, None]
    C, total = np.tile(np.eye(3), (dt.size, 1, 1)), np.zeros((dt.size, 3))
    for k in range(count):
        half = pushed[:, k] + 0.5 * np.cross(turned[:, k], pushed[:, k])
        total += np.einsum("nij,nj->ni", C, half)
        C = C @ Rotation.from_rotvec(turned[:, k]).as_matrix()
    ends = [np.cross(turned[:, k] * (count / dt)[:, None], lever) for k in (0, -1)]
    total += np.einsum("nij,nj->ni", C, ends[1]) - ends[0]
    _, r_i, v_i = inertial_fixes(log, 0.0, gmst(log.epoch))
    fallen = gravity_along(0.5 * (r_i[first] + r_i[last])) * dt[:, None]
    return _Intervals(first, last, v_i[last] - v_i[first] - fallen, total, C)


def _unexplained(found: _Intervals, t_fix: Floats) -> tuple[Floats, Ints]:
    """Return the size (n,) m/s of what the unit does not explain, and of which intervals (n,): those in windows."""
    blocks = _blocks(found, t_fix)
    if not blocks.size:
        return np.zeros(0), np.zeros(0, dtype=np.int64)
    C, turned = np.tile(np.eye(3), (len(blocks), 1, 1)), np.empty((*blocks.shape, 3))
    for k in range(blocks.shape[1]):
        turned[:, k] = np.einsum("nij,nj->ni", C, found.pushed[blocks[:, k]])
        C = C @ found.turn[blocks[:, k]]
    gained, weight = found.gained[blocks], np.ones(blocks.shape)
    size = weight
    for _ in range(_PASSES):  # so that a wild row does not turn the attitude
        U, _s, Vt = np.linalg.svd(np.einsum("nk,nki,nkj->nij", weight, gained, turned))
        U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
        size = np.linalg.norm(gained - np.einsum("nij,nkj->nki", U @ Vt, turned), axis=2)
        scale = np.maximum(np.median(size, axis=1, keepdims=True), 1e-6)
        weight = 1.0 / (1.0 + (size / (3.0 * scale)) ** 2)
    rows, at = np.unique(blocks.ravel(), return_index=True)
    return size.ravel()[at], rows


def _blocks(found: _Intervals, t_fix: Floats) -> Ints:
    """Return the intervals (n_block, n) of each window: runs without a gap, the last window of a run ends with it."""
    if not found.first.size:
        return np.zeros((0, 0), dtype=np.int64)
    typical = float(np.median(t_fix[found.last] - t_fix[found.first]))
    n = max(_FEWEST, round(_WINDOW / typical))
    edges = np.concatenate([[0], np.flatnonzero(found.first[1:] != found.last[:-1]) + 1, [found.first.size]])
    starts: list[int] = []
    for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        if b - a >= n:
            starts += [*range(a, b - n + 1, n), b - n]
    return np.add.outer(np.unique(np.array(starts, dtype=np.int64)), np.arange(n))
