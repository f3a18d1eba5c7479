"""Guesses of the meaning of a user's columns, by their names, or else by the size of their numbers."""

import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities.data_file import column_names, read_columns
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.times import (
    SECONDS_PER_WEEK,
    UNIX_ORIGIN,
    WEEK_ROLLOVER,
    gps_seconds,
    resolve_week,
    utc_after,
    utc_of,
)
from lvnav_trade.quantities.units import parse

_UNITS = {
    "s": "s",
    "sec": "s",
    "seconds": "s",
    "ms": "ms",
    "min": "min",
    "deg": "deg",
    "degrees": "deg",
    "rad": "rad",
    "°": "deg",
    "m": "m",
    "km": "km",
    "ft": "ft",
    "m_s": "m/s",
    "m/s": "m/s",
    "mps": "m/s",
    "km_s": "km/s",
    "km/s": "km/s",
    "kmps": "km/s",
    "ft_s": "ft/s",
    "ft/s": "ft/s",
    "fps": "ft/s",
}
_WITH_UNIT = re.compile(
    rf"(.+?)[\s_]*[\[(_ ](?:{'|'.join(sorted(map(re.escape, _UNITS), key=len, reverse=True))})[\])]?"
)
_TIME = ("t", "time", "met", "elapsed", "elapsed_time", "mission_time", "flight_time", "timestamp")
_CLOCKS = (  # columns of time whose origin is not lift-off
    "tow",
    "gps_tow",
    "time_of_week",
    "gps_time_of_week",
    "seconds_of_week",
    "sow",
    "gps_sow",
    "itow",
    "gps_time",
    "gps_seconds",
    "unix_time",
    "unix",
    "posix_time",
    "epoch_time",
)
_GEODETIC = (
    ("lat", "latitude", "geodetic_latitude", "phi"),
    ("lon", "long", "longitude", "lambda"),
    ("alt", "altitude", "height", "h", "ellipsoidal_height"),
)
_NED = (
    ("vn", "v_n", "v_north", "north", "vel_n", "vel_north", "north_velocity", "velocity_north"),
    ("ve", "v_e", "v_east", "east", "vel_e", "vel_east", "east_velocity", "velocity_east"),
    ("vd", "v_d", "v_down", "down", "vel_d", "vel_down", "down_velocity", "velocity_down"),
)
_AXIS = "{x}", "pos_{x}", "position_{x}", "r{x}", "r_{x}", "p{x}"
_RATE = "v{x}", "v_{x}", "vel_{x}", "velocity_{x}", "{x}dot", "{x}_dot", "d{x}"
_FRAMES = (
    dict.fromkeys(("ecef", "ecr", "ecf", "itrf", "itrs"), "ecef")
    | dict.fromkeys(("eci", "teme"), "eci")
    | dict.fromkeys(("j2000", "eme2000", "mj2000", "mj2000eq", "gcrf", "gcrs", "icrf", "icrs"), "j2000")
)
_QUATERNIONS = (
    (("q0", "q1", "q2", "q3"), "first"),
    (("qw", "qx", "qy", "qz"), "first"),
    (("q1", "q2", "q3", "q4"), "last"),
)
_EULER = (("yaw", "psi", "heading", "azimuth"), ("pitch", "theta"), ("roll", "phi", "bank"))
_WEEKS = ("gps_week", "week", "week_number", "wn", "gps_wn", "gpsweek")
_OF_WEEK = ("tow", "gps_tow", "time_of_week", "gps_time_of_week", "seconds_of_week", "sow", "gps_sow", "itow")
_SINCE_GPS, _SINCE_UNIX = ("gps_time", "gps_seconds"), ("unix_time", "unix", "posix_time", "epoch_time")
_LAST_WEEK = 8192.0  # numbers of a GPS week have ten or thirteen bits
_HIGHEST_PAD, _HIGHEST_KM = 9.0, 3e3  # km
_QUIET, _SPANS = 0.3, 20  # in units/s^2: a flight in m is faster over so many parts of it, in km slower


