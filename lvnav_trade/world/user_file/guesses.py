"""What the columns of a user's file probably hold: by their names first, else by the size of their numbers."""

import re
from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.errors import InputError
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.records import Floats
from lvnav_trade.world.user_file.rows import column_names, read_columns

_UNITS = {
    "s": "s", "sec": "s", "seconds": "s", "ms": "ms", "min": "min", "deg": "deg", "degrees": "deg", "rad": "rad",
    "m": "m", "km": "km", "ft": "ft", "m_s": "m/s", "m/s": "m/s", "mps": "m/s", "km_s": "km/s", "km/s": "km/s",
    "kmps": "km/s", "ft_s": "ft/s", "ft/s": "ft/s", "fps": "ft/s",
}  # fmt: skip
_WITH_UNIT = re.compile(
    rf"(.+?)[\s_]*[\[(_ ](?:{'|'.join(sorted(map(re.escape, _UNITS), key=len, reverse=True))})[\])]?"
)
_TIME = ("t", "time", "met", "elapsed", "elapsed_time", "mission_time", "flight_time", "timestamp")
_GEODETIC = (
    ("lat", "latitude", "geodetic_latitude", "phi"), ("lon", "long", "longitude", "lambda"),
    ("alt", "altitude", "height", "h", "ellipsoidal_height"),
)  # fmt: skip
_NED = (
    ("vn", "v_n", "v_north", "north", "vel_n", "vel_north", "north_velocity", "velocity_north"),
    ("ve", "v_e", "v_east", "east", "vel_e", "vel_east", "east_velocity", "velocity_east"),
    ("vd", "v_d", "v_down", "down", "vel_d", "vel_down", "down_velocity", "velocity_down"),
)  # fmt: skip
_AXIS = "{x}", "pos_{x}", "position_{x}", "r{x}", "r_{x}", "p{x}"
_RATE = "v{x}", "v_{x}", "vel_{x}", "velocity_{x}", "{x}dot", "{x}_dot", "d{x}"
_FRAMES = {"ecef": "ecef", "ecr": "ecef", "itrf": "ecef", "eci": "eci", "j2000": "eci", "gcrf": "eci", "icrf": "eci"}
_QUATERNIONS = (
    (("q0", "q1", "q2", "q3"), "first"),
    (("qw", "qx", "qy", "qz"), "first"),
    (("q1", "q2", "q3", "q4"), "last"),
)
_EULER = (("yaw", "psi", "heading", "azimuth"), ("pitch", "theta"), ("roll", "phi", "bank"))
_REST = 1.0  # m/s


class Guess(NamedTuple):
    """A part of a trajectory card (`time`, `position`, ...), its content, and why."""

    part: str
    content: Any
    why: str


class _Column(NamedTuple):
    title: str
    name: str  # in small letters, without unit and frame
    unit: str  # empty where the title has none
    frame: str


def guess(file: str) -> list[Guess]:
    """Return what a trajectory card says of a file's columns; InputError where time or position are not found.

    The file is CSV, with commas, semicolons or tabs between its fields, or Parquet.
    """
    delimiter = max((",", ";", "\t"), key=lambda one: len(column_names(file, one)))
    columns = [_column(title) for title in column_names(file, delimiter)]
    found = [Guess("delimiter", delimiter, "the header has more fields with it")] * (delimiter != ",")
    time = _named(columns, [_TIME])
    if time is None:
        raise InputError(f"{file}: no column of time (one of {', '.join(_TIME)}); it has {_titles(columns)}")

    def values(of: Sequence[_Column]) -> Floats:
        return read_columns(file, [one.title for one in of], delimiter)[0]

    t = values(time)[:, 0]
    unit = time[0].unit or "s"
    found.append(Guess("time", {"column": time[0].title, "unit": unit}, _why(time[0].unit, "seconds assumed")))
    position, place = _position(file, columns, values)
    velocity = _velocity(columns, values)
    if position.content["frame"] == "unknown":
        frame, why = _frame(place, t)
        position = Guess("position", position.content | {"frame": frame}, f"{position.why}; {why}")
        if velocity is not None and velocity.content["frame"] == "unknown":
            velocity = Guess("velocity", velocity.content | {"frame": frame}, velocity.why)
    moving = [] if velocity is None else [velocity]
    return [*found, position, *moving, *_attitude(columns, values)]


