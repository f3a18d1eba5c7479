"""Guesses of the meaning of a user's columns, by their names, or else by the size of their numbers."""

import re
from collections.abc import Sequence
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
    """A guessed part of a trajectory card.

    part : Field of the card, such as `time` or `position`.
    content : Its content.
    why : Reason of the guess.
    """

    part: str
    content: Any
    why: str


class _Column(NamedTuple):
    title: str
    name: str  # in small letters, without unit and frame
    unit: str  # empty where the title has none
    frame: str


def epoch_of(file: str, guesses: Sequence[Guess], near: str) -> tuple[str, str] | None:
    """Return lift-off in UTC and the reason, if the column of time is seconds of GPS week, GPS time or Unix time.

    None for another clock, or without a column of GPS weeks.

    near : ISO 8601 time in UTC that selects the era of a week number of ten bits.
    """
    content = {part.part: part.content for part in guesses}
    time, delimiter = content["time"], content.get("delimiter", ",")
    liftoff = time.get("liftoff", 0.0) * parse(f"1 {time['unit']}", "s")
    name = _column(time["column"]).name
    if name in _SINCE_UNIX and liftoff > 0.0:
        return utc_after(UNIX_ORIGIN.isoformat(), liftoff), "from Unix time at lift-off"
    if name in _SINCE_GPS and liftoff > SECONDS_PER_WEEK:
        return utc_of(liftoff).isoformat(), "from GPS time at lift-off"
    week = _named([_column(title) for title in column_names(file, delimiter)], [_WEEKS])
    if name not in _OF_WEEK or week is None:
        return None
    number = float(read_columns(file, [week[0].title], delimiter)[0][0, 0])
    if not 0.0 <= number < _LAST_WEEK or number != round(number):
        return None
    why = f"from {week[0].title} and {time['column']} at lift-off"
    era = "; the week number has ten bits: confirm the year" if number < WEEK_ROLLOVER else ""
    return utc_of(resolve_week(int(number), liftoff, gps_seconds(near))).isoformat(), why + era


def left_out(file: str, guesses: Sequence[Guess]) -> list[str]:
    """Return the titles of the columns of a file that no guess uses."""
    content = {part.part: part.content for part in guesses}
    taken = {content["time"]["column"]}
    for part in ("position", "velocity", "attitude"):
        taken |= {*content.get(part, {}).get("columns", ())}
    return [title for title in column_names(file, content.get("delimiter", ",")) if title not in taken]


def guess(file: str, time_column: str | None = None) -> list[Guess]:
    """Return the guessed parts of a trajectory card for a file: CSV with commas, semicolons or tabs, or Parquet.

    InputError if time or position are not found.

    time_column : Title of the column of time; None: guess it.
    """
    delimiter = max((",", ";", "\t"), key=lambda column: len(column_names(file, column)))
    columns = [_column(title) for title in column_names(file, delimiter)]
    guesses = [Guess("delimiter", delimiter, "the header has more fields with it")] * (delimiter != ",")
    time = _named(columns, [_TIME + _CLOCKS])
    if time_column is not None:
        time = [column for column in columns if column.title == time_column]
        if not time:
            raise InputError(f"{file}: no column {time_column!r}; it has {_titles(columns)}")
    if time is None:
        raise InputError(f"{file}: no column of time (one of {', '.join(_TIME)}); it has {_titles(columns)}")

    def values(of: Sequence[_Column]) -> Floats:
        return read_columns(file, [column.title for column in of], delimiter)[0]

    t = values(time)[:, 0]
    unit = time[0].unit or ("ms" if time[0].name == "itow" else "s")
    guesses.append(
        Guess(
            "time",
            {"column": time[0].title, "unit": unit},
            _why(time[0].unit, f"{unit} assumed"),
        )
    )
    position, place = _position(file, columns, values, t * parse(f"1 {unit}", "s"))
    velocity = _velocity(columns, values)
    if position.content["frame"] == "unknown":
        frame, why = _frame(place, t)
        position = Guess("position", position.content | {"frame": frame}, f"{position.why}; {why}")
        if velocity is not None and velocity.content["frame"] == "unknown":
            velocity = Guess("velocity", velocity.content | {"frame": frame}, velocity.why)
    moving = [] if velocity is None else [velocity]
    return [*guesses, position, *moving, *_attitude(columns, values)]


def is_clock(title: str) -> bool:
    """Return whether the origin of a column of time is not lift-off, according to its name."""
    return _column(title).name in _CLOCKS


def _column(title: str) -> _Column:
    text = title.strip().lower()
    match = _WITH_UNIT.fullmatch(text)
    name = match[1].strip() if match else text
    unit = text[len(name) :].strip(" _[]()") if match else ""
    words = re.split(r"[\s_]+", name)
    frame = next((_FRAMES[word] for word in words if word in _FRAMES), "")
    name = "_".join(word for word in words if word not in _FRAMES)
    return _Column(title, name, _UNITS.get(unit, ""), frame)


