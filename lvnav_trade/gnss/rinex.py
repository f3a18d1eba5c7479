"""Reader of RINEX navigation files, versions 2 and 3: ephemerides of GPS, Galileo, BeiDou and GLONASS."""

import math
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from lvnav_trade.gnss.navigation_lines import NumberBounds, number, read_lines
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.input_files import decimal, integer
from lvnav_trade.quantities.times import BDT_BEHIND, BDT_WEEKS, GPS_ORIGIN, SECONDS_PER_WEEK, leap_seconds

WIDTH = 19  # of a number
LABEL = 60  # column where the label of a header line begins


class Ephemeris(NamedTuple):
    """Broadcast Keplerian elements of a satellite of GPS, Galileo or BeiDou, SI and radians.

    name : Name of the satellite.
    toe : s of GPS time. Reference time of the orbit.
    toc : s of GPS time. Reference time of the clock.
    health : Health word of its system; 0 if all signals are healthy.
    accuracy : m. URA, or SISA of Galileo.
    elements : By the names in `_KEPLERIAN`. Among them week_second, toe in seconds of the system's week, from which the
        node counts; group_delay (s), TGD, BGD E5a/E1 or TGD1; data_source, the word of a Galileo record that identifies
        its message, 0 for other systems.
    """

    name: str
    toc: float
    toe: float
    health: float
    elements: Mapping[str, float]
    accuracy: float = 0.0


class StateVector(NamedTuple):
    """Broadcast state of a GLONASS satellite, PZ-90, SI, at `time` in s of GPS time.

    a_e is the acceleration due to Moon and Sun; clock_bias is -tau_n (s), clock_drift is gamma_n.
    """

    name: str
    time: float
    clock_bias: float
    clock_drift: float
    r_e: tuple[float, float, float]
    v_e: tuple[float, float, float]
    a_e: tuple[float, float, float]
    health: float


class BrokenRecord(NamedTuple):
    """A record that cannot be used: name of the satellite, error with its place, and whether it is marked unhealthy."""

    name: str
    fault: str
    is_unhealthy: bool


class TimeOffset(NamedTuple):
    """Offset of a system's time from GPS time, apart from whole seconds.

    system : Letter of the system.
    bias : s. System time minus GPS time.
    drift : s/s. Rate of the offset.
    time : s of GPS time. Reference time.
    """

    system: str
    bias: float
    drift: float
    time: float


class NavigationFile(NamedTuple):
    """Contents of a navigation file.

    Its ephemerides and state vectors in order, alpha and beta of the Klobuchar model (None if missing), the offsets of
    system times from GPS time, and its broken records.
    """

    ephemerides: tuple[Ephemeris, ...]
    states: tuple[StateVector, ...]
    klobuchar: tuple[tuple[float, ...], tuple[float, ...]] | None
    offsets: tuple[TimeOffset, ...] = ()
    broken_records: tuple[BrokenRecord, ...] = ()


class _RinexField(NamedTuple):
    name: str
    label: str
    line: int  # of the record; that of the epoch is 0
    column: int  # 0 to 3; on the first line 1 to 3, after the epoch
    bounds: NumberBounds


