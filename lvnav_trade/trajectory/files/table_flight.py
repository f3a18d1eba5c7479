"""True trajectory from a user's file: splines through its rows, jumps of the reference point, contradictions."""

import hashlib
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from lvnav_trade.kernels.earth import gravity_along
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import (
    earth_angle,
    earth_velocity,
    ecef_from_eci,
    eci_from_ecef,
    matrices,
    quaternions,
    unit,
)
from lvnav_trade.quantities.input_files import read_bytes
from lvnav_trade.quantities.input_limits import DATA_BYTES
from lvnav_trade.quantities.reads import remembered
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import parse
from lvnav_trade.trajectory.ascent.launch import achieved
from lvnav_trade.trajectory.ascent.plausibility import within_limits
from lvnav_trade.trajectory.ascent.vehicle_cards import STANDARD_GRAVITY
from lvnav_trade.trajectory.discontinuities import missing_events, suggested_events
from lvnav_trade.trajectory.files.columns import TableTrajectory
from lvnav_trade.trajectory.files.contradiction import Residual, added
from lvnav_trade.trajectory.files.first_rows import REST, axes_remark, better, clock_remark, compared
from lvnav_trade.trajectory.files.rows import SAME, TrajectoryRows, read_rows
from lvnav_trade.trajectory.files.splines import along_path, fit
from lvnav_trade.trajectory.truth import NOTE, PAD_STEP, WARNING, Phase, Trajectory, motion, pad_phase, pad_times

_COARSEST = 2.0  # s; longest interval over which the force is averaged to distinguish a jump from noise
_CLOSEST = 0.1  # s; smallest interval of the samples at rest before the rows
_COMPONENTS = 0.5 * np.sqrt(0.75)  # RMS of a quaternion's four components for one radian of rotation per axis


class ReferencePointChange(NamedTuple):
    """A change of the reference point of the position rows: a step at an event, or a movement between two events.

    name : Event or pair of events.
    time : s since lift-off.
    shift : (3,) m. Change of the point, frame i.
    """

    name: str
    time: float
    shift: Floats


class RowFit(NamedTuple):
    """Fit of the rows.

    rows : The rows.
    position : Position spline (m, frame i).
    edges : s. Start of the file, events with a jump of force, end of the file.
    jumps : Changes of the reference point, which are removed from the rows.
    misfit : Position of the spline minus rows: RMS (m), largest (m), and its time (s).
    residuals : Worst contradiction of each part between edges.
    missing : Warning about events that the card does not declare; empty for none.
    """

    rows: TrajectoryRows
    position: BSpline
    edges: list[float]
    jumps: tuple[ReferencePointChange, ...]
    misfit: tuple[float, float, float]
    residuals: tuple[Residual, ...]
    missing: str = ""


def from_table(card: TableTrajectory) -> Trajectory:
    """Return the true trajectory of a user's file.

    Raises
    ------
    InputError
        The file cannot be read or contradicts itself grossly, an event lies outside it, or the flight exceeds a limit
        of the card.
    """
    path = _path_of(card)
    rows, edges, hold = path.rows, path.edges, card.pad_hold
    speed = float(np.linalg.norm(earth_velocity(path.position(edges[0]), path.position(edges[0], 1))))
    if hold > 0.0 and speed > REST:  # only a file that begins at rest can have a pad before it
        raise InputError(
            f"{card.file}: the first row moves at {speed:.3g} m/s over the Earth, so it is not on a pad: set pad_hold "
            f"to 0 s"
        )
    try:
        attitude = _attitude(card, path, hold)
    except InputError as error:
        raise InputError(f"{card.file}: {error}") from None
    pad_e = ecef_from_eci(path.position(edges[0]), earth_angle(rows.theta0, edges[0]))
    phases = [*pad_phase(pad_e, rows.theta0, edges[0], hold, attitude, v_end=path.position(edges[0], 1))]
    marks = _marks(card.events, rows.t)
    for begin, end in pairwise(edges):
        name = next((name for name, time in marks.items() if abs(time - begin) < SAME), "start")
        phases.append(Phase(f"from {name}", begin, end, path.position, attitude))
    flight = Trajectory(tuple(phases), _named_events(marks, card.events), rows.theta0, card.epoch)
    warnings = [path.missing, clock_remark(card, rows), axes_remark(card, rows), _reading_remark(card, path)]
    flight = flight.remarked(NOTE, rows.notes).remarked(WARNING, [text for text in warnings if text])
    flight = within_limits(flight, card, card.file)
    flight.facts.update(_facts(card, path, flight))
    return flight


