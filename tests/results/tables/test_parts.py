"""A part is written whole, checked when read, replaced by a longer one."""

from __future__ import annotations

import numpy as np
import pyarrow.parquet as pq
import pytest

from lvnav_trade.results.tables import parts as part_files
from lvnav_trade.simulation.statistics import summarise
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


def same(one, other) -> bool:
    return all(np.asarray(a).tobytes() == np.asarray(b).tobytes() for a, b in zip(one, other, strict=True))


def read_or_none(path):
    """Return what is read of a part, None where it is refused as damaged."""
    try:
        return part_files.read(path, "a")
    except ValueError as error:
        return None if str(error).startswith(f"{path}: damaged part: ") else error


def test_no_flipped_byte_and_no_cut_gives_other_numbers(tmp_path):
    path = part_files.write(tmp_path, part(), "a")
    sound, content = part_files.read(path), path.read_bytes()
    places = np.linspace(0, len(content) - 1, 120).astype(int)
    ends = range(len(content) - 120, len(content))  # of the footer every byte
    refused = 0
    for at in (*places, *ends):
        damaged = bytearray(content)
        damaged[at] ^= 0x55
        path.write_bytes(damaged)
        found = read_or_none(path)
        refused += found is None
        assert found is None or same(found, sound), f"byte {at}"
    assert refused > 120  # the others hold what no reader needs
    for length in (0, 3, 1000, *places[1:-1:10], len(content) - 1):
        path.write_bytes(content[:length])
        assert read_or_none(path) is None, f"the first {length} bytes"
    path.write_bytes(content)
    assert same(part_files.read(path, "a"), sound)


def test_a_part_of_another_campaign_or_code_is_refused_and_dropped(tmp_path, caplog):
    path = part_files.write(tmp_path, part(), "campaign a")
    with pytest.raises(ValueError, match=r"0-8\.parquet: a part of another campaign, case or code$"):
        part_files.read(path, "campaign b")
    part_files.drop_damaged(tmp_path, "campaign b")
    assert caplog.text.count("will be computed again") == 1
    assert part_files.paths(tmp_path) == []


def test_a_part_whose_identity_was_changed_is_damaged(tmp_path):
    path = part_files.write(tmp_path, part(), "campaign a")
    table = pq.read_table(path)
    metadata = {**table.schema.metadata, b"lvnav_trade.identity": b"campaign b"}
    pq.write_table(table.replace_schema_metadata(metadata), path)
    with pytest.raises(ValueError, match="checksum"):
        part_files.read(path, "campaign b")


def test_a_part_under_the_name_of_other_runs_is_refused(tmp_path):
    path = part_files.write(tmp_path, part())
    moved = path.rename(tmp_path / "8-8.parquet")
    with pytest.raises(ValueError, match="other runs than its name says"):
        part_files.read(moved)


def test_a_file_of_the_users_own_among_the_parts_is_left_alone(tmp_path, caplog):
    (tmp_path / "my-notes.parquet").write_text("mine")
    part_files.write(tmp_path, part())
    part_files.drop_damaged(tmp_path)
    assert caplog.text == ""
    assert (tmp_path / "my-notes.parquet").exists()


def test_of_two_parts_from_the_same_run_the_longer_is_kept(tmp_path, caplog):
    part_files.write(tmp_path / "short", part(0, 4))
    part_files.write(tmp_path, part(0, 8))
    (tmp_path / "short/0-4.parquet").rename(tmp_path / "0-4.parquet")  # as a process killed before deleting it leaves
    part_files.drop_damaged(tmp_path)
    assert caplog.text == ""
    assert [path.name for path in part_files.paths(tmp_path)] == ["0-8.parquet"]


def test_a_part_that_may_not_be_read_is_not_thrown_away(tmp_path, monkeypatch):
    path = part_files.write(tmp_path, part())

    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(pq, "ParquetFile", refuse)
    with pytest.raises(PermissionError):
        part_files.drop_damaged(tmp_path)
    assert path.exists()