class Guess(NamedTuple):
    """A guessed field of a trajectory card.

    field : Name of the field, such as `time` or `position`.
    content : Its content.
    reason : Reason of the guess.
    """

    field: str
    content: Any
    reason: str


class _Column(NamedTuple):
    title: str
    name: str  # in small letters, without unit and frame
    unit: str  # empty where the title has none
    frame: str


_Reader = Callable[[Sequence[_Column]], Floats]  # reads the values (n, k) of columns


def guess_epoch(file: str, guesses: Sequence[Guess], near: str) -> tuple[str, str] | None:
    """Return lift-off in UTC and the reason, if the column of time is seconds of GPS week, GPS time or Unix time.

    None for another clock, or without a column of GPS weeks.

    near : ISO 8601 time in UTC that selects the era of a week number of ten bits.
    """
    content = {guess.field: guess.content for guess in guesses}
    time = content["time"]
    delimiter = content.get("delimiter", ",")
    second = parse(f"1 {time['unit']}", "s")
    liftoff = time.get("liftoff", 0.0) * second
    name = _parse_title(time["column"]).name
    if name in _SINCE_UNIX and liftoff > 0.0:
        return utc_after(UNIX_ORIGIN.isoformat(), liftoff), "from Unix time at lift-off"
    if name in _SINCE_GPS and liftoff > SECONDS_PER_WEEK:
        return utc_of(liftoff).isoformat(), "from GPS time at lift-off"
    columns = [_parse_title(title) for title in column_names(file, delimiter)]
    week = _find_columns(columns, [_WEEKS])
    if name not in _OF_WEEK or week is None:
        return None
    table, _ = read_columns(file, [week[0].title], delimiter)
    number = float(table[0, 0])
    if not 0.0 <= number < _LAST_WEEK or number != round(number):
        return None
    reason = f"from {week[0].title} and {time['column']} at lift-off"
    if number < WEEK_ROLLOVER:
        reason += "; the week number has ten bits: confirm the year"
    seconds = resolve_week(int(number), liftoff, gps_seconds(near))
    return utc_of(seconds).isoformat(), reason


def unused_columns(file: str, guesses: Sequence[Guess]) -> list[str]:
    """Return the titles of the columns of a file that no guess uses."""
    content = {guess.field: guess.content for guess in guesses}
    guessed_titles = {content["time"]["column"]}
    for name in ("position", "velocity", "attitude"):
        columns = content.get(name, {}).get("columns", ())
        guessed_titles.update(columns)
    delimiter = content.get("delimiter", ",")
    titles = column_names(file, delimiter)
    return [title for title in titles if title not in guessed_titles]


def guess(file: str, time_column: str | None = None) -> list[Guess]:
    """Return the guessed parts of a trajectory card for a file: CSV with commas, semicolons or tabs, or Parquet.

    InputError if time or position are not found.

    time_column : Title of the column of time; None: guess it.
    """
    delimiter = max((",", ";", "\t"), key=lambda character: len(column_names(file, character)))
    columns = [_parse_title(title) for title in column_names(file, delimiter)]
    guesses = []
    if delimiter != ",":
        guesses.append(Guess("delimiter", delimiter, "the header has more fields with it"))

    def read_values(columns: Sequence[_Column]) -> Floats:
        table, _ = read_columns(file, [column.title for column in columns], delimiter)
        return table

    time = _time_column(file, columns, time_column)
    t = read_values([time])[:, 0]
    unit = time.unit or ("ms" if time.name == "itow" else "s")
    reason = "by its name" if time.unit else f"{unit} assumed"
    guesses.append(Guess("time", {"column": time.title, "unit": unit}, reason))
    seconds = t * parse(f"1 {unit}", "s")
    position, place = _guess_position(file, columns, read_values, seconds)
    velocity = _guess_velocity(columns, read_values)
    if position.content["frame"] == "unknown":
        frame, reason = _guess_frame(place, seconds)
        position = Guess("position", position.content | {"frame": frame}, f"{position.reason}; {reason}")
        if velocity is not None and velocity.content["frame"] == "unknown":
            velocity = Guess("velocity", velocity.content | {"frame": frame}, velocity.reason)
    guesses.append(position)
    if velocity is not None:
        guesses.append(velocity)
    return [*guesses, *_guess_attitude(columns, read_values)]