def _reading_remark(card: TableTrajectory, path: RowFit) -> str:
    """Return the warning that another interpretation of the attitude fits the forces better; InputError as `better`."""
    rows = path.rows
    if rows.q_b_i is None:
        return ""
    r = path.position(rows.t)
    force = path.position(rows.t, 2) - gravity_along(r)
    strong = np.linalg.norm(force, axis=1) > STANDARD_GRAVITY
    return better(card, compared(card, rows.r_i, force, strong))


def undeclared(card: TableTrajectory) -> str:
    """Return the warning about events that jumps of force suggest and the card does not declare; empty for none."""
    return _path_of(card).missing


def suggested(card: TableTrajectory) -> dict[str, str]:
    """Return names and times of the events that a file suggests, in order of time.

    They are jumps of the specific force, and the events of the card, at which the file has two different rows.
    """
    rows = read_rows(card)
    t, force, noise = _rows_force(rows)
    events = suggested_events(t, force, _marks({}, rows.t), _COARSEST, noise)
    near = 2.0 * float(np.median(np.diff(rows.t)))
    for number, time in enumerate(card.events.values(), start=1):
        jumps = (name for name, at in events.items() if abs(parse(at, "s") - time) < near)
        events[next(jumps, f"two_states_{number}")] = f"{time!r} s"
    return dict(sorted(events.items(), key=lambda event: parse(event[1], "s")))


def at_rest(card: TableTrajectory) -> bool:
    """Whether the first row is at rest on the Earth, so that time on the pad may precede it."""
    rows = read_rows(card)
    v_i = (rows.r_i[1] - rows.r_i[0]) / (rows.t[1] - rows.t[0]) if rows.v_i is None else rows.v_i[0]
    return float(np.linalg.norm(earth_velocity(rows.r_i[0], v_i))) <= REST


def residuals(card: TableTrajectory) -> tuple[Residual, ...]:
    """Return the worst contradiction of each part of a file between events; none for a file of positions only."""
    return _path_of(card).residuals


def content_of(file: str) -> str:
    """Return the SHA-256 digest of a file; InputError if it cannot be read."""
    return hashlib.sha256(read_bytes(file, DATA_BYTES)).hexdigest()


def _path_of(card: TableTrajectory) -> RowFit:
    return _cached_fit((card.model_dump_json(), content_of(card.file)), card)


@remembered(4)
def _cached_fit(identity: tuple[str, str], card: TableTrajectory) -> RowFit:
    """Return the fit of a card's file, cached by `identity`: the card and the digest of the file."""
    rows = read_rows(card)
    marks = _marks(card.events, rows.t)
    for name, time in card.events.items():
        if not rows.t[0] - SAME <= time <= rows.t[-1] + SAME:
            raise InputError(
                f"{card.file}: event {name!r} at {time:g} s is outside the rows, {rows.t[0]:g} to {rows.t[-1]:g} s"
            )
    breaks = sorted({time for time in marks.values() if rows.t[0] + SAME < time < rows.t[-1] - SAME})
    breaks = [time for k, time in enumerate(breaks) if k == 0 or time - breaks[k - 1] > SAME]
    edges = [float(rows.t[0]), *breaks, float(rows.t[-1])]
    t, force, noise = _rows_force(rows)
    missing = missing_events(t, force, marks, _COARSEST, noise)
    try:
        path = (_by_position if rows.v_i is None else _by_velocity)(card, rows, edges, marks)
    except InputError as error:
        raise InputError(f"{error}{added(missing)}") from None
    path = path._replace(missing=missing)
    if rows.q_b_i is None:
        return path
    size = _angles(_turning(rows, rows.t, rows.q_b_i)(rows.t), rows.q_b_i)
    return path._replace(residuals=path.residuals + _worst("attitude", rows, edges, lambda here: size[here]))


