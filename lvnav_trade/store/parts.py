"""One file per block of runs: written whole or not at all, checked when read, by content and by whose it is."""

from __future__ import annotations

import hashlib
import logging
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from lvnav_trade.engines.statistics import BlockSummary

_LOG = logging.getLogger("lvnav_trade.store")
_CHECKSUM, _IDENTITY = b"lvnav_trade.checksum", b"lvnav_trade.identity"
_NAME = re.compile(r"(\d+)-(\d+)\.parquet")
_SCHEMA = pa.schema(
    [
        pa.field("name", pa.string()),
        pa.field("dtype", pa.string()),
        pa.field("shape", pa.list_(pa.int64())),
        pa.field("bytes", pa.large_binary()),
    ]
)


def write(folder: Path, summary: BlockSummary, identity: str = "") -> Path:
    """Write a part as ``FIRST-N.parquet``: first to a file of another name, then renamed, so that none is ever half.

    A part that starts at the same run and is shorter (the incomplete last block of an earlier campaign) is replaced.
    `identity` names the campaign and the code; it is written into the file.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{summary.first_run}-{summary.n_run}.parquet"
    table = _pack(summary)
    table = table.replace_schema_metadata({_IDENTITY: identity, _CHECKSUM: _checksum(table, identity.encode())})
    replace_table(table, path)
    for other in folder.glob(f"{summary.first_run}-*.parquet"):
        if other != path:
            other.unlink(missing_ok=True)
    return path


def replace_table(table: pa.Table, path: Path) -> None:
    """Write a table as one zstd row group to `path` in one step that either happens or does not."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        rows = max(1, table.num_rows)
        pq.write_table(table, temporary, compression="zstd", row_group_size=rows, write_page_checksum=True)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def read(path: Path, identity: str | None = None) -> BlockSummary:
    """Return a part; ValueError where the file is damaged, or not of the campaign and code of `identity`.

    An error of the operating system, such as a file that may not be read, is raised as it comes: it is no damage.
    """
    try:
        table = pq.read_table(path)
        metadata = table.schema.metadata or {}
        written_by = metadata.get(_IDENTITY, b"")
        if table.schema.names != _SCHEMA.names or _checksum(table, written_by) != metadata.get(_CHECKSUM):
            raise ValueError("its checksum does not fit")
        summary = _unpack(table)
    except (OSError, pa.ArrowException, KeyError, TypeError, ValueError, OverflowError, MemoryError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise ValueError(f"{path}: damaged part: {error}") from error
    if (summary.first_run, summary.n_run) != span(path):
        raise ValueError(f"{path}: damaged part: it holds other runs than its name says")
    if identity is not None and written_by.decode(errors="replace") != identity:
        raise ValueError(f"{path}: a part of another campaign or code")
    return summary


def drop_damaged(folder: Path, identity: str | None = None) -> list[str]:
    """Read all parts of a case, delete those that `read` refuses (they will be computed again), return what was wrong.

    Of two parts that start at the same run, which a process leaves that is killed between writing the one and deleting
    the other, the longer is kept.
    """
    messages = []
    for path in paths(folder):
        try:
            read(path, identity)
        except ValueError as error:
            messages.append(str(error))
            _LOG.warning("%s; dropped, its runs will be computed again", error)
            path.unlink(missing_ok=True)
    kept = {span(path)[0]: path for path in paths(folder)}  # in order of length where the start is the same
    for path in paths(folder):
        if path != kept[span(path)[0]]:
            path.unlink(missing_ok=True)
    return messages


def sweep(folder: Path) -> None:
    """Delete what a killed process left half written in a folder."""
    for path in folder.glob(".*.*"):
        if re.fullmatch(r"\..+\.(parquet|json|yaml)\.\d+", path.name):
            path.unlink(missing_ok=True)


def paths(folder: Path) -> list[Path]:
    """Return the part files of a case in run order."""
    return sorted((path for path in folder.glob("*-*.parquet") if _NAME.fullmatch(path.name)), key=span)


def span(path: Path) -> tuple[int, int]:
    """Return (first run, number of runs) of a part file, from its name."""
    first, _, count = path.stem.partition("-")
    return int(first), int(count)


def stream(folder: Path, identity: str | None = None) -> Iterator[BlockSummary]:
    """Return the parts in run order, one in memory at a time."""
    return (read(path, identity) for path in paths(folder))


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


def _checksum(table: pa.Table, identity: bytes) -> bytes:
    digest = hashlib.sha256(identity)
    for row in table.to_pylist():
        digest.update(f"{row['name']} {row['dtype']} {row['shape']}\n".encode())
        digest.update(row["bytes"])
    return digest.hexdigest().encode()
