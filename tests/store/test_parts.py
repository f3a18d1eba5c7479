"""A part is written whole, checked when read, replaced by a longer one."""

from __future__ import annotations

import numpy as np
import pyarrow.parquet as pq
import pytest

from lvnav_trade.engines.statistics import summarise
from lvnav_trade.store import parts as part_files
from tests.synthetic import EVENTS, OUTPUTS, block, covariance

COV = covariance()


def part(first: int = 0, n_run: int = 8):
    return summarise(block(COV, first, n_run), EVENTS, COV.true_sigma, OUTPUTS)


def test_a_part_reads_back_as_it_was_written(tmp_path):
    summary = part(40)
    path = part_files.write(tmp_path, summary)
    assert path.name == "40-8.parquet"
    for one, other in zip(summary, part_files.read(path), strict=True):
        np.testing.assert_array_equal(np.asarray(one), np.asarray(other))


def test_a_part_leaves_no_temporary_file(tmp_path):
    part_files.write(tmp_path, part())
    assert [path.name for path in tmp_path.iterdir()] == ["0-8.parquet"]


def test_a_longer_block_replaces_the_incomplete_one(tmp_path):
    part_files.write(tmp_path, part(0, 4))
    part_files.write(tmp_path, part(0, 8))
    assert [path.name for path in part_files.paths(tmp_path)] == ["0-8.parquet"]


def test_a_part_with_other_numbers_but_the_old_checksum_is_refused(tmp_path):
    path = part_files.write(tmp_path, part())
    table = pq.read_table(path)
    other = part_files._pack(part(8)).replace_schema_metadata(table.schema.metadata)
    pq.write_table(other, path)
    with pytest.raises(ValueError, match="checksum"):
        part_files.read(path)
