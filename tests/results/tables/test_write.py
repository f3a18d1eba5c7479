"""Results grow, resume and finish with the same bytes."""

from __future__ import annotations

import errno
import json
import shutil

import pyarrow.parquet as pq
import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.tables import write
from lvnav_trade.results.tables.contents import CONTENTS
from lvnav_trade.results.tables.dictionary import FEATURES, TABLES
from lvnav_trade.results.tables.engine_tables import CaseInfo
from lvnav_trade.results.tables.read import load
from lvnav_trade.results.tables.versions import RESULTS_VERSION, campaign_digest
from lvnav_trade.results.tables.write import open_results
from lvnav_trade.simulation.statistics import merge, summarise
from tests import synthetic
from tests.synthetic import CAMPAIGN, EVENTS, OUTPUTS, block, covariance

COV = covariance()


def part(first: int = 0, n_run: int = 8):
    return summarise(block(COV, first, n_run), EVENTS, COV.true_sigma, OUTPUTS)


def table_bytes(folder):
    return {file.name: file.read_bytes() for file in folder.glob("*.parquet")}


def test_a_damaged_part_is_reported_and_dropped(tmp_path, caplog):
    results = open_results(tmp_path, "x", CAMPAIGN, {})
    results.write_block("c", part(0))
    path = results.write_block("c", part(8))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    assert results.block_spans("c") == [(0, 8)]
    (message,) = caplog.messages
    assert "8-8.parquet" in message
    assert not path.exists()


def test_a_truncated_part_is_dropped(tmp_path):
    results = open_results(tmp_path, "x", CAMPAIGN, {})
    path = results.write_block("c", part(0))
    path.write_bytes(path.read_bytes()[:1000])
    assert results.block_spans("c") == []


def test_parts_come_in_run_order_not_in_the_order_of_names(tmp_path):
    results = open_results(tmp_path, "x", CAMPAIGN, {})
    for first in (80, 8, 0):
        results.write_block("c", part(first))
    assert [p.first_run for p in results.block_summaries("c")] == [0, 8, 80]
    assert merge(results.block_summaries("c")).n_run == 24


def test_fifty_runs_and_then_fifty_more_give_the_bytes_of_a_hundred(tmp_path, written):
    synthetic.results(tmp_path / "grown", n_run=50)
    synthetic.results(tmp_path / "grown", n_run=100)
    assert table_bytes(tmp_path / "grown") == table_bytes(written)


def test_a_second_writing_gives_the_same_bytes(written):
    before = table_bytes(written)
    synthetic.results(written, n_run=100)
    assert table_bytes(written) == before


def test_tables_say_what_wrote_them_and_are_compressed(written):
    for path in written.glob("*.parquet"):
        file = pq.ParquetFile(path)
        metadata = file.schema_arrow.metadata
        assert metadata[b"lvnav_trade.campaign"].decode() == campaign_digest(CAMPAIGN)
        assert b"lvnav_trade.version" in metadata
        assert file.metadata.num_row_groups == 2, path
        assert file.metadata.row_group(0).column(0).compression == "LZ4"


def test_a_table_without_rows_is_not_written_and_is_read_as_a_frame_without_rows(written):
    files = {file.stem for file in written.glob("*.parquet")}
    assert TABLES.keys() - files >= {"nozzle_travel", "allan", "protection", "mode_transitions"}
    tables = load(written)
    for name in TABLES:
        frame = getattr(tables, name)
        assert frame.empty == (name not in files), name
        assert ["case", *TABLES[name]] == list(frame.columns)[: len(TABLES[name]) + 1]
        assert list(frame.dtypes.astype(str)[:1]) == list(tables.cases.dtypes.astype(str)[:1])


def test_tables_of_runs_keep_their_columns_of_errors_without_runs(tmp_path, written):
    alone = load(synthetic.results(tmp_path, n_run=0))
    for name in ("runs", "spot_runs", "interval_errors"):
        with_rows = load(written).runs if name == "spot_runs" else getattr(load(written), name)
        frame = getattr(alone, name)
        assert frame.empty
        assert not (tmp_path / f"{name}.parquet").exists()
        assert list(frame.columns) == list(with_rows.columns)


