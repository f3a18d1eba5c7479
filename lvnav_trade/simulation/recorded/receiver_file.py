"""Recorded solutions of a receiver: reading, and consistency of positions with velocities and with each other.

Rows without a fix and single impossible rows are omitted and counted. A column that is wrong as a whole (a wrong unit,
two columns exchanged) is refused.
"""

import os
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from lvnav_trade.quantities.data_file import column_names, read_columns, refuse_first, refuse_unordered, time_stamps
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import ecef_from_geodetic, rotation_e_n
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.quantities.units import Card
from lvnav_trade.simulation.recorded.imu_log import time_column

PLACE = ("latitude_deg", "longitude_deg", "height_m")
MOTION = ("v_north_m_s", "v_east_m_s", "v_down_m_s")
SIGMAS = tuple(f"sigma_{part}" for part in ("north_m", "east_m", "down_m", "v_north_m_s", "v_east_m_s", "v_down_m_s"))
FEWEST = 3  # solutions of a log
MOST_WILD = 0.1  # largest fraction of rows omitted as outliers; with more the log contradicts itself
_NAMED = 5  # rows that a note lists
_LOWEST, _HIGHEST = -2e3, 1e9  # m, heights
_FASTEST = 2e4  # m/s
_SMALLEST = np.repeat([1e-4, 1e-5], 3)  # smallest sigmas, m and m/s
_LARGEST = np.repeat([1e5, 1e3], 3)  # largest sigmas, m and m/s
_JUMP = 10.0  # m, threshold of an outlier
_SCATTERS = 15.0  # threshold of an outlier as a multiple of the log's median residual
_UNSEEN = 100.0 / 8.0  # m/s^2; deviation of the path, over dt^2, due to an acceleration of 100 m/s^2 between rows
_WINDOWS = (10.0, 30.0)  # s, lengths of the windows in which positions and velocities are compared
_FEWEST_WINDOWS = 5
_PATH = 30.0  # m, shortest path in a window
_MISSED = 0.3  # residual over path from which velocities contradict positions
_FITS = 0.1  # residual over path below which velocities and positions agree


class ReceiverFile(Card):
    """The file of the receiver's solutions."""

    file: str
    delimiter: str = Field(",", min_length=1, max_length=1)
    noise: Literal["filter", "log"] = Field(
        "filter",
        description="noise that the filter assumes of a solution: filter: that of its card; log: the sigmas of the "
        "file",
    )


class Solutions(NamedTuple):
    """Solutions that are used, m rows.

    file : Name of the file.
    t : (m,) s. Times of the file.
    place : (m, 3) rad, rad, m. Latitude, longitude, height.
    velocity_ned : (m, 3) m/s. Velocity north, east, down.
    sigma : (m, 6) m, m/s. Sigmas of position and velocity; NaN without columns of it.
    lines : (m,). Lines of the file.
    zero : s. Time of the first row of the file.
    notes : Remarks on omitted rows.
    """

    file: str
    t: Floats
    place: Floats
    velocity_ned: Floats
    sigma: Floats
    lines: tuple[str, ...]
    zero: float
    notes: tuple[str, ...] = ()

    def select(self, is_used: Bools, note: str = "") -> "Solutions":
        """Return the rows with `is_used` (m,), with a note on the others; InputError if too few remain."""
        if is_used.all():
            return self
        n_used = np.count_nonzero(is_used)
        if n_used < FEWEST:
            raise InputError(f"{self.file}: {note}; {n_used} are left, a log needs {FEWEST} or more")
        return Solutions(
            file=self.file,
            t=self.t[is_used],
            place=self.place[is_used],
            velocity_ned=self.velocity_ned[is_used],
            sigma=self.sigma[is_used],
            lines=tuple(self.lines[row] for row in np.flatnonzero(is_used)),
            zero=self.zero,
            notes=(*self.notes, note),
        )