def _marks(events: Mapping[str, float], t: Floats) -> dict[str, float]:
    """Return the times of the events with those of the file: start, lift-off if the rows contain it, and end."""
    ends = {"start": float(t[0]), "end": float(t[-1])}
    liftoff = {"liftoff": max(0.0, float(t[0]))} if t[0] <= SAME <= t[-1] else {}
    return dict(sorted({**ends, **liftoff, **events}.items(), key=lambda item: item[1]))


def _named_events(marks: Mapping[str, float], events: Mapping[str, float]) -> dict[str, float]:
    """Return the events of the flight. Start and end of the file are omitted at the time of another event."""
    others = [*events.values(), *(time for name, time in marks.items() if name == "liftoff")]
    idle = {name for name in ("start", "end") if any(abs(marks[name] - time) < SAME for time in others)}
    return {name: time for name, time in marks.items() if name not in idle}


def _names_at(marks: Mapping[str, float], begin: float, end: float) -> str:
    return ", ".join(name for name, time in marks.items() if begin < time <= end)


def _by_velocity(card: TableTrajectory, rows: TrajectoryRows, edges: list[float], marks: Mapping[str, float]) -> RowFit:
    """Return the fit whose velocity is a spline through the velocity rows, and whose position is its integral."""
    v_i = np.asarray(rows.v_i)
    velocity = fit(rows.t, v_i, edges[1:-1], 4, rows.noise[1]).spline
    position = velocity.antiderivative()
    position.c = position.c + (rows.r_i[0] - position(rows.t[0]))
    apart = position(rows.t) - rows.r_i
    change = np.diff(apart, axis=0)
    jumps = _moved(card, rows, change, marks) + _stepped(card, rows, change, marks)
    apart = np.concatenate([apart[:1], apart[:1] + np.cumsum(change, axis=0)])
    residuals = _worst("position", rows, edges, lambda here: np.linalg.norm(apart[here] - apart[here[0]], axis=1))
    residuals += _worst(
        "velocity", rows, edges, lambda here: np.linalg.norm(velocity(rows.t[here]) - v_i[here], axis=1)
    )
    in_order = tuple(sorted(jumps, key=lambda jump: jump.time))
    return RowFit(rows, position, edges, in_order, _misfit(rows, apart), residuals)


def _worst(
    what: str, rows: TrajectoryRows, edges: list[float], size: Callable[[NDArray[np.int64]], Floats]
) -> tuple[Residual, ...]:
    """Return the worst residual of each part with two rows or more; `size` returns the residuals at given rows."""
    noise, residuals = rows.noise[("position", "velocity", "attitude").index(what)], []
    for begin, end in pairwise(edges):
        here = np.flatnonzero((rows.t >= begin - SAME) & (rows.t <= end + SAME))
        if here.size > 1:
            sizes = size(here)
            k = int(np.argmax(sizes))
            residuals.append(Residual(what, begin, end, float(rows.t[here[k]]), float(sizes[k]), noise))
    return tuple(residuals)


def _angles(p: Floats, q: Floats) -> Floats:
    """Return the angles (n,) in rad between the attitudes p (n, 4), of any length, and q (n, 4)."""
    return np.asarray(4.0 * np.arcsin(np.minimum(1.0, 0.5 * np.linalg.norm(unit(p) - q, axis=1))))


