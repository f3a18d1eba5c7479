"""Columns are those that Arrow itself makes of the same values."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from lvnav_trade.results.tables.table_files import binaries, column, integers

VALUES = {
    "real": (np.array([1.5, -0.0, np.nan, np.inf]), pa.float64()),
    "real from a list": ([1.0, 2.5], pa.float64()),
    "real from whole": (np.arange(3), pa.float64()),
    "every other one of a row": (np.arange(12.0).reshape(3, 4)[:, 1::2].T[0], pa.float64()),
    "whole": (np.array([1, -(2**62), 7]), pa.int64()),
    "whole of four bytes": (np.array([1, -3], dtype=np.int32), pa.int64()),
    "truth": (np.arange(19) % 3 == 0, pa.bool_()),
    "truth from a list": ([True, False], pa.bool_()),
    "text": (["stage 1", "", "Kármán", "stage 1"], pa.string()),
    "text of numpy": (np.array(["G01", "G07", "G01"]), pa.string()),
    "no text": ([], pa.string()),
    "nothing real": ([], pa.float64()),
    "nothing whole": ([], pa.int64()),
    "nothing true": (np.zeros(0, dtype=bool), pa.bool_()),
}


@pytest.mark.parametrize("name", VALUES)
def test_a_column_is_the_one_that_arrow_makes(name):
    values, kind = VALUES[name]
    found = column(values, kind)
    found.validate(full=True)
    expected = pa.array(np.asarray(values, dtype=object).tolist() if kind == pa.string() else values, type=kind)
    assert found.type == kind
    assert found.null_count == 0
    np.testing.assert_array_equal(found.to_pylist(), expected.to_pylist())


def test_a_whole_number_does_not_lose_its_fraction_unnoticed():
    with pytest.raises(TypeError, match="Cannot cast"):
        column(np.array([1.5]), pa.int64())


def test_bytes_and_lists_are_those_that_arrow_makes():
    arrays = [np.arange(3.0), np.zeros((0, 2)), np.array([[1, 2], [3, 4]], dtype=np.uint8)]
    found = binaries(arrays)
    found.validate(full=True)
    assert found.to_pylist() == [array.tobytes() for array in arrays]
    lists = integers([array.shape for array in arrays])
    lists.validate(full=True)
    assert lists.to_pylist() == [[3], [0, 2], [2, 2]]
    assert lists.type == pa.list_(pa.int64())
