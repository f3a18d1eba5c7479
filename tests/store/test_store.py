"""Parts and tables on disk: same bytes whatever the cut, units in every name, damage found."""

from __future__ import annotations

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from lvnav_trade.engines.statistics import merge, summarise
from lvnav_trade.errors import InputError
from lvnav_trade.store import TABLES, CaseInfo, load, open_results
from lvnav_trade.store import parts as part_files
from lvnav_trade.store.schema import arrow_schema, error_column, unit_of
from lvnav_trade.store.versions import campaign_digest
from tests import synthetic
from tests.synthetic import CAMPAIGN, EVENTS, OUTPUTS, block, covariance

COV = covariance()


def part(first: int = 0, n_run: int = 8):
    return summarise(block(COV, first, n_run), EVENTS, COV.true_sigma, OUTPUTS)


def table_bytes(folder):
    return {name: (folder / f"{name}.parquet").read_bytes() for name in TABLES}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    return synthetic.results(tmp_path_factory.mktemp("store") / "whole", n_run=100)


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


def test_a_damaged_part_is_reported_and_dropped(tmp_path):
    results = open_results(tmp_path, "x", CAMPAIGN, {})
    results.write_part("c", part(0))
    path = results.write_part("c", part(8))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    assert results.done("c") == [(0, 8)]
    assert len(results.damaged) == 1
    assert "8-8.parquet" in results.damaged[0]
    assert not path.exists()


def test_a_truncated_part_is_dropped(tmp_path):
    results = open_results(tmp_path, "x", CAMPAIGN, {})
    path = results.write_part("c", part(0))
    path.write_bytes(path.read_bytes()[:1000])
    assert results.done("c") == []


def test_a_part_with_other_numbers_but_the_old_checksum_is_refused(tmp_path):
    path = part_files.write(tmp_path, part())
    table = pq.read_table(path)
    other = part_files._pack(part(8)).replace_schema_metadata(table.schema.metadata)
    pq.write_table(other, path)
    with pytest.raises(ValueError, match="checksum"):
        part_files.read(path)


def test_parts_come_in_run_order_not_in_the_order_of_names(tmp_path):
    results = open_results(tmp_path, "x", CAMPAIGN, {})
    for first in (80, 8, 0):
        results.write_part("c", part(first))
    assert [p.first_run for p in results.parts("c")] == [0, 8, 80]
    assert merge(results.parts("c")).n_run == 24


def test_fifty_runs_and_then_fifty_more_give_the_bytes_of_a_hundred(tmp_path, written):
    synthetic.results(tmp_path / "grown", n_run=50)
    synthetic.results(tmp_path / "grown", n_run=100)
    assert table_bytes(tmp_path / "grown") == table_bytes(written)


def test_a_second_writing_gives_the_same_bytes(written):
    before = table_bytes(written)
    synthetic.results(written, n_run=100)
    assert table_bytes(written) == before


def test_every_column_of_numbers_names_its_unit(written):
    for name in TABLES:
        for field in pq.read_schema(written / f"{name}.parquet"):
            if str(field.type) in ("double", "int64"):
                assert unit_of(field.name), f"{name}.{field.name}"


def test_every_row_carries_the_digest_of_its_case(written):
    tables = load(written)
    for name in TABLES:
        assert set(getattr(tables, name).case) == {"aaaaaaaaaaaa", "bbbbbbbbbbbb"}, name


def test_tables_say_what_wrote_them_and_are_compressed(written):
    for name in TABLES:
        file = pq.ParquetFile(written / f"{name}.parquet")
        metadata = file.schema_arrow.metadata
        assert metadata[b"lvnav_trade.campaign"].decode() == campaign_digest(CAMPAIGN)
        assert b"lvnav_trade.version" in metadata
        assert file.metadata.num_row_groups == 2
        assert file.metadata.row_group(0).column(0).compression == "ZSTD"


def test_every_column_has_a_meaning():
    for name in TABLES:
        for field in arrow_schema(name):
            assert field.metadata[b"meaning"]


def test_history_holds_the_moments_of_the_runs(written):
    history = load(written).history
    row = history[(history.case == "aaaaaaaaaaaa") & (history.t_s == 99.5) & (history.quantity == "position")]
    errors = block(COV, 0, 100).err[:, -1, 6:9]
    np.testing.assert_allclose(row.rms_si[:3], np.sqrt((errors**2).mean(axis=0)), rtol=1e-12)
    np.testing.assert_allclose(row.rms_si.iloc[3], np.sqrt((errors**2).sum(axis=1).mean()), rtol=1e-12)
    np.testing.assert_allclose(row.lincov_true_si.iloc[3], np.linalg.norm(COV.true_sigma[-1, 6:9]), rtol=1e-12)