_ANY = NumberBounds(-1e15, 1e15)  # these may be blank, which is zero
_TURN = NumberBounds(-7.0, 7.0)  # rad
_SMALL = NumberBounds(-1e-3, 1e-3)  # harmonic corrections of angles (rad), clock drift (s/s)
_METRES = NumberBounds(-1e5, 1e5)
_KEPLERIAN = (
    _RinexField("clock_bias", "clock bias", 0, 1, NumberBounds(-1.0, 1.0)),
    _RinexField("clock_drift", "clock drift", 0, 2, _SMALL),
    _RinexField("clock_drift_rate", "clock drift rate", 0, 3, _SMALL),
    _RinexField("radius_sin", "Crs", 1, 1, _METRES),
    _RinexField("mean_motion_difference", "delta n", 1, 2, NumberBounds(-1e-6, 1e-6)),
    _RinexField("mean_anomaly", "M0", 1, 3, _TURN),
    _RinexField("latitude_cos", "Cuc", 2, 0, _SMALL),
    _RinexField("eccentricity", "eccentricity", 2, 1, NumberBounds(0.0, 0.999)),
    _RinexField("latitude_sin", "Cus", 2, 2, _SMALL),
    _RinexField("root_axis", "root of the semi-major axis", 2, 3, NumberBounds(2600.0, 1e5)),
    _RinexField("week_second", "toe", 3, 0, NumberBounds(0.0, SECONDS_PER_WEEK)),
    _RinexField("inclination_cos", "Cic", 3, 1, _SMALL),
    _RinexField("node", "OMEGA0", 3, 2, _TURN),
    _RinexField("inclination_sin", "Cis", 3, 3, _SMALL),
    _RinexField("inclination", "i0", 4, 0, NumberBounds(-math.pi, math.pi)),
    _RinexField("radius_cos", "Crc", 4, 1, _METRES),
    _RinexField("perigee", "omega", 4, 2, _TURN),
    _RinexField("node_rate", "OMEGA dot", 4, 3, NumberBounds(-1e-6, 1e-6)),
    _RinexField("inclination_rate", "i dot", 5, 0, NumberBounds(-1e-6, 1e-6)),
    _RinexField("data_source", "data source", 5, 1, _ANY),
    _RinexField("accuracy", "accuracy", 6, 0, _ANY),
    _RinexField("health", "health", 6, 1, _ANY),
    _RinexField("group_delay", "group delay", 6, 2, _ANY),
)
_KM, _KM_S = NumberBounds(-1e5, 1e5), NumberBounds(-10.0, 10.0)
_GLONASS = (
    _RinexField("clock_bias", "-tau", 0, 1, NumberBounds(-1.0, 1.0)),
    _RinexField("clock_drift", "gamma", 0, 2, _SMALL),
    *(_RinexField(f"r{axis}", f"{axis} position", line, 0, _KM) for line, axis in enumerate("xyz", 1)),
    *(_RinexField(f"v{axis}", f"{axis} velocity", line, 1, _KM_S) for line, axis in enumerate("xyz", 1)),
    *(_RinexField(f"a{axis}", f"{axis} acceleration", line, 2, _SMALL) for line, axis in enumerate("xyz", 1)),
    _RinexField("health", "health", 1, 3, _ANY),
)
_ORBIT, _SPEED = (1e7, 5e7), (5e2, 1e4)  # m from the Earth's centre, m/s: those of GLONASS are 2.55e7 and some 3.6e3
# Differences of a system's time and GPS time in the header, and the letter of the system.
_OFFSETS = {"GAGP": "E", "GPGA": "E", "GLGP": "R", "BDGP": "C"}
_OFFSET_BOUNDS = NumberBounds(-1e-3, 1e-3)  # s, s/s
# Coefficients of the Klobuchar model in the header of version 3 and of version 2.
_COEFFICIENTS = {"GPSA": "alpha", "ION ALPHA": "alpha", "GPSB": "beta", "ION BETA": "beta"}
# Lines of a record, the epoch's included; later versions of the format add lines at the end.
_LENGTH = {"G": 8, "E": 8, "C": 8, "R": 4}


class _Format(NamedTuple):
    """Format of the records: system of all records (empty: named in each record), and columns before the numbers."""

    version: int
    system: str
    margin: int

    def begins(self, line: str) -> bool:
        """Whether a record begins on the line."""
        return bool(line[: self.margin - 1].strip())


class _Record(NamedTuple):
    where: str  # file
    name: str
    first: int  # line number
    lines: list[str]


def read_navigation(path: str | Path) -> NavigationFile:
    """Read all records of GPS, Galileo, BeiDou and GLONASS of a navigation file, gzip or plain; others are skipped.

    RINEX 2.11, table A3 to A12; RINEX 3.04, table A5 to A14. The week of a reference time is the week closest to the
    time of clock, because writers disagree about the rollover of the week. A truncated record, or a record with an
    impossible value, is broken: merged files contain such records of satellites in test, and other records are valid.

    Raises
    ------
    InputError
        The file cannot be read, is not a RINEX navigation file of version 2 or 3, or every record is broken. The
        message begins with ``file:line``.
    """
    lines = read_lines(path, "RINEX navigation file")
    form = _format(path, lines)
    header = _header(path, lines)
    ephemerides: list[Ephemeris] = []
    states: list[StateVector] = []
    broken_records: list[BrokenRecord] = []
    for record in _records(path, form, lines, len(header) + 1):
        try:
            if record.name[0] == "R":
                states.append(_state(record, form))
            else:
                ephemerides.append(_ephemeris(record, form))
        except InputError as error:
            broken_records.append(BrokenRecord(record.name, str(error), _is_unhealthy(record, form)))
    if not ephemerides and not states:
        no_records = f"{path}: no record of GPS, Galileo, BeiDou or GLONASS"
        raise InputError(broken_records[0].fault if broken_records else no_records)
    return NavigationFile(
        ephemerides=tuple(ephemerides),
        states=tuple(states),
        klobuchar=_klobuchar(path, header),
        offsets=tuple(_offsets(path, header)),
        broken_records=tuple(broken_records),
    )


