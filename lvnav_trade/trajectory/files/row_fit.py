"""Fit of a user's rows: position spline, jumps of the reference point, and the contradictions of the file."""

import hashlib
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from lvnav_trade.kernels.earth import gravity_along
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import unit
from lvnav_trade.quantities.input_files import read_bytes
from lvnav_trade.quantities.input_limits import DATA_BYTES
from lvnav_trade.quantities.reads import result_cache
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.discontinuities import missing_events
from lvnav_trade.trajectory.files.columns import TableTrajectory
from lvnav_trade.trajectory.files.contradiction import Residual, message_suffix
from lvnav_trade.trajectory.files.row_checks import SAME
from lvnav_trade.trajectory.files.rows import TrajectoryRows, read_rows
from lvnav_trade.trajectory.files.splines import fit

COARSEST = 2.0
"""Longest interval (s) over which the force is averaged to distinguish a jump from noise."""
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
    event_warning : Warning about events that the card does not declare; empty for none.
    """

    rows: TrajectoryRows
    position: BSpline
    edges: list[float]
    jumps: tuple[ReferencePointChange, ...]
    misfit: tuple[float, float, float]
    residuals: tuple[Residual, ...]
    event_warning: str = ""


def row_fit(card: TableTrajectory) -> RowFit:
    """Return the fit of a card's file.

    Raises
    ------
    InputError
        The file cannot be read, contradicts itself grossly, or an event lies outside it.
    """
    identity = (card.model_dump_json(), file_digest(card.file))
    return _cached_fit(identity, card)


def file_digest(file: str) -> str:
    """Return the SHA-256 digest of a file; InputError if it cannot be read."""
    return hashlib.sha256(read_bytes(file, DATA_BYTES)).hexdigest()


@result_cache(4)
def _cached_fit(identity: tuple[str, str], card: TableTrajectory) -> RowFit:
    """Return the fit of a card's file, cached by `identity`: the card and the digest of the file."""
    rows = read_rows(card)
    marks = event_marks(card.events, rows.t)
    for name, time in card.events.items():
        if not rows.t[0] - SAME <= time <= rows.t[-1] + SAME:
            raise InputError(
                f"{card.file}: event {name!r} at {time:g} s is outside the rows, {rows.t[0]:g} to {rows.t[-1]:g} s"
            )
    edges = _edges(marks, rows.t)
    t, force, noise = mean_forces(rows)
    event_warning = missing_events(t, force, marks, COARSEST, noise)
    try:
        path = (
            _fit_positions(card, rows, edges, marks) if rows.v_i is None else _fit_velocities(card, rows, edges, marks)
        )
    except InputError as error:
        raise InputError(f"{error}{message_suffix(event_warning)}") from None
    path = path._replace(event_warning=event_warning)
    if rows.q_b_i is None:
        return path
    attitude = attitude_fit(rows, rows.t, rows.q_b_i)
    fitted_q = attitude(rows.t)
    size = angles_between(fitted_q, rows.q_b_i)
    worst = _worst_residuals("attitude", rows, edges, lambda indices: size[indices])
    return path._replace(residuals=path.residuals + worst)


def event_marks(events: Mapping[str, float], t: Floats) -> dict[str, float]:
    """Return the times of the events with those of the file: start, lift-off if the rows contain it, and end."""
    first_t, last_t = float(t[0]), float(t[-1])
    marks = {"start": first_t, "end": last_t}
    if first_t <= SAME <= last_t:
        marks["liftoff"] = max(0.0, first_t)
    all_marks = {**marks, **events}
    return dict(sorted(all_marks.items(), key=lambda item: item[1]))


def _edges(marks: Mapping[str, float], t: Floats) -> list[float]:
    """Return start, events and end of the rows in order; events within `SAME` of the previous event are omitted."""
    edges = [float(t[0])]
    previous = None
    earliest, latest = t[0] + SAME, t[-1] - SAME
    inner_times = {time for time in marks.values() if earliest < time < latest}
    for time in sorted(inner_times):
        if previous is None or time - previous > SAME:
            edges.append(time)
        previous = time
    return [*edges, float(t[-1])]


def _event_names(marks: Mapping[str, float], begin: float, end: float) -> str:
    """Return the names of the events between two times (s)."""
    names = []
    for name, time in marks.items():
        if begin < time <= end:
            names.append(name)
    return ", ".join(names)


