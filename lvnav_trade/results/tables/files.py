"""Atomic writing of files, and writing of tables in pieces, so that memory does not grow with the number of runs."""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

CASE_TABLE = ".arrow"
"""Extension of the table of a case: Arrow's own format, which is written and read in a fifth of the time of Parquet."""
ROWS = 16_384  # rows of a row group; fixed, so that files do not depend on the size of the blocks of runs
_WHOLE = 2**31  # largest number of rows of a row group: a table is written as one group
_HOW = {"compression": "lz4", "write_page_checksum": True}  # zstd: a tenth smaller; three times as long for few rows
_QUICK = pa.ipc.IpcWriteOptions(compression="lz4")
_Part = TypeVar("_Part")


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
    with replacing(path) as temporary, temporary.open("xb") as file:
        file.write(content.encode() if isinstance(content, str) else content)


def replace_table(table: pa.Table, path: Path, **how: Any) -> None:
    """Write a table atomically as a Parquet file with one row group."""
    with replacing(path) as temporary:
        pq.write_table(table, temporary, row_group_size=_WHOLE, **{**_HOW, **how})


@contextmanager
def merged_table(path: Path, schema: pa.Schema) -> Iterator[Callable[[pa.Table], None]]:
    """Yield a function that appends a table as a row group to a Parquet file, which is written atomically.

    Only texts have a dictionary: dictionaries of real numbers make the file a quarter larger and take twice as long.
    """
    texts = [field.name for field in schema if field.type == pa.string()]
    with replacing(path) as temporary, pq.ParquetWriter(temporary, schema, use_dictionary=texts, **_HOW) as writer:
        yield partial(writer.write_table, row_group_size=_WHOLE)


@contextmanager
def _case_tables(schemas: Mapping[Path, pa.Schema]) -> Iterator[list[Callable[[pa.Table], None]]]:
    """Yield for each file a function that appends a table as a batch; all files appear at the end, or none."""
    with ExitStack() as files:
        temporaries = [files.enter_context(replacing(path)) for path in schemas]
        opened = [
            files.enter_context(pa.ipc.new_file(str(path), schema, options=_QUICK))
            for path, schema in zip(temporaries, schemas.values(), strict=True)
        ]
        yield [writer.write_table for writer in opened]


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


class Rows:
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

    def noted(self, parts: Iterable[_Part], tables: Callable[[_Part], Mapping[str, pa.Table]]) -> Iterator[_Part]:
        """Yield parts unchanged, one by one, after appending the tables of each."""
        for part in parts:
            self.add(tables(part))
            yield part

    def end(self) -> None:
        """Write the remaining rows."""
        for name, table in self._waiting.items():
            if table.num_rows:
                self._group(name, table)

    def _group(self, name: str, table: pa.Table) -> None:
        """Write a row group in one piece, since otherwise its bytes would depend on the size of the blocks of runs."""
        self._write[name](table.combine_chunks())


@contextmanager
def row_files(folder: Path, empty: Mapping[str, pa.Table]) -> Iterator[Rows]:
    """Yield the writer of a case's tables; all files appear at the end of the ``with`` block, or none.

    empty: tables without rows, which define the columns.
    """
    schemas = {folder / f"{name}{CASE_TABLE}": table.schema for name, table in empty.items()}
    with _case_tables(schemas) as write:
        rows = Rows(dict(zip(empty, write, strict=True)), empty)
        yield rows
        rows.end()
