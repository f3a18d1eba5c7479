"""The true flight of a user's own file: splines through its rows, jumps of its reference point named and removed."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from lvnav_trade.errors import InputError
from lvnav_trade.frames import earth_angle, earth_velocity, ecef_from_eci, eci_from_ecef, matrices, quaternions, unit
from lvnav_trade.input_files import read_bytes
from lvnav_trade.kernels.earth import OMEGA, gravity_along
from lvnav_trade.limits import DATA_BYTES
from lvnav_trade.world.ascent.launch import achieved
from lvnav_trade.world.ascent.vehicle import STANDARD_GRAVITY
from lvnav_trade.world.truth import Phase, Trajectory, motion, position_spline
from lvnav_trade.world.user_file.columns import TableTrajectory
from lvnav_trade.world.user_file.residual import Residual
from lvnav_trade.world.user_file.roll_axis import along_path
from lvnav_trade.world.user_file.rows import Rows, read_rows
from lvnav_trade.world.user_file.stretches import fit

Floats = NDArray[np.float64]

_SAME = 1e-6  # s; two times closer than this are one
_PAD_STEP = 2.5  # s between knots on the pad
_REST = 1.0  # m/s relative to the Earth; more than this is no lift-off
_MOST_LOAD = 100.0  # standard gravities; beyond, rows or events are wrong
_COMPONENTS = 0.5 * np.sqrt(0.75)  # RMS of a quaternion's four components for one radian of rotation per axis


class Jump(NamedTuple):
    """A change of the point that the rows of position refer to: a step at an event, or a movement between two."""

    name: str
    time: float
    shift: Floats


class Fitted(NamedTuple):
    """What is left of the rows: the position spline in frame i, edges (s) of its stretches, what was removed from the
    rows, RMS and worst of spline minus rows of position, and the residuals.
    """

    rows: Rows
    position: BSpline
    edges: list[float]
    jumps: tuple[Jump, ...]
    misfit: tuple[float, float, float]
    residuals: tuple[Residual, ...]


def from_table(card: TableTrajectory) -> Trajectory:
    """Return the flight of a user's file; InputError where the file is broken, contradicts itself grossly, or an event
    lies outside it.
    """
    path = _path_of(card)
    rows, edges = path.rows, path.edges
    hold = _checked_hold(card, path)
    try:
        attitude = _attitude(card, path, hold)
    except InputError as error:
        raise InputError(f"{card.file}: {error}") from None
    phases = [_pad(path, hold, attitude)] if hold > 0.0 else []
    marks = _marks(card.events, rows.t)
    for begin, end in pairwise(edges):
        name = next((name for name, time in marks.items() if abs(time - begin) < _SAME), "start")
        phases.append(Phase(f"from {name}", begin, end, path.position, attitude))
    flight = Trajectory(tuple(phases), _named_events(marks, card.events), rows.theta0, card.epoch)
    flight.facts.update(_facts(card, path, flight))
    return flight


def residuals(card: TableTrajectory) -> tuple[Residual, ...]:
    """Return the worst contradiction of each stretch of a user's file; none where it holds position alone."""
    return _path_of(card).residuals


def content_of(file: str) -> str:
    """Return the digest of a file; InputError where it cannot be read."""
    return hashlib.sha256(read_bytes(file, DATA_BYTES)).hexdigest()


def _path_of(card: TableTrajectory) -> Fitted:
    return _fitted(card.model_dump_json(), content_of(card.file))


@lru_cache(maxsize=4)
def _fitted(card_json: str, content: str) -> Fitted:
    """Return the path of a card's file; `content` is the digest of the file, so that a changed one is read again."""
    card = TableTrajectory.model_validate_json(card_json)
    rows = read_rows(card)
    marks = _marks(card.events, rows.t)
    for name, time in card.events.items():
        if not rows.t[0] - _SAME <= time <= rows.t[-1] + _SAME:
            raise InputError(
                f"{card.file}: event {name!r} at {time:g} s is outside the rows, {rows.t[0]:g} to {rows.t[-1]:g} s"
            )
    breaks = sorted({time for time in marks.values() if rows.t[0] + _SAME < time < rows.t[-1] - _SAME})
    breaks = [time for k, time in enumerate(breaks) if k == 0 or time - breaks[k - 1] > _SAME]
    edges = [float(rows.t[0]), *breaks, float(rows.t[-1])]
    path = _by_velocity(card, rows, edges, marks) if rows.v_i is not None else _by_position(card, rows, edges, marks)
    _refuse_absurd_load(card, path)
    return path._replace(residuals=(*path.residuals, *_of_attitude(rows, edges)))


