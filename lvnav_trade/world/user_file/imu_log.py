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
from lvnav_trade.world.user_file.rows import column_names, read_columns, refuse_first, refuse_unordered, si

FEWEST = 12
_UNEVEN = 0.1  # of the interval, by which a row may be early or late
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# Endings of columns: the unit, and whether a column is of increments.
_GYRO = {
    "rad_s": ("rad/s", False), "mrad_s": ("mrad/s", False), "deg_s": ("deg/s", False), "deg_h": ("deg/h", False),
    "rad": ("rad", True), "mrad": ("mrad", True), "urad": ("urad", True), "deg": ("deg", True),
    "arcsec": ("arcsec", True),
}  # fmt: skip
_ACCEL = {
    "m_s2": ("m/s**2", False), "g": ("g", False), "mg": ("mg", False), "ug": ("ug", False), "m_s": ("m/s", True),
    "mm_s": ("mm/s", True),
}  # fmt: skip
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
    file: str, delimiter: str = ",", gap: float | None = None, start: float = 0.0, end: float = math.inf
) -> ImuLog:
    """Return the rows of a log; InputError names file, row and fault: a column, a number, a gap, uneven sampling.

    Parameters
    ----------
    gap : rows may be uneven and that far apart (s); none: they are even, and dt is the interval of each
    start, end : part of the log, s after its first row; what is wrong with the times of other rows does not matter
    """
    titles = column_names(file, delimiter)
    time, scale = time_column(file, titles)
    found = {part: _columns(file, titles, part) for part in _SI}
    names = [time, *(name for columns, _, _ in found.values() for name in columns)]
    table, places = read_columns(file, names, delimiter, FEWEST, "a log")
    here = _part(table[:, 0] * scale, start, end, file)
    table, places = table[here], places[here]
    t = table[:, 0] * scale
    dt = _interval(t - t[0], file, places) if gap is None else _uneven(t, file, places, gap)
    steps = dt if gap is None else np.diff(t, prepend=t[0] - dt)[:, None]
    means = {}
    for at, (part, (_, unit, increments)) in zip((1, 4), found.items(), strict=True):
        means[part] = table[:, at : at + 3] * si(unit, _SI[part][increments]) / (steps if increments else 1.0)
    return ImuLog(t, dt, means["gyro"], means["accel"])


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
    """Return the interval (s) of rows at times t (n,); InputError where they leave a gap or are uneven."""
    steps = refuse_unordered(t, file, places)
    dt = float(np.median(steps))
    gap = steps > 1.5 * dt
    refuse_first(
        gap, file, places[1:],
        lambda k: f"a gap: no rows between {t[k]:.9g} s and {t[k + 1]:.9g} s, {dt:.6g} s apart elsewhere",
    )  # fmt: skip
    refuse_first(
        np.abs(steps - dt) > _UNEVEN * dt, file, places[1:],
        lambda k: f"uneven sampling: a row {steps[k]:.6g} s after the one before, {dt:.6g} s elsewhere",
    )  # fmt: skip
    return float(t[-1] / (t.size - 1))


def _uneven(t: Floats, file: str, places: list[str], longest: float) -> float:
    """Return the mean interval (s) of uneven rows; InputError where they leave a longer gap."""
    steps = refuse_unordered(t, file, places)
    refuse_first(
        steps > longest, file, places[1:],
        lambda k: f"a gap: no rows between {t[k]:.9g} s and {t[k + 1]:.9g} s; at most {longest:g} s are bridged",
    )  # fmt: skip
    return float((t[-1] - t[0]) / (t.size - 1))


def _part(t: Floats, start: float, end: float, file: str) -> slice:
    """Return the rows from one time to another (s after the first row); InputError where they are too few."""
    since = t - t[0]
    here = slice(*np.searchsorted(since, [start - 1e-9, end + 1e-9]))
    if here.stop - here.start < FEWEST:
        raise InputError(f"{file}: {here.stop - here.start} rows from {start:g} to {end:g} s, needs {FEWEST} or more")
    return here
