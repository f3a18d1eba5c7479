"""`export-filter`: a folder with the filter of a case as C, and a replay that agrees."""

from __future__ import annotations

import json

import lvnav_trade.exports
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


def test_from_python_without_runs(tmp_path):
    found = lvnav_trade.exports.export_filter("smoke", tmp_path / "code", runs=0)
    assert (tmp_path / "code" / "nav_filter.c").read_text() == found.files["nav_filter.c"]
