"""A record of time, speed and altitude read from CSV, with every mistake named by file and line."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.errors import InputError, quoted
from lvnav_trade.input_files import read_bytes
from lvnav_trade.limits import DATA_BYTES

Floats = NDArray[np.float64]

HEADER = ["time_s", "speed_m_s", "altitude_m"]
_GAP = 6.0  # times the usual interval: what a fit can still bridge


class Record(NamedTuple):
    """Time since lift-off (n,) s, Earth-relative speed (n,) m/s, altitude over the site (n,) m."""

    t: Floats
    speed: Floats
    altitude: Floats


def read(path: str) -> Record:
    """Return the record in a CSV file with the header ``time_s,speed_m_s,altitude_m``; # begins a comment line.

    InputError names file, line and fault: no such file, wrong header, a field that is no finite number, a time that
    does not rise, a gap, a negative speed, fewer than 12 rows.
    """
    rows: list[list[float]] = []
    header: list[str] | None = None
    for number, line in enumerate(_lines(path), start=1):
        text = line.strip()
        if not text or text.startswith("#"):
            continue
        fields = [field.strip() for field in text.split(",")]
        if header is None:
            header = fields
            _check_header(fields, f"{path}:{number}")
        else:
            rows.append(_row(fields, rows[-1] if rows else None, f"{path}:{number}"))
    if len(rows) < 12:
        raise InputError(f"{path}: {len(rows)} rows of data, an ascent needs 12 or more")
    table = np.array(rows)
    _check_gaps(table[:, 0], path)
    return Record(table[:, 0], table[:, 1], table[:, 2])


def _lines(path: str) -> list[str]:
    try:
        return read_bytes(path, DATA_BYTES).decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not a text file") from None


def _check_header(fields: list[str], where: str) -> None:
    if fields != HEADER:
        raise InputError(f"{where}: the header is {quoted(','.join(fields))}, expected {','.join(HEADER)!r}")


def _row(fields: list[str], before: list[float] | None, where: str) -> list[float]:
    """Return one row of three numbers."""
    if len(fields) != len(HEADER):
        raise InputError(f"{where}: {len(fields)} fields, expected {len(HEADER)}")
    row = []
    for name, field in zip(HEADER, fields, strict=True):
        try:
            value = float(field)
        except ValueError:
            raise InputError(f"{where}: {name} is {quoted(field)}, not a number") from None
        if not math.isfinite(value):
            raise InputError(f"{where}: {name} is {quoted(field)}, not a finite number")
        row.append(value)
    if row[1] < 0.0:
        raise InputError(f"{where}: speed_m_s is {fields[1]}, a speed is not negative")
    if before is not None and row[0] <= before[0]:
        fault = "repeats" if row[0] == before[0] else "goes back from"
        raise InputError(f"{where}: time_s {fields[0]} {fault} {before[0]:g} s of the row before")
    return row


def _check_gaps(t: Floats, path: str) -> None:
    interval = np.diff(t)
    usual = float(np.median(interval))
    k = int(np.argmax(interval))
    if interval[k] > _GAP * usual:
        raise InputError(
            f"{path}: no data between {t[k]:g} s and {t[k + 1]:g} s, where rows are {usual:g} s apart elsewhere"
        )
