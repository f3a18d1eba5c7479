"""Files that appear whole or not at all; tables whose rows come piece by piece: memory does not grow with the runs."""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

CASE_TABLE = ".arrow"
"""How the name of a case's table ends: Arrow's own format, which is written and read in a fifth of Parquet's time."""
ROWS = 16_384  # rows of a row group: the same rows stand in each, whatever blocks the runs were flown in
_WHOLE = 2**31  # rows of a row group at the most: a table is written as one
_HOW = {"compression": "lz4", "write_page_checksum": True}  # zstd: a tenth smaller; three times as long for few rows
_QUICK = pa.ipc.IpcWriteOptions(compression="lz4")
_Part = TypeVar("_Part")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give the name of a new file, which takes the place of `path` in one step at the end; none is left on an error.

    A link at `path` is replaced, not followed.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.unlink(missing_ok=True)
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def replace_file(path: Path, content: bytes | str) -> None:
    """Write a file in one step that either happens or does not."""
    with replacing(path) as temporary, temporary.open("xb") as file:
        file.write(content.encode() if isinstance(content, str) else content)


def replace_table(table: pa.Table, path: Path, **how: Any) -> None:
    """Write a table as one row group in one step that either happens or does not."""
    with replacing(path) as temporary:
        pq.write_table(table, temporary, row_group_size=_WHOLE, **{**_HOW, **how})


@contextmanager
def merged_table(path: Path, schema: pa.Schema) -> Iterator[Callable[[pa.Table], None]]:
    """Give a function that writes a table as the next row group of a Parquet file, which appears at the end, or not.

    Only texts have a dictionary: one of real numbers makes the file a quarter larger, and takes twice as long.
    """
    texts = [field.name for field in schema if field.type == pa.string()]
    with replacing(path) as temporary, pq.ParquetWriter(temporary, schema, use_dictionary=texts, **_HOW) as writer:
        yield partial(writer.write_table, row_group_size=_WHOLE)


@contextmanager
def _case_tables(schemas: Mapping[Path, pa.Schema]) -> Iterator[list[Callable[[pa.Table], None]]]:
    """Give a function for each file that writes a table as its next batch; all files appear at the end, or none."""
    with ExitStack() as files:
        temporaries = [files.enter_context(replacing(path)) for path in schemas]
        opened = [
            files.enter_context(pa.ipc.new_file(str(path), schema, options=_QUICK))
            for path, schema in zip(temporaries, schemas.values(), strict=True)
        ]
        yield [writer.write_table for writer in opened]


def write_case_table(table: pa.Table, path: Path) -> None:
    """Write a case's table in one step that either happens or does not."""
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
    """Tables that come piece by piece (see `row_files`)."""

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
        """Hand parts on, one by one, after appending their tables."""
        for part in parts:
            self.add(tables(part))
            yield part

    def end(self) -> None:
        """Write what is left."""
        for name, left in self._waiting.items():
            if left.num_rows:
                self._group(name, left)

    def _group(self, name: str, table: pa.Table) -> None:
        """Write a row group; in one piece, or its bytes would tell how many runs a block has."""
        self._write[name](table.combine_chunks())


@contextmanager
def row_files(folder: Path, empty: Mapping[str, pa.Table]) -> Iterator[Rows]:
    """Give `Rows` for the files of a case's tables, which all appear when all pieces are in, or none.

    empty: the tables without rows.
    """
    schemas = {folder / f"{name}{CASE_TABLE}": table.schema for name, table in empty.items()}
    with _case_tables(schemas) as write:
        rows = Rows(dict(zip(empty, write, strict=True)), empty)
        yield rows
        rows.end()
