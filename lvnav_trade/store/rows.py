"""Tables with rows of every run, written while the parts of a case are read: memory does not grow with the runs."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

ROWS = 16_384
"""Rows of a row group: the same rows stand in each, whatever blocks the runs were flown in."""
_Part = TypeVar("_Part")


class RowFiles:
    """Files ``NAME.parquet`` of tables that come piece by piece; all of them appear when all pieces are in, or none.

    empty: the tables without rows.
    """

    def __init__(self, folder: Path, empty: Mapping[str, pa.Table]) -> None:
        self._waiting = dict(empty)
        self._begun: set[str] = set()
        self._paths = {name: folder / f"{name}.parquet" for name in empty}
        self._parts = {name: path.with_name(f".{path.name}.{os.getpid()}") for name, path in self._paths.items()}
        self._writers: dict[str, pq.ParquetWriter] = {}

    def __enter__(self) -> Self:
        how = {"compression": "zstd", "write_page_checksum": True}
        for name, table in self._waiting.items():
            self._writers[name] = pq.ParquetWriter(self._parts[name], table.schema, **how)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        try:
            for name, writer in self._writers.items():
                left = self._waiting[name]
                if kind is None and (left.num_rows or name not in self._begun):
                    self._write(name, left)
                writer.close()
            if kind is None:
                for name, path in self._paths.items():
                    os.replace(self._parts[name], path)
        finally:
            for part in self._parts.values():
                part.unlink(missing_ok=True)

    def add(self, tables: Mapping[str, pa.Table]) -> None:
        """Append rows to each table."""
        for name, table in tables.items():
            waiting = pa.concat_tables([self._waiting[name], table])
            while waiting.num_rows >= ROWS:
                self._write(name, waiting.slice(0, ROWS))
                waiting = waiting.slice(ROWS)
            self._waiting[name] = waiting

    def _write(self, name: str, table: pa.Table) -> None:
        """Write a row group; in one piece, or its bytes would tell how many runs a block has."""
        self._writers[name].write_table(table.combine_chunks(), row_group_size=max(1, table.num_rows))
        self._begun.add(name)

    def noted(self, parts: Iterable[_Part], tables: Callable[[_Part], Mapping[str, pa.Table]]) -> Iterator[_Part]:
        """Hand parts on, one by one, after appending their tables."""
        for part in parts:
            self.add(tables(part))
            yield part


def row_groups(path: Path) -> Iterator[pa.Table]:
    """Yield a file's row groups, one in memory at a time; a file without rows as one table."""
    with pq.ParquetFile(path) as file:
        for k in range(file.num_row_groups):
            yield file.read_row_group(k, use_threads=False)
