"""Readers of YUMA and SEM almanac files; every error names file and line."""

import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from lvnav_trade.gnss.navigation_lines import NumberBounds, number, read_lines
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.input_files import integer

HIGHEST_PRN = 63  # six bits in the navigation message (IS-GPS-200, 20.3.3.5); those of QZSS begin at 193
SEMICIRCLE = math.pi
REFERENCE_INCLINATION = 0.30 * SEMICIRCLE  # SEM gives inclinations as differences from it (IS-GPS-200, table 20-VI)


class AlmanacRecord(NamedTuple):
    """A satellite of an almanac, SI and radians."""

    prn: int  # number of the satellite
    health: int  # 0: healthy
    eccentricity: float  # of the orbit
    applicability: float  # s of week, reference time of the elements
    inclination: float  # rad
    node_rate: float  # rad/s, relative to inertial space
    root_axis: float  # m^0.5, square root of the semi-major axis
    node: float  # rad, longitude of the ascending node relative to Greenwich at the start of the week
    perigee: float  # rad, argument of perigee
    mean_anomaly: float  # rad, at the reference time
    clock_bias: float  # s
    clock_drift: float  # s/s
    week: int  # number of the week, as broadcast


class _AlmanacField(NamedTuple):
    name: str  # of the field of the record
    label: str  # several beginnings of a YUMA line, by |, where writers differ
    bounds: NumberBounds  # refuse impossible orbits, not unusual orbits
    unit: float = 1.0


_PRN, _HEALTH, _WEEK = NumberBounds(1, 255, integer), NumberBounds(0, 255, integer), NumberBounds(0, 99999, integer)
_SECONDS, _ECCENTRICITY, _ROOT_AXIS = NumberBounds(0.0, 604800.0), NumberBounds(0.0, 0.999), NumberBounds(2600.0, 1e5)
_BIAS, _DRIFT = NumberBounds(-1.0, 1.0), NumberBounds(-1e-3, 1e-3)
_TURN, _SEMICIRCLES = NumberBounds(-7.0, 7.0), NumberBounds(-2.3, 2.3)

# A line begins with the label, in lower case; the file's own order.
_YUMA = (
    _AlmanacField("prn", "id", _PRN),
    _AlmanacField("health", "health", _HEALTH),
    _AlmanacField("eccentricity", "eccentricity", _ECCENTRICITY),
    _AlmanacField("applicability", "time of applicability", _SECONDS),
    _AlmanacField("inclination", "orbital inclination", NumberBounds(-math.pi, math.pi)),
    _AlmanacField("node_rate", "rate of right ascen", NumberBounds(-1e-6, 1e-6)),
    _AlmanacField("root_axis", "sqrt(a)", _ROOT_AXIS),
    _AlmanacField("node", "right ascen at week|right ascen at toa|right ascension at", _TURN),
    _AlmanacField("perigee", "argument of perigee", _TURN),
    _AlmanacField("mean_anomaly", "mean anom", _TURN),
    _AlmanacField("clock_bias", "af0", _BIAS),
    _AlmanacField("clock_drift", "af1", _DRIFT),
    _AlmanacField("week", "week", _WEEK),
)
# The lines of a satellite; a blank line follows.
_SEM: tuple[tuple[_AlmanacField, ...], ...] = (
    (_AlmanacField("prn", "PRN", _PRN),),
    (),  # the satellite's serial number, blank in some files
    (),  # index of its range accuracy
    (
        _AlmanacField("eccentricity", "eccentricity", _ECCENTRICITY),
        _AlmanacField("inclination", "inclination offset", NumberBounds(-1.3, 0.7), SEMICIRCLE),
        _AlmanacField("node_rate", "rate of right ascension", NumberBounds(-3e-7, 3e-7), SEMICIRCLE),
    ),
    (
        _AlmanacField("root_axis", "root of the semi-major axis", _ROOT_AXIS),
        _AlmanacField("node", "longitude of the orbital plane", _SEMICIRCLES, SEMICIRCLE),
        _AlmanacField("perigee", "argument of perigee", _SEMICIRCLES, SEMICIRCLE),
    ),
    (
        _AlmanacField("mean_anomaly", "mean anomaly", _SEMICIRCLES, SEMICIRCLE),
        _AlmanacField("clock_bias", "clock bias", _BIAS),
        _AlmanacField("clock_drift", "clock drift", _DRIFT),
    ),
    (_AlmanacField("health", "health", _HEALTH),),
    (),  # satellite configuration
)
_HEAD = (
    _AlmanacField("count", "number of records", _PRN),
    _AlmanacField("week", "week", _WEEK),
    _AlmanacField("applicability", "second", _SECONDS),
)