def test_degrees_of_freedom_of_a_norm_are_satterthwaites(written):
    """One axis without mean: 1. Three axes 3, 3.5, 6 with mean 2 along the last: 2 E^2 / Var by hand."""
    history = load(written).history
    row = history[(history.case == "aaaaaaaaaaaa") & (history.t_s == 0.0) & (history.quantity == "position")]
    variance = np.array([9.0, 12.25, 36.0])
    expected = 2 * (variance.sum() + 4) ** 2 / (2 * (variance**2).sum() + 4 * 4 * 36)
    np.testing.assert_allclose(row.dof_ratio.iloc[[0, 3]], [1.0, expected], rtol=1e-12)


def test_budget_shares_sum_to_one(written):
    budget = load(written).budget
    total = budget.groupby(["case", "event", "t_s", "quantity", "axis"]).share_ratio.sum()
    np.testing.assert_allclose(total, 1.0, rtol=1e-12)


def test_a_fault_is_an_interval_among_the_events(written):
    events = load(written).events
    fault = events[events.kind == "fault"].iloc[0]
    assert (fault.t_s, fault.t_end_s) == (60.0, 75.0)


def test_the_reference_climbs_as_it_was_told(written):
    reference = load(written).reference
    row = reference[(reference.case == "aaaaaaaaaaaa") & (reference.t_s.round(6) == 50.0)].iloc[0]
    assert row.altitude_m == pytest.approx(25000.0, abs=1e-3)


def test_linear_covariance_alone_fills_its_columns_and_leaves_the_others_empty(tmp_path):
    tables = load(synthetic.results(tmp_path, n_run=0))
    assert tables.history.rms_si.isna().all()
    assert (tables.history.run_count == 0).all()
    assert tables.history.lincov_true_si.notna().all()
    assert len(tables.runs) == 0


def test_another_campaign_is_refused_and_fresh_starts_again(tmp_path):
    synthetic.results(tmp_path, n_run=8)
    other = CAMPAIGN.replace("seed: 7", "seed: 8")
    with pytest.raises(InputError, match="another campaign"):
        open_results(tmp_path, "synthetic", other, {})
    (tmp_path / "notes.txt").write_text("mine")
    results = open_results(tmp_path, "synthetic", other, {}, "fresh")
    assert results.done("aaaaaaaaaaaa") == []
    assert (tmp_path / "notes.txt").exists()


def test_more_runs_or_another_requirement_is_the_same_campaign():
    assert campaign_digest(CAMPAIGN) == campaign_digest(CAMPAIGN.replace("runs: 200", "runs: 400"))
    assert campaign_digest(CAMPAIGN) == campaign_digest(CAMPAIGN.replace("below: 2.0", "below: 3.0"))
    assert campaign_digest(CAMPAIGN) != campaign_digest(CAMPAIGN.replace("block: 40", "block: 80"))


def test_results_of_another_version_are_refused(tmp_path):
    synthetic.results(tmp_path, n_run=8)
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    (tmp_path / "manifest.json").write_text(json.dumps({**manifest, "tool": "0.0.1"}))
    with pytest.raises(InputError, match="another version"):
        open_results(tmp_path, "synthetic", CAMPAIGN, {})


def test_a_folder_that_cannot_be_written_is_a_users_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        open_results(tmp_path / "file" / "results", "x", CAMPAIGN, {})


def test_no_results_is_a_users_error(tmp_path):
    with pytest.raises(InputError, match="no results here"):
        load(tmp_path)


def test_the_manifest_names_versions_machine_and_order(written):
    manifest = load(written).manifest
    assert manifest["cases"] == ["aaaaaaaaaaaa", "bbbbbbbbbbbb"]
    assert {"tool", "python", "numpy", "numba", "host", "cpu", "seed", "created", "commit"} <= set(manifest)


def test_workers_may_write_the_cases_and_the_plan_gives_the_order(tmp_path):
    results = open_results(tmp_path, "x", CAMPAIGN, {})
    for name in ("b", "a"):
        results.write_case(CaseInfo(name, name, {}), synthetic.prepared(), COV, None)
    again = open_results(tmp_path, "x", CAMPAIGN, {})
    again.finish({"cases": ["a", "b"]})
    assert list(load(tmp_path).cases.case) == ["a", "b"]


def test_error_columns_are_named_by_quantity_axis_and_unit():
    assert error_column("velocity", "3d", "m/s") == "velocity_3d_error_m_per_s"