def read_solutions(card: ReceiverFile, folder: Path) -> Solutions:
    """Return the consistent solutions of a file; InputError names file, row and error."""
    file = os.fspath(folder / card.file)
    titles = column_names(file, card.delimiter)
    time, scale = time_column(file, titles)
    has_sigmas = all(name in titles for name in SIGMAS)
    if card.noise == "log" and not has_sigmas:
        raise InputError(f"{file}: gnss.noise: log needs the columns {', '.join(SIGMAS)}")
    names: tuple[str, ...] = (*PLACE, *MOTION)
    if has_sigmas:
        names = (*names, *SIGMAS)
    table, places = read_columns(file, [time, *names], card.delimiter, FEWEST, "a log", blanks=names)
    t = time_stamps(table[:, 0], time.rpartition("_")[2], file, places) * scale
    refuse_unordered(t, file, places)
    refuse_impossible(table[:, 1:7], file, places)
    solutions = Solutions(
        file=file,
        t=t,
        place=np.column_stack([np.radians(table[:, 1:3]), table[:, 3]]),
        velocity_ned=table[:, 4:7],
        sigma=table[:, 7:] if has_sigmas else np.full((t.size, 6), np.nan),
        lines=tuple(places),
        zero=float(t[0]),
    )
    solutions = _select_complete(solutions)
    solutions = _select_fixed(solutions)
    if has_sigmas:
        solutions = _check_sigmas(solutions, card.noise == "log")
    return remove_outliers(solutions)


def refuse_impossible(rows: Floats, file: str, places: list[str]) -> None:
    """Raise InputError for the first of the rows (n, 6), in the units of the file, that is impossible."""
    lowest = (-90.0, -360.0, _LOWEST)
    highest = (90.0, 360.0, _HIGHEST)
    for name, column, low, high in zip(PLACE, rows.T, lowest, highest, strict=False):
        is_outside = (column < low) | (column > high)
        for k in np.flatnonzero(is_outside)[:1]:
            value = column[k]
            bound = high if value > high else low
            raise InputError(f"{file}:{places[k]}: {name} is {value:.9g}, beyond {bound:g}; is the unit right?")
    velocities = rows[:, 3:]
    with np.errstate(over="ignore"):  # an infinite speed is refused as well
        speed = np.linalg.norm(velocities, axis=1)
    is_too_fast = speed > _FASTEST
    refuse_first(is_too_fast, file, places, lambda k: f"a speed of {speed[k]:.6g} m/s; is the unit right?")


def _select_complete(solutions: Solutions) -> Solutions:
    """Return the solutions without an empty field of position or velocity."""
    values = np.hstack([solutions.place, solutions.velocity_ned])
    is_complete = np.asarray(np.isfinite(values).all(axis=1))
    note = omission_note(solutions, ~is_complete, "have an empty field")
    return solutions.select(is_complete, note)


def _select_fixed(solutions: Solutions) -> Solutions:
    """Return the solutions that are not at latitude and longitude zero."""
    latitude_and_longitude = solutions.place[:, :2]
    is_at_zero = np.asarray(np.all(latitude_and_longitude == 0.0, axis=1))
    note = omission_note(solutions, is_at_zero, "are at latitude and longitude zero, as of a receiver without a fix")
    return solutions.select(np.logical_not(is_at_zero), note)


def omission_note(solutions: Solutions, is_omitted: Bools, reason: str) -> str:
    """Return the note on omitted rows (m,)."""
    lines = [solutions.lines[k] for k in np.flatnonzero(is_omitted)]
    n_omitted = len(lines)
    first_lines = ", ".join(lines[:_NAMED])
    if n_omitted > _NAMED:
        first_lines += ", ..."
    file = os.path.basename(solutions.file)
    return f"{n_omitted} of {is_omitted.size} solutions {reason}: left out ({file}:{first_lines})"


