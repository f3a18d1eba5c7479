"""`export-vectors` and `export-filter`: folders with reference vectors, and with the filter of a case as C."""

from __future__ import annotations

import json
from typing import Any

import pandas as pd

from tests.cli.calling import call
from tests.export.translation.compiled import needs_compiler

SHORT = ("--set", "base.filter=filters/tight")


@needs_compiler
def test_a_filter_is_exported_and_its_runs_replayed(tmp_path):
    out = tmp_path / "code"
    done = call("export-filter", "smoke", *SHORT, "-o", str(out), "--runs", "2", "--json", "--quiet")
    assert done.exit_code == 0, done.output
    content = json.loads(done.output)
    assert content["agrees"]
    assert {row["run"] for row in content["replayed"]} == {"run_0.bin", "run_1.bin"}
    assert max(row["difference"] for row in content["replayed"]) <= 1e-9
    expected = {"README.md", "nav_filter.h", "nav_filter.c", "replay.c", "flight.bin", "run_0.bin", "run_1.bin",
                "replay.csv", "contents.json"}  # fmt: skip
    assert {path.name for path in out.iterdir()} == expected


def test_a_folder_of_other_files_is_left_alone(tmp_path):
    mine = tmp_path / "mine.txt"
    mine.write_text("mine")
    done = call("export-filter", "smoke", "-o", str(tmp_path), "--runs", "0")
    assert done.exit_code == 2
    assert done.output.count("\n") == 1
    assert mine.read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_a_case_that_there_is_not_is_one_line(tmp_path):
    done = call("export-filter", "smoke", "--case", "nothing", "-o", str(tmp_path / "x"))
    assert done.exit_code == 2
    assert done.output.startswith("error: no case 'nothing'") or "no case 'nothing'" in done.output
    assert not (tmp_path / "x").exists()


def test_reference_vectors_are_tables_with_units(tmp_path):
    out = tmp_path / "vectors"
    done = call("export-vectors", "smoke", *SHORT, "-o", str(out), "--run", "1", "--format", "parquet", "--json")
    assert done.exit_code == 0, done.output
    content = json.loads(done.output)
    assert {*content["files"], "contents.json"} == {path.name for path in out.iterdir()}
    tables = {path.stem: pd.read_parquet(path) for path in out.glob("*.parquet")}
    described = pd.read_csv(out / "columns.csv", keep_default_na=False)
    assert {(row.table, row.column) for row in described.itertuples()} == {
        (name, column) for name, frame in tables.items() for column in frame.columns
    }
    assert len(tables["epochs"]) > 600
    epochs = tables["estimates"].groupby("stage").epoch.nunique()
    assert epochs["before"] == epochs["after"] == len(tables["epochs"])


def test_a_kernel_that_cannot_be_translated_is_named(tmp_path, monkeypatch):
    from lvnav_trade.export import entries

    monkeypatch.setattr(entries, "update", _untranslatable)
    done = call("export-filter", "smoke", *SHORT, "-o", str(tmp_path / "code"), "--runs", "0")
    assert done.exit_code == 2
    assert done.output.count("\n") == 1
    assert "cannot be translated to C" in done.output
    assert "_untranslatable" in done.output
    assert not (tmp_path / "code").exists()


def _untranslatable(work: Any, parts: Any, unit: Any, sensors: Any, signals: Any, model: Any, options: Any, epoch: Any):
    """Update in words that C does not have."""
    work.nav[0] = {"a": 1.0}["a"]
