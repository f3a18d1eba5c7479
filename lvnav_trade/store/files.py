"""Files that appear whole or not at all; tables whose rows come piece by piece: memory does not grow with the runs."""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

ROWS = 16_384  # rows of a row group: the same rows stand in each, whatever blocks the runs were flown in
_WHOLE = 2**31  # rows of a row group at the most: a table is written as one
_HOW = {"compression": "zstd", "write_page_checksum": True}
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
def writers(schemas: Mapping[Path, pa.Schema]) -> Iterator[list[Callable[[pa.Table], None]]]:
    """Give a function for each file that writes a table as its next row group; all files appear at the end, or none."""
    with ExitStack() as files:
        temporaries = [files.enter_context(replacing(path)) for path in schemas]
        opened = [pq.ParquetWriter(*each, **_HOW) for each in zip(temporaries, schemas.values(), strict=True)]
        yield [partial(files.enter_context(writer).write_table, row_group_size=_WHOLE) for writer in opened]


def row_groups(path: Path) -> Iterator[pa.Table]:
    """Yield a file's row groups, one in memory at a time; a file without rows as one table."""
    with pq.ParquetFile(path) as file:
        for k in range(file.num_row_groups):
            yield file.read_row_group(k, use_threads=False)


class Rows:
    """Tables that come piece by piece (see `row_files`)."""

    def __init__(self, write: Mapping[str, Callable[[pa.Table], None]], empty: Mapping[str, pa.Table]) -> None:
        self._write, self._waiting = write, dict(empty)
        self._begun: set[str] = set()

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
        """Write what is left; a table without rows has one row group that is empty."""
        for name, left in self._waiting.items():
            if left.num_rows or name not in self._begun:
                self._group(name, left)

    def _group(self, name: str, table: pa.Table) -> None:
        """Write a row group; in one piece, or its bytes would tell how many runs a block has."""
        self._write[name](table.combine_chunks())
        self._begun.add(name)


@contextmanager
def row_files(folder: Path, empty: Mapping[str, pa.Table]) -> Iterator[Rows]:
    """Give `Rows` for files ``NAME.parquet``, which all appear when all pieces are in, or none.

    empty: the tables without rows.
    """
    schemas = {folder / f"{name}.parquet": table.schema for name, table in empty.items()}
    with writers(schemas) as write:
        rows = Rows(dict(zip(empty, write, strict=True)), empty)
        yield rows
        rows.end()
