"""Files that appear whole or not at all, tables that grow piece by piece, columns from the memory of arrays.

`pyarrow.array` imports pandas to check for pandas objects, which takes 65 MiB and a second in every worker process;
workers have no such objects.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import ArrayLike, NDArray

CASE_TABLE = ".arrow"
"""Extension of the table of a case: Arrow's own format, which is written and read in a fifth of the time of Parquet."""
ROWS = 16_384  # rows of a row group; fixed, so that files do not depend on the size of the blocks of runs
_WHOLE = 2**31  # largest number of rows of a row group: a table is written as one group
# Compression by zstd is a tenth smaller and takes three times as long for few rows
_PARQUET_OPTIONS = {"compression": "lz4", "write_page_checksum": True}
_ARROW_OPTIONS = pa.ipc.IpcWriteOptions(compression="lz4")
_Item = TypeVar("_Item")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield the name of a temporary file that replaces `path` in one step at the end of the ``with`` block.

    After an error the temporary file is removed and `path` is unchanged. A link at `path` is replaced, not followed.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.unlink(missing_ok=True)
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def replace_file(path: Path, content: bytes | str) -> None:
    """Write a file atomically: after an interruption the old content remains."""
    if isinstance(content, str):
        content = content.encode()
    with replacing(path) as temporary, temporary.open("xb") as file:
        file.write(content)


def replace_table(table: pa.Table, path: Path, **options: Any) -> None:
    """Write a table atomically as a Parquet file with one row group."""
    with replacing(path) as temporary:
        pq.write_table(table, temporary, row_group_size=_WHOLE, **{**_PARQUET_OPTIONS, **options})


@contextmanager
def merged_table(path: Path, schema: pa.Schema) -> Iterator[Callable[[pa.Table], None]]:
    """Yield a function that appends a table as a row group to a Parquet file, which is written atomically.

    Only texts have a dictionary: dictionaries of real numbers make the file a quarter larger and take twice as long.
    """
    texts = [field.name for field in schema if field.type == pa.string()]
    with (
        replacing(path) as temporary,
        pq.ParquetWriter(temporary, schema, use_dictionary=texts, **_PARQUET_OPTIONS) as writer,
    ):
        yield partial(writer.write_table, row_group_size=_WHOLE)


@contextmanager
def _case_tables(schemas: Mapping[Path, pa.Schema]) -> Iterator[list[Callable[[pa.Table], None]]]:
    """Yield for each file a function that appends a table as a batch; all files appear at the end, or none."""
    with ExitStack() as files:
        temporaries = [files.enter_context(replacing(path)) for path in schemas]
        append = []
        for path, schema in zip(temporaries, schemas.values(), strict=True):
            writer = files.enter_context(pa.ipc.new_file(str(path), schema, options=_ARROW_OPTIONS))
            append.append(writer.write_table)
        yield append


def write_case_table(table: pa.Table, path: Path) -> None:
    """Write the table of a case atomically."""
    with _case_tables({path: table.schema}) as (write,):
        write(table)


def case_schema(path: Path) -> pa.Schema:
    """Return the schema of a case's table."""
    with pa.memory_map(str(path)) as source, pa.ipc.open_file(source) as file:
        return file.schema


def has_rows(path: Path) -> bool:
    """Whether a case's table has rows."""
    with pa.memory_map(str(path)) as source, pa.ipc.open_file(source) as file:
        return any(file.get_batch(k).num_rows for k in range(file.num_record_batches))


def batches(path: Path) -> Iterator[pa.Table]:
    """Yield the batches of a case's table, one in memory at a time."""
    with pa.memory_map(str(path)) as source, pa.ipc.open_file(source) as file:
        for k in range(file.num_record_batches):
            yield pa.Table.from_batches([file.get_batch(k)])


class RowWriter:
    """Writer of tables in pieces, see `row_files`."""

    def __init__(self, write: Mapping[str, Callable[[pa.Table], None]], empty: Mapping[str, pa.Table]) -> None:
        self._write, self._waiting = write, dict(empty)

    def add(self, tables: Mapping[str, pa.Table]) -> None:
        """Append rows to each table."""
        for name, table in tables.items():
            waiting = pa.concat_tables([self._waiting[name], table])
            while waiting.num_rows >= ROWS:
                self._group(name, waiting.slice(0, ROWS))
                waiting = waiting.slice(ROWS)
            self._waiting[name] = waiting

    def record_tables(
        self, items: Iterable[_Item], tables: Callable[[_Item], Mapping[str, pa.Table]]
    ) -> Iterator[_Item]:
        """Yield items unchanged, after appending the tables of each item."""
        for item in items:
            self.add(tables(item))
            yield item

    def end(self) -> None:
        """Write the remaining rows."""
        for name, table in self._waiting.items():
            if table.num_rows:
                self._group(name, table)

    def _group(self, name: str, table: pa.Table) -> None:
        """Write a row group in one piece, since otherwise its bytes would depend on the size of the blocks of runs."""
        self._write[name](table.combine_chunks())