def _check_sigmas(solutions: Solutions, sigmas_used: bool) -> Solutions:
    """Return the solutions with possible sigmas, or all of them if sigmas are not used."""
    if not sigmas_used:
        has_no_sigma = (solutions.sigma <= 0.0).any(axis=1)
        if not has_no_sigma.any():
            return solutions
        n_without_sigma = np.count_nonzero(has_no_sigma)
        note = f"sigmas of {n_without_sigma} of {has_no_sigma.size} solutions are not above zero; they are not used"
        return solutions._replace(notes=(*solutions.notes, note))
    is_possible = (solutions.sigma >= _SMALLEST) & (solutions.sigma <= _LARGEST)
    wrong = ~is_possible
    wrong_rows = np.asarray(wrong.any(axis=1))
    if np.count_nonzero(wrong_rows) > 0.5 * wrong_rows.size:
        row = int(np.argmax(wrong_rows))
        column = int(np.argmax(wrong[row]))
        sigma = solutions.sigma[row, column]
        place = f"{solutions.file}:{solutions.lines[row]}"
        limits = f"from {_SMALLEST[column]:g} to {_LARGEST[column]:g}"
        raise InputError(
            f"{place}: {SIGMAS[column]} is {sigma:g}; a sigma is {limits} (gnss.noise: filter takes the noise of the "
            "filter's card)"
        )
    note = omission_note(solutions, wrong_rows, "have a sigma that is not above zero, or empty or too large")
    return solutions.select(np.logical_not(wrong_rows), note)


# --- positions against velocities -------------------------------------------------------------------------------------


def remove_outliers(solutions: Solutions) -> Solutions:
    """Return the solutions without outliers; InputError if positions and velocities of the log are inconsistent."""
    r_e, v_e = _earth_fixed(solutions.place, solutions.velocity_ned)
    is_on_path, worst = _path_rows(solutions.t, r_e, v_e)
    is_omitted = np.logical_not(is_on_path)
    n_omitted = np.count_nonzero(is_omitted)
    if n_omitted <= max(1.0, MOST_WILD * is_omitted.size):
        reason = f"contradict the positions and velocities of the rows around them, by up to {_length(worst)}"
        note = omission_note(solutions, is_omitted, reason)
        solutions = solutions.select(is_on_path, note)
        _refuse_contradiction(solutions)
        return solutions
    _refuse_contradiction(solutions)
    is_edge = is_on_path[1:] != is_on_path[:-1]
    k = int(np.argmax(is_edge)) + 1  # first row at which the consistent run begins or ends
    raise InputError(
        f"{solutions.file}:{solutions.lines[k]}: the position is not where the rows before and their velocities lead; "
        f"{n_omitted} of {is_omitted.size} solutions so, by up to {_length(worst)}"
    )


def _length(size: float) -> str:
    return f"{size * 1e-3:.4g} km" if size >= 1e3 else f"{size:.3g} m"


def _earth_fixed(place: Floats, velocity_ned: Floats) -> tuple[Floats, Floats]:
    latitude = place[:, 0]
    longitude = place[:, 1]
    C_e_n = rotation_e_n(latitude, longitude)
    v_e = np.einsum("kji,kj->ki", C_e_n, velocity_ned)
    r_e = ecef_from_geodetic(*place.T)
    return r_e, v_e


