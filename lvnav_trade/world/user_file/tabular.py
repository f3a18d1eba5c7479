"""Columns of numbers read from CSV or Parquet, with every mistake named by file and row."""

from __future__ import annotations

import csv
import difflib
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.errors import InputError, quoted
from lvnav_trade.input_files import read_bytes
from lvnav_trade.limits import DATA_BYTES, DATA_ROWS, FIELD_LENGTH

Floats = NDArray[np.float64]

FEWEST = 12  # rows from which a flight can be rebuilt
_GAP = 6.0  # times the longer of the intervals beside it: what a spline can still bridge


def read_columns(
    path: str, names: list[str], delimiter: str, fewest: int = FEWEST, what: str = "a trajectory"
) -> tuple[Floats, list[str]]:
    """Return the columns `names` of a CSV or Parquet file (n, n_name), and where each row stands, for messages.

    A name that ends in .parquet or .pq is Parquet; anything else is text with one line of headers, in which lines that
    begin with # are comments. InputError names file, row and fault: no such file, no such column, a field that is no
    finite number, fewer rows than `what` they are of needs.
    """
    if Path(path).suffix.lower() in (".parquet", ".pq"):
        table, places = _parquet(path, names)
    else:
        table, places = _text(path, names, delimiter)
    if len(table) < fewest:
        raise InputError(f"{path}: {len(table)} rows of data, {what} needs {fewest} or more")
    wrong = np.argwhere(~np.isfinite(table))
    if wrong.size:
        row, column = wrong[0]
        raise InputError(f"{path}:{places[row]}: {names[column]} is {table[row, column]}, not a finite number")
    return table, places


def _parquet(path: str, names: list[str]) -> tuple[Floats, list[str]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        file = pq.ParquetFile(path)
        _refuse_missing(path, names, list(file.schema_arrow.names))
        if file.metadata.num_rows > DATA_ROWS:
            raise InputError(f"{path}: {file.metadata.num_rows} rows; at most {DATA_ROWS} are read")
        table = file.read(columns=names)
        columns = [table.column(name).cast(pa.float64()).to_numpy(zero_copy_only=False) for name in names]
    except (OSError, pa.ArrowException) as error:
        raise InputError(f"{path}: cannot be read as Parquet: {str(error).partition(chr(10))[0]}") from None
    return np.column_stack(columns).astype(float), [f"row {number}" for number in range(1, table.num_rows + 1)]


def _text(path: str, names: list[str], delimiter: str) -> tuple[Floats, list[str]]:
    lines = _lines(path)
    number, header = next(lines, (0, ""))
    if not header:
        raise InputError(f"{path}: is empty")
    titles = [title.strip() for title in _fields(header, delimiter, f"{path}:{number}")]
    _refuse_missing(f"{path}:{number}", names, titles)
    at = [titles.index(name) for name in names]
    rows: list[list[float]] = []
    places: list[str] = []
    for number, line in lines:
        fields = _fields(line, delimiter, f"{path}:{number}")
        if len(fields) != len(titles):
            raise InputError(f"{path}:{number}: {len(fields)} fields, the header has {len(titles)}")
        rows.append([_number(fields[k], titles[k], f"{path}:{number}") for k in at])
        if len(rows) > DATA_ROWS:
            raise InputError(f"{path}:{number}: more than {DATA_ROWS} rows")
        places.append(str(number))
    return np.array(rows, dtype=float).reshape(len(rows), len(names)), places


def _fields(line: str, delimiter: str, where: str) -> list[str]:
    """Return the fields of a line; InputError where one is longer than any number or name."""
    if len(line) > FIELD_LENGTH:
        longest = max(map(len, line.split(delimiter)))
        if longest > FIELD_LENGTH:
            raise InputError(f"{where}: a field of {longest} characters; at most {FIELD_LENGTH} are read")
    try:
        return next(csv.reader([line], delimiter=delimiter))
    except csv.Error as error:
        raise InputError(f"{where}: {error}") from None


def _lines(path: str) -> Iterator[tuple[int, str]]:
    """Yield the lines that say something, with their numbers."""
    try:
        text = read_bytes(path, DATA_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not a text file") from None
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield number, line


def _refuse_missing(where: str, names: list[str], titles: list[str]) -> None:
    for name in names:
        if name not in titles:
            near = difflib.get_close_matches(name, titles, n=1, cutoff=0.5)
            hint = f"did you mean {near[0]!r}?" if near else f"it has {', '.join(titles[:20])}"
            raise InputError(f"{where}: no column {quoted(name)} ({hint})")
        if titles.count(name) > 1:
            raise InputError(f"{where}: column {name!r} stands {titles.count(name)} times")


def _number(field: str, title: str, where: str) -> float:
    try:
        return float(field)
    except ValueError:
        raise InputError(f"{where}: {title} is {quoted(field.strip())}, not a number") from None


def refuse_unordered(t: Floats, path: str, places: list[str]) -> Floats:
    """Return the intervals (n - 1,) between times t (n,) in s; InputError where they repeat or go back."""
    interval = np.diff(t)
    for k in np.flatnonzero(interval <= 0.0)[:1]:
        fault = "repeats" if interval[k] == 0.0 else "goes back from"
        raise InputError(f"{path}:{places[k + 1]}: time {t[k + 1]:.9g} s {fault} {t[k]:.9g} s of the row before")
    return interval


def refuse_bad_times(t: Floats, path: str, places: list[str]) -> None:
    """InputError where times t (n,) in s repeat, go back, or leave a gap that no spline bridges."""
    interval = refuse_unordered(t, path, places)
    beside = np.maximum(np.append(interval[1:], 0.0), np.append(0.0, interval[:-1]))
    k = int(np.argmax(interval / beside))
    if interval[k] > _GAP * beside[k]:
        raise InputError(
            f"{path}:{places[k + 1]}: no data between {t[k]:g} s and {t[k + 1]:g} s, where rows beside are "
            f"{beside[k]:g} s apart"
        )


def rounding(column: Floats) -> float:
    """Return one sigma of the rounding of a column's numbers, seen in their digits; zero where they carry them all."""
    if np.all(column == column[0]):
        return 0.0
    largest = float(np.max(np.abs(column)))
    for digits in range(-3, 10):
        scaled = column * 10.0**digits
        if largest * 10.0**digits > 2.0**40:  # a double has hardly a digit more to round
            break
        if np.ptp(scaled) >= 1.0 and np.all(np.abs(scaled - np.rint(scaled)) < 1e-3):
            return 10.0**-digits / math.sqrt(12.0)
    return 0.0