@contextmanager
def row_files(folder: Path, empty: Mapping[str, pa.Table]) -> Iterator[RowWriter]:
    """Yield the writer of a case's tables; all files appear at the end of the ``with`` block, or none.

    empty: tables without rows, which define the columns.
    """
    schemas = {folder / f"{name}{CASE_TABLE}": table.schema for name, table in empty.items()}
    with _case_tables(schemas) as write:
        rows = RowWriter(dict(zip(empty, write, strict=True)), empty)
        yield rows
        rows.end()


_DTYPES = {pa.float64(): np.float64, pa.int64(): np.int64, pa.bool_(): np.bool_}


class Coded(Sequence[str]):
    """Texts (n,) as distinct texts and an index (n,) into them, in a tenth of the time for n texts."""

    def __init__(self, distinct: Sequence[str], numbers: ArrayLike) -> None:
        self.distinct = distinct
        self.numbers: NDArray[np.int32] = np.ascontiguousarray(numbers, dtype=np.int32)

    def __len__(self) -> int:
        return self.numbers.size

    def __getitem__(self, index: Any) -> Any:
        return np.array(self.distinct)[self.numbers[index]]

    def texts(self) -> pa.StringArray:
        """Return the texts as an Arrow array."""
        encoded_texts = [text.encode() for text in self.distinct]
        n = len(self)
        if len(encoded_texts) == 1:
            text = encoded_texts[0]
            offsets = np.arange(n + 1, dtype=np.int32) * np.int32(len(text))
            content = text * n
            return pa.StringArray.from_buffers(n, pa.py_buffer(offsets), pa.py_buffer(content))
        lengths = map(len, encoded_texts)
        offsets = np.cumsum([0, *lengths], dtype=np.int32)
        content = b"".join(encoded_texts)
        distinct = pa.StringArray.from_buffers(len(encoded_texts), pa.py_buffer(offsets), pa.py_buffer(content))
        buffers = [None, pa.py_buffer(self.numbers)]
        numbers = pa.Array.from_buffers(pa.int32(), n, buffers)
        return distinct.take(numbers)


def column(values: ArrayLike | Iterable[str] | Coded, data_type: pa.DataType) -> pa.Array:
    """Return values (n,) as an Arrow array, if possible without a copy.

    Parameters
    ----------
    values : array_like, iterable of str or Coded
        Values (n,).
    data_type : pyarrow.DataType
        Text, real or whole number, or truth value.

    Raises
    ------
    TypeError
        Real numbers would become whole numbers.
    """
    if isinstance(values, Coded):
        return values.texts()
    if data_type == pa.string():
        if isinstance(values, np.ndarray):
            return texts(values.tolist())
        return texts(list(values))  # type: ignore[arg-type]
    array: NDArray[Any] = np.asarray(values)
    dtype = np.dtype(_DTYPES[data_type])
    if array.size == 0:
        array = array.astype(dtype)  # numpy converts an empty list to real numbers
    array = np.ascontiguousarray(array.astype(dtype, casting="same_kind", copy=False))
    if data_type == pa.bool_():
        content = np.packbits(array, bitorder="little")
    else:
        content = array
    return pa.Array.from_buffers(data_type, array.size, [None, pa.py_buffer(content)])


def texts(values: list[str]) -> pa.StringArray:
    """Return texts, most of them repeated, as an Arrow array."""
    distinct = list(dict.fromkeys(values))
    number_by_text = {text: number for number, text in enumerate(distinct)}
    numbers = np.fromiter((number_by_text[text] for text in values), np.int32, len(values))
    return Coded(distinct, numbers).texts()


def binaries(values: list[NDArray[Any]]) -> pa.LargeBinaryArray:
    """Return the bytes of contiguous arrays, one array per row."""
    sizes = [value.nbytes for value in values]
    ends = np.cumsum([0, *sizes], dtype=np.int64)
    content = np.empty(int(ends[-1]), dtype=np.uint8)
    for value, start, end in zip(values, ends, ends[1:], strict=False):
        flat = value.reshape(-1)
        content[start:end] = flat.view(np.uint8)
    buffers = [None, pa.py_buffer(ends), pa.py_buffer(content)]
    n_row = len(values)
    return pa.LargeBinaryArray.from_buffers(pa.large_binary(), n_row, buffers)


def integers(rows: Sequence[Sequence[int]]) -> pa.ListArray:
    """Return lists of whole numbers, one list per row."""
    lengths = [len(row) for row in rows]
    ends = np.cumsum([0, *lengths], dtype=np.int32)
    numbers: list[int] = []
    for row in rows:
        numbers += row
    content = column(np.array(numbers, dtype=np.int64), pa.int64())
    offsets = pa.Array.from_buffers(pa.int32(), ends.size, [None, pa.py_buffer(ends)])
    return pa.ListArray.from_arrays(offsets, content)