def _fit_velocities(
    card: TableTrajectory, rows: TrajectoryRows, edges: list[float], marks: Mapping[str, float]
) -> RowFit:
    """Return the fit whose velocity is a spline through the velocity rows, and whose position is its integral.

    edges : s. Ends of the parts between events.
    marks : s. Times of the events by name.
    """
    v_i = np.asarray(rows.v_i)
    velocity = fit(rows.t, v_i, edges[1:-1], 4, rows.noise[1]).spline
    position = velocity.antiderivative()
    initial_position = rows.r_i[0] - position(rows.t[0])
    position.c = position.c + initial_position
    difference = position(rows.t) - rows.r_i
    change = np.diff(difference, axis=0)  # from row to row: motion of the reference point, and contradictions
    jumps = _remove_movements(card, rows, change, marks)
    jumps += _remove_steps(card, rows, change, marks)
    first_difference = difference[:1]
    later_differences = first_difference + np.cumsum(change, axis=0)
    difference = np.concatenate([first_difference, later_differences])

    def position_residuals(indices: NDArray[np.int64]) -> Floats:
        residual = difference[indices] - difference[indices[0]]
        return np.asarray(np.linalg.norm(residual, axis=1))

    def velocity_residuals(indices: NDArray[np.int64]) -> Floats:
        residual = velocity(rows.t[indices]) - v_i[indices]
        return np.asarray(np.linalg.norm(residual, axis=1))

    residuals = _worst_residuals("position", rows, edges, position_residuals)
    residuals += _worst_residuals("velocity", rows, edges, velocity_residuals)
    return RowFit(
        rows=rows,
        position=position,
        edges=edges,
        jumps=tuple(sorted(jumps, key=lambda jump: jump.time)),
        misfit=_misfit(rows, difference),
        residuals=residuals,
    )


def _fit_positions(
    card: TableTrajectory, rows: TrajectoryRows, edges: list[float], marks: Mapping[str, float]
) -> RowFit:
    """Return the fit of a spline through the position rows, after removal of large steps at events.

    edges : s. Ends of the parts between events.
    marks : s. Times of the events by name.
    """
    breaks, noise = edges[1:-1], rows.noise[0]
    with_all_steps = fit(rows.t, rows.r_i, breaks, 5, noise, breaks)
    sizes = np.linalg.norm(with_all_steps.steps, axis=1)
    step_times = []
    for time, size in zip(breaks, sizes, strict=True):
        if size > card.smallest_jump + 10.0 * noise:
            step_times.append(time)
    spline_fit = fit(rows.t, rows.r_i, breaks, 5, noise, step_times)
    jumps = []
    offset = np.zeros_like(rows.r_i)
    for time, shift in zip(step_times, spline_fit.steps, strict=True):
        names = _event_names(marks, time - SAME, time + SAME)
        jumps.append(ReferencePointChange(name=names, time=time, shift=shift))
        offset = offset + np.outer(rows.t >= time, shift)
    difference = spline_fit.spline(rows.t) + offset - rows.r_i
    return RowFit(
        rows=rows,
        position=spline_fit.spline,
        edges=edges,
        jumps=tuple(jumps),
        misfit=_misfit(rows, difference),
        residuals=(),
    )


def _worst_residuals(
    quantity: str, rows: TrajectoryRows, edges: list[float], size: Callable[[NDArray[np.int64]], Floats]
) -> tuple[Residual, ...]:
    """Return the worst residual of each part with two rows or more.

    Parameters
    ----------
    quantity : {"position", "velocity", "attitude"}
        Quantity of the residuals.
    rows : TrajectoryRows
        Rows of the file, with their noise.
    edges : list of float
        Ends of the parts (s).
    size : callable
        Function of row numbers (m,) that returns the residuals (m,), SI.
    """
    noise = rows.noise[("position", "velocity", "attitude").index(quantity)]
    residuals = []
    for begin, end in pairwise(edges):
        indices = np.flatnonzero((rows.t >= begin - SAME) & (rows.t <= end + SAME))
        if indices.size < 2:
            continue
        sizes = size(indices)
        worst = int(np.argmax(sizes))
        residuals.append(
            Residual(
                quantity=quantity,
                start=begin,
                end=end,
                time=float(rows.t[indices[worst]]),
                size=float(sizes[worst]),
                noise=noise,
            )
        )
    return tuple(residuals)


def angles_between(p: Floats, q: Floats) -> Floats:
    """Return the angles (n,) in rad between the attitudes p (n, 4), of any length, and q (n, 4).

    Unit quaternions that differ by an angle a are 2 sin(a / 4) apart.
    """
    distance = np.linalg.norm(unit(p) - q, axis=1)
    sine = np.minimum(1.0, 0.5 * distance)  # of a quarter of the angle
    return np.asarray(4.0 * np.arcsin(sine))