def _marks(events: Mapping[str, float], t: Floats) -> dict[str, float]:
    """Return the times of the events, the file's own among them: start, lift-off where it is in the rows, end."""
    own = {"start": float(t[0]), "end": float(t[-1])}
    if t[0] <= _SAME <= t[-1]:
        own["liftoff"] = max(0.0, float(t[0]))
    return dict(sorted({**own, **events}.items(), key=lambda item: item[1]))


def _named_events(marks: Mapping[str, float], events: Mapping[str, float]) -> dict[str, float]:
    """Return the events of the flight: start and end of the file only where nothing else happens."""
    others = [*events.values(), *(time for name, time in marks.items() if name == "liftoff")]
    idle = {name for name in ("start", "end") if any(abs(marks[name] - time) < _SAME for time in others)}
    return {name: time for name, time in marks.items() if name not in idle}


def _names_at(marks: Mapping[str, float], begin: float, end: float) -> str:
    return ", ".join(name for name, time in marks.items() if begin < time <= end)


def _by_velocity(card: TableTrajectory, rows: Rows, edges: list[float], marks: Mapping[str, float]) -> Fitted:
    """Return the path whose velocity is a spline through the rows of velocity."""
    assert rows.v_i is not None
    velocity = fit(rows.t, rows.v_i, edges[1:-1], 4, rows.noise[1]).spline
    position = velocity.antiderivative()
    position.c = position.c + (rows.r_i[0] - position(rows.t[0]))
    apart = position(rows.t) - rows.r_i
    change = np.diff(apart, axis=0)
    jumps = _moved(card, rows, change, marks) + _stepped(card, rows, change, marks)
    apart = np.concatenate([apart[:1], apart[:1] + np.cumsum(change, axis=0)])
    found = []
    for begin, end in pairwise(edges):
        here = np.flatnonzero((rows.t >= begin - _SAME) & (rows.t <= end + _SAME))
        if here.size < 2:
            continue
        sizes = {
            "position": np.linalg.norm(apart[here] - apart[here[0]], axis=1),
            "velocity": np.linalg.norm(velocity(rows.t[here]) - rows.v_i[here], axis=1),
        }
        found += [_worst(what, begin, end, rows, here, size) for what, size in sizes.items()]
    return Fitted(rows, position, edges, tuple(sorted(jumps, key=lambda jump: jump.time)), _misfit(rows, apart),
                 tuple(found))  # fmt: skip


def _of_attitude(rows: Rows, edges: list[float]) -> list[Residual]:
    """Return the residuals of the attitude; none where there is none."""
    if rows.q_b_i is None:
        return []
    size = _angles(fit(rows.t, rows.q_b_i, [], 5, rows.noise[2] * _COMPONENTS).spline(rows.t), rows.q_b_i)
    found = []
    for begin, end in pairwise(edges):
        here = np.flatnonzero((rows.t >= begin - _SAME) & (rows.t <= end + _SAME))
        found += [_worst("attitude", begin, end, rows, here, size[here])] if here.size > 1 else []
    return found


def _angles(p: Floats, q: Floats) -> Floats:
    """Return the angles (n,) in rad between the attitudes p (n, 4), of any length, and q (n, 4)."""
    p = unit(p)
    return np.asarray(4.0 * np.arcsin(np.minimum(1.0, 0.5 * np.linalg.norm(p - q, axis=1))))


def _worst(what: str, begin: float, end: float, rows: Rows, here: NDArray[np.int64], size: Floats) -> Residual:
    k = int(np.argmax(size))
    noise = rows.noise[("position", "velocity", "attitude").index(what)]
    return Residual(what, begin, end, float(rows.t[here[k]]), float(size[k]), noise)


def _moved(card: TableTrajectory, rows: Rows, change: Floats, marks: Mapping[str, float]) -> list[Jump]:
    """Take the declared movements of the reference point out of the `change` from row to row (n - 1, 3)."""
    found = []
    for first, last in card.moving_reference:
        times = marks.get(first), marks.get(last)
        if times[0] is None or times[1] is None or times[0] >= times[1]:
            raise InputError(f"{card.name}: moving_reference: {first!r} does not come before {last!r} in {card.file}")
        here = (rows.t[1:] > times[0]) & (rows.t[:-1] < times[1])
        # an interval that a step may share is left to it
        here &= np.linalg.norm(change, axis=1) < card.smallest_jump
        found.append(Jump(f"{first} to {last}", times[0], -np.sum(change[here], axis=0)))
        change[here] = 0.0
    return found