def _moved(
    card: TableTrajectory, rows: TrajectoryRows, change: Floats, marks: Mapping[str, float]
) -> list[ReferencePointChange]:
    """Remove the declared movements of the reference point from the `change` from row to row (n - 1, 3)."""
    jumps = []
    for first, last in card.moving_reference:
        times = marks.get(first), marks.get(last)
        if times[0] is None or times[1] is None or times[0] >= times[1]:
            raise InputError(f"{card.name}: moving_reference: {first!r} does not come before {last!r} in {card.file}")
        here = (rows.t[1:] > times[0]) & (rows.t[:-1] < times[1])
        # an interval with a step is treated by `_stepped`
        here &= np.linalg.norm(change, axis=1) < card.smallest_jump
        jumps.append(ReferencePointChange(f"{first} to {last}", times[0], -np.sum(change[here], axis=0)))
        change[here] = 0.0
    return jumps


def _stepped(
    card: TableTrajectory, rows: TrajectoryRows, change: Floats, marks: Mapping[str, float]
) -> list[ReferencePointChange]:
    """Remove the steps at events from the `change` from row to row (n - 1, 3); InputError for a step without event."""
    size = np.linalg.norm(change, axis=1)
    jumps = []
    for k in np.flatnonzero(size > card.smallest_jump + 10.0 * rows.noise[0]):
        names = _names_at(marks, rows.t[k], rows.t[k + 1])
        if not names:
            raise InputError(
                f"{card.file}: the position steps by {size[k]:.3g} m beside its velocity between {rows.t[k]:.9g} and "
                f"{rows.t[k + 1]:.9g} s, where no event is declared: is one missing, or a frame or unit wrong?"
            )
        jumps.append(ReferencePointChange(names, float(rows.t[k + 1]), -change[k]))
        change[k] = 0.0
    return jumps


def _by_position(card: TableTrajectory, rows: TrajectoryRows, edges: list[float], marks: Mapping[str, float]) -> RowFit:
    """Return the fit of a spline through the position rows, after removal of large steps at events."""
    breaks, noise = edges[1:-1], rows.noise[0]
    free = fit(rows.t, rows.r_i, breaks, 5, noise, breaks)
    size = np.linalg.norm(free.steps, axis=1)
    kept = [time for time, step in zip(breaks, size, strict=True) if step > card.smallest_jump + 10.0 * noise]
    fitted = fit(rows.t, rows.r_i, breaks, 5, noise, kept)
    names = [_names_at(marks, time - SAME, time + SAME) for time in kept]
    jumps = tuple(ReferencePointChange(*item) for item in zip(names, kept, fitted.steps, strict=True))
    offset = sum((np.outer(rows.t >= jump.time, jump.shift) for jump in jumps), start=np.zeros_like(rows.r_i))
    return RowFit(rows, fitted.spline, edges, jumps, _misfit(rows, fitted.spline(rows.t) + offset - rows.r_i), ())


def _misfit(rows: TrajectoryRows, apart: Floats) -> tuple[float, float, float]:
    size = np.linalg.norm(apart, axis=1)
    k = int(np.argmax(size))
    return float(np.sqrt(np.mean(size**2))), float(size[k]), float(rows.t[k])


def _force(path: RowFit) -> tuple[Floats, Floats]:
    """Return times (n,) within the parts between edges, at most 0.05 s apart, and the specific forces there (n, 3)."""
    edges = path.edges
    t = np.concatenate([np.linspace(a, b, max(8, int((b - a) / 0.05)) + 2)[1:-1] for a, b in pairwise(edges)])
    return t, path.position(t, 2) - gravity_along(path.position(t))


def _rows_force(rows: TrajectoryRows) -> tuple[Floats, Floats, float]:
    """Return times (n,) s, the mean specific force (n - 1,) m/s^2 between them, and one sigma (m/s) of the velocities.

    The velocities are those of the rows, or differences of positions at the times between the rows.
    """
    t, r, v, noise = rows.t, rows.r_i, rows.v_i, rows.noise[1]
    if v is None:
        noise = 2.0 * rows.noise[0] / float(np.median(np.diff(t)))
        v = np.diff(r, axis=0) / np.diff(t)[:, None]
        t, r = 0.5 * (t[1:] + t[:-1]), 0.5 * (r[1:] + r[:-1])
    force = np.diff(v, axis=0) / np.diff(t)[:, None] - gravity_along(0.5 * (r[1:] + r[:-1]))
    return t, np.linalg.norm(force, axis=1), noise


