"""Recorded solutions of a receiver: reading, and consistency of positions with velocities and with each other.

Rows without a fix and single impossible rows are omitted and counted. A column that is wrong as a whole (a wrong unit,
two columns exchanged) is refused.
"""

import os
from collections.abc import Callable
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
_LOWEST, _HIGHEST, _FASTEST = -2e3, 1e9, 2e4  # m, m, m/s
_SMALLEST = np.repeat([1e-4, 1e-5], 3)
_LARGEST = np.repeat([1e5, 1e3], 3)  # sigmas, m and m/s
_JUMP, _SCATTERS = 10.0, 15.0  # m, and median residuals of the log: thresholds of an outlier
_UNSEEN = 100.0 / 8.0  # m/s^2; deviation of the path, over dt^2, due to an acceleration of 100 m/s^2 between rows
_WINDOWS = (10.0, 30.0)
_FEWEST_WINDOWS = 5
_PATH = 30.0  # s; number; m, shortest path in a window
_MISSED, _FITS = 0.3, 0.1  # residual over path from which velocities contradict positions, and below which they agree


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
    moving : (m, 3) m/s. Velocity north, east, down.
    sigma : (m, 6) m, m/s. Sigmas of position and velocity; NaN without columns of it.
    lines : (m,). Lines of the file.
    zero : s. Time of the first row of the file.
    notes : Remarks on omitted rows.
    """

    file: str
    t: Floats
    place: Floats
    moving: Floats
    sigma: Floats
    lines: tuple[str, ...]
    zero: float
    notes: tuple[str, ...] = ()

    def only(self, used: Bools, note: str = "") -> "Solutions":
        """Return the rows with `used` (m,), with a note on the others; InputError if too few remain."""
        if used.all():
            return self
        if np.count_nonzero(used) < FEWEST:
            raise InputError(f"{self.file}: {note}; {np.count_nonzero(used)} are left, a log needs {FEWEST} or more")
        lines = tuple(line for line, kept in zip(self.lines, used, strict=True) if kept)
        t, place, moving, sigma = (part[used] for part in (self.t, self.place, self.moving, self.sigma))
        return Solutions(self.file, t, place, moving, sigma, lines, self.zero, (*self.notes, note))


def read_solutions(card: ReceiverFile, folder: Path) -> Solutions:
    """Return the consistent solutions of a file; InputError names file, row and error."""
    file = os.fspath(folder / card.file)
    titles = column_names(file, card.delimiter)
    time, scale = time_column(file, titles)
    stated = all(name in titles for name in SIGMAS)
    if card.noise == "log" and not stated:
        raise InputError(f"{file}: gnss.noise: log needs the columns {', '.join(SIGMAS)}")
    names = [time, *PLACE, *MOTION, *(SIGMAS if stated else ())]
    table, places = read_columns(file, names, card.delimiter, FEWEST, "a log", blanks=tuple(names[1:]))
    t = time_stamps(table[:, 0], time.rpartition("_")[2], file, places) * scale
    refuse_unordered(t, file, places)
    refuse_impossible(table[:, 1:7], file, places)
    sigma = table[:, 7:] if stated else np.full((t.size, 6), np.nan)
    place = np.column_stack([np.radians(table[:, 1:3]), table[:, 3]])
    solutions = Solutions(file, t, place, table[:, 4:7], sigma, tuple(places), float(t[0]))
    solutions = solutions.only(*_complete(solutions))
    solutions = solutions.only(*_fixed(solutions))
    if stated:
        solutions = _weighed(solutions, card.noise == "log")
    return consistent(solutions)


def refuse_impossible(rows: Floats, file: str, places: list[str]) -> None:
    """Raise InputError for the first of the rows (n, 6), in the units of the file, that is impossible."""
    for name, column, low, high in zip(PLACE, rows.T, (-90.0, -360.0, _LOWEST), (90.0, 360.0, _HIGHEST), strict=False):
        for k in np.flatnonzero((column < low) | (column > high))[:1]:
            bound = high if column[k] > high else low
            raise InputError(f"{file}:{places[k]}: {name} is {column[k]:.9g}, beyond {bound:g}; is the unit right?")
    with np.errstate(over="ignore"):  # an infinite speed is refused as well
        speed = np.linalg.norm(rows[:, 3:], axis=1)
    refuse_first(speed > _FASTEST, file, places, lambda k: f"a speed of {speed[k]:.6g} m/s; is the unit right?")


def _complete(solutions: Solutions) -> tuple[Bools, str]:
    full = np.asarray(np.isfinite(np.hstack([solutions.place, solutions.moving])).all(axis=1))
    return full, left_out(solutions, ~full, "have an empty field")


def _fixed(solutions: Solutions) -> tuple[Bools, str]:
    none = np.asarray(np.all(solutions.place[:, :2] == 0.0, axis=1))
    return np.logical_not(none), left_out(
        solutions, none, "are at latitude and longitude zero, as of a receiver without a fix"
    )


def left_out(solutions: Solutions, gone: Bools, why: str) -> str:
    """Return the note on omitted rows `gone` (m,)."""
    which = [solutions.lines[k] for k in np.flatnonzero(gone)]
    named = ", ".join(which[:_NAMED]) + (", ..." if len(which) > _NAMED else "")
    place = f"{os.path.basename(solutions.file)}:{named}"
    return f"{len(which)} of {gone.size} solutions {why}: left out ({place})"


def _weighed(solutions: Solutions, used: bool) -> Solutions:
    """Return the solutions with possible sigmas, or all of them if sigmas are not used."""
    wrong = ~((solutions.sigma >= _SMALLEST) & (solutions.sigma <= _LARGEST))
    rows = np.asarray(wrong.any(axis=1))
    if not used:
        below = (solutions.sigma <= 0.0).any(axis=1)
        note = f"sigmas of {np.count_nonzero(below)} of {below.size} solutions are not above zero; they are not used"
        return solutions._replace(notes=(*solutions.notes, note)) if below.any() else solutions
    if np.count_nonzero(rows) > 0.5 * rows.size:
        k = int(np.argmax(rows))
        at = int(np.argmax(wrong[k]))
        limits = f"from {_SMALLEST[at]:g} to {_LARGEST[at]:g}"
        raise InputError(
            f"{solutions.file}:{solutions.lines[k]}: {SIGMAS[at]} is {solutions.sigma[k, at]:g}; a sigma is {limits} "
            f"(gnss.noise: filter takes the noise of the filter's card)"
        )
    return solutions.only(
        np.logical_not(rows), left_out(solutions, rows, "have a sigma that is not above zero, or empty or too large")
    )


# --- positions against velocities -------------------------------------------------------------------------------------


def consistent(solutions: Solutions) -> Solutions:
    """Return the solutions without outliers; InputError if positions and velocities of the log are inconsistent."""
    r_e, v_e = _earth_fixed(solutions.place, solutions.moving)
    used, worst = _on_path(solutions.t, r_e, v_e)
    gone = np.logical_not(used)
    if np.count_nonzero(gone) <= max(1.0, MOST_WILD * gone.size):
        why = f"contradict the positions and velocities of the rows around them, by up to {_length(worst)}"
        solutions = solutions.only(used, left_out(solutions, gone, why))
        _refuse_contradiction(solutions)
        return solutions
    _refuse_contradiction(solutions)
    k = int(np.argmax(used[1:] != used[:-1])) + 1  # first row at which the consistent run begins or ends
    raise InputError(
        f"{solutions.file}:{solutions.lines[k]}: the position is not where the rows before and their velocities lead; "
        f"{np.count_nonzero(gone)} of {gone.size} solutions so, by up to {_length(worst)}"
    )


def _length(size: float) -> str:
    return f"{size * 1e-3:.4g} km" if size >= 1e3 else f"{size:.3g} m"


def _earth_fixed(place: Floats, moving: Floats) -> tuple[Floats, Floats]:
    v_e = np.einsum("kji,kj->ki", rotation_e_n(place[:, 0], place[:, 1]), moving)
    return ecef_from_geodetic(*place.T), v_e


def _on_path(t: Floats, r_e: Floats, v_e: Floats) -> tuple[Bools, float]:
    """Return which rows (m,) lie on the path through the longest run of consistent rows.

    The second result is the largest distance (m) of another row from that path.
    """
    dt = np.diff(t)
    misses = np.linalg.norm(np.diff(r_e, axis=0) - 0.5 * (v_e[1:] + v_e[:-1]) * dt[:, None], axis=1)
    allowed = max(_JUMP, _SCATTERS * float(np.median(misses)))

    def miss(i: int, j: int) -> float:
        """Return the distance (m) of row j from the path from row i, less the allowed distance; negative: it fits."""
        lag = abs(t[j] - t[i])
        led = 0.5 * (v_e[i] + v_e[j]) * (t[j] - t[i])
        return float(np.linalg.norm(r_e[j] - r_e[i] - led)) - allowed - _UNSEEN * lag**2

    bad = misses > allowed + _UNSEEN * dt**2
    edges = np.concatenate([[0], np.flatnonzero(bad) + 1, [t.size]])
    runs = [range(a, b) for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)]
    main = max(range(len(runs)), key=lambda k: len(runs[k]))
    used = np.zeros(t.size, dtype=bool)
    worst = 0.0
    used[list(runs[main])] = True
    for order, end in ((runs[main + 1 :], runs[main][-1]), (runs[:main][::-1], runs[main][0])):
        last = end
        for run in order:
            near, far = (run[0], run[-1]) if run[0] > last else (run[-1], run[0])
            if (beyond := miss(last, near)) <= 0.0:
                used[list(run)] = True
                last = far
            else:
                worst = max(worst, beyond + allowed)
    return used, worst


_Change = Callable[[Floats, Floats], tuple[Floats, Floats]]


def _scaled(factor: float) -> _Change:
    return lambda place, moving: (place, moving * factor)


_READINGS: tuple[tuple[str, _Change], ...] = (
    ("v_north_m_s and v_east_m_s exchanged", lambda p, v: (p, v[:, [1, 0, 2]])),
    ("v_down_m_s counted upwards", lambda p, v: (p, v * [1.0, 1.0, -1.0])),
    ("velocities of the opposite sign", _scaled(-1.0)),
    ("velocities in km/h", _scaled(1.0 / 3.6)),
    ("velocities in knots", _scaled(1852.0 / 3600.0)),
    ("velocities in ft/s", _scaled(0.3048)),
    ("velocities in cm/s", _scaled(0.01)),
    ("velocities in mm/s", _scaled(0.001)),
    ("velocities in km/s", _scaled(1000.0)),
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
    missed = _missed(solutions.t, solutions.place, solutions.moving)
    axis = int(np.argmax(missed)) if missed.size else 0
    if not missed.size or missed[axis] <= _MISSED:
        return
    what = "positions contradict the velocities" if axis == 0 else f"{MOTION[axis - 1]} contradicts the positions"
    fits = []
    for name, change in _READINGS:
        place, moving = change(solutions.place, solutions.moving)
        if np.abs(place[:, 0]).max() <= 0.5 * np.pi:
            other = _missed(solutions.t, place, moving)
            if other.size and other.max() <= _FITS:
                fits.append((float(other.max()), name))
    hint = f"with {min(fits)[1]} they fit: is that so?" if fits else "is a unit, an axis or a time wrong?"
    raise InputError(f"{solutions.file}: {what}: they miss the path by {100.0 * missed[axis]:.0f} % of it; {hint}")


def _missed(t: Floats, place: Floats, moving: Floats) -> Floats:
    """Return the difference of integrated velocities and positions over the path, as a median over windows.

    The result (4,) is for the whole vector and for the axes north, east and down, 0 for an axis without motion. It is
    empty if the vehicle moves in too few windows.
    """
    r_e, v_e = _earth_fixed(place, moving)
    step = np.diff(t)
    steps = 0.5 * (v_e[1:] + v_e[:-1]) * step[:, None]
    led, gone = (np.vstack([np.zeros(3), np.cumsum(part, axis=0)]) for part in (steps, np.diff(r_e, axis=0)))
    covered = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
    for span in _WINDOWS:
        first, last = _windows(t, span)
        by_v = led[last] - led[first]
        by_r = gone[last] - gone[first]
        path = np.maximum(covered[last] - covered[first], np.linalg.norm(by_r, axis=1))
        moves = path >= _PATH
        if np.count_nonzero(moves) < _FEWEST_WINDOWS:
            continue
        first = first[moves]
        by_v = by_v[moves]
        by_r = by_r[moves]
        path = path[moves]
        C = rotation_e_n(place[first, 0], place[first, 1])
        v_n, r_n = (np.abs(np.einsum("kij,kj->ki", C, part)) for part in (by_v, by_r))
        off = np.abs(np.einsum("kij,kj->ki", C, by_r - by_v))
        along = np.maximum(v_n, r_n)
        parts = np.where(np.median(along, axis=0) >= _PATH, np.median(off / np.maximum(along, 1e-9), axis=0), 0.0)
        return np.append(np.median(np.linalg.norm(by_r - by_v, axis=1) / path), parts)
    return np.zeros(0)


def _windows(t: Floats, span: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return first and last rows of windows of about `span` s, half a window apart, without gaps in them."""
    starts = np.searchsorted(t, np.arange(t[0], t[-1] - span, 0.5 * span))
    ends = np.minimum(np.searchsorted(t, t[starts] + span), t.size - 1)
    gaps = np.concatenate([[0], np.cumsum(np.diff(t) > max(2.0, 3.0 * float(np.median(np.diff(t)))))])
    whole = (ends > starts) & (gaps[ends] == gaps[starts])
    return starts[whole], ends[whole]
