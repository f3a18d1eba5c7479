"""Results of version 2 are read under the present names; those of other versions are refused."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq
import pytest

from lvnav_trade.api import Results
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.report.build import build
from lvnav_trade.report.compare import keep_base
from lvnav_trade.results.comparison.comparison import compare
from lvnav_trade.results.tables.contents import CONTENTS, MANIFEST, owned_folder
from lvnav_trade.results.tables.dictionary import COLUMNS_OF_VERSION_2, FEATURES, TABLES, TABLES_OF_VERSION_2
from lvnav_trade.results.tables.read import load
from lvnav_trade.results.tables.versions import RESULTS_VERSION
from lvnav_trade.results.tables.write import open_results
from tests import synthetic


def stated(folder: Path, **entries: object) -> None:
    """Change entries of the manifest; None removes one."""
    manifest = {**json.loads((folder / MANIFEST).read_text()), **entries}
    kept = {name: value for name, value in manifest.items() if value is not None}
    (folder / MANIFEST).write_text(json.dumps(kept))


def as_version_2(folder: Path) -> Path:
    """Rename tables and columns of results as version 2 had them."""
    synthetic.unsealed(folder)
    stated(folder, results_version=None, across_machines=None)
    for name in TABLES:
        path = folder / f"{name}.parquet"
        if path.exists():
            table, names = pq.read_table(path), COLUMNS_OF_VERSION_2.get(name, {})
            path.unlink()
            earlier = folder / f"{TABLES_OF_VERSION_2.get(name, name)}.parquet"
            pq.write_table(table.rename_columns([names.get(column, column) for column in table.column_names]), earlier)
    listed = json.loads((folder / CONTENTS).read_text())
    files = [f"{name}.parquet" for name in TABLES_OF_VERSION_2]
    listed["files"]["run"] = [
        *(name for name in listed["files"]["run"] if name not in files),
        *(f"{earlier}.parquet" for earlier in TABLES_OF_VERSION_2.values()),
    ]
    listed["tables"] = {path.stem: "" for path in folder.glob("*.parquet")}
    (folder / CONTENTS).write_text(json.dumps(listed))
    return folder


@pytest.fixture
def earlier(tmp_path: Path) -> Path:
    """Return results of version 2."""
    return as_version_2(synthetic.results(tmp_path / "earlier", n_run=40, logic=True))


def test_every_present_name_of_an_earlier_one_is_in_the_dictionary() -> None:
    assert TABLES_OF_VERSION_2.keys() <= TABLES.keys()
    assert not set(TABLES_OF_VERSION_2.values()) & TABLES.keys()
    for table, columns in COLUMNS_OF_VERSION_2.items():
        assert columns.keys() <= TABLES[table].keys(), table
        assert not set(columns.values()) & TABLES[table].keys(), table


def test_tables_of_version_2_are_those_of_today(earlier: Path, tmp_path: Path) -> None:
    now = load(synthetic.results(tmp_path / "now", n_run=40, logic=True))
    assert {"worst.parquet", "starts.parquet", "logic.parquet", "joint.parquet"} <= {p.name for p in earlier.iterdir()}
    assert "lincov_row_count" in pq.read_schema(earlier / "innovations.parquet").names
    found = load(earlier)
    for name in TABLES:
        pd.testing.assert_frame_equal(getattr(found, name), getattr(now, name))


def test_a_report_of_version_2_is_that_of_today_and_leaves_its_tables_readable(earlier: Path, tmp_path: Path) -> None:
    now = synthetic.results(tmp_path / "now", n_run=40, logic=True)
    for folder in (earlier, now):
        build(folder, ["summary"])  # tables are written whatever the sections
    csv = {path.name for path in now.glob("*.csv")}
    assert {path.name for path in earlier.glob("*.csv")} == csv >= {"rms.csv", "agreement.csv", "budget.csv"}
    for name in csv:
        assert (earlier / name).read_bytes() == (now / name).read_bytes(), name
    assert json.loads((earlier / CONTENTS).read_text())["tables"]["worst"] == FEATURES["interval_errors"]
    assert len(load(earlier).interval_errors) == len(load(now).interval_errors) > 0


def test_a_comparison_reads_results_and_a_base_of_version_2(earlier: Path, tmp_path: Path) -> None:
    now = synthetic.results(tmp_path / "now", n_run=40, logic=True)
    base = as_version_2_base(keep_base(earlier, tmp_path / "base"))
    for before in (earlier, base):
        found = compare(before, now)
        assert len(found.frame) > 0
        assert found.verdict == "not worse"
        assert (found.frame.base == found.frame.candidate).all()


def as_version_2_base(folder: Path) -> Path:
    """Rename the tables of a kept base as version 2 had them."""
    (folder / "interval_errors.parquet").rename(folder / "worst.parquet")
    stated(folder, results_version=None, digests=None)
    return folder


def test_a_base_that_is_kept_of_version_2_is_of_the_present_version(earlier: Path, tmp_path: Path) -> None:
    base = keep_base(earlier, tmp_path / "base")
    assert json.loads((base / MANIFEST).read_text())["results_version"] == RESULTS_VERSION
    assert (base / "interval_errors.parquet").exists()
    pd.testing.assert_frame_equal(load(base).interval_errors, load(earlier).interval_errors)


def test_python_reads_version_2_and_answers_an_earlier_name_with_the_present_one(earlier: Path) -> None:
    results = Results(earlier)
    assert (results.innovations.measurement_count > 0).any()
    with pytest.raises(AttributeError, match=r"no table 'worst'; its name is interval_errors$"):
        results.worst  # noqa: B018


def test_a_damaged_column_of_version_2_is_named_as_it_is_stored(earlier: Path) -> None:
    path = earlier / "innovations.parquet"
    frame = pd.read_parquet(path)
    frame.assign(lincov_row_count="many").to_parquet(path)
    with pytest.raises(InputError, match="the column 'lincov_row_count' has values of type"):
        load(earlier).innovations  # noqa: B018


def test_a_campaign_does_not_resume_in_results_of_version_2_and_fresh_removes_them(earlier: Path) -> None:
    with pytest.raises(InputError, match=r"was computed with other tables \(version 2, this is 3\); use --fresh$"):
        open_results(earlier, "synthetic", synthetic.CAMPAIGN, {"seed": 7})
    case = earlier / "parts/aaaaaaaaaaaa/tables"
    (case / "worst.arrow").write_bytes(b"")
    open_results(earlier, "synthetic", synthetic.CAMPAIGN, {"seed": 7}, "fresh")
    assert not list(earlier.rglob("*.parquet"))
    assert not list(earlier.rglob("*.arrow"))


def test_a_folder_of_version_2_without_a_list_of_files_is_owned(earlier: Path) -> None:
    (earlier / CONTENTS).unlink()
    owned_folder(earlier, "results").clear()
    assert not list(earlier.glob("*.parquet"))


@pytest.mark.parametrize("version", [1, RESULTS_VERSION + 1])
def test_results_of_another_version_are_refused_in_one_line(tmp_path: Path, version: int) -> None:
    folder = synthetic.results(tmp_path, n_run=8)
    stated(folder, results_version=version)
    message = rf"manifest\.json: results of version {version}; this version of lvnav-trade reads 2 and 3$"
    with pytest.raises(InputError, match=message):
        load(folder)


def test_the_kept_base_of_the_smallest_campaign_is_of_version_2(root: Path) -> None:
    base = root / "tests/baseline/smoke"
    assert "results_version" not in json.loads((base / MANIFEST).read_text())
    rows = load(base).interval_errors
    pd.testing.assert_frame_equal(rows, pd.read_parquet(base / "worst.parquet")[rows.columns])