def test_the_contents_of_a_folder_say_which_feature_each_table_belongs_to(written):
    listed = json.loads((written / CONTENTS).read_text())
    assert listed["tables"].keys() == {file.stem for file in written.glob("*.parquet")}
    assert {f"{name}.parquet" for name in listed["tables"]} < set(listed["files"]["run"])
    assert listed["tables"]["budget"] == "error budget (covariance.budget)"
    assert all(FEATURES[name] == feature for name, feature in listed["tables"].items())


def test_a_table_that_becomes_empty_is_removed(tmp_path):
    synthetic.results(tmp_path, n_run=8, size=8)
    assert (tmp_path / "observability.parquet").exists()
    synthetic.results(tmp_path, n_run=8, size=8, explained=False)
    assert not (tmp_path / "observability.parquet").exists()
    assert load(tmp_path).observability.empty


def test_another_campaign_takes_a_folder_in_which_nothing_was_stored(tmp_path):
    open_results(tmp_path, "synthetic", CAMPAIGN, {})
    (tmp_path / "notes.txt").write_text("mine")
    open_results(tmp_path, "synthetic", CAMPAIGN.replace("seed: 7", "seed: 8"), {})
    assert "seed: 8" in (tmp_path / "campaign.resolved.yaml").read_text()
    assert (tmp_path / "notes.txt").exists()


def test_another_campaign_is_refused_and_fresh_starts_again(tmp_path):
    synthetic.results(tmp_path, n_run=8)
    other = CAMPAIGN.replace("seed: 7", "seed: 8")
    with pytest.raises(InputError, match="another campaign"):
        open_results(tmp_path, "synthetic", other, {})
    (tmp_path / "notes.txt").write_text("mine")
    results = open_results(tmp_path, "synthetic", other, {}, "fresh")
    assert results.block_spans("aaaaaaaaaaaa") == []
    assert (tmp_path / "notes.txt").exists()


def test_results_of_another_version_are_refused(tmp_path):
    synthetic.results(tmp_path, n_run=8)
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    (tmp_path / "manifest.json").write_text(json.dumps({**manifest, "tool": "0.0.1"}))
    with pytest.raises(InputError, match="another version"):
        open_results(tmp_path, "synthetic", CAMPAIGN, {})


@pytest.mark.parametrize("library", ["numpy", "numba", "scipy"])
def test_results_computed_with_another_version_of_a_library_are_refused(tmp_path, library):
    synthetic.results(tmp_path, n_run=8)
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    (tmp_path / "manifest.json").write_text(json.dumps({**manifest, library: "0.0.1"}))
    with pytest.raises(InputError, match=rf"with another {library} \(0\.0\.1, this is .*\); use --fresh$"):
        open_results(tmp_path, "synthetic", CAMPAIGN, {})


def test_parts_without_a_manifest_are_kept_only_where_they_are_of_this_campaign(tmp_path, caplog):
    synthetic.results(tmp_path, n_run=8)
    (tmp_path / "manifest.json").unlink()
    same = open_results(tmp_path, "synthetic", CAMPAIGN, {"seed": 7})
    assert same.block_spans("aaaaaaaaaaaa") == [(0, 8)]
    (tmp_path / "manifest.json").unlink()
    other = open_results(tmp_path, "synthetic", CAMPAIGN.replace("seed: 7", "seed: 8"), {"seed": 8})
    assert other.block_spans("aaaaaaaaaaaa") == []
    assert "a part of another campaign, case or code" in caplog.text


@pytest.mark.parametrize("stays", [True, False])
def test_a_part_of_another_case_of_the_same_shape_is_dropped(tmp_path, stays, caplog):
    results = open_results(tmp_path, "x", CAMPAIGN, {"seed": 7})
    ours, other = results.write_block("c", part(0)), results.write_block("d", part(0))
    shutil.copyfile(other, ours)
    if not stays:
        other.unlink()
    assert results.block_spans("c") == []
    assert "c/0-8.parquet: a part of another campaign, case or code" in caplog.text
    assert results.block_spans("d") == ([(0, 8)] if stays else [])
    results.write_block("c", part(0))
    assert results.block_spans("c") == [(0, 8)]


