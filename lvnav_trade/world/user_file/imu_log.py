"""A recorded log of an inertial unit, CSV or Parquet: rates or increments of three gyros and accelerometers.

Columns are named by what they hold and end in their unit: `t_s` (or time_ms, t_us, ...); `gyro_x_deg_s` is a rate,
`gyro_x_rad` an increment; `accel_x_g` a specific force, `accel_x_m_s` an increment; y and z the same. `deg_per_s` is
understood as `deg_s`. A row holds what the unit put out since the row before it.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.errors import InputError
from lvnav_trade.records import Floats
from lvnav_trade.world.user_file.data_file import (
    column_names,
    read_columns,
    refuse_first,
    refuse_unordered,
    time_stamps,
)
from lvnav_trade.world.user_file.rows import si

FEWEST = 12
_UNEVEN = 0.1  # of the interval, by which a row may be early or late
_LAG, _MOST_STEPS = 60, 5000  # rows over which stamps are compared; late stamps that are looked at
_FEW, _PART = 4, 0.02  # rows, and part of them, that are early or late without the stamps being a host's
_FARTHEST = 5.0  # intervals by which a stamp of a host is late at most
_FASTEST, _STRONGEST = 400.0, 2e4  # rad/s and m/s^2 beyond any unit: 64 turns a second, 2000 g
_SOME = 2.0  # m/s^2, of a vehicle that is not in free fall
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# Endings of columns: the unit, and whether a column is of increments.
_GYRO = {
    "rad_s": ("rad/s", False),
    "mrad_s": ("mrad/s", False),
    "deg_s": ("deg/s", False),
    "deg_h": ("deg/h", False),
    "rad": ("rad", True),
    "mrad": ("mrad", True),
    "urad": ("urad", True),
    "deg": ("deg", True),
    "arcsec": ("arcsec", True),
}
_ACCEL = {
    "m_s2": ("m/s**2", False),
    "g": ("g", False),
    "mg": ("mg", False),
    "ug": ("ug", False),
    "m_s": ("m/s", True),
    "mm_s": ("mm/s", True),
}
_SI = {"gyro": ("rad/s", "rad"), "accel": ("m/s**2", "m/s")}


class ImuLog(NamedTuple):
    """t (n,) s at the end of each interval, as the log counts it; dt s; gyro (n, 3) rad/s and accel (n, 3) m/s^2, means
    over the interval, axes of the log.
    """

    t: Floats
    dt: float
    gyro: Floats
    accel: Floats


def read_log(
    file: str,
    delimiter: str = ",",
    gap: float | None = None,
    start: float = 0.0,
    end: float = math.inf,
    counted: bool = False,
) -> ImuLog:
    """Return the rows of a log; InputError names file, row and fault: a column, a number, a gap, uneven sampling.

    Parameters
    ----------
    gap : rows may be uneven and that far apart (s); none: they are even, and dt is the interval of each
    start, end : part of the log, s after its first row; what is wrong with the times of other rows does not matter
    counted : rows are evenly spaced and their times scatter, as those of a host do: rows are counted
    """
    titles = column_names(file, delimiter)
    time, scale = time_column(file, titles)
    found = {part: _columns(file, titles, part) for part in _SI}
    names = [time, *(name for columns, _, _ in found.values() for name in columns)]
    table, places = read_columns(file, names, delimiter, FEWEST, "a log")
    stamps = table[:, 0] if counted else time_stamps(table[:, 0], time.rpartition("_")[2], file, places)
    here = _part(stamps * scale, start, end, file)
    table, places, t = table[here], places[here], stamps[here] * scale
    if counted:
        t = _evenly(t, file, places)
    dt = _interval(t - t[0], file, places) if gap is None else _uneven(t, file, places, gap)
    steps = dt if gap is None else np.diff(t, prepend=t[0] - dt)[:, None]
    means = {}
    for at, (part, (_, unit, increments)) in zip((1, 4), found.items(), strict=True):
        with np.errstate(over="ignore"):  # endless is beyond any unit as well
            means[part] = table[:, at : at + 3] * si(unit, _SI[part][increments]) / (steps if increments else 1.0)
    _refuse_impossible(means["gyro"], means["accel"], file, places)
    return ImuLog(t, dt, means["gyro"], means["accel"])


def _refuse_impossible(gyro: Floats, accel: Floats, file: str, places: list[str]) -> None:
    """InputError for the first row (n,) that no unit puts out: beyond any range, or zeros among rows with forces."""
    with np.errstate(over="ignore"):
        rate, force = np.linalg.norm(gyro, axis=1), np.linalg.norm(accel, axis=1)
    refuse_first(rate > _FASTEST, file, places, lambda k: f"a rate of {rate[k]:.4g} rad/s; is the unit right?")
    refuse_first(
        force > _STRONGEST, file, places, lambda k: f"a specific force of {force[k]:.4g} m/s^2; is the unit right?"
    )
    empty = (rate == 0.0) & (force == 0.0)
    before, after = np.append(force[:1], force[:-1]), np.append(force[1:], force[-1:])
    refuse_first(
        empty & (np.maximum(before, after) > _SOME),
        file,
        places,
        lambda k: "all six columns are zero, and the specific force is not in the row next to it: a row without data",
    )


def time_column(file: str, titles: Sequence[str]) -> tuple[str, float]:
    """Return the name of the column of time and its unit in s; InputError where there is none."""
    for name in titles:
        start, _, end = name.rpartition("_")
        if start in ("t", "time") and end in TIMES:
            return name, TIMES[end]
    raise InputError(f"{file}: no column of time: name it t_s, t_ms, t_us or t_ns")


def _columns(file: str, titles: Sequence[str], part: str) -> tuple[list[str], str, bool]:
    """Return the names of the columns of x, y and z of a triad, their unit, and whether they are increments."""
    endings = _GYRO if part == "gyro" else _ACCEL
    known = {title.replace("_per_", "_"): title for title in titles}
    for end, (unit, increments) in endings.items():
        names = [f"{part}_{axis}_{end}" for axis in "xyz"]
        if all(name in known for name in names):
            return [known[name] for name in names], unit, increments
    raise InputError(
        f"{file}: no columns {part}_x_UNIT, {part}_y_UNIT, {part}_z_UNIT of one unit: {', '.join(endings)}; it has "
        f"{', '.join(titles[:12])}"
    )


def _interval(t: Floats, file: str, places: list[str]) -> float:
    """Return the interval (s) of rows at times t (n,); InputError where they leave a gap, scatter or are uneven."""
    steps = np.diff(t)
    dt = float(np.median(steps))
    uneven = np.abs(steps - dt) > _UNEVEN * dt
    if np.count_nonzero(uneven) > max(_FEW, _PART * uneven.size):
        _refuse_scatter(t, file)
    refuse_unordered(t, file, places)
    refuse_first(
        steps > 1.5 * dt,
        file,
        places[1:],
        lambda k: f"a gap: no rows between {t[k]:.9g} s and {t[k + 1]:.9g} s, {dt:.6g} s apart elsewhere",
    )
    refuse_first(
        uneven,
        file,
        places[1:],
        lambda k: f"uneven sampling: a row {steps[k]:.6g} s after the one before, {dt:.6g} s elsewhere",
    )
    return float(t[-1] / (t.size - 1))


def _refuse_scatter(t: Floats, file: str) -> None:
    """InputError where times (n,) scatter about rows of which none is missing."""
    dt, sigma = _scatter(t)
    if sigma > 0.0:
        raise InputError(
            f"{file}: the time stamps scatter by {sigma * 1e3:.3g} ms (one sigma) about {t.size} rows {dt * 1e3:.6g} "
            "ms apart, and no row is missing: stamps of a host; take the unit's own counter as the column of time, or "
            "count the rows (--count-rows)"
        )


def _scatter(t: Floats) -> tuple[float, float]:
    """Return the interval (s) of evenly spaced rows whose times (n,) scatter, and one sigma of that (s); sigma 0 where
    rows are missing, or the rate changes.

    A missing row moves all times behind it by an interval, a late stamp only its own.
    """
    lag, count = min(_LAG, t.size // 4), np.arange(t.size)
    dt = float(np.median(t[lag:] - t[:-lag])) / lag
    off = t - dt * count
    many = np.flatnonzero(np.diff(t) > 1.5 * dt)
    if dt <= 0.0:
        return dt, 0.0
    for k in many[:_MOST_STEPS].tolist():
        if np.median(off[k + 1 : k + 1 + lag]) - np.median(off[max(0, k + 1 - lag) : k + 1]) > 0.5 * dt:
            return dt, 0.0
    slope, base = np.polyfit(count, t, 1)
    left = t - slope * count - base
    return float(slope), float(np.std(left)) if np.max(np.abs(left)) < _FARTHEST * dt else 0.0


def _evenly(t: Floats, file: str, places: list[str]) -> Floats:
    """Return times (n,) of evenly spaced rows from times that scatter; InputError where rows are missing."""
    dt, sigma = _scatter(t)
    if sigma == 0.0 and np.any(np.abs(np.diff(t) - dt) > _UNEVEN * dt):
        _interval(t - t[0], file, places)  # names the row
    return np.asarray(t[0] + dt * np.arange(t.size))


def _uneven(t: Floats, file: str, places: list[str], longest: float) -> float:
    """Return the mean interval (s) of uneven rows; InputError where they leave a longer gap."""
    steps = refuse_unordered(t, file, places)
    refuse_first(
        steps > longest,
        file,
        places[1:],
        lambda k: f"a gap: no rows between {t[k]:.9g} s and {t[k + 1]:.9g} s; at most {longest:g} s are bridged",
    )
    return float((t[-1] - t[0]) / (t.size - 1))


def _part(t: Floats, start: float, end: float, file: str) -> slice:
    """Return the rows from one time to another (s after the first row); InputError where they are too few."""
    since = t - t[0]
    first, last = np.searchsorted(since, [start - 1e-9, end + 1e-9])
    here = slice(int(first) if start > 0.0 else 0, int(last) if math.isfinite(end) else t.size)
    if here.stop - here.start < FEWEST:
        raise InputError(f"{file}: {here.stop - here.start} rows from {start:g} to {end:g} s, needs {FEWEST} or more")
    return here
