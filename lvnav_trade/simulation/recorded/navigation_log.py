"""A recorded log of a vehicle: its card, increments of the IMU, solutions, pseudoranges and range rates.

The IMU file is that of `imu_log`, possibly with uneven rows. The receiver file has the columns `t_s`, `latitude_deg`,
`longitude_deg`, `height_m` above the ellipsoid (WGS-84), `v_north_m_s`, `v_east_m_s`, `v_down_m_s`, and optionally the
sigmas `sigma_north_m`, `sigma_east_m`, `sigma_down_m`, `sigma_v_north_m_s`, `sigma_v_east_m_s`, `sigma_v_down_m_s`. A
file of ranges has `t_s`, `satellite` (as in RINEX, such as G05), `pseudorange_m`, `range_rate_m_s`, with a row for each
satellite and epoch.
"""

import os
import re
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from lvnav_trade.quantities.data_file import column_names, read_columns, read_texts, refuse_first
from lvnav_trade.quantities.errors import InputError, quoted
from lvnav_trade.quantities.input_limits import YEARS
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.quantities.times import GPS_ORIGIN, UNIX_ORIGIN, utc_after, utc_time
from lvnav_trade.quantities.units import Angle, Card, Duration, Epoch, NamedCard, Pause
from lvnav_trade.simulation.recorded.imu_log import read_log, time_column
from lvnav_trade.simulation.recorded.receiver_file import ReceiverFile, read_solutions

_NAME = re.compile(r"([A-Za-z])\s*([0-9]{1,3})")
_COLUMNS = ("pseudorange_m", "range_rate_m_s")
_FEWEST = 4
_SAME = 1e-3  # s between rows of one epoch
_NEAREST, _FARTHEST, _FASTEST = 1e5, 1e9, 3e4  # m, m, m/s; limits with the errors of both clocks


class RangesFile(Card):
    """The file of pseudoranges and range rates, for filters that measure them."""

    file: str
    delimiter: str = Field(",", min_length=1, max_length=1)


class Ranges(NamedTuple):
    """Recorded ranges, n rows.

    t : (n,) s. Time since the first row of the receiver.
    satellites : (n,). Names as from `satellite_name`.
    values : (n, 2) m, m/s. Measured pseudorange and range rate; NaN if missing.
    file : Name of the file.
    notes : Remarks on rows with missing values.
    """

    t: Floats
    satellites: tuple[str, ...]
    values: Floats
    file: str = "ranges"
    notes: tuple[str, ...] = ()


def satellite_name(text: str) -> str:
    """Return the RINEX name of a satellite, such as G05 for `G 5`, `G5`, `g05`; other names are unchanged."""
    match = _NAME.fullmatch(text.strip())
    return f"{match[1].upper()}{int(match[2]):02d}" if match else text.strip()


def read_ranges(card: RangesFile, folder: Path, zero: float) -> Ranges:
    """Return the ranges of a file.

    Parameters
    ----------
    card : RangesFile
    folder : Path
        Folder to which the file name is relative.
    zero : float
        Time (s) of the file from which the result counts.

    Raises
    ------
    InputError
        A number that no receiver measures, a row without a satellite, two rows of a satellite at the same time. The
        message names file, row and error.
    """
    file = os.fspath(folder / card.file)
    time, scale = time_column(file, column_names(file, card.delimiter))
    table, places = read_columns(file, [time, *_COLUMNS], card.delimiter, _FEWEST, "a log", blanks=_COLUMNS)
    texts = read_texts(file, "satellite", card.delimiter)
    refuse_first(np.array([not text.strip() for text in texts]), file, places, lambda k: "satellite is empty")
    t = table[:, 0] * scale
    names = tuple(satellite_name(text) for text in texts)
    _refuse_second(t, names, file, places)
    pseudorange = table[:, 1]
    rate = table[:, 2]
    no_pseudorange = ~(pseudorange > 0.0)
    no_rate = ~np.isfinite(rate) | (rate == 0.0)
    missing = (
        ("pseudorange_m", no_pseudorange, "is empty, zero or below it"),
        ("range_rate_m_s", no_rate, "is empty or zero"),
    )
    for name, rows, reason in missing:
        if rows.all():
            raise InputError(f"{file}:{places[0]}: {name} {reason}, in all {rows.size} rows")
    refuse_first(
        ~no_pseudorange & ((pseudorange < _NEAREST) | (pseudorange > _FARTHEST)),
        file,
        places,
        lambda k: f"pseudorange_m is {pseudorange[k]:.9g}; is it in m?",
    )
    refuse_first(
        ~no_rate & (np.abs(rate) > _FASTEST),
        file,
        places,
        lambda k: f"range_rate_m_s is {rate[k]:.9g}; is it in m/s?",
    )
    notes = []
    for name, rows, reason in missing:
        if rows.any():
            where = _listed_rows(file, places, rows)
            notes.append(f"{name} {reason} in {np.count_nonzero(rows)} of {rows.size} rows: left out ({where})")
    values = np.where(np.column_stack([no_pseudorange, no_rate]), np.nan, table[:, 1:])
    return Ranges(t - zero, names, values, file, tuple(notes))