def _path_rows(t: Floats, r_e: Floats, v_e: Floats) -> tuple[Bools, float]:
    """Return which rows (m,) lie on the path through the longest run of consistent rows.

    The second result is the largest distance (m) of another row from that path.
    """
    dt = np.diff(t)
    mean_velocities = 0.5 * (v_e[1:] + v_e[:-1])
    predicted_displacements = mean_velocities * dt[:, None]
    displacements = np.diff(r_e, axis=0)
    distances = np.linalg.norm(displacements - predicted_displacements, axis=1)
    typical_distance = float(np.median(distances))
    distance_limit = max(_JUMP, _SCATTERS * typical_distance)

    def excess(i: int, j: int) -> float:
        """Return the distance (m) of row j from the path from row i, less the allowed distance; negative: it fits."""
        step = t[j] - t[i]
        mean_velocity = 0.5 * (v_e[i] + v_e[j])
        predicted_displacement = mean_velocity * step
        displacement = r_e[j] - r_e[i]
        distance = float(np.linalg.norm(displacement - predicted_displacement))
        unseen_distance = _UNSEEN * step**2
        return distance - distance_limit - unseen_distance

    unseen_distances = _UNSEEN * dt**2
    bad = distances > distance_limit + unseen_distances
    later_edges = np.flatnonzero(bad) + 1
    edges = [0, *later_edges.tolist(), t.size]
    runs = [range(begin, end) for begin, end in pairwise(edges)]
    longest = max(range(len(runs)), key=lambda k: len(runs[k]))
    longest_run = runs[longest]
    is_on_path = np.zeros(t.size, dtype=bool)
    is_on_path[list(longest_run)] = True
    worst = 0.0
    # runs after the longest in rising order, then runs before it in falling order: row next to the path, row at its end
    runs_after = runs[longest + 1 :]
    runs_before = reversed(runs[:longest])
    later_runs = [(run[0], run[-1], run) for run in runs_after]
    earlier_runs = [(run[-1], run[0], run) for run in runs_before]
    for path_end, neighbours in ((longest_run[-1], later_runs), (longest_run[0], earlier_runs)):
        last = path_end
        for near, far, run in neighbours:
            excess_distance = excess(last, near)
            if excess_distance <= 0.0:
                is_on_path[list(run)] = True
                last = far
            else:
                worst = max(worst, excess_distance + distance_limit)
    return is_on_path, worst


_Change = Callable[[Floats, Floats], tuple[Floats, Floats]]


def _velocity_scaling(factor: float) -> _Change:
    return lambda place, moving: (place, moving * factor)


_READINGS: tuple[tuple[str, _Change], ...] = (
    ("v_north_m_s and v_east_m_s exchanged", lambda p, v: (p, v[:, [1, 0, 2]])),
    ("v_down_m_s counted upwards", lambda p, v: (p, v * [1.0, 1.0, -1.0])),
    ("velocities of the opposite sign", _velocity_scaling(-1.0)),
    ("velocities in km/h", _velocity_scaling(1.0 / 3.6)),
    ("velocities in knots", _velocity_scaling(1852.0 / 3600.0)),
    ("velocities in ft/s", _velocity_scaling(0.3048)),
    ("velocities in cm/s", _velocity_scaling(0.01)),
    ("velocities in mm/s", _velocity_scaling(0.001)),
    ("velocities in km/s", _velocity_scaling(1000.0)),
    ("latitude_deg and longitude_deg exchanged", lambda p, v: (p[:, [1, 0, 2]], v)),
    ("longitude_deg counted to the west", lambda p, v: (p * [1.0, -1.0, 1.0], v)),
    ("latitude_deg and longitude_deg in rad", lambda p, v: (np.column_stack([np.degrees(p[:, :2]), p[:, 2]]), v)),
    ("height_m in ft", lambda p, v: (p * [1.0, 1.0, 0.3048], v)),
    ("height_m in km", lambda p, v: (p * [1.0, 1.0, 1000.0], v)),
)


def _refuse_contradiction(solutions: Solutions) -> None:
    """Raise InputError if positions and velocities disagree, in the whole log or along an axis.

    The message offers the interpretation of the columns, if any, with which they agree.
    """
    misses = _path_misses(solutions.t, solutions.place, solutions.velocity_ned)
    axis = int(np.argmax(misses)) if misses.size else 0
    if not misses.size or misses[axis] <= _MISSED:
        return
    fits = []
    for name, change in _READINGS:
        place, velocity_ned = change(solutions.place, solutions.velocity_ned)
        latitude = place[:, 0]
        if np.abs(latitude).max() <= 0.5 * np.pi:
            candidate_misses = _path_misses(solutions.t, place, velocity_ned)
            if candidate_misses.size and candidate_misses.max() <= _FITS:
                largest_miss = float(candidate_misses.max())
                fits.append((largest_miss, name))
    hint = f"with {min(fits)[1]} they fit: is that so?" if fits else "is a unit, an axis or a time wrong?"
    contradiction = "positions contradict the velocities"
    if axis > 0:
        contradiction = f"{MOTION[axis - 1]} contradicts the positions"
    percent = 100.0 * misses[axis]
    raise InputError(f"{solutions.file}: {contradiction}: they miss the path by {percent:.0f} % of it; {hint}")