def _titles(columns: Sequence[_Column]) -> str:
    return ", ".join(column.title for column in columns[:20])


def _why(named: str, otherwise: str) -> str:
    return "by its name" if named else otherwise


def _named(columns: Sequence[_Column], wanted: Sequence[Sequence[str]]) -> list[_Column] | None:
    """Return a column for each of several lists of names; None if a column is missing."""
    chosen = [next((column for name in names for column in columns if column.name == name), None) for names in wanted]
    return None if None in chosen else [column for column in chosen if column is not None]


def _three(columns: Sequence[_Column], forms: Sequence[str]) -> list[_Column] | None:
    """Return three columns whose names differ in x, y and z only; None if there are none."""
    for form in forms:
        chosen = _named(columns, [(form.format(x=axis),) for axis in "xyz"])
        if chosen is not None:
            return chosen
    return None


def _height_unit(t: Floats, height: Floats) -> str:
    """Return the unit of heights (n,) at times t (n,) s: km if in metres the flight would be too slow, otherwise m."""
    even = np.linspace(t[0], t[-1], _SPANS + 1)
    step = max(float(even[1] - even[0]), 1e-9)
    quickest = float(np.max(np.abs(np.diff(np.interp(even, t, height), 2)))) / step**2
    is_high_pad = height[0] == height[1] and abs(height[0]) > _HIGHEST_PAD
    return "m" if quickest > _QUIET or np.max(height) > _HIGHEST_KM or is_high_pad else "km"


def _position(file: str, columns: Sequence[_Column], values: Any, t: Floats) -> tuple[Guess, Floats]:
    """Return the guess of position, and its rows (n, 3), in m for x, y, z, at times t (n,) s.

    The frame is "unknown" if the names of x, y and z do not contain it.
    """
    geodetic = _named(columns, _GEODETIC)
    if geodetic is not None:
        rows = values(geodetic)
        unit = geodetic[0].unit or ("deg" if np.max(np.abs(rows[:, :2])) > 2.0 * np.pi else "rad")
        height = geodetic[2].unit or _height_unit(t, rows[:, 2])
        content = {
            "frame": "geodetic",
            "columns": [column.title for column in geodetic],
            "unit": unit,
            "height_unit": height,
        }
        why = _why(geodetic[0].unit and geodetic[2].unit, "units by size of the numbers")
        return Guess("position", content, why), rows
    axes = _three(columns, _AXIS)
    if axes is None:
        raise InputError(
            f"{file}: no columns of position (latitude, longitude, height; or x, y, z); it has {_titles(columns)}"
        )
    rows = values(axes)
    unit = axes[0].unit or ("m" if np.linalg.norm(rows[0]) > 1e5 else "km")
    content = {"frame": axes[0].frame or "unknown", "columns": [column.title for column in axes], "unit": unit}
    return Guess("position", content, _why(axes[0].unit, "unit by size of the numbers")), rows * (
        1e3 if unit == "km" else 1.0
    )


def _velocity(columns: Sequence[_Column], values: Any) -> Guess | None:
    ned = _named(columns, _NED)
    chosen = ned or _three(columns, _RATE)
    if chosen is None:
        return None
    fast = float(np.max(np.abs(values(chosen))))
    unit = chosen[0].unit or ("m/s" if fast > 30.0 else "km/s")
    content = {
        "frame": "ned" if ned else chosen[0].frame or "unknown",
        "columns": [column.title for column in chosen],
        "unit": unit,
    }
    return Guess("velocity", content, _why(chosen[0].unit, "unit by size of the numbers"))


def _frame(place: Floats, t: Floats) -> tuple[str, str]:
    """Return the frame of x, y and z, and the reason: Earth-fixed if the first rows are at rest, else inertial."""
    speed = float(np.linalg.norm(place[1] - place[0]) / (t[1] - t[0]))
    turning = OMEGA * float(np.hypot(*place[0, :2]))
    if speed < 0.5 * turning:
        return "ecef", f"the first rows move at {speed:.3g} m/s: fixed to the Earth"
    return "eci", f"the first rows move at {speed:.0f} m/s, as the Earth does there: inertial"


def _attitude(columns: Sequence[_Column], values: Any) -> list[Guess]:
    for names, scalar in _QUATERNIONS:
        chosen = _named(columns, [(name,) for name in names])
        if chosen is not None:
            content = {
                "form": "quaternion",
                "frame": chosen[0].frame or "eci",
                "columns": [column.title for column in chosen],
            }
            content |= {"scalar": scalar, "turns": "body_to_frame"}
            return [Guess("attitude", content, "frame, scalar and sense are assumed: confirm all three")]
    chosen = _named(columns, _EULER)
    if chosen is None:
        return []
    unit = chosen[0].unit or ("deg" if np.max(np.abs(values(chosen))) > 2.0 * np.pi else "rad")
    content = {"form": "euler", "frame": "ned", "columns": [column.title for column in chosen], "unit": unit}
    return [Guess("attitude", content, "against north, east and down, assumed: confirm")]