def _header(path: str | Path, lines: list[str]) -> list[str]:
    """Return the lines of the header, without its last line; InputError if it has no end."""
    for index, line in enumerate(lines):
        if line[LABEL:].strip() == "END OF HEADER":
            return lines[:index]
    raise InputError(f"{path}:{max(1, len(lines))}: ends without 'END OF HEADER'")


def _is_unhealthy(record: _Record, form: _Format) -> bool:
    """Return whether a broken record has a readable health word other than zero."""
    fields = _GLONASS if record.name[0] == "R" else _KEPLERIAN
    health = tuple(field for field in fields if field.name == "health")
    try:
        return _values(record, form, health)["health"] != 0.0
    except InputError:
        return False


def _format(path: str | Path, lines: list[str]) -> _Format:
    """Return the format of the records by the first line; InputError if it is not that of a navigation file."""
    first = lines[0] if lines else ""
    if first[LABEL:].strip() != "RINEX VERSION / TYPE":
        raise InputError(f"{path}:1: not a RINEX file (the first line should end with 'RINEX VERSION / TYPE')")
    version = int(number(f"{path}:1: version", first[:9], NumberBounds(1.0, 9.99)))
    if version not in (2, 3):
        raise InputError(f"{path}:1: RINEX version {first[:9].strip()}; versions 2 and 3 can be read")
    file_type = first[20:21].upper()
    is_glonass = version == 2 and file_type == "G"
    if file_type != "N" and not is_glonass:
        raise InputError(f"{path}:1: {first[20:40].strip() or 'no type'!r} is not a RINEX navigation file")
    return _Format(3, "", 4) if version == 3 else _Format(2, "R" if is_glonass else "G", 3)


def _klobuchar(path: str | Path, header: list[str]) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """Return alpha and beta if the header has both, else None."""
    coefficients: dict[str, tuple[float, ...]] = {}
    for line_number, line in enumerate(header, start=1):
        label = line[LABEL:].strip()
        is_version_3 = label == "IONOSPHERIC CORR"
        key = _COEFFICIENTS.get(line[:4] if is_version_3 else label)
        if key is None:
            continue
        start = 5 if is_version_3 else 2
        where = f"{path}:{line_number}: {label}"
        texts = [line[start + 12 * k : start + 12 * (k + 1)] for k in range(4)]
        coefficients[key] = tuple(number(where, text, _ANY) for text in texts)
    if len(coefficients) < 2:
        return None
    return coefficients["alpha"], coefficients["beta"]


def _offsets(path: str | Path, header: list[str]) -> Iterator[TimeOffset]:
    """Yield the offsets from GPS time in the lines TIME SYSTEM CORR of the header; those from UTC are passed over.

    GAGP, in files before 3.04 named GPGA, is Galileo minus GPS (A0G and A1G of the Galileo OS SIS ICD, section 5.1.8);
    GLGP is GLONASS minus GPS (minus tau_GPS of the GLONASS ICD, section 4.5), constant and without a reference time;
    BDGP is BeiDou minus GPS (A0GPS and A1GPS of the BDS-SIS-ICD, section 5.2.4.17), at second and week of BeiDou time.
    """
    for line_number, line in enumerate(header, start=1):
        if line[LABEL:].strip() != "TIME SYSTEM CORR" or line[:4] not in _OFFSETS:
            continue
        where = f"{path}:{line_number}: {line[:4]}"
        bias = number(where, line[5:22], _OFFSET_BOUNDS)
        drift = number(where, line[22:38], _OFFSET_BOUNDS)
        second = _number_or_zero(where, line[38:45], NumberBounds(0.0, SECONDS_PER_WEEK))
        week = _number_or_zero(where, line[45:50], NumberBounds(0.0, 9999.0))
        time = week * SECONDS_PER_WEEK + second
        if line[:4] == "BDGP":
            time += BDT_WEEKS * SECONDS_PER_WEEK + BDT_BEHIND
        yield TimeOffset(_OFFSETS[line[:4]], bias, drift, time)


def _number_or_zero(where: str, text: str, bounds: NumberBounds) -> float:
    """Return the number in a text, zero if the text is blank."""
    return number(where, text, bounds) if text.strip() else 0.0


def _records(path: str | Path, form: _Format, lines: list[str], start: int) -> list[_Record]:
    """Split the lines after the header into the records of the systems that are read."""
    records: list[_Record] = []
    for line_number, line in enumerate(lines[start:], start=start + 1):
        if not line.strip():
            continue
        if form.begins(line):
            name = _name(path, line_number, form, line)
            records.append(_Record(str(path), name, line_number, [line]))
        elif not records:
            raise InputError(f"{path}:{line_number}: a record should begin here with a satellite and a time")
        else:
            records[-1].lines.append(line)
    return [record for record in records if record.name[0] in _LENGTH]


