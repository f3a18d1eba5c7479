"""Recorded log of an IMU, CSV or Parquet: rates or increments of three gyros and three accelerometers.

Columns are named by their quantity and end in its unit: `t_s` (or time_ms, t_us, ...); `gyro_x_deg_s` is a rate,
`gyro_x_rad` an increment; `accel_x_g` is a specific force, `accel_x_m_s` an increment; y and z the same. `deg_per_s` is
read as `deg_s`. A row is the output of the IMU since the previous row.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.quantities.data_file import column_names, read_columns, refuse_first, refuse_unordered, time_stamps
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.files.rows import si_factor

FEWEST = 12
_UNEVEN = 0.1  # of the interval; tolerance of evenly spaced rows
_LAG = 60  # rows over which time stamps are compared
_MOST_STEPS = 5000  # largest number of late stamps examined
_FEW, _PART = 4, 0.02  # number and fraction of uneven rows above which the stamps are those of a host computer
_FARTHEST = 5.0  # intervals; largest delay of a stamp of a host
_FASTEST, _STRONGEST = 400.0, 2e4  # rad/s and m/s^2 beyond the range of any IMU: 64 turns a second, 2000 g
_SOME = 2.0  # m/s^2; a vehicle with more specific force is not in free fall
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# Endings of column names: the unit, and whether the column contains increments.
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
    """IMU data of a log, means over the sampling intervals, axes of the log.

    t : (n,) s. End of each interval, time of the log.
    dt : s. Sampling interval.
    gyro : (n, 3) rad/s. Angular rate.
    accel : (n, 3) m/s^2. Specific force.
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
    counts_rows: bool = False,
) -> ImuLog:
    """Return the IMU data of a log.

    Parameters
    ----------
    file, delimiter : str
        CSV or Parquet file, and separator of a CSV file.
    gap : float, optional
        Longest interval (s) of unevenly spaced rows. None: rows are evenly spaced.
    start, end : float
        Part of the log (s after its first row); the times of other rows are not checked.
    counts_rows : bool
        Whether to number the rows, for evenly spaced rows whose time stamps scatter, such as those of a host computer.

    Raises
    ------
    InputError
        A missing column, a text that is no number, a gap, uneven sampling. The message names file, row and error.
    """
    titles = column_names(file, delimiter)
    time, scale = time_column(file, titles)
    gyro_names, gyro_unit, gyro_increments = _columns(file, titles, "gyro")
    accel_names, accel_unit, accel_increments = _columns(file, titles, "accel")
    names = [time, *gyro_names, *accel_names]
    table, places = read_columns(file, names, delimiter, FEWEST, "a log")
    stamps = table[:, 0] if counts_rows else time_stamps(table[:, 0], time.rpartition("_")[2], file, places)
    rows = _row_range(stamps * scale, start, end, file)
    table = table[rows]
    places = places[rows]
    t = stamps[rows] * scale
    if counts_rows:
        t = _even_times(t, file, places)
    if gap is None:
        dt = _interval(t - t[0], file, places)
        intervals: Floats | float = dt
    else:
        dt = _mean_interval(t, file, places, gap)
        intervals = np.diff(t, prepend=t[0] - dt)[:, None]
    gyro_scale = si_factor(gyro_unit, _SI["gyro"][gyro_increments])
    accel_scale = si_factor(accel_unit, _SI["accel"][accel_increments])
    with np.errstate(over="ignore"):  # infinite values are refused below
        gyro = table[:, 1:4] * gyro_scale / (intervals if gyro_increments else 1.0)
        accel = table[:, 4:7] * accel_scale / (intervals if accel_increments else 1.0)
    _refuse_impossible(gyro, accel, file, places)
    return ImuLog(t, dt, gyro, accel)


def _refuse_impossible(gyro: Floats, accel: Floats, file: str, places: list[str]) -> None:
    """Raise InputError for the first impossible row: beyond the range of any IMU, or zeros next to a specific force."""
    with np.errstate(over="ignore"):
        rate = np.linalg.norm(gyro, axis=1)
        force = np.linalg.norm(accel, axis=1)
    refuse_first(rate > _FASTEST, file, places, lambda k: f"a rate of {rate[k]:.4g} rad/s; is the unit right?")
    refuse_first(
        force > _STRONGEST, file, places, lambda k: f"a specific force of {force[k]:.4g} m/s^2; is the unit right?"
    )
    is_empty = (rate == 0.0) & (force == 0.0)
    previous_force = np.append(force[:1], force[:-1])
    next_force = np.append(force[1:], force[-1:])
    refuse_first(
        is_empty & (np.maximum(previous_force, next_force) > _SOME),
        file,
        places,
        lambda k: "all six columns are zero, and the specific force is not in the row next to it: a row without data",
    )


def time_column(file: str, titles: Sequence[str]) -> tuple[str, float]:
    """Return the name of the column of time and its unit in s; InputError if there is none."""
    for name in titles:
        start, _, end = name.rpartition("_")
        if start in ("t", "time") and end in TIMES:
            return name, TIMES[end]
    raise InputError(f"{file}: no column of time: name it t_s, t_ms, t_us or t_ns")