def _listed_rows(file: str, places: list[str], rows: Bools) -> str:
    """Return the name of the file with the first of the rows (n,)."""
    indices = np.flatnonzero(rows)
    first_places = ", ".join(places[k] for k in indices[:5])
    ellipsis = ", ..." if indices.size > 5 else ""
    return f"{os.path.basename(file)}:{first_places}{ellipsis}"


def _refuse_second(t: Floats, names: tuple[str, ...], file: str, places: list[str]) -> None:
    """Raise InputError for the first two rows of a satellite at the same time."""
    _, number = np.unique(names, return_inverse=True)
    order = np.lexsort((t, number))
    is_same_satellite = np.diff(number[order]) == 0
    is_same_time = np.diff(t[order]) < _SAME
    is_repeated = is_same_satellite & is_same_time
    pairs = []
    for k in np.flatnonzero(is_repeated):
        rows = sorted((int(order[k]), int(order[k + 1])))
        pairs.append((rows[1], rows[0]))
    if pairs:
        second, first = min(pairs, key=lambda pair: pair[0])
        raise InputError(
            f"{file}:{places[second]}: {quoted(names[second])} at {t[second]:.9g} s again, as in {places[first]}: keep "
            "the rows of one signal"
        )


Axis = Literal["x", "-x", "y", "-y", "z", "-z"]
_GAP = 0.1  # s; longest gap between IMU rows that increments may bridge


class ImuFile(Card):
    """The file of the IMU."""

    file: str
    delimiter: str = Field(",", min_length=1, max_length=1)
    axes: tuple[Axis, Axis, Axis] = Field(
        ("x", "y", "z"), description="axis of the log along each body axis (x forward, y right, z down)"
    )
    delay: Duration = Field(0.0, description="delay of the IMU's time tags relative to those of the receiver")

    def _faults(self) -> Iterator[str]:
        if round(float(np.linalg.det(axis_rotation(self.axes)))) != 1:
            yield f"axes: {', '.join(self.axes)} is no right-handed triad of three axes"


class NavigationLog(NamedCard):
    """A recorded log, and how it is aligned."""

    epoch: Epoch = Field(description="UTC at which the time columns are zero")
    time_scale: Literal["gps", "unix"] | None = Field(
        None,
        description="gps: the time columns count leap seconds; unix: they skip them; none: gps for the epoch "
        "1980-01-06, unix for 1970-01-01; with another epoch it is required if a leap second lies between"
        " epoch and log",
    )
    imu: ImuFile  # file of IMU data and its columns
    gnss: ReceiverFile  # file of the receiver's solutions and its columns
    ranges: RangesFile | None = None  # file of ranges; none: solutions alone
    still: tuple[Duration, Duration] = Field(
        description="interval in which the vehicle rests, from the receiver's first row"
    )
    heading: Angle | None = Field(
        None, description="heading of the body's x axis, or of its z axis if x points up; none: from the motion"
    )
    heading_within: Pause = Field(15.0, description="time after the rest whose motion determines the heading")
    gyro_bias: Literal["still", "none"] = Field(
        "still",
        description="still: the mean rate at rest, minus the Earth rate, is removed; none: it is left to the filter",
    )

    def _faults(self) -> Iterator[str]:
        if not 0.0 <= self.still[0] < self.still[1]:
            yield "still: should begin at the first row or later, and end after it begins"
        if self.time_scale == "gps" and utc_time(self.epoch) < GPS_ORIGIN:
            yield "time_scale: gps: GPS time begins 1980-01-06, the epoch is before it"