@pytest.mark.parametrize("name", ["seed", "results", "runs", "case"])
def test_a_part_says_what_it_is_of(tmp_path, name):
    path = open_results(tmp_path, "x", CAMPAIGN, {"seed": 7}).write_block("c", part(8))
    identity = pq.read_schema(path).metadata[b"lvnav_trade.identity"].decode()
    expected = {"seed": "7", "results": str(RESULTS_VERSION), "runs": "8+8", "case": "c"}[name]
    assert f" {name}={expected} " in f" {identity} "


def test_a_case_with_a_hole_in_its_runs_has_no_summary(tmp_path):
    results = open_results(tmp_path, "x", CAMPAIGN, {})
    for first in (0, 8, 16):
        results.write_block("c", part(first))
    assert merge(results.block_summaries("c", 24)).n_run == 24
    # a block that was flown beyond the end of a case is not of it
    assert merge(results.block_summaries("c", 16)).n_run == 16
    with pytest.raises(ValueError, match="runs 24 to 31 are in no part"):
        results.block_summaries("c", 32)
    (tmp_path / "parts/c/8-8.parquet").unlink()
    with pytest.raises(ValueError, match="runs 8 to 15 are in no part"):
        results.block_summaries("c", 24)


def test_what_a_killed_process_left_half_written_is_gone_when_the_campaign_goes_on(tmp_path):
    synthetic.results(tmp_path, n_run=8)
    case = tmp_path / "parts/aaaaaaaaaaaa"
    litter = [tmp_path / ".runs.parquet.1", case / ".8-8.parquet.1", case / "tables/.runs.parquet.1"]
    for path in litter:
        path.write_bytes(b"PAR1")
    open_results(tmp_path, "synthetic", CAMPAIGN, {})
    assert not any(path.exists() for path in litter)


def test_a_folder_that_cannot_be_written_is_a_users_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        open_results(tmp_path / "file" / "results", "x", CAMPAIGN, {})


def test_a_full_disk_is_not_a_users_error(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(write, "_write_json", full)
    with pytest.raises(OSError, match="No space left on device"):
        open_results(tmp_path, "x", CAMPAIGN, {})


def test_workers_may_write_the_cases_and_the_plan_gives_the_order(tmp_path):
    results = open_results(tmp_path, "x", CAMPAIGN, {})
    for name in ("b", "a"):
        results.write_case(CaseInfo(name, name, {}), synthetic.prepared_case(), COV, None)
    again = open_results(tmp_path, "x", CAMPAIGN, {})
    again.finish({"cases": ["a", "b"]})
    assert list(load(tmp_path).cases.case) == ["a", "b"]


def test_tables_of_single_cases_go_and_blocks_of_runs_stay(tmp_path):
    results = open_results(tmp_path, "x", CAMPAIGN, {})
    kept = results.write_block("a", part())
    for name in ("a", "b"):
        results.owned_folder.claim("run", (), ["a", "b"])
        results.write_case(
            CaseInfo(name, name, {}),
            synthetic.prepared_case(),
            COV,
            results.block_summaries("a") if name == "a" else None,
        )
    results.finish({"cases": ["a", "b"]})
    whole, before = table_bytes(tmp_path), sum(file.stat().st_size for file in tmp_path.glob("parts/*/tables/*"))
    mine = tmp_path / "parts/b/tables/mine.txt"
    mine.write_text("of the user's own")
    results.remove_case_tables()
    assert sorted(tmp_path.glob("parts/**/*.*")) == sorted([kept, mine])
    assert table_bytes(tmp_path) == whole
    size = sum(map(len, whole.values()))
    assert size < before
    assert list(load(tmp_path).cases.case) == ["a", "b"]


def test_a_manifest_that_is_a_link_to_a_device_is_refused_and_not_read(tmp_path):
    open_results(tmp_path, "x", CAMPAIGN, {})
    (tmp_path / "manifest.json").unlink()
    (tmp_path / "manifest.json").symlink_to("/dev/zero")
    with pytest.raises(InputError, match=r"manifest\.json: "):
        open_results(tmp_path, "x", CAMPAIGN, {})