def _path_misses(t: Floats, place: Floats, velocity_ned: Floats) -> Floats:
    """Return the difference of integrated velocities and positions over the path, as a median over windows.

    Parameters
    ----------
    t
        (m,) s.
    place
        (m, 3) rad, rad, m. Latitude, longitude, height.
    velocity_ned
        (m, 3) m/s. Velocity, north, east and down.

    Returns
    -------
    ndarray
        (4,). For the whole vector and for the axes north, east and down, 0 for an axis without motion. It is empty if
        the vehicle moves in too few windows.
    """
    r_e, v_e = _earth_fixed(place, velocity_ned)
    dt = np.diff(t)
    mean_velocities = 0.5 * (v_e[1:] + v_e[:-1])
    steps = mean_velocities * dt[:, None]
    displacements = np.diff(r_e, axis=0)
    origin = np.zeros(3)
    by_velocity = np.vstack([origin, np.cumsum(steps, axis=0)])
    by_position = np.vstack([origin, np.cumsum(displacements, axis=0)])
    step_lengths = np.linalg.norm(steps, axis=1)
    path_length = np.concatenate([[0.0], np.cumsum(step_lengths)])
    for span in _WINDOWS:
        first, last = _windows(t, span)
        moved_v = by_velocity[last] - by_velocity[first]
        moved_r = by_position[last] - by_position[first]
        path_by_velocity = path_length[last] - path_length[first]
        path_by_position = np.linalg.norm(moved_r, axis=1)
        path = np.maximum(path_by_velocity, path_by_position)
        moves = path >= _PATH
        if np.count_nonzero(moves) < _FEWEST_WINDOWS:
            continue
        start = place[first[moves]]
        C_e_n = rotation_e_n(start[:, 0], start[:, 1])
        moved_r = moved_r[moves]
        moved_v = moved_v[moves]
        miss = moved_r - moved_v
        relative_miss = np.linalg.norm(miss, axis=1) / path[moves]
        vector_miss = np.median(relative_miss)
        axis_misses = _axis_misses(C_e_n, moved_v, moved_r, miss)
        return np.append(vector_miss, axis_misses)
    return np.zeros(0)


def _axis_misses(C_e_n: Floats, moved_v: Floats, moved_r: Floats, miss: Floats) -> Floats:
    """Return the miss divided by the path along north, east, down (3,), as a median over windows; 0 without motion.

    Parameters
    ----------
    C_e_n
        (n, 3, 3). Rotation from Earth axes to north, east, down at the start of each window.
    moved_v, moved_r
        (n, 3) m. Displacements by velocities and by positions, Earth axes.
    miss
        (n, 3) m. Their difference.
    """
    v_n = np.abs(np.einsum("kij,kj->ki", C_e_n, moved_v))
    r_n = np.abs(np.einsum("kij,kj->ki", C_e_n, moved_r))
    miss_n = np.abs(np.einsum("kij,kj->ki", C_e_n, miss))
    path_n = np.maximum(v_n, r_n)
    relative_miss = miss_n / np.maximum(path_n, 1e-9)
    median_miss = np.median(relative_miss, axis=0)
    moves = np.median(path_n, axis=0) >= _PATH
    return np.where(moves, median_miss, 0.0)


def _windows(t: Floats, span: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return first and last rows of windows of about `span` s, half a window apart, without gaps in them."""
    dt = np.diff(t)
    typical_interval = float(np.median(dt))
    is_gap = dt > max(2.0, 3.0 * typical_interval)
    n_gap = np.concatenate([[0], np.cumsum(is_gap)])
    last_start = t[-1] - span
    grid = np.arange(t[0], last_start, 0.5 * span)
    starts = np.searchsorted(t, grid)
    ends = np.searchsorted(t, t[starts] + span)
    ends = np.minimum(ends, t.size - 1)
    is_without_gap = n_gap[ends] == n_gap[starts]
    gapless = (ends > starts) & is_without_gap
    return starts[gapless], ends[gapless]