class NavigationData(NamedTuple):
    """Recorded IMU and receiver data; times in s from the receiver's first row of the file.

    t : (n,) s. Start of the first sampling interval of the IMU, then the end of each.
    angle_sums : (n, 3) rad. Sum of the angle increments up to t, body axes.
    velocity_sums : (n, 3) m/s. Sum of the velocity increments up to t, body axes.
    t_fix : (m,) s. Times of the receiver's solutions.
    place : (m, 3) rad, rad, m. Latitude, longitude, height.
    velocity_ned : (m, 3) m/s. Velocity north, east, down.
    sigma : (m, 6). Sigma of position and velocity; NaN without columns of it.
    epoch : UTC of time zero.
    ranges : Recorded ranges; None without a file of them.
    lines : (m,). Lines of the solutions in their file.
    solution_file : Name of the file of the solutions.
    notes : Remarks on rows of the files that are omitted.
    """

    t: Floats
    angle_sums: Floats
    velocity_sums: Floats
    t_fix: Floats
    place: Floats
    velocity_ned: Floats
    sigma: Floats
    epoch: str
    ranges: Ranges | None = None
    lines: tuple[str, ...] = ()
    solution_file: str = ""
    notes: tuple[str, ...] = ()


def axis_rotation(axes: tuple[str, ...]) -> Floats:
    """Return the matrix (3, 3) from the axes of a log to body axes."""
    matrix = np.zeros((3, 3))
    for row, axis in enumerate(axes):
        matrix[row, "xyz".index(axis[-1])] = -1.0 if axis.startswith("-") else 1.0
    return matrix


def read_recording(card: NavigationLog, folder: Path) -> NavigationData:
    """Return the usable data of a log.

    folder : Folder to which the file names of the card are relative.

    InputError names file, row and error.
    """
    solutions = read_solutions(card.gnss, folder)
    unit_file = os.fspath(folder / card.imu.file)
    zero = solutions.zero
    epoch = first_row_utc(card, solutions.zero, solutions.file)
    log = read_log(unit_file, card.imu.delimiter, _GAP)
    start_of_first_row = log.t[:1] - log.dt
    t = np.concatenate([start_of_first_row, log.t]) - card.imu.delay
    if t[-1] <= zero + card.still[1] or t[0] > zero + card.still[0] + 1e-6:
        spans = f"{t[0]:.9g} to {t[-1]:.9g} s, and {solutions.file} from {zero:.9g} s on"
        raise InputError(f"{unit_file}: its rows do not span the rest: it has {spans}")
    step = np.diff(t)[:, None]
    dtheta = log.gyro * step
    dvel = log.accel * step
    origin = np.zeros(3)
    angle_sums = np.cumsum(np.vstack([origin, dtheta]), axis=0)
    velocity_sums = np.cumsum(np.vstack([origin, dvel]), axis=0)
    to_body = axis_rotation(card.imu.axes).T
    ranges = None if card.ranges is None else read_ranges(card.ranges, folder, zero)
    notes = solutions.notes
    if ranges is not None:
        notes = notes + ranges.notes
    return NavigationData(
        t=t - zero,
        angle_sums=angle_sums @ to_body,
        velocity_sums=velocity_sums @ to_body,
        t_fix=solutions.t - zero,
        place=solutions.place,
        velocity_ned=solutions.velocity_ned,
        sigma=solutions.sigma,
        epoch=epoch,
        ranges=ranges,
        lines=solutions.lines,
        solution_file=solutions.file,
        notes=notes,
    )


def first_row_utc(card: NavigationLog, seconds: float, file: str) -> str:
    """Return the ISO 8601 time (UTC) of a log's first row.

    Parameters
    ----------
    card : NavigationLog
    seconds : float
        Time of the row in the file (s).
    file : str
        Name of the file for messages.

    Raises
    ------
    InputError
        The time cannot be in that unit, or leap seconds lie between the card's epoch and the row and it is unknown
        whether the column counts them.
    """
    utc = utc_time(card.epoch)
    scale = card.time_scale or {GPS_ORIGIN: "gps", UNIX_ORIGIN: "unix"}.get(utc)
    try:
        unix_utc = utc + timedelta(seconds=seconds)
        gps_utc = datetime.fromisoformat(utc_after(card.epoch, seconds))
        possible = YEARS[0] <= unix_utc.year <= YEARS[1]
    except OverflowError:
        possible = False
    if not possible:
        raise InputError(f"{file}: its first row is {seconds:.9g} s after {card.epoch}; is the unit of time right?")
    if scale is None and gps_utc != unix_utc:
        count = round((unix_utc - gps_utc).total_seconds())
        raise InputError(
            f"{file}: {count} leap second{'s' if abs(count) > 1 else ''} between the epoch {card.epoch} and the first "
            "row: state time_scale in the card: gps where the column of time counts leap seconds, unix where it skips "
            "them"
        )
    return (unix_utc if scale == "unix" else gps_utc).isoformat()
