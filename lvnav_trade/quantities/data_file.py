"""Columns of a user's file, CSV or Parquet: numbers and texts by column name, and the place of each row."""

import csv
import difflib
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.quantities.errors import InputError, quoted
from lvnav_trade.quantities.input_files import decimal_or_endless, is_plain, open_regular, read_text
from lvnav_trade.quantities.input_limits import DATA_BYTES, DATA_ROWS, FIELD_LENGTH
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.times import coarse_message, restore_time_stamps

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

FEWEST = 12  # rows; smallest number for a trajectory
_PREFIXED = "DELTA_BYTE_ARRAY"  # a text encoding whose unpacked size is not in the metadata


def read_columns(
    path: str,
    names: list[str],
    delimiter: str,
    minimum_rows: int = FEWEST,
    data_name: str = "a trajectory",
    blanks: tuple[str, ...] = (),
) -> tuple[Floats, list[str]]:
    """Return columns of numbers of a CSV or Parquet file, (n, n_name), and the place of each row for messages.

    A file named .parquet or .pq is Parquet. Any other file is text with a header line; lines that begin with # are
    comments. If the first line has numbers, the last comment before it with as many names is the header.

    Parameters
    ----------
    path : str
        File.
    names : list of str
        Names of the columns.
    delimiter : str
        Separator of a text file.
    minimum_rows : int
        Smallest number of rows.
    data_name : str
        Kind of data with that smallest number, for messages.
    blanks : tuple of str
        Columns in which a missing number is NaN.

    Raises
    ------
    InputError
        No such file, no such column, a field that is no finite number, too few rows. The message names file and row.
    """
    if _is_parquet(path):
        table, places = _parquet_numbers(path, names)
    else:
        table, places = _text_numbers(path, names, delimiter, blanks)
    if len(table) < minimum_rows:
        raise InputError(f"{path}: {len(table)} rows of data, {data_name} needs {minimum_rows} or more")
    is_blank = np.isnan(table) & np.isin(names, blanks)
    is_wrong = ~np.isfinite(table) & ~is_blank
    for row, column in np.argwhere(is_wrong)[:1]:
        name = names[column]
        number = table[row, column]
        raise InputError(f"{path}:{places[row]}: {name} is {number}, not a finite number")
    return table, places


def read_texts(path: str, name: str, delimiter: str = ",") -> list[str]:
    """Return a column of texts, row by row, of a file that `read_columns` has read; InputError if there is none."""
    if _is_parquet(path):
        return _parquet_texts(path, name)
    head = _head(path, delimiter)
    _refuse_missing(f"{path}:{head.number}", [name], head.titles)
    column = head.titles.index(name)
    texts = []
    for number, line in head.lines:
        fields = _fields(line, delimiter, f"{path}:{number}")
        texts.append(fields[column].strip())
    return texts


def _parquet_texts(path: str, name: str) -> list[str]:
    import pyarrow as pa

    with _parquet(path, (name,)) as file:  # as a dictionary, so that repeated texts are in memory once
        column_type = _column_type(path, file, name)
        has_texts = pa.types.is_string(column_type) or pa.types.is_large_string(column_type)
        if not has_texts:
            raise InputError(f"{path}: column {name!r} is of {column_type}, not of texts")
        _try_first_row(file, [name])
        _refuse_large(path, file, [name])
        table = file.read(columns=[name])
        column = table.column(0).combine_chunks()
        column = column.cast(pa.dictionary(pa.int32(), pa.string()))
        column.validate(full=True)  # a damaged file may have indices without a text
        texts = column.dictionary.to_pylist()
        index = column.indices.to_pylist()
    longest = max(map(len, texts), default=0)
    if longest > FIELD_LENGTH:
        raise InputError(f"{path}: {name}: a text of {longest} characters; at most {FIELD_LENGTH} are read")
    return ["" if k is None else texts[k] for k in index]


def column_names(path: str, delimiter: str = ",") -> list[str]:
    """Return the names of the columns of a CSV or Parquet file; InputError if it cannot be read."""
    if not _is_parquet(path):
        return _head(path, delimiter, empty=True).titles
    with _parquet(path) as file:
        return list(file.schema_arrow.names)


def refuse_first(is_wrong: NDArray[np.bool_], path: str, places: list[str], fault: Callable[[int], str]) -> None:
    """Raise InputError for the first row that is wrong (n,); `fault` returns its message."""
    for k in np.flatnonzero(is_wrong)[:1]:
        message = fault(int(k))
        raise InputError(f"{path}:{places[k]}: {message}")