def _name(path: str | Path, line_number: int, form: _Format, line: str) -> str:
    """Return the name of the satellite at the beginning of a record, such as G05."""
    text = line[: form.margin - 1]
    system = form.system or text[0]
    digits = text if form.system else text[1:]
    if not (text.isascii() and system.isalpha() and digits.strip().isdigit()):
        raise InputError(
            f"{path}:{line_number}: {text.strip()!r} is not a satellite{'' if form.system else ' such as G05'}"
        )
    return f"{system}{int(digits):02d}"


def _values(record: _Record, form: _Format, fields: tuple[_RinexField, ...]) -> dict[str, float]:
    """Return the numbers of some fields of a record, by name; InputError if it is too short or a number is invalid."""
    length = _LENGTH[record.name[0]]
    if len(record.lines) < length:
        last = record.first + len(record.lines) - 1
        raise InputError(
            f"{record.where}:{last}: the record of {record.name} has {len(record.lines)} lines, not {length}"
        )
    values: dict[str, float] = {}
    for field in fields:
        start = form.margin + WIDTH * field.column
        where = f"{record.where}:{record.first + field.line}: {record.name} {field.label}"
        text = record.lines[field.line][start : start + WIDTH]
        read = _number_or_zero if field.bounds is _ANY else number
        values[field.name] = read(where, text, field.bounds)
    return values


def _moment(record: _Record, form: _Format) -> tuple[datetime, float]:
    """Return the time on the first line, in the scale of its system: the minute, labelled UTC, and seconds from there.

    The second may be 60: writers that round print it for the next minute, and UTC has it where a leap second is added.
    """
    text = record.lines[0][form.margin - 1 : form.margin + WIDTH]
    words = text.split()
    try:
        year, month, day, hour, minute = map(integer, words[:5])
        second = decimal(words[5])
        if form.version == 2:
            year += 1900 if year >= 80 else 2000
        if not 0.0 <= second < 61.0:
            raise ValueError(second)
        return datetime(year, month, day, hour, minute, tzinfo=UTC), second
    except (ValueError, IndexError, OverflowError):
        raise InputError(f"{record.where}:{record.first}: {text.strip()!r} is not a time") from None


def _ephemeris(record: _Record, form: _Format) -> Ephemeris:
    """Return the ephemeris of a record of GPS, Galileo or BeiDou."""
    minute, second = _moment(record, form)
    toc = (minute - GPS_ORIGIN).total_seconds() + second
    values = _values(record, form, _KEPLERIAN)
    ahead = math.remainder(values["week_second"] - toc, SECONDS_PER_WEEK)
    if record.name[0] != "E":
        values["data_source"] = 0.0  # for GPS the field gives the codes on L2
    if record.name[0] == "C":
        toc += BDT_BEHIND  # its records are in BeiDou time, whose weeks begin with those of GPS
    return Ephemeris(
        name=record.name,
        toc=toc,
        toe=toc + ahead,
        health=values.pop("health"),
        accuracy=values.pop("accuracy"),
        elements=values,
    )


def _state(record: _Record, form: _Format) -> StateVector:
    """Return the state vector of a record of GLONASS."""
    minute, second = _moment(record, form)
    values = _values(record, form, _GLONASS)
    r_e = _vector(values, "r")
    v_e = _vector(values, "v")
    _refuse_size(record, "position", r_e, _ORBIT, "m")
    _refuse_size(record, "velocity", v_e, _SPEED, "m/s")
    return StateVector(
        name=record.name,
        time=(minute - GPS_ORIGIN).total_seconds() + leap_seconds(minute) + second,
        clock_bias=values["clock_bias"],
        clock_drift=values["clock_drift"],
        r_e=r_e,
        v_e=v_e,
        a_e=_vector(values, "a"),
        health=values["health"],
    )


def _vector(values: dict[str, float], letter: str) -> tuple[float, float, float]:
    """Return a vector of a GLONASS record in m, m/s or m/s^2; the record has kilometres."""
    return 1e3 * values[f"{letter}x"], 1e3 * values[f"{letter}y"], 1e3 * values[f"{letter}z"]


def _refuse_size(
    record: _Record, name: str, vector: tuple[float, float, float], limits: tuple[float, float], unit: str
) -> None:
    """Raise InputError if the length of a vector is outside its limits, as that of a state of zeros."""
    size = math.hypot(*vector)
    low, high = limits
    if not low <= size <= high:
        where = f"{record.where}:{record.first}: {record.name} {name}"
        raise InputError(f"{where}: its size of {size:.6g} {unit} is outside {low:g} to {high:g}")
