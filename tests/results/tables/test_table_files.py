"""Rows that come piece by piece give the file that they give at once."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from lvnav_trade.results.tables import table_files
from lvnav_trade.results.tables.table_files import batches, case_schema, column, row_files


def numbers(first: int, end: int) -> dict[str, pa.Table]:
    return {"runs": pa.table({"run": column(np.arange(first, end), pa.int64())})}


@pytest.fixture(autouse=True)
def small_groups(monkeypatch):
    monkeypatch.setattr(table_files, "ROWS", 100)


def written(folder, size: int, n: int = 350):
    folder.mkdir()
    with row_files(folder, numbers(0, 0)) as rows:
        for first in range(0, n, size):
            rows.add(numbers(first, min(first + size, n)))
    return folder / "runs.arrow"


def test_the_bytes_do_not_tell_in_which_pieces_the_rows_came(tmp_path):
    whole = written(tmp_path / "350", 350)
    for size in (1, 40, 99, 100, 250):
        assert written(tmp_path / str(size), size).read_bytes() == whole.read_bytes()
    assert [group["run"].to_pylist() for group in batches(whole)] == [
        list(range(first, min(first + 100, 350))) for first in (0, 100, 200, 300)
    ]


@pytest.mark.parametrize("n", [0, 100])
def test_no_batch_is_empty(tmp_path, n):
    path = written(tmp_path / "new", 30, n)
    assert [group.num_rows for group in batches(path)] == [n] * (n > 0)
    assert case_schema(path).names == ["run"]


def test_where_a_piece_fails_no_file_appears_and_the_old_one_stays(tmp_path):
    old = written(tmp_path / "new", 10, 30)
    before = old.read_bytes()

    def pieces():
        yield 1
        raise ValueError("a part is damaged")

    with (
        pytest.raises(ValueError, match="damaged"),
        row_files(old.parent, numbers(0, 0)) as rows,
    ):
        assert list(rows.record_tables(pieces(), lambda one: numbers(one, 200)))
    assert [path.name for path in old.parent.iterdir()] == ["runs.arrow"]
    assert old.read_bytes() == before
