"""One file per block of runs: written whole or not at all, checked when read."""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from lvnav_trade.engines.statistics import BlockSummary

_LOG = logging.getLogger("lvnav_trade.store")
_CHECKSUM = b"lvnav_trade.checksum"
_SCHEMA = pa.schema(
    [
        pa.field("name", pa.string()),
        pa.field("dtype", pa.string()),
        pa.field("shape", pa.list_(pa.int64())),
        pa.field("bytes", pa.large_binary()),
    ]
)


def write(folder: Path, summary: BlockSummary) -> Path:
    """Write a part as ``FIRST-N.parquet``: first to a file of another name, then renamed, so that none is ever half.

    A part that starts at the same run and is shorter (the incomplete last block of an earlier campaign) is replaced.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{summary.first_run}-{summary.n_run}.parquet"
    table = _pack(summary)
    table = table.replace_schema_metadata({_CHECKSUM: _checksum(table)})
    replace_table(table, path)
    for other in folder.glob(f"{summary.first_run}-*.parquet"):
        if other != path:
            other.unlink(missing_ok=True)
    return path


def replace_table(table: pa.Table, path: Path) -> None:
    """Write a table as one zstd row group to `path` in one step that either happens or does not."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        pq.write_table(table, temporary, compression="zstd", row_group_size=max(1, table.num_rows))
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def read(path: Path) -> BlockSummary:
    """Return a part; ValueError where the file is damaged."""
    try:
        table = pq.read_table(path)
        if table.schema.names != _SCHEMA.names or _checksum(table) != (table.schema.metadata or {}).get(_CHECKSUM):
            raise ValueError("its checksum does not fit")
        return _unpack(table)
    except (OSError, pa.ArrowException, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: damaged part: {error}") from error


def drop_damaged(folder: Path) -> list[str]:
    """Read all parts of a case, delete those that are damaged (they will be computed again), return what was wrong."""
    messages = []
    for path in paths(folder):
        try:
            read(path)
        except ValueError as error:
            messages.append(str(error))
            _LOG.warning("%s; dropped, its runs will be computed again", error)
            path.unlink(missing_ok=True)
    return messages


def paths(folder: Path) -> list[Path]:
    """Return the part files of a case in run order."""
    found = [path for path in folder.glob("*-*.parquet") if not path.name.startswith(".")]
    return sorted(found, key=span)


def span(path: Path) -> tuple[int, int]:
    """Return (first run, number of runs) of a part file, from its name."""
    first, _, count = path.stem.partition("-")
    return int(first), int(count)


def stream(folder: Path) -> Iterator[BlockSummary]:
    """Return the parts in run order, one in memory at a time."""
    return (read(path) for path in paths(folder))


def _pack(summary: BlockSummary) -> pa.Table:
    arrays = {name: _array(value) for name, value in zip(summary._fields, summary, strict=True)}
    return pa.table(
        {
            "name": list(arrays),
            "dtype": [str(array.dtype) for array in arrays.values()],
            "shape": [list(array.shape) for array in arrays.values()],
            "bytes": [np.ascontiguousarray(array).tobytes() for array in arrays.values()],
        },
        schema=_SCHEMA,
    )


def _array(value: Any) -> np.ndarray[Any, Any]:
    """Return an array; the event names as bytes of one text."""
    return value if isinstance(value, np.ndarray) else np.frombuffer("\n".join(value).encode(), dtype=np.uint8)


def _unpack(table: pa.Table) -> BlockSummary:
    arrays: dict[str, Any] = {}
    for row in table.to_pylist():
        arrays[row["name"]] = np.frombuffer(row["bytes"], dtype=row["dtype"]).reshape(row["shape"])
    text = arrays["events"].tobytes().decode()
    return BlockSummary(**{**arrays, "events": tuple(text.split("\n")) if text else ()})


def _checksum(table: pa.Table) -> bytes:
    digest = hashlib.sha256()
    for row in table.to_pylist():
        digest.update(f"{row['name']} {row['dtype']} {row['shape']}\n".encode())
        digest.update(row["bytes"])
    return digest.hexdigest().encode()