def _turning(rows: TrajectoryRows, t: Floats, q_b_i: Floats) -> BSpline:
    """Return the quaternion spline through rows of attitude q_b_i (n, 4) at t (n,), with the noise of the file."""
    return fit(t, q_b_i, [], 5, rows.noise[2] * _COMPONENTS).spline


def _attitude(card: TableTrajectory, path: RowFit, hold: float) -> BSpline:
    """Return the quaternion spline through the rows of attitude, or else along the path."""
    rows = path.rows
    if rows.q_b_i is None:
        return along_path(path.position, path.edges, rows.theta0, card.pointing, card.roll, hold)
    t, q = rows.t, rows.q_b_i
    if hold > 0.0:
        # same interval as the rows, because the roughness of the spline is weighted by it
        step = min(PAD_STEP, max(_CLOSEST, float(np.median(np.diff(t)))))
        before = pad_times(rows.t[0], hold, step)[:-1]
        axes_e = ecef_from_eci(matrices(q[0]).T, earth_angle(rows.theta0, rows.t[0]))  # the body's axes, by rows
        axes = np.stack([eci_from_ecef(axis, earth_angle(rows.theta0, before)) for axis in axes_e], axis=-1)
        t = np.concatenate([before, t])
        q = quaternions(np.concatenate([axes, matrices(q)]))
    return _turning(rows, t, q)


def _facts(card: TableTrajectory, path: RowFit, flight: Trajectory) -> dict[str, float | str]:
    """Return the facts for the report on the file and its fit, SI; InputError as in `_attitude_facts`."""
    t, force = _force(path)
    jerk = np.linalg.norm(path.position(t, 3), axis=1)
    load = np.linalg.norm(force, axis=1)
    facts: dict[str, float | str] = {
        "file": card.source,
        **achieved(np.concatenate([path.position(path.edges[-1], order) for order in (0, 1)])),
        "max_load_g": float(np.max(load)) / STANDARD_GRAVITY,
        "implied_jerk_worst_m_s3": float(np.max(jerk)),
        "implied_jerk_worst_at_s": float(t[np.argmax(jerk)]),
        "position_misfit_rms_m": path.misfit[0],
        "position_misfit_worst_m": path.misfit[1],
        "position_misfit_worst_at_s": path.misfit[2],
    }
    for number, jump in enumerate(path.jumps, start=1):
        change = f"reference_change_{number}"
        facts |= {change: jump.name, f"{change}_at_s": jump.time, f"{change}_m": float(np.linalg.norm(jump.shift))}
    for what, si_unit in (("position", "m"), ("velocity", "m_s"), ("attitude", "rad")):
        worst = max((r for r in path.residuals if r.what == what), key=lambda residual: residual.size, default=None)
        if worst is not None:
            facts |= {f"residual_{what}_worst_{si_unit}": worst.size, f"residual_{what}_worst_at_s": worst.time}
    strong = load > STANDARD_GRAVITY
    return facts | _attitude_facts(card, path, flight, t[strong], force[strong])


def _attitude_facts(
    card: TableTrajectory, path: RowFit, flight: Trajectory, t: Floats, force: Floats
) -> dict[str, float]:
    """Return the interpolation error of the attitude rows, and the angle of the forces (n, 3) at t from the roll axis.

    InputError if that angle exceeds the limit of the card. Without rows of attitude there are no facts.
    """
    rows = path.rows
    if rows.q_b_i is None:
        return {}
    coarse = _turning(rows, rows.t[::2], rows.q_b_i[::2])
    omitted = slice(1, None if rows.t.size % 2 else -1, 2)  # rows not used by the coarse spline, within its range
    worst = float(np.max(_angles(coarse(rows.t[omitted]), rows.q_b_i[omitted])))
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
