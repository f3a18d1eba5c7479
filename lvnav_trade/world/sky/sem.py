"""SEM almanac files to the same records as YUMA's, with every mistake named by file and line."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

from lvnav_trade.errors import InputError
from lvnav_trade.world.sky.almanac import HIGHEST_PRN, AlmanacRecord
from lvnav_trade.world.sky.numbers import Bounds, number, read_lines

SEMICIRCLE = math.pi
REFERENCE_INCLINATION = 0.30 * SEMICIRCLE  # inclinations are given as differences from it (IS-GPS-200, table 20-VI)
LINES = 8  # of one satellite; a blank line follows


class _Field(NamedTuple):
    name: str  # of the field of the record
    label: str
    bounds: Bounds
    unit: float = 1.0


_ANGLE = Bounds(-2.3, 2.3)  # semicircles
_RECORD: tuple[tuple[_Field, ...], ...] = (
    (_Field("prn", "PRN", Bounds(1, HIGHEST_PRN, int)),),
    (),  # the satellite's serial number, which some files leave blank
    (),  # index of its range accuracy
    (
        _Field("eccentricity", "eccentricity", Bounds(0.0, 0.999)),
        _Field("inclination", "inclination offset", Bounds(-1.3, 0.7), SEMICIRCLE),
        _Field("node_rate", "rate of right ascension", Bounds(-3e-7, 3e-7), SEMICIRCLE),
    ),
    (
        _Field("root_axis", "root of the semi-major axis", Bounds(2600.0, 1e5)),
        _Field("node", "longitude of the orbital plane", _ANGLE, SEMICIRCLE),
        _Field("perigee", "argument of perigee", _ANGLE, SEMICIRCLE),
    ),
    (
        _Field("mean_anomaly", "mean anomaly", _ANGLE, SEMICIRCLE),
        _Field("clock_bias", "clock bias", Bounds(-1.0, 1.0)),
        _Field("clock_drift", "clock drift", Bounds(-1e-3, 1e-3)),
    ),
    (_Field("health", "health", Bounds(0, 255, int)),),
    (),  # satellite configuration
)
_COUNT = Bounds(1, HIGHEST_PRN, int)
_WEEK, _SECONDS = Bounds(0, 99999, int), Bounds(0.0, 604800.0)


def read_sem(path: str | Path) -> tuple[AlmanacRecord, ...]:
    """Read all satellites of a SEM almanac, healthy or not, in the order of the file.

    Parameters
    ----------
    path
        The file: number of records and title; week and second of applicability; then per satellite eight lines (PRN,
        serial number, accuracy, and with angles in semicircles: eccentricity, inclination offset, node rate; root of
        the axis, node, perigee; mean anomaly, clock bias and drift; health; configuration), set apart by blank lines.

    Raises
    ------
    InputError
        ``file:line: what`` where the file cannot be read, ends early, has more or fewer satellites than it says, a
        value is not a number or impossible, or a satellite comes twice.
    """
    lines = read_lines(path, "SEM almanac")
    rows = [(at, line.split()) for at, line in enumerate(lines, start=1)]
    stated, at = _head(path, rows)
    records: list[AlmanacRecord] = []
    seen: dict[int, int] = {}
    seconds_row = rows[at - 1]
    week, seconds = (_one(path, seconds_row, i, f) for i, f in enumerate((("week", _WEEK), ("second", _SECONDS))))
    while (at := _next(rows, at)) < len(rows):
        record = _record(path, rows[at : at + LINES], week, seconds)
        if record.prn in seen:
            raise InputError(f"{path}:{at + 1}: PRN {record.prn} again (first on line {seen[record.prn]})")
        seen[record.prn] = at + 1
        records.append(record)
        at += LINES
    if len(records) != stated:
        raise InputError(f"{path}:{len(rows)}: ends after {len(records)} satellites, but line 1 says {stated}")
    return tuple(records)


def _head(path: str | Path, rows: list[tuple[int, list[str]]]) -> tuple[int, int]:
    """Return the number of satellites stated, and the line (from 1) of week and second."""
    first = _next(rows, 0)
    second = _next(rows, first + 1)
    if second >= len(rows):
        raise InputError(f"{path}:{max(1, len(rows))}: no SEM almanac: number of records, week and second are missing")
    return int(_one(path, rows[first], 0, ("number of records", _COUNT))), second + 1


def _next(rows: list[tuple[int, list[str]]], at: int) -> int:
    """Return the index of the next line that is not blank."""
    while at < len(rows) and not rows[at][1]:
        at += 1
    return at


def _one(path: str | Path, row: tuple[int, list[str]], index: int, field: tuple[str, Bounds]) -> float:
    line, words = row
    label, bounds = field
    if index >= len(words):
        raise InputError(f"{path}:{line}: {label} is missing")
    return number(f"{path}:{line}: {label}", words[index], bounds)


def _record(path: str | Path, rows: list[tuple[int, list[str]]], week: float, seconds: float) -> AlmanacRecord:
    """Read the eight lines of one satellite."""
    if len(rows) < LINES:
        raise InputError(f"{path}:{rows[-1][0]}: the last satellite has {len(rows)} lines, not {LINES}")
    values: dict[str, float] = {"week": week, "applicability": seconds}
    for row, wanted in zip(rows, _RECORD, strict=True):
        if wanted and len(row[1]) != len(wanted):
            labels = ", ".join(field.label for field in wanted)
            raise InputError(f"{path}:{row[0]}: {len(row[1])} numbers where {len(wanted)} should be ({labels})")
        for index, field in enumerate(wanted):
            value = _one(path, row, index, (field.label, field.bounds))
            values[field.name] = value if field.bounds.read is int else value * field.unit
    values["inclination"] += REFERENCE_INCLINATION
    return AlmanacRecord(**values)  # type: ignore[arg-type]