def _columns(file: str, titles: Sequence[str], sensor: str) -> tuple[list[str], str, bool]:
    """Return the names of the x, y and z columns of a triad, their unit, and whether they are increments.

    Parameters
    ----------
    file, titles
        Name of the file, and titles of its columns.
    sensor
        "gyro" or "accel".
    """
    endings = _GYRO if sensor == "gyro" else _ACCEL
    title_of = {title.replace("_per_", "_"): title for title in titles}
    for end, (unit, increments) in endings.items():
        names = [f"{sensor}_{axis}_{end}" for axis in "xyz"]
        if all(name in title_of for name in names):
            titles_of_axes = [title_of[name] for name in names]
            return titles_of_axes, unit, increments
    raise InputError(
        f"{file}: no columns {sensor}_x_UNIT, {sensor}_y_UNIT, {sensor}_z_UNIT of one unit: {', '.join(endings)}; "
        f"it has {', '.join(titles[:12])}"
    )


def _interval(t: Floats, file: str, places: list[str]) -> float:
    """Return the interval (s) of evenly spaced rows.

    Parameters
    ----------
    t
        (n,) s since the first row.
    file, places
        Name of the file and place of each row, for messages.

    Raises
    ------
    InputError
        For a gap, scatter or uneven sampling.
    """
    steps = np.diff(t)
    dt = float(np.median(steps))
    is_uneven = np.abs(steps - dt) > _UNEVEN * dt
    if np.count_nonzero(is_uneven) > max(_FEW, _PART * is_uneven.size):
        _refuse_scatter(t, file)
    refuse_unordered(t, file, places)
    refuse_first(
        steps > 1.5 * dt,
        file,
        places[1:],
        lambda k: f"a gap: no rows between {t[k]:.9g} s and {t[k + 1]:.9g} s, {dt:.6g} s apart elsewhere",
    )
    refuse_first(
        is_uneven,
        file,
        places[1:],
        lambda k: f"uneven sampling: a row {steps[k]:.6g} s after the one before, {dt:.6g} s elsewhere",
    )
    return float(t[-1] / (t.size - 1))


def _refuse_scatter(t: Floats, file: str) -> None:
    """Raise InputError if times t (n,) scatter although no row is missing."""
    dt, sigma = _scatter(t)
    if sigma > 0.0:
        raise InputError(
            f"{file}: the time stamps scatter by {sigma * 1e3:.3g} ms (one sigma) about {t.size} rows {dt * 1e3:.6g} "
            "ms apart, and no row is missing: stamps of a host; take the unit's own counter as the column of time, or "
            "count the rows (--count-rows)"
        )


def _scatter(t: Floats) -> tuple[float, float]:
    """Return the interval (s) of evenly spaced rows whose times t (n,) scatter, and one sigma of the scatter (s).

    The sigma is 0 if rows are missing or the rate changes. A missing row shifts all later times by an interval, a late
    stamp only its own time.
    """
    lag = min(_LAG, t.size // 4)
    count = np.arange(t.size)
    lagged_differences = t[lag:] - t[:-lag]
    dt = float(np.median(lagged_differences)) / lag
    if dt <= 0.0:
        return dt, 0.0
    deviation = t - dt * count
    is_late = np.diff(t) > 1.5 * dt
    late_stamps = np.flatnonzero(is_late)
    for k in late_stamps[:_MOST_STEPS].tolist():
        after_step = k + 1
        begin = max(0, after_step - lag)
        end = after_step + lag
        earlier_deviation = np.median(deviation[begin:after_step])
        later_deviation = np.median(deviation[after_step:end])
        if later_deviation - earlier_deviation > 0.5 * dt:
            return dt, 0.0
    slope, base = np.polyfit(count, t, 1)
    residual = t - slope * count - base
    interval = float(slope)
    if np.max(np.abs(residual)) >= _FARTHEST * dt:
        return interval, 0.0
    sigma = float(np.std(residual))
    return interval, sigma


def _even_times(t: Floats, file: str, places: list[str]) -> Floats:
    """Return the times (n,) of evenly spaced rows from times that scatter; InputError if rows are missing."""
    dt, sigma = _scatter(t)
    if sigma == 0.0:
        deviations = np.abs(np.diff(t) - dt)
        if np.any(deviations > _UNEVEN * dt):
            _interval(t - t[0], file, places)  # raises the error with the row
    count = np.arange(t.size)
    return np.asarray(t[0] + dt * count)


def _mean_interval(t: Floats, file: str, places: list[str], longest: float) -> float:
    """Return the mean interval (s) of uneven rows.

    Parameters
    ----------
    t
        (n,) s.
    file, places
        Name of the file and place of each row, for messages.
    longest
        s. Longest interval between rows.

    Raises
    ------
    InputError
        For rows that are not in order, or a longer interval.
    """
    steps = refuse_unordered(t, file, places)
    refuse_first(
        steps > longest,
        file,
        places[1:],
        lambda k: f"a gap: no rows between {t[k]:.9g} s and {t[k + 1]:.9g} s; at most {longest:g} s are bridged",
    )
    return float((t[-1] - t[0]) / (t.size - 1))


def _row_range(t: Floats, start: float, end: float, file: str) -> slice:
    """Return the rows of a part of a log.

    Parameters
    ----------
    t
        (n,) s.
    start, end
        s after the first row.
    file
        Name of the file, for messages.

    Raises
    ------
    InputError
        If the part has too few rows.
    """
    time_since_first = t - t[0]
    bounds = [start - 1e-9, end + 1e-9]
    first, last = np.searchsorted(time_since_first, bounds)
    begin = int(first) if start > 0.0 else 0
    stop = int(last) if math.isfinite(end) else t.size
    n_row = stop - begin
    if n_row < FEWEST:
        raise InputError(f"{file}: {n_row} rows from {start:g} to {end:g} s, needs {FEWEST} or more")
    return slice(begin, stop)