def read_almanac(path: str | Path) -> tuple[AlmanacRecord, ...]:
    """Read a YUMA or a SEM almanac, distinguished by its first word: a SEM file begins with the number of its records.

    InputError as of `read_yuma` and `read_sem`, and if the file is one of another kind.
    """
    lines = read_lines(path, "YUMA or SEM almanac")
    if lines and lines[0].rstrip().endswith("RINEX VERSION / TYPE"):
        raise InputError(f"{path}:1: a RINEX file; name it by {{rinex: ...}}, not {{almanac: ...}}")
    words = "\n".join(lines).split(maxsplit=1)
    if words and words[0].isdigit():
        return read_sem(path)
    return read_yuma(path)


def read_yuma(path: str | Path) -> tuple[AlmanacRecord, ...]:
    """Read all satellites of a YUMA almanac, healthy or not, in the order of the file.

    Satellites of other systems (PRN above 63) and unhealthy satellites with a broken record are skipped.
    Records are 13 lines ``label: value``, each begun by a line of stars or by its ``ID``. InputError ``file:line:
    what`` if the file cannot be read or is empty, a record lacks a field or has it twice, a value is not a number or
    impossible, or a satellite comes twice.
    """
    records = _distinct_records(path, _yuma_records(path))
    if not records:
        raise InputError(f"{path}:1: no almanac record (a YUMA record begins with 'ID:')")
    return _own_system(path, records)


def read_sem(path: str | Path) -> tuple[AlmanacRecord, ...]:
    """Read all satellites of a SEM almanac, healthy or not, in the order of the file.

    Satellites of other systems (PRN above 63) are skipped.

    Number of records and title; week and second of applicability; then per satellite eight lines (PRN, serial number,
    accuracy, and with angles in semicircles: eccentricity, inclination offset, node rate; root of the axis, node,
    perigee; mean anomaly, clock bias and drift; health; configuration), set apart by blank lines. InputError
    ``file:line: what`` if the file cannot be read, ends early, has more or fewer satellites than it says, a value is
    not a number or impossible, or a satellite comes twice.
    """
    lines = read_lines(path, "SEM almanac")
    rows = [(line_number, line.split()) for line_number, line in enumerate(lines, start=1)]
    first = _next_line(rows, 0)
    second = _next_line(rows, first + 1)
    if second >= len(rows):
        raise InputError(f"{path}:{max(1, len(rows))}: no SEM almanac: number of records, week and second are missing")
    count_field, week_field, second_field = _HEAD
    count = int(_read_word(path, rows[first], 0, count_field))
    time = {
        "week": _read_word(path, rows[second], 0, week_field),
        "applicability": _read_word(path, rows[second], 1, second_field),
    }
    records = _distinct_records(path, _sem_records(path, rows, second + 1, time))
    if len(records) != count:
        raise InputError(f"{path}:{len(rows)}: ends after {len(records)} satellites, but line 1 says {count}")
    return _own_system(path, records)


def _own_system(path: str | Path, records: tuple[AlmanacRecord, ...]) -> tuple[AlmanacRecord, ...]:
    """Return the records of the almanac's system; InputError if there are only records of other systems."""
    of_system = tuple(record for record in records if record.prn <= HIGHEST_PRN)
    if not of_system:
        raise InputError(f"{path}: PRN {records[0].prn} and no other up to {HIGHEST_PRN}, so no satellite to take")
    return of_system


def _distinct_records(path: str | Path, pairs: Iterable[tuple[int, AlmanacRecord]]) -> tuple[AlmanacRecord, ...]:
    """Return the records from pairs of first line and record; InputError if a satellite occurs twice."""
    records: list[AlmanacRecord] = []
    first_lines: dict[int, int] = {}
    for line, record in pairs:
        if record.prn in first_lines:
            raise InputError(f"{path}:{line}: PRN {record.prn} again (first on line {first_lines[record.prn]})")
        first_lines[record.prn] = line
        records.append(record)
    return tuple(records)


