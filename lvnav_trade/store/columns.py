"""Columns of Arrow tables straight from the memory of numpy arrays.

`pyarrow.array` imports pandas, which takes 65 MiB of every worker process and a second, to see whether it was given
something of pandas; workers have nothing of it.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike, NDArray

_DTYPES = {pa.float64(): np.float64, pa.int64(): np.int64, pa.bool_(): np.bool_}


class Coded(Sequence[str]):
    """Texts (n,) as few distinct ones and the number of each (n,): a tenth of the time that n texts take."""

    def __init__(self, distinct: Sequence[str], numbers: ArrayLike) -> None:
        self.distinct = distinct
        self.numbers: NDArray[np.int32] = np.ascontiguousarray(numbers, dtype=np.int32)

    def __len__(self) -> int:
        return self.numbers.size

    def __getitem__(self, index: Any) -> Any:
        return np.array(self.distinct)[self.numbers[index]]

    def texts(self) -> pa.StringArray:
        """Return the texts as an Arrow array."""
        encoded = [value.encode() for value in self.distinct]
        if len(encoded) == 1:
            ends = np.arange(len(self) + 1, dtype=np.int32) * np.int32(len(encoded[0]))
            return pa.StringArray.from_buffers(len(self), pa.py_buffer(ends), pa.py_buffer(encoded[0] * len(self)))
        ends = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
        distinct = pa.StringArray.from_buffers(len(encoded), pa.py_buffer(ends), pa.py_buffer(b"".join(encoded)))
        return distinct.take(pa.Array.from_buffers(pa.int32(), len(self), [None, pa.py_buffer(self.numbers)]))


def column(values: ArrayLike | Iterable[str] | Coded, kind: pa.DataType) -> pa.Array:
    """Return values (n,) as an Arrow array of text, real or whole numbers, or truth; numbers are not copied where they
    need not be. TypeError where numbers would lose their fraction.
    """
    if isinstance(values, Coded):
        return values.texts()
    if kind == pa.string():
        return texts(values.tolist() if isinstance(values, np.ndarray) else list(values))  # type: ignore[arg-type]
    found: NDArray[Any] = np.asarray(values)
    wanted = np.dtype(_DTYPES[kind])
    if found.size == 0:
        found = found.astype(wanted)  # an empty list is one of real numbers to numpy
    found = np.ascontiguousarray(found.astype(wanted, casting="same_kind", copy=False))
    content = np.packbits(found, bitorder="little") if kind == pa.bool_() else found
    return pa.Array.from_buffers(kind, found.size, [None, pa.py_buffer(content)])


def texts(values: list[str]) -> pa.StringArray:
    """Return texts, of which there are few different ones, as an Arrow array."""
    numbers = {value: number for number, value in enumerate(dict.fromkeys(values))}
    return Coded(list(numbers), np.fromiter(map(numbers.__getitem__, values), np.int32, len(values))).texts()


def binaries(values: list[NDArray[Any]]) -> pa.LargeBinaryArray:
    """Return the bytes of contiguous arrays, one array a row."""
    ends = np.cumsum([0, *(value.nbytes for value in values)], dtype=np.int64)
    content = np.empty(int(ends[-1]), dtype=np.uint8)
    for value, start, end in zip(values, ends, ends[1:], strict=False):
        content[start:end] = value.reshape(-1).view(np.uint8)
    return pa.LargeBinaryArray.from_buffers(
        pa.large_binary(), len(values), [None, pa.py_buffer(ends), pa.py_buffer(content)]
    )


def integers(rows: Sequence[Sequence[int]]) -> pa.ListArray:
    """Return lists of whole numbers, one list a row."""
    ends = np.cumsum([0, *map(len, rows)], dtype=np.int32)
    flat = np.array([number for row in rows for number in row], dtype=np.int64)
    starts = pa.Array.from_buffers(pa.int32(), ends.size, [None, pa.py_buffer(ends)])
    return pa.ListArray.from_arrays(starts, column(flat, pa.int64()))
