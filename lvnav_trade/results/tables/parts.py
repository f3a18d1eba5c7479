"""Files of blocks of runs, one per block: written atomically; content and origin are verified when read."""

import hashlib
import logging
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from lvnav_trade.results.tables.table_files import binaries, integers, replace_table, texts
from lvnav_trade.simulation.statistics import BlockSummary

_LOG = logging.getLogger("lvnav_trade.results.tables")
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
_Array = np.ndarray[Any, Any]


def write(folder: Path, summary: BlockSummary, identity: str = "") -> Path:
    """Write the statistics of a block of runs atomically as ``FIRST-N.parquet``.

    A shorter part with the same first run, such as the incomplete last block of an earlier campaign, is replaced.

    Parameters
    ----------
    folder : Path
        Folder of the case.
    summary : BlockSummary
        Statistics of the block.
    identity : str
        Campaign, case and code, which are written into the file.

    Returns
    -------
    Path
        The file.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{summary.first_run}-{summary.n_run}.parquet"
    table = _pack(summary)
    identity = _run_identity(identity, summary)
    checksum = _checksum(_array_rows(table), identity.encode())
    table = table.replace_schema_metadata({_IDENTITY: identity, _CHECKSUM: checksum})
    # compression halves the size, but takes as long as three runs; a dictionary is useless for few large values
    replace_table(table, path, use_dictionary=False, write_statistics=False, compression="none")
    for block_file in paths(folder):
        first_run, _ = span(block_file)
        if first_run == summary.first_run and block_file != path:
            block_file.unlink(missing_ok=True)
    return path


def read(path: Path, identity: str | None = None) -> BlockSummary:
    """Read a part; ValueError if the file is damaged, or of another campaign, case or code than `identity`.

    Errors of the operating system, such as missing permission, are not damage and are raised unchanged.
    """
    try:
        with pq.ParquetFile(path) as file:
            table = file.read(use_threads=False)
        metadata = table.schema.metadata or {}
        origin = metadata.get(_IDENTITY, b"")
        if table.schema.names != _SCHEMA.names or _checksum(_array_rows(table), origin) != metadata.get(_CHECKSUM):
            raise ValueError("its checksum does not fit")
        summary = _unpack(_array_rows(table))
    except (OSError, pa.ArrowException, KeyError, TypeError, ValueError, OverflowError, MemoryError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise ValueError(f"{path}: damaged part: {error}") from error
    if (summary.first_run, summary.n_run) != span(path):
        raise ValueError(f"{path}: damaged part: it holds other runs than its name says")
    if identity is not None and origin.decode(errors="replace") != _run_identity(identity, summary):
        raise ValueError(f"{path}: a part of another campaign, case or code")
    return summary


def drop_damaged(folder: Path, identity: str | None = None) -> None:
    """Delete the invalid parts of a case with a warning; their runs will be computed again.

    If two parts have the same first run, the longer is kept. This happens when a process is killed after writing a part
    and before deleting the shorter one.
    """
    for path in paths(folder):
        try:
            read(path, identity)
        except ValueError as error:
            _LOG.warning("%s; dropped, its runs will be computed again", error)
            path.unlink(missing_ok=True)
    # parts with the same first run are in order of length
    longest = {span(path)[0]: path for path in paths(folder)}
    for path in paths(folder):
        if path != longest[span(path)[0]]:
            path.unlink(missing_ok=True)


def is_name(name: str) -> bool:
    """Whether a file name is that of a part."""
    return _NAME.fullmatch(name) is not None


def paths(folder: Path) -> list[Path]:
    """Return the part files of a case in run order."""
    block_files = [path for path in folder.glob("*-*.parquet") if is_name(path.name)]
    return sorted(block_files, key=span)


def span(path: Path) -> tuple[int, int]:
    """Return (first run, number of runs) of a part file, from its name."""
    first, _, count = path.stem.partition("-")
    return int(first), int(count)


def stream(folder: Path, identity: str | None = None, n_run: int | None = None) -> Iterator[BlockSummary]:
    """Return an iterator over the parts in the order of the runs, with one part in memory at a time.

    Parameters
    ----------
    folder : Path
        Folder of the case.
    identity : str, optional
        Expected campaign, case and code.
    n_run : int, optional
        Only the first `n_run` runs; all runs if None.

    Raises
    ------
    ValueError
        At once if one of the first `n_run` runs is missing; during the iteration if a part is damaged.
    """
    block_files = [path for path in paths(folder) if n_run is None or sum(span(path)) <= n_run]
    if n_run is not None:
        end = 0
        for first, count in [*map(span, block_files), (n_run, 0)]:
            if first != end:
                raise ValueError(f"{folder}: runs {end} to {first - 1} are in no part")
            end = first + count
    return (read(path, identity) for path in block_files)


def _run_identity(identity: str, summary: BlockSummary) -> str:
    """Return the origin of a part with its runs."""
    return f"{identity} runs={summary.first_run}+{summary.n_run}"


def _pack(summary: BlockSummary) -> pa.Table:
    arrays = {name: _array(value) for name, value in zip(summary._fields, summary, strict=True)}
    content = {
        "name": texts(list(arrays)),
        "dtype": texts([str(array.dtype) for array in arrays.values()]),
        "shape": integers([array.shape for array in arrays.values()]),
        "bytes": binaries(list(arrays.values())),
    }
    return pa.table(content, schema=_SCHEMA)


def _array(value: Any) -> _Array:
    """Return a value as contiguous array; the names of events become the bytes of one text."""
    if isinstance(value, np.ndarray):
        return np.ascontiguousarray(value)
    return np.frombuffer("\n".join(value).encode(), dtype=np.uint8)


def _array_rows(table: pa.Table) -> Iterator[tuple[str, str, list[int], Any]]:
    """Yield name, type, shape and bytes of each array of a part, without copying the bytes."""
    names = table["name"].to_pylist()
    dtypes = table["dtype"].to_pylist()
    shapes = table["shape"].to_pylist()
    buffers = (value.as_buffer() for value in table["bytes"])
    yield from zip(names, dtypes, shapes, buffers, strict=True)


def _unpack(rows: Iterable[tuple[str, str, list[int], Any]]) -> BlockSummary:
    arrays: dict[str, Any] = {}
    for name, dtype, shape, content in rows:
        arrays[name] = np.frombuffer(content, dtype=dtype).reshape(shape).copy()
    text = arrays["events"].tobytes().decode()
    arrays["events"] = tuple(text.split("\n")) if text else ()
    return BlockSummary(**arrays)


def _checksum(rows: Iterable[tuple[str, str, list[int], Any]], identity: bytes) -> bytes:
    digest = hashlib.sha256(identity)
    for name, dtype, shape, content in rows:
        digest.update(f"{name} {dtype} {shape}\n".encode())
        digest.update(content)
    return digest.hexdigest().encode()