def _time_column(file: str, columns: Sequence[_Column], title: str | None) -> _Column:
    """Return the column of time.

    title : title of the column; None: the column is found by its name

    InputError if there is no such column.
    """
    if title is not None:
        for column in columns:
            if column.title == title:
                return column
        raise InputError(f"{file}: no column {title!r}; it has {_titles(columns)}")
    time = _find_columns(columns, [_TIME + _CLOCKS])
    if time is None:
        raise InputError(f"{file}: no column of time (one of {', '.join(_TIME)}); it has {_titles(columns)}")
    return time[0]


def is_clock(title: str) -> bool:
    """Return whether the origin of a column of time is not lift-off, according to its name."""
    return _parse_title(title).name in _CLOCKS


def _parse_title(title: str) -> _Column:
    """Return a column with the name, unit and frame in its title."""
    text = title.strip().lower()
    match = _WITH_UNIT.fullmatch(text)
    name = match[1].strip() if match else text
    unit = text[len(name) :].strip(" _[]()") if match else ""
    words = re.split(r"[\s_]+", name)
    frames = [_FRAMES[word] for word in words if word in _FRAMES]
    return _Column(
        title=title,
        name="_".join(word for word in words if word not in _FRAMES),
        unit=_UNITS.get(unit, ""),
        frame=frames[0] if frames else "",
    )


def _titles(columns: Sequence[_Column]) -> str:
    return ", ".join(column.title for column in columns[:20])


def _find_columns(columns: Sequence[_Column], name_lists: Sequence[Sequence[str]]) -> list[_Column] | None:
    """Return a column for each of several lists of names; None if a column is missing.

    Names that come first in a list have precedence.
    """
    selection = []
    for names in name_lists:
        matches = [column for name in names for column in columns if column.name == name]
        if not matches:
            return None
        selection.append(matches[0])
    return selection


def _find_axes(columns: Sequence[_Column], forms: Sequence[str]) -> list[_Column] | None:
    """Return three columns whose names differ in x, y and z only; None if there are none."""
    for form in forms:
        axis_columns = _find_columns(columns, [(form.format(x=axis),) for axis in "xyz"])
        if axis_columns is not None:
            return axis_columns
    return None


def _angle_unit(column: _Column, angles: Floats) -> str:
    """Return the unit of angles: that of the title, or else by their size."""
    if column.unit:
        return column.unit
    return "deg" if np.max(np.abs(angles)) > 2.0 * np.pi else "rad"


def _height_unit(t: Floats, height: Floats) -> str:
    """Return the unit of heights (n,) at times t (n,) s: km if in metres the flight would be too slow, otherwise m."""
    even_t = np.linspace(t[0], t[-1], _SPANS + 1)
    even_height = np.interp(even_t, t, height)
    step = max(float(even_t[1] - even_t[0]), 1e-9)
    second_difference = np.diff(even_height, 2)
    largest_difference = float(np.max(np.abs(second_difference)))
    acceleration = largest_difference / step**2
    first, second = height[0], height[1]
    is_high_pad = first == second and abs(first) > _HIGHEST_PAD
    is_metres = acceleration > _QUIET or np.max(height) > _HIGHEST_KM or is_high_pad
    return "m" if is_metres else "km"