def readings(attitude: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the readings of columns of attitude, the one that was guessed first: frames, scalar and sense."""
    frames = dict.fromkeys([attitude["frame"], "eci", "ecef", "ned"])
    if attitude["form"] == "euler":
        yield from (attitude | {"frame": frame} for frame in frames)
        return
    scalars = dict.fromkeys([attitude["scalar"], "first", "last"])
    for scalar, frame, turns in product(scalars, frames, ("body_to_frame", "frame_to_body")):
        yield attitude | {"frame": frame, "turns": turns, "scalar": scalar}


def _column(title: str) -> _Column:
    text = title.strip().lower()
    found = _WITH_UNIT.fullmatch(text)
    name = found[1].strip() if found else text
    unit = text[len(name) :].strip(" _[]()") if found else ""
    words = re.split(r"[\s_]+", name)
    frame = next((_FRAMES[word] for word in words if word in _FRAMES), "")
    name = "_".join(word for word in words if word not in _FRAMES)
    return _Column(title, name, _UNITS.get(unit, ""), frame)


def _titles(columns: Sequence[_Column]) -> str:
    return ", ".join(one.title for one in columns[:20])


def _why(named: str, otherwise: str) -> str:
    return "by its name" if named else otherwise


def _named(columns: Sequence[_Column], wanted: Sequence[Sequence[str]]) -> list[_Column] | None:
    """Return the columns whose names are among those wanted, one of each; None where one is missing."""
    found = [next((one for name in names for one in columns if one.name == name), None) for names in wanted]
    return None if None in found else [one for one in found if one is not None]


def _three(columns: Sequence[_Column], forms: Sequence[str]) -> list[_Column] | None:
    """Return three columns whose names differ in x, y and z."""
    for form in forms:
        found = _named(columns, [(form.format(x=axis),) for axis in "xyz"])
        if found is not None:
            return found
    return None


def _position(file: str, columns: Sequence[_Column], values: Any) -> tuple[Guess, Floats]:
    """Return position, frame "unknown" where x, y and z do not say theirs, and its rows (n, 3), m or as they are."""
    geodetic = _named(columns, _GEODETIC)
    if geodetic is not None:
        rows = values(geodetic)
        unit = geodetic[0].unit or ("deg" if np.max(np.abs(rows[:, :2])) > 2.0 * np.pi else "rad")
        height = geodetic[2].unit or ("m" if np.max(rows[:, 2]) > 3e3 else "km")
        content = {"frame": "geodetic", "columns": [one.title for one in geodetic], "unit": unit, "height_unit": height}
        why = _why(geodetic[0].unit and geodetic[2].unit, "units by size of the numbers")
        return Guess("position", content, why), rows
    found = _three(columns, _AXIS)
    if found is None:
        raise InputError(
            f"{file}: no columns of position (latitude, longitude, height; or x, y, z); it has {_titles(columns)}"
        )
    rows = values(found)
    unit = found[0].unit or ("m" if np.linalg.norm(rows[0]) > 1e5 else "km")
    content = {"frame": found[0].frame or "unknown", "columns": [one.title for one in found], "unit": unit}
    return Guess("position", content, _why(found[0].unit, "unit by size of the numbers")), rows * (
        1e3 if unit == "km" else 1.0
    )


def _velocity(columns: Sequence[_Column], values: Any) -> Guess | None:
    ned = _named(columns, _NED)
    found = ned or _three(columns, _RATE)
    if found is None:
        return None
    fast = float(np.max(np.abs(values(found))))
    unit = found[0].unit or ("m/s" if fast > 30.0 else "km/s")
    content = {
        "frame": "ned" if ned else found[0].frame or "unknown",
        "columns": [one.title for one in found],
        "unit": unit,
    }
    return Guess("velocity", content, _why(found[0].unit, "unit by size of the numbers"))


def _frame(place: Floats, t: Floats) -> tuple[str, str]:
    """Return the frame of x, y and z: one that turns with the Earth where the first rows are at rest in it."""
    speed = float(np.linalg.norm(place[1] - place[0]) / (t[1] - t[0]))
    turning = OMEGA * float(np.hypot(*place[0, :2]))
    if speed < 0.5 * turning:
        return "ecef", f"the first rows move at {speed:.3g} m/s: fixed to the Earth"
    return "eci", f"the first rows move at {speed:.0f} m/s, as the Earth does there: inertial"


def _attitude(columns: Sequence[_Column], values: Any) -> list[Guess]:
    for names, scalar in _QUATERNIONS:
        found = _named(columns, [(name,) for name in names])
        if found is not None:
            content = {"form": "quaternion", "frame": found[0].frame or "eci", "columns": [one.title for one in found]}
            content |= {"scalar": scalar, "turns": "body_to_frame"}
            return [Guess("attitude", content, "frame, scalar and sense are assumed: confirm all three")]
    found = _named(columns, _EULER)
    if found is None:
        return []
    unit = found[0].unit or ("deg" if np.max(np.abs(values(found))) > 2.0 * np.pi else "rad")
    content = {"form": "euler", "frame": "ned", "columns": [one.title for one in found], "unit": unit}
    return [Guess("attitude", content, "against north, east and down, assumed: confirm")]