def _stepped(card: TableTrajectory, rows: Rows, change: Floats, marks: Mapping[str, float]) -> list[Jump]:
    """Take the steps at events out of the `change` from row to row (n - 1, 3); refuse a step where there is none."""
    size = np.linalg.norm(change, axis=1)
    found = []
    for k in np.flatnonzero(size > card.smallest_jump + 10.0 * rows.noise[0]):
        names = _names_at(marks, rows.t[k], rows.t[k + 1])
        if not names:
            raise InputError(
                f"{card.file}: the position steps by {size[k]:.3g} m beside its velocity between {rows.t[k]:.9g} and "
                f"{rows.t[k + 1]:.9g} s, where no event is declared: is one missing, or a frame or unit wrong?"
            )
        found.append(Jump(names, float(rows.t[k + 1]), -change[k]))
        change[k] = 0.0
    return found


def _by_position(card: TableTrajectory, rows: Rows, edges: list[float], marks: Mapping[str, float]) -> Fitted:
    """Return the path that is a spline through the rows of position, steps at events left out where they are large."""
    breaks, noise = edges[1:-1], rows.noise[0]
    free = fit(rows.t, rows.r_i, breaks, 5, noise, breaks)
    size = np.linalg.norm(free.steps, axis=1)
    kept = [time for time, step in zip(breaks, size, strict=True) if step > card.smallest_jump + 10.0 * noise]
    found = fit(rows.t, rows.r_i, breaks, 5, noise, kept)
    names = [_names_at(marks, time - _SAME, time + _SAME) for time in kept]
    jumps = tuple(Jump(*item) for item in zip(names, kept, found.steps, strict=True))
    offset = sum((np.outer(rows.t >= jump.time, jump.shift) for jump in jumps), start=np.zeros_like(rows.r_i))
    return Fitted(rows, found.spline, edges, jumps, _misfit(rows, found.spline(rows.t) + offset - rows.r_i), ())


def _misfit(rows: Rows, apart: Floats) -> tuple[float, float, float]:
    """Return RMS and worst length of `apart` (n, 3), and when it is worst."""
    size = np.linalg.norm(apart, axis=1)
    k = int(np.argmax(size))
    return float(np.sqrt(np.mean(size**2))), float(size[k]), float(rows.t[k])


def _inner(edges: Sequence[float]) -> Floats:
    """Return times within the stretches, close enough that no force between knots is missed."""
    parts = [np.linspace(a, b, max(8, int((b - a) / 0.05)) + 2)[1:-1] for a, b in pairwise(edges)]
    return np.concatenate(parts)


def _refuse_absurd_load(card: TableTrajectory, path: Fitted) -> None:
    t = _inner(path.edges)
    load = np.linalg.norm(path.position(t, 2) - gravity_along(path.position(t)), axis=1) / STANDARD_GRAVITY
    k = int(np.argmax(load))
    if load[k] > _MOST_LOAD:
        raise InputError(
            f"{card.file}: the rows need a specific force of {load[k]:.3g} g at {t[k]:.6g} s: is an event missing "
            f"there, or are the rows noisier than their digits (state position_noise or velocity_noise)?"
        )


def _checked_hold(card: TableTrajectory, path: Fitted) -> float:
    """Return the rest on the pad, which only a file that begins at rest can have before it."""
    if card.pad_hold > 0.0:
        start = path.edges[0]
        speed = float(np.linalg.norm(earth_velocity(path.position(start), path.position(start, 1))))
        if speed > _REST:
            raise InputError(
                f"{card.file}: the first row moves at {speed:.3g} m/s over the Earth, so it is not on a pad: set "
                f"pad_hold to 0 s"
            )
    return card.pad_hold


def _pad_times(start: float, hold: float) -> Floats:
    return start + np.linspace(-hold, 0.0, max(8, int(np.ceil(hold / _PAD_STEP))) + 1)


def _pad(path: Fitted, hold: float, attitude: BSpline) -> Phase:
    """Return the phase before the first row, at rest on the Earth; it ends with the first row's velocity."""
    start, spin = path.edges[0], np.array([0.0, 0.0, OMEGA])
    t = _pad_times(start, hold)
    r_e = ecef_from_eci(path.position(start), earth_angle(path.rows.theta0, start))
    r = eci_from_ecef(np.tile(r_e, (t.size, 1)), earth_angle(path.rows.theta0, t))
    v = np.cross(spin, r[[0, -1]])
    a = np.cross(spin, v)
    v[1] = path.position(start, 1)
    return Phase("pad", float(t[0]), float(t[-1]), position_spline(t, r, v, a), attitude)