def _guess_position(file: str, columns: Sequence[_Column], read_values: _Reader, t: Floats) -> tuple[Guess, Floats]:
    """Return the guess of position, and its rows (n, 3), in m for x, y, z.

    The frame is "unknown" if the names of x, y and z do not contain it.

    read_values : function of columns that returns their numbers (n, n_column)
    t : (n,) s. Times of the rows.

    InputError if there are no columns of position.
    """
    geodetic = _find_columns(columns, _GEODETIC)
    if geodetic is not None:
        rows = read_values(geodetic)
        latitude, _, height = geodetic
        content = {
            "frame": "geodetic",
            "columns": [column.title for column in geodetic],
            "unit": _angle_unit(latitude, rows[:, :2]),
            "height_unit": height.unit or _height_unit(t, rows[:, 2]),
        }
        is_named = latitude.unit and height.unit
        return Guess("position", content, "by its name" if is_named else "units by size of the numbers"), rows
    axes = _find_axes(columns, _AXIS)
    if axes is None:
        raise InputError(
            f"{file}: no columns of position (latitude, longitude, height; or x, y, z); it has {_titles(columns)}"
        )
    rows = read_values(axes)
    unit = axes[0].unit or ("m" if np.linalg.norm(rows[0]) > 1e5 else "km")
    content = {"frame": axes[0].frame or "unknown", "columns": [column.title for column in axes], "unit": unit}
    metres = rows * (1e3 if unit == "km" else 1.0)
    return Guess("position", content, _reason(axes[0])), metres


def _reason(column: _Column) -> str:
    """Return the reason for a unit: the title of its column, or the size of the numbers."""
    return "by its name" if column.unit else "unit by size of the numbers"


def _guess_velocity(columns: Sequence[_Column], read_values: _Reader) -> Guess | None:
    """Return the guess of velocity; None if there are no columns of it."""
    ned_columns = _find_columns(columns, _NED)
    velocity_columns = ned_columns or _find_axes(columns, _RATE)
    if velocity_columns is None:
        return None
    largest = float(np.max(np.abs(read_values(velocity_columns))))
    content = {
        "frame": "ned" if ned_columns else velocity_columns[0].frame or "unknown",
        "columns": [column.title for column in velocity_columns],
        "unit": velocity_columns[0].unit or ("m/s" if largest > 30.0 else "km/s"),
    }
    return Guess("velocity", content, _reason(velocity_columns[0]))


def _guess_frame(place: Floats, t: Floats) -> tuple[str, str]:
    """Return the frame of x, y and z, and the reason: Earth-fixed if the first rows are at rest, else inertial.

    place : (n, 3), m.
    t : (n,), s.
    """
    distance = np.linalg.norm(place[1] - place[0])
    speed = float(distance / (t[1] - t[0]))
    axis_distance = float(np.hypot(*place[0, :2]))
    earth_speed = OMEGA * axis_distance
    if speed < 0.5 * earth_speed:
        return "ecef", f"the first rows move at {speed:.3g} m/s: fixed to the Earth"
    return "eci", f"the first rows move at {speed:.0f} m/s, as the Earth does there: inertial"


def _guess_attitude(columns: Sequence[_Column], read_values: _Reader) -> list[Guess]:
    """Return the guess of attitude in a list; an empty list if there are no columns of it."""
    for names, scalar in _QUATERNIONS:
        quaternion = _find_columns(columns, [(name,) for name in names])
        if quaternion is not None:
            content = {
                "form": "quaternion",
                "frame": quaternion[0].frame or "eci",
                "columns": [column.title for column in quaternion],
                "scalar": scalar,
                "turns": "body_to_frame",
            }
            return [Guess("attitude", content, "frame, scalar and sense are assumed: confirm all three")]
    euler = _find_columns(columns, _EULER)
    if euler is None:
        return []
    content = {
        "form": "euler",
        "frame": "ned",
        "columns": [column.title for column in euler],
        "unit": euler[0].unit or _angle_unit(euler[0], read_values(euler)),
    }
    return [Guess("attitude", content, "against north, east and down, assumed: confirm")]