def refuse_unordered(t: Floats, path: str, places: list[str]) -> Floats:
    """Return the intervals (n - 1,) between times t (n,) in s; InputError if times repeat or decrease."""
    interval = np.diff(t)
    wrong_intervals = np.flatnonzero(interval <= 0.0)
    if wrong_intervals.size:
        k = wrong_intervals[0]
        previous_time = t[k]
        next_time = t[k + 1]
        fault = "repeats" if interval[k] == 0.0 else "goes back from"
        raise InputError(
            f"{path}:{places[k + 1]}: time {next_time:.9g} s {fault} {previous_time:.9g} s of the row before"
        )
    return interval


def time_stamps(column: Floats, unit: str, path: str, places: list[str]) -> Floats:
    """Return a column of time (n,), restored to its grid if of single precision; InputError if such times repeat."""
    stamps = restore_time_stamps(column, unit)
    interval = np.diff(column, prepend=-math.inf)
    is_repeated = (interval == 0.0) & (stamps.spacing > 0.0)

    def fault(row: int) -> str:
        return f"time {column[row]:.9g} {unit} repeats: {coarse_message(stamps.spacing, unit)}"

    refuse_first(is_repeated, path, places, fault)
    return stamps.column


# --- Parquet ----------------------------------------------------------------------------------------------------------


def _is_parquet(path: str) -> bool:
    return Path(path).suffix.lower() in (".parquet", ".pq")


