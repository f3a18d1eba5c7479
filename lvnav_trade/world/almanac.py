"""YUMA almanac files to records, with every mistake named by file and line."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from lvnav_trade.errors import InputError

HIGHEST_PRN = 63  # six bits in the navigation message (IS-GPS-200, 20.3.3.5)


class AlmanacRecord(NamedTuple):
    """One satellite of an almanac: SI and radians, angles as broadcast (node relative to Greenwich at week start)."""

    prn: int
    health: int
    eccentricity: float
    applicability: float  # s of week
    inclination: float
    node_rate: float  # rad/s, relative to inertial space
    root_axis: float  # m^0.5
    node: float
    perigee: float
    mean_anomaly: float
    clock_bias: float  # s
    clock_drift: float  # s/s
    week: int


class _Field(NamedTuple):
    label: str  # what the line begins with, in lower case
    read: Callable[[str], float]
    low: float
    high: float


# The file's own order of lines; bounds refuse what no orbit can have, not what is merely unusual.
_FIELDS = {
    "prn": _Field("id", int, 1, HIGHEST_PRN),
    "health": _Field("health", int, 0, 255),
    "eccentricity": _Field("eccentricity", float, 0.0, 0.999),
    "applicability": _Field("time of applicability", float, 0.0, 604800.0),
    "inclination": _Field("orbital inclination", float, -math.pi, math.pi),
    "node_rate": _Field("rate of right ascen", float, -1e-6, 1e-6),
    "root_axis": _Field("sqrt(a)", float, 2600.0, 1e5),
    "node": _Field("right ascen at week", float, -7.0, 7.0),
    "perigee": _Field("argument of perigee", float, -7.0, 7.0),
    "mean_anomaly": _Field("mean anom", float, -7.0, 7.0),
    "clock_bias": _Field("af0", float, -1.0, 1.0),
    "clock_drift": _Field("af1", float, -1e-3, 1e-3),
    "week": _Field("week", int, 0, 99999),
}


def read_yuma(path: str | Path) -> tuple[AlmanacRecord, ...]:
    """Read all satellites of a YUMA almanac, healthy or not, in the order of the file.

    Parameters
    ----------
    path
        The file: records of 13 lines ``label: value``, each begun by a line of stars or by its ``ID``.

    Raises
    ------
    InputError
        ``file:line: what`` where the file cannot be read or is empty, a record lacks a field or states one twice, a
        value is not a number or impossible, or a satellite comes twice.
    """
    records: list[AlmanacRecord] = []
    seen: dict[int, int] = {}
    for start, end, lines in _blocks(path):
        record = _record(path, end, lines)
        if record.prn in seen:
            raise InputError(f"{path}:{start}: PRN {record.prn} again (first on line {seen[record.prn]})")
        seen[record.prn] = start
        records.append(record)
    if not records:
        raise InputError(f"{path}:1: no almanac record (a YUMA record begins with 'ID:')")
    return tuple(records)


def _blocks(path: str | Path) -> list[tuple[int, int, list[tuple[int, str, str]]]]:
    """Split the file into records: (first line, last line, [(line, label, value)])."""
    blocks: list[tuple[int, int, list[tuple[int, str, str]]]] = []
    current: list[tuple[int, str, str]] = []
    for number, line in enumerate([*_read_lines(path), "*"], start=1):
        label, colon, value = line.partition(":")
        begins = line.startswith("*") or label.strip().lower() == "id"
        if begins and current:
            blocks.append((current[0][0], current[-1][0], current))
            current = []
        if line.startswith("*") or not line.strip():
            continue
        if not colon:
            raise InputError(f"{path}:{number}: {line.strip()!r} is not a line 'label: value' of a YUMA almanac")
        current.append((number, " ".join(label.lower().split()), value.strip()))
    return blocks


def _read_lines(path: str | Path) -> list[str]:
    try:
        return Path(path).read_text(encoding="ascii").splitlines()
    except OSError as error:
        raise InputError(f"{path}: cannot read the almanac: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}:1: not a text file, so not a YUMA almanac") from None


def _record(path: str | Path, end: int, lines: list[tuple[int, str, str]]) -> AlmanacRecord:
    """Read one record; `end` is its last line, where a missing field is reported."""
    values: dict[str, float] = {}
    for number, label, value in lines:
        name = next((name for name, field in _FIELDS.items() if label.startswith(field.label)), None)
        if name is None:
            raise InputError(f"{path}:{number}: {label!r} is not a field of a YUMA almanac")
        if name in values:
            raise InputError(f"{path}:{number}: {label!r} comes twice in one record")
        values[name] = _number(f"{path}:{number}: {label}", value, _FIELDS[name])
    missing = [field.label for name, field in _FIELDS.items() if name not in values]
    if missing:
        raise InputError(f"{path}:{end}: the record ends without {', '.join(repr(label) for label in missing)}")
    return AlmanacRecord(**values)  # type: ignore[arg-type]


def _number(where: str, text: str, field: _Field) -> float:
    """Return the number that the text states, Fortran exponents included, within the field's bounds."""
    try:
        value = field.read(text.upper().replace("D", "E"))
    except ValueError:
        kind = "a whole number" if field.read is int else "a number"
        raise InputError(f"{where}: {text!r} is not {kind}") from None
    if not field.low <= value <= field.high:  # also refuses nan and inf
        raise InputError(f"{where}: {text} is outside {field.low:g} to {field.high:g}")
    return value
