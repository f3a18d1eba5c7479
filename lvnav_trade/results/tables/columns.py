"""Columns of Arrow tables directly from the memory of numpy arrays.

`pyarrow.array` imports pandas to check for pandas objects, which takes 65 MiB and a second in every worker process;
workers have no such objects.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike, NDArray

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
        encoded = [value.encode() for value in self.distinct]
        if len(encoded) == 1:
            ends = np.arange(len(self) + 1, dtype=np.int32) * np.int32(len(encoded[0]))
            return pa.StringArray.from_buffers(len(self), pa.py_buffer(ends), pa.py_buffer(encoded[0] * len(self)))
        ends = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
        distinct = pa.StringArray.from_buffers(len(encoded), pa.py_buffer(ends), pa.py_buffer(b"".join(encoded)))
        return distinct.take(pa.Array.from_buffers(pa.int32(), len(self), [None, pa.py_buffer(self.numbers)]))


def column(values: ArrayLike | Iterable[str] | Coded, kind: pa.DataType) -> pa.Array:
    """Return values (n,) as an Arrow array, if possible without a copy.

    Parameters
    ----------
    values : array_like, iterable of str or Coded
        Values (n,).
    kind : pyarrow.DataType
        Text, real or whole number, or truth value.

    Raises
    ------
    TypeError
        Real numbers would become whole numbers.
    """
    if isinstance(values, Coded):
        return values.texts()
    if kind == pa.string():
        return texts(values.tolist() if isinstance(values, np.ndarray) else list(values))  # type: ignore[arg-type]
    array: NDArray[Any] = np.asarray(values)
    dtype = np.dtype(_DTYPES[kind])
    if array.size == 0:
        array = array.astype(dtype)  # numpy converts an empty list to real numbers
    array = np.ascontiguousarray(array.astype(dtype, casting="same_kind", copy=False))
    content = np.packbits(array, bitorder="little") if kind == pa.bool_() else array
    return pa.Array.from_buffers(kind, array.size, [None, pa.py_buffer(content)])


def texts(values: list[str]) -> pa.StringArray:
    """Return texts, most of them repeated, as an Arrow array."""
    numbers = {value: number for number, value in enumerate(dict.fromkeys(values))}
    return Coded(list(numbers), np.fromiter(map(numbers.__getitem__, values), np.int32, len(values))).texts()


def binaries(values: list[NDArray[Any]]) -> pa.LargeBinaryArray:
    """Return the bytes of contiguous arrays, one array per row."""
    ends = np.cumsum([0, *(value.nbytes for value in values)], dtype=np.int64)
    content = np.empty(int(ends[-1]), dtype=np.uint8)
    for value, start, end in zip(values, ends, ends[1:], strict=False):
        content[start:end] = value.reshape(-1).view(np.uint8)
    return pa.LargeBinaryArray.from_buffers(
        pa.large_binary(), len(values), [None, pa.py_buffer(ends), pa.py_buffer(content)]
    )


def integers(rows: Sequence[Sequence[int]]) -> pa.ListArray:
    """Return lists of whole numbers, one list per row."""
    ends = np.cumsum([0, *map(len, rows)], dtype=np.int32)
    flat = np.array([number for row in rows for number in row], dtype=np.int64)
    starts = pa.Array.from_buffers(pa.int32(), ends.size, [None, pa.py_buffer(ends)])
    return pa.ListArray.from_arrays(starts, column(flat, pa.int64()))
