"""YUMA almanac files to records, with every mistake named by file and line."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

from lvnav_trade.errors import InputError
from lvnav_trade.world.sky.numbers import Bounds, number, read_lines

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
    bounds: Bounds


# The file's own order of lines; bounds refuse what no orbit can have, not what is merely unusual.
_FIELDS = {
    "prn": _Field("id", Bounds(1, HIGHEST_PRN, int)),
    "health": _Field("health", Bounds(0, 255, int)),
    "eccentricity": _Field("eccentricity", Bounds(0.0, 0.999)),
    "applicability": _Field("time of applicability", Bounds(0.0, 604800.0)),
    "inclination": _Field("orbital inclination", Bounds(-math.pi, math.pi)),
    "node_rate": _Field("rate of right ascen", Bounds(-1e-6, 1e-6)),
    "root_axis": _Field("sqrt(a)", Bounds(2600.0, 1e5)),
    "node": _Field("right ascen at week", Bounds(-7.0, 7.0)),
    "perigee": _Field("argument of perigee", Bounds(-7.0, 7.0)),
    "mean_anomaly": _Field("mean anom", Bounds(-7.0, 7.0)),
    "clock_bias": _Field("af0", Bounds(-1.0, 1.0)),
    "clock_drift": _Field("af1", Bounds(-1e-3, 1e-3)),
    "week": _Field("week", Bounds(0, 99999, int)),
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
    for at, line in enumerate([*read_lines(path, "YUMA almanac"), "*"], start=1):
        label, colon, value = line.partition(":")
        begins = line.startswith("*") or label.strip().lower() == "id"
        if begins and current:
            blocks.append((current[0][0], current[-1][0], current))
            current = []
        if line.startswith("*") or not line.strip():
            continue
        if not colon:
            raise InputError(f"{path}:{at}: {line.strip()!r} is not a line 'label: value' of a YUMA almanac")
        current.append((at, " ".join(label.lower().split()), value.strip()))
    return blocks


def _record(path: str | Path, end: int, lines: list[tuple[int, str, str]]) -> AlmanacRecord:
    """Read one record; `end` is its last line, where a missing field is reported."""
    values: dict[str, float] = {}
    for line, label, value in lines:
        name = next((name for name, field in _FIELDS.items() if label.startswith(field.label)), None)
        if name is None:
            raise InputError(f"{path}:{line}: {label!r} is not a field of a YUMA almanac")
        if name in values:
            raise InputError(f"{path}:{line}: {label!r} comes twice in one record")
        values[name] = number(f"{path}:{line}: {label}", value, _FIELDS[name].bounds)
    missing = [field.label for name, field in _FIELDS.items() if name not in values]
    if missing:
        raise InputError(f"{path}:{end}: the record ends without {', '.join(repr(label) for label in missing)}")
    return AlmanacRecord(**values)  # type: ignore[arg-type]