_Lines = list[tuple[int, str, str]]  # number, label and value of each


def _yuma_blocks(path: str | Path) -> list[_Lines]:
    """Return the lines of each record of a YUMA almanac."""
    blocks: list[_Lines] = [[]]
    for line_number, line in enumerate(read_lines(path, "YUMA almanac"), start=1):
        label, colon, value = line.partition(":")
        is_separator = line.startswith("*")
        if is_separator or label.strip().lower() == "id":
            blocks.append([])
        if is_separator or not line.strip():
            continue
        if not colon:
            raise InputError(f"{path}:{line_number}: {line.strip()!r} is not a line 'label: value' of a YUMA almanac")
        blocks[-1].append((line_number, " ".join(label.lower().split()), value.strip()))
    return [block for block in blocks if block]


def _yuma_records(path: str | Path) -> Iterator[tuple[int, AlmanacRecord]]:
    """Yield the satellites, each with its first line, except unhealthy satellites with a broken record."""
    for block in _yuma_blocks(path):
        first_line = block[0][0]
        try:
            yield first_line, _yuma_record(path, block)
        except InputError:
            if not _is_unhealthy(block):
                raise


def _is_unhealthy(lines: _Lines) -> bool:
    """Return whether a record states a health word other than zero."""
    return any(label == "health" and value.strip("0") and value.isdigit() for _, label, value in lines)


def _yuma_record(path: str | Path, lines: _Lines) -> AlmanacRecord:
    """Return the satellite of a record; InputError if a field is unknown, missing, repeated or invalid."""
    values: dict[str, float] = {}
    for line, label, value in lines:
        field = _yuma_field(label)
        if field is None:
            raise InputError(f"{path}:{line}: {label!r} is not a field of a YUMA almanac")
        if field.name in values:
            raise InputError(f"{path}:{line}: {label!r} comes twice in one record")
        values[field.name] = number(f"{path}:{line}: {label}", value, field.bounds)
    missing_labels = [repr(field.label.partition("|")[0]) for field in _YUMA if field.name not in values]
    if missing_labels:
        last_line = lines[-1][0]
        raise InputError(f"{path}:{last_line}: the record ends without {', '.join(missing_labels)}")
    return AlmanacRecord(**values)  # type: ignore[arg-type]


def _yuma_field(label: str) -> _AlmanacField | None:
    """Return the field of a YUMA almanac whose line begins with a label, None if there is none."""
    for field in _YUMA:
        if label.startswith(tuple(field.label.split("|"))):
            return field
    return None


_Row = tuple[int, list[str]]  # number and words of a line


def _next_line(rows: list[_Row], start: int) -> int:
    """Return the index of the first line from `start` on that is not blank; the number of lines if there is none."""
    for k in range(start, len(rows)):
        if rows[k][1]:
            return k
    return max(start, len(rows))


def _read_word(path: str | Path, row: _Row, index: int, field: _AlmanacField) -> float:
    """Return the number of a field from the words of a line, SI."""
    line, words = row
    if index >= len(words):
        raise InputError(f"{path}:{line}: {field.label} is missing")
    value = number(f"{path}:{line}: {field.label}", words[index], field.bounds)
    return value if field.bounds.read is integer else value * field.unit


def _sem_records(
    path: str | Path, rows: list[_Row], start: int, time: dict[str, float]
) -> Iterator[tuple[int, AlmanacRecord]]:
    """Yield the satellites from a line on, each with its first line."""
    first = _next_line(rows, start)
    while first < len(rows):
        n_line = len(_SEM)
        lines = rows[first : first + n_line]
        if len(lines) < n_line:
            last_line, _ = lines[-1]
            raise InputError(f"{path}:{last_line}: the last satellite has {len(lines)} lines, not {n_line}")
        values = dict(time)
        for row, fields in zip(lines, _SEM, strict=True):
            line, words = row
            if fields and len(words) != len(fields):
                labels = ", ".join(field.label for field in fields)
                raise InputError(f"{path}:{line}: {len(words)} numbers where {len(fields)} should be ({labels})")
            for index, field in enumerate(fields):
                values[field.name] = _read_word(path, row, index, field)
        values["inclination"] += REFERENCE_INCLINATION
        record = AlmanacRecord(**values)  # type: ignore[arg-type]
        yield first + 1, record
        first = _next_line(rows, first + n_line)