def _remove_movements(
    card: TableTrajectory, rows: TrajectoryRows, change: Floats, marks: Mapping[str, float]
) -> list[ReferencePointChange]:
    """Remove the declared movements of the reference point, in place, and return them.

    change : (n - 1, 3) m. Change of the difference of position from row to row; zeroed within the movements.
    marks : s. Times of the events by name.

    InputError if a movement does not begin before its end.
    """
    jumps = []
    for first, last in card.moving_reference:
        begin, end = marks.get(first), marks.get(last)
        if begin is None or end is None or begin >= end:
            raise InputError(f"{card.name}: moving_reference: {first!r} does not come before {last!r} in {card.file}")
        ends_after_begin = rows.t[1:] > begin
        begins_before_end = rows.t[:-1] < end
        is_inside = ends_after_begin & begins_before_end
        # an interval with a step is treated by `_remove_steps`
        is_inside &= np.linalg.norm(change, axis=1) < card.smallest_jump
        shift = -np.sum(change[is_inside], axis=0)
        jumps.append(ReferencePointChange(name=f"{first} to {last}", time=begin, shift=shift))
        change[is_inside] = 0.0
    return jumps


def _remove_steps(
    card: TableTrajectory, rows: TrajectoryRows, change: Floats, marks: Mapping[str, float]
) -> list[ReferencePointChange]:
    """Remove the steps of position at events, in place, and return them; InputError for a step without event.

    change : (n - 1, 3) m. Change of the difference of position from row to row; zeroed at the steps.
    marks : s. Times of the events by name.
    """
    size = np.linalg.norm(change, axis=1)
    jumps = []
    for k in np.flatnonzero(size > card.smallest_jump + 10.0 * rows.noise[0]):
        names = _event_names(marks, rows.t[k], rows.t[k + 1])
        if not names:
            raise InputError(
                f"{card.file}: the position steps by {size[k]:.3g} m more than its velocity between {rows.t[k]:.9g} "
                f"and {rows.t[k + 1]:.9g} s, where no event is declared: is one missing, or a frame or unit wrong?"
            )
        jump_time = float(rows.t[k + 1])
        jumps.append(ReferencePointChange(name=names, time=jump_time, shift=-change[k]))
        change[k] = 0.0
    return jumps


def _misfit(rows: TrajectoryRows, difference: Floats) -> tuple[float, float, float]:
    """Return RMS and largest length of differences (n, 3) m, and the time (s) of the largest."""
    size = np.linalg.norm(difference, axis=1)
    worst = int(np.argmax(size))
    mean_square = np.mean(size**2)
    rms = float(np.sqrt(mean_square))
    return rms, float(size[worst]), float(rows.t[worst])


def path_forces(path: RowFit) -> tuple[Floats, Floats]:
    """Return times (n,) within the parts between edges, at most 0.05 s apart, and the specific forces there (n, 3)."""
    times = []
    for begin, end in pairwise(path.edges):
        n_interval = max(8, int((end - begin) / 0.05))
        even_t = np.linspace(begin, end, n_interval + 2)
        times.append(even_t[1:-1])
    t = np.concatenate(times)
    acceleration = path.position(t, 2)
    gravity = gravity_along(path.position(t))
    return t, acceleration - gravity


def mean_forces(rows: TrajectoryRows) -> tuple[Floats, Floats, float]:
    """Return times (n,) s, the mean specific force (n - 1,) m/s^2 between them, and one sigma (m/s) of the velocities.

    The velocities are those of the rows, or differences of positions at the times between the rows.
    """
    t, r, v = rows.t, rows.r_i, rows.v_i
    noise = rows.noise[1]
    if v is None:
        interval = np.diff(t)
        median_interval = float(np.median(interval))
        noise = 2.0 * rows.noise[0] / median_interval
        v = np.diff(r, axis=0) / interval[:, None]
        t = _midpoints(t)
        r = _midpoints(r)
    velocity_gain = np.diff(v, axis=0)
    acceleration = velocity_gain / np.diff(t)[:, None]
    gravity = gravity_along(_midpoints(r))
    force = acceleration - gravity
    return t, np.linalg.norm(force, axis=1), noise


def _midpoints(values: Floats) -> Floats:
    """Return the means of successive values."""
    previous_values = values[:-1]
    next_values = values[1:]
    return np.asarray(0.5 * (next_values + previous_values))


def attitude_fit(rows: TrajectoryRows, t: Floats, q_b_i: Floats) -> BSpline:
    """Return the quaternion spline through rows of attitude, smoothed by the noise of the file.

    rows : rows of the file, for their noise
    t : (n,) s. Times.
    q_b_i : (n, 4). Quaternions from body to frame i, scalar first, of continuous sign.
    """
    component_noise = rows.noise[2] * _COMPONENTS
    return fit(t, q_b_i, [], 5, component_noise).spline