def _attitude(card: TableTrajectory, path: Fitted, hold: float) -> BSpline:
    """Return the quaternion spline through the rows of attitude, or else along the path."""
    rows = path.rows
    if rows.q_b_i is None:
        return along_path(path.position, path.edges, rows.theta0, card.pointing, card.roll, hold)
    t, q = rows.t, rows.q_b_i
    if hold > 0.0:
        before = _pad_times(rows.t[0], hold)[:-1]
        axes_e = ecef_from_eci(matrices(q[0]).T, earth_angle(rows.theta0, rows.t[0]))  # the body's axes, by rows
        axes = np.stack([eci_from_ecef(np.tile(axis, (before.size, 1)), earth_angle(rows.theta0, before))
                         for axis in axes_e], axis=-1)  # fmt: skip
        t = np.concatenate([before, t])
        q = quaternions(np.concatenate([axes, matrices(q)]))
    return fit(t, q, [], 5, rows.noise[2] * _COMPONENTS).spline


def _facts(card: TableTrajectory, path: Fitted, flight: Trajectory) -> dict[str, float | str]:
    """Return what the report says of the file and of what was made of it, SI.

    InputError where the forces do not lie along the roll axis at all.
    """
    low, high, inclination = achieved(np.concatenate([path.position(path.edges[-1]), path.position(path.edges[-1], 1)]))
    t = _inner(path.edges)
    jerk = np.linalg.norm(path.position(t, 3), axis=1)
    force = path.position(t, 2) - gravity_along(path.position(t))
    load = np.linalg.norm(force, axis=1)
    facts: dict[str, float | str] = {
        "file": card.source,
        "perigee_m": low,
        "apogee_m": high,
        "inclination_rad": inclination,
        "max_load_g": float(np.max(load)) / STANDARD_GRAVITY,
        "implied_jerk_worst_m_s3": float(np.max(jerk)),
        "implied_jerk_worst_at_s": float(t[np.argmax(jerk)]),
        "position_misfit_rms_m": path.misfit[0],
        "position_misfit_worst_m": path.misfit[1],
        "position_misfit_worst_at_s": path.misfit[2],
    }
    for number, jump in enumerate(path.jumps, start=1):
        facts[f"reference_change_{number}"] = jump.name
        facts[f"reference_change_{number}_at_s"] = jump.time
        facts[f"reference_change_{number}_m"] = float(np.linalg.norm(jump.shift))
    for what, unit_ in (("position", "m"), ("velocity", "m_s"), ("attitude", "rad")):
        of = [one for one in path.residuals if one.what == what]
        if of:
            worst = max(of, key=lambda one: one.size)
            facts[f"residual_{what}_worst_{unit_}"] = worst.size
            facts[f"residual_{what}_worst_at_s"] = worst.time
    if path.rows.q_b_i is not None:
        facts |= _attitude_facts(card, path, flight, t[load > STANDARD_GRAVITY], force[load > STANDARD_GRAVITY])
    return facts


def _attitude_facts(
    card: TableTrajectory, path: Fitted, flight: Trajectory, t: Floats, force: Floats
) -> dict[str, float]:
    """Return how well the rows of attitude are spaced, and how far off the roll axis the forces (n, 3) at t lie."""
    rows = path.rows
    assert rows.q_b_i is not None
    coarse = fit(rows.t[::2], rows.q_b_i[::2], [], 5, rows.noise[2] * _COMPONENTS).spline
    every = slice(1, None if rows.t.size % 2 else -1, 2)  # the rows left out, none beyond the last one kept
    worst = float(np.max(_angles(coarse(rows.t[every]), rows.q_b_i[every])))
    facts = {"attitude_from_half_the_rows_worst_rad": worst}
    if t.size:
        along = np.einsum("ij,ij->i", unit(force), matrices(motion(flight, t).q_b_i)[:, :, 0])
        angle = float(np.median(np.arccos(np.clip(along, -1.0, 1.0))))
        facts["force_off_roll_axis_median_rad"] = angle
        if angle > card.largest_force_angle:
            raise InputError(
                f"{card.file}: forces above 1 g lie {np.degrees(angle):.0f} deg off the body's x axis (median): are "
                f"turns, scalar and frame of the attitude right? If so, set largest_force_angle"
            )
    return facts
