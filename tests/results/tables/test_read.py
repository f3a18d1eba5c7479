"""Reading what is not there."""

from __future__ import annotations

import json
import shutil

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.tables.read import Tables, load, read_table
from tests import synthetic


def test_no_results_is_a_users_error(tmp_path):
    with pytest.raises(InputError, match="no results here"):
        load(tmp_path)


def test_a_column_that_an_earlier_version_did_not_write_is_empty(written, tmp_path):
    folder = synthetic.unsealed(shutil.copytree(written, tmp_path / "older"))
    rows = pq.read_table(folder / "satellites.parquet").drop_columns(["cn0_db_hz", "state"])
    pq.write_table(rows, folder / "satellites.parquet")
    found = load(folder).satellites
    assert len(found) == rows.num_rows
    assert found.cn0_db_hz.isna().all()
    assert found.state.isna().all()


def test_an_unfinished_campaign_is_not_read_as_if_it_had_finished(tmp_path):
    """The tables on disk may be those of an earlier campaign of fewer runs, or asked other questions."""
    folder = synthetic.results(tmp_path, n_run=8)
    manifest = json.loads((folder / "manifest.json").read_text())
    del manifest["finished"]
    (folder / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(InputError, match=r"has not finished; the same lvnav-trade run goes on with it$"):
        load(folder)


def test_no_flipped_byte_among_the_numbers_of_a_table_gives_others(tmp_path):
    folder = synthetic.results(tmp_path, n_run=8)
    path = folder / "runs.parquet"
    content, sound = path.read_bytes(), load(folder).runs
    refused = 0
    footer = len(content) - 8 - int.from_bytes(content[-8:-4], "little")  # which has no checksum, and no numbers
    for at in range(4, footer, max(1, footer // 150)):
        damaged = bytearray(content)
        damaged[at] ^= 0x10
        path.write_bytes(damaged)
        try:
            found = load(folder).runs
        except InputError as error:
            refused += f"{path}: damaged: " in str(error)
            continue
        pd.testing.assert_frame_equal(found, sound)
    assert refused > 75


@pytest.mark.parametrize(
    ("design", "is_sampled"),
    [("latin_hypercube", True), ("sobol", True), ("grid", False), ("box_behnken", False), ("one_at_a_time", False)],
)
def test_designs_that_are_drawn_at_random_are_a_sample(design, is_sampled):
    assert Tables.from_arrow({}, {"design": design}).is_sampled == is_sampled


def test_a_torn_manifest_is_reported(tmp_path):
    folder = synthetic.results(tmp_path, n_run=8)
    (folder / "manifest.json").write_text('{"created":')
    with pytest.raises(InputError, match=r"manifest\.json: damaged: "):
        load(folder)


def test_a_table_that_a_kept_base_does_not_have_is_reported_as_such(tmp_path):
    with pytest.raises(InputError, match=r"history.parquet: this table is missing; a kept base has none, and of other"):
        read_table(tmp_path / "history.parquet")


@pytest.mark.parametrize(
    "text",
    ["a: [", "a: {b", "- 1", "- [a, b, c]", "!!python/object/apply:os.system [x]", "a: b: c", "\0", "a: *x"],
)
def test_a_damaged_campaign_of_results_is_one_line(tmp_path, text):
    folder = synthetic.unsealed(synthetic.results(tmp_path, n_run=8))
    (folder / "campaign.resolved.yaml").write_text(text)
    with pytest.raises(InputError, match=r"resolved\.yaml: damaged: [^\n]*; the same lvnav-trade run makes it again$"):
        load(folder).campaign  # noqa: B018


def test_texts_in_place_of_numbers_are_one_line(tmp_path):
    folder = synthetic.unsealed(synthetic.results(tmp_path, n_run=8))
    table = pq.read_table(folder / "runs.parquet")
    at = table.column_names.index("run_number")
    pq.write_table(table.set_column(at, "run_number", pa.array(["<b>x"] * len(table))), folder / "runs.parquet")
    with pytest.raises(InputError, match="damaged: the column 'run_number' has values of type string, not int"):
        load(folder).runs  # noqa: B018


@pytest.mark.parametrize("name", ["runs.parquet", "campaign.resolved.yaml"])
def test_a_sound_file_that_the_campaign_did_not_write_is_one_line(tmp_path, name):
    """As a table of other results, or with columns of other names; its own checksums are good."""
    folder, other = synthetic.results(tmp_path / "a", n_run=8), synthetic.results(tmp_path / "b", n_run=12)
    content = (other / name).read_bytes()
    (folder / name).write_bytes(content if name.endswith("parquet") else content + b"more: 1\n")
    tables = load(folder)
    with pytest.raises(InputError, match=rf"{name}: damaged: its content is not what the campaign wrote; the same"):
        tables.runs if name.endswith("parquet") else tables.campaign