@contextmanager
def _parquet(path: str, texts: tuple[str, ...] = ()) -> "Iterator[pq.ParquetFile]":
    """Open a Parquet file and turn errors of its library into InputError.

    texts : Columns to read as dictionaries.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    with open_regular(path, DATA_BYTES) as content:
        try:
            yield pq.ParquetFile(content, read_dictionary=list(texts))
        except (OSError, pa.ArrowException, LookupError, UnicodeError) as error:  # of damaged names and indices too
            first_line, _, _ = str(error).partition("\n")
            raise InputError(f"{path}: cannot be read as Parquet: {first_line}") from None


def _parquet_numbers(path: str, names: list[str]) -> tuple[Floats, list[str]]:
    import pyarrow as pa

    with _parquet(path) as file:
        for name in names:
            column_type = _column_type(path, file, name)
            _refuse_no_number(path, name, column_type)
        _try_first_row(file, names)
        _refuse_large(path, file, names)
        table = file.read(columns=names)
        # unsafe cast: integers beyond 2**53, such as nanoseconds since 1970, are rounded as in a CSV file
        columns = [table.column(name).cast(pa.float64(), safe=False).to_numpy() for name in names]
    places = [f"row {number}" for number in range(1, table.num_rows + 1)]
    numbers = np.column_stack(columns).astype(float)
    return numbers, places


def _column_type(path: str, file: "pq.ParquetFile", name: str) -> "pa.DataType":
    """Return the type of a column, for a dictionary that of its values; InputError if there is no such column."""
    import pyarrow as pa

    _refuse_missing(path, [name], list(file.schema_arrow.names))
    column_type = file.schema_arrow.field(name).type
    return column_type.value_type if pa.types.is_dictionary(column_type) else column_type


def _refuse_no_number(path: str, name: str, column_type: "pa.DataType") -> None:
    """Raise InputError if the type of a column is not numeric."""
    from pyarrow import types

    if types.is_integer(column_type) or types.is_floating(column_type) or types.is_decimal(column_type):
        return
    is_moment = types.is_timestamp(column_type) or types.is_date(column_type) or types.is_time(column_type)
    hint = f"of {column_type}, not of numbers"
    if is_moment or types.is_duration(column_type):
        hint += ": write seconds, in pandas such as (t - t.iloc[0]).dt.total_seconds()"
    elif types.is_string(column_type) or types.is_large_string(column_type):
        hint = "of texts, not of numbers"
    elif types.is_boolean(column_type):
        hint = "of truth values, not of numbers"
    raise InputError(f"{path}: column {name!r} is {hint}")


def _try_first_row(file: "pq.ParquetFile", names: list[str]) -> None:
    """Read a row of each group with small pages.

    Damaged statistics of a column raise an error here; without this read they end the process when the metadata of the
    column are accessed.
    """
    for group in range(file.num_row_groups):
        size = file.metadata.row_group(group).total_byte_size
        if size <= DATA_BYTES:
            batches = file.iter_batches(batch_size=1, row_groups=[group], columns=names)
            next(batches, None)


def _refuse_large(path: str, file: "pq.ParquetFile", names: list[str]) -> None:
    """Raise InputError if a file has too many rows, or its columns `names` are too large unpacked."""
    metadata = file.metadata
    if metadata.num_rows > DATA_ROWS:
        raise InputError(f"{path}: {metadata.num_rows} rows; at most {DATA_ROWS} are read")
    columns = []
    for k in range(metadata.num_columns):
        column_name, _, _ = metadata.schema.column(k).path.partition(".")
        if column_name in names:
            columns.append(k)
    chunks = []
    for group in range(metadata.num_row_groups):
        row_group = metadata.row_group(group)
        chunks += [row_group.column(k) for k in columns]
    size = sum(chunk.total_uncompressed_size for chunk in chunks)
    if size > DATA_BYTES:
        raise InputError(f"{path}: {', '.join(names)}: unpacked {size} bytes; at most {DATA_BYTES} are read")
    if any(_PREFIXED in chunk.encodings for chunk in chunks):
        raise InputError(f"{path}: {', '.join(names)}: encoded as {_PREFIXED}; write it plain or as a dictionary")


# --- text -------------------------------------------------------------------------------------------------------------


class _Head(NamedTuple):
    """Header of a text file: its line number, the names of the columns, and the numbered lines of data."""

    number: int
    titles: list[str]
    lines: list[tuple[int, str]]


def _head(path: str, delimiter: str, empty: bool = False) -> _Head:
    """Return the header of a text file; InputError if it has none, or is empty unless `empty` allows it."""
    comments: list[tuple[int, str]] = []
    lines: list[tuple[int, str]] = []
    text_lines = read_text(path, DATA_BYTES).splitlines()
    for number, line in enumerate(text_lines, start=1):
        if line.lstrip().startswith("#"):
            if not lines:
                comments.append((number, line))
        elif line.strip():
            lines.append((number, line))
    if not lines:
        if empty:
            return _Head(0, [], [])
        raise InputError(f"{path}: is empty")
    number, first = lines[0]
    titles = _titles(first, delimiter, f"{path}:{number}")
    if not all(map(_is_number, titles)):
        return _Head(number, titles, lines[1:])
    for comment_number, comment in reversed(comments):
        content = comment.lstrip().lstrip("#")
        names = _titles(content, delimiter, f"{path}:{comment_number}")
        if len(names) == len(titles) and not any(map(_is_number, names)):
            return _Head(comment_number, names, lines)
    raise InputError(f"{path}:{number}: has numbers where the names of the columns should be: add a line of names")


def _titles(line: str, delimiter: str, place: str) -> list[str]:
    return [title.strip() for title in _fields(line, delimiter, place)]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _text_numbers(path: str, names: list[str], delimiter: str, blanks: tuple[str, ...]) -> tuple[Floats, list[str]]:
    head = _head(path, delimiter)
    titles = head.titles
    _refuse_missing(f"{path}:{head.number}", names, titles)
    columns = [titles.index(name) for name in names]
    may_be_empty = {titles.index(name) for name in blanks}
    rows: list[list[float]] = []
    places: list[str] = []
    for number, line in head.lines:
        place = f"{path}:{number}"
        fields = _fields(line, delimiter, place)
        if len(fields) != len(titles):
            raise InputError(f"{place}: {len(fields)} fields, the header has {len(titles)}")
        row = _plain_numbers(line, fields, columns)
        if row is None:
            row = []
            for k in columns:
                field = fields[k]
                is_blank = k in may_be_empty and not field.strip()
                row.append(math.nan if is_blank else _number(field, titles[k], place))
        rows.append(row)
        if len(rows) > DATA_ROWS:
            raise InputError(f"{place}: more than {DATA_ROWS} rows")
        places.append(str(number))
    numbers = np.array(rows, dtype=float).reshape(len(rows), len(names))
    return numbers, places


def _fields(line: str, delimiter: str, place: str) -> list[str]:
    """Return the fields of a line; InputError if a field is longer than any number or name."""
    longest = 0
    if len(line) > FIELD_LENGTH:
        longest = max(map(len, line.split(delimiter)))
    if longest > FIELD_LENGTH:
        raise InputError(f"{place}: a field of {longest} characters; at most {FIELD_LENGTH} are read")
    try:
        return next(csv.reader([line], delimiter=delimiter))
    except csv.Error as error:
        raise InputError(f"{place}: {error}") from None


def _refuse_missing(place: str, names: list[str], titles: list[str]) -> None:
    for name in names:
        if name not in titles:
            near = difflib.get_close_matches(name, titles, n=1, cutoff=0.5)
            title_list = ", ".join(titles[:20])
            hint = f"did you mean {near[0]!r}?" if near else f"it has {title_list}"
            raise InputError(f"{place}: no column {quoted(name)} ({hint})")
        count = titles.count(name)
        if count > 1:
            raise InputError(f"{place}: {count} columns have the name {name!r}; rename all but one")


def _plain_numbers(line: str, fields: list[str], columns: list[int]) -> list[float] | None:
    """Return the numbers in the columns of a line; None if one of its fields is empty or not a number."""
    if not is_plain(line):
        return None
    try:
        return [float(fields[k]) for k in columns]
    except ValueError:
        return None


def _number(field: str, title: str, place: str) -> float:
    try:
        return decimal_or_endless(field)
    except ValueError:
        raise InputError(f"{place}: {title} is {quoted(field.strip())}, not a number") from None
