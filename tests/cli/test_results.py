"""The verbs that look at results: report, compare, keep-base."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.calling import call


def test_a_folder_without_results_is_refused(events: dict[str, float]) -> None:
    Path("empty").mkdir()
    for verb in (["report", "empty"], ["replay", "empty", "0", "0"]):
        result = call(*verb)
        assert result.exit_code == 2
        assert result.stderr.startswith("empty: no results here")


@pytest.mark.parametrize(("candidate", "code"), [("same", 0), ("larger", 1), ("other", 2), ("close", 3)])
def test_a_comparison_says_by_its_exit_code_what_came_out(variants: Path, candidate: str, code: int) -> None:
    result = call("compare", str(variants / "base"), str(variants / candidate), "--effect", "rare=none")
    assert result.exit_code == code
    assert (result.stdout == "") == (code == 2)


def test_a_comparison_as_one_json_object_and_as_files(variants: Path, tmp_path: Path) -> None:
    junit, md = tmp_path / "junit.xml", tmp_path / "page.md"
    sides = [str(variants / "base"), str(variants / "larger")]
    result = call("compare", *sides, "--json", "--junit", str(junit), "--md", str(md), "--map", "fine:coarse")
    content = json.loads(result.stdout)
    assert (content["verb"], content["verdict"], content["exit_code"]) == ("compare", "worse", 1)
    assert content["rows"][0]["case"] == "imu=fine → imu=coarse"
    assert content["written"] == [str(md), str(junit)]
    assert junit.read_text().startswith("<?xml")
    assert "imu=fine → imu=coarse" in md.read_text()


def test_what_a_repository_keeps_of_a_base_is_reported(variants: Path, tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    assert call("keep-base", str(variants / "base"), str(kept)).stdout == f"base: {kept}\n"
    assert call("compare", str(kept), str(variants / "same"), "--effect", "rare=none").exit_code == 0


def test_a_report_and_a_base_are_not_kept_in_a_folder_of_the_users_own(variants: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/rms.csv").write_text("mine")
    base = str(variants / "base")
    for verb in (["report", base, "--keep", str(tmp_path / "mine")], ["keep-base", base, str(tmp_path / "mine")]):
        result = call(*verb)
        assert result.exit_code == 2
        assert result.stderr.count("\n") == 1
        assert "holds files that lvnav-trade did not write" in result.stderr
    result = call("report", base, "--keep", base)
    assert result.exit_code == 2
    assert "holds the results of a campaign, not a kept report" in result.stderr
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["rms.csv"]
    assert not (variants / "base/report.html").exists()


def test_tables_are_left_out_of_a_page_that_is_kept_and_of_none_else(variants: Path) -> None:
    result = call("report", str(variants / "base"), "--no-tables")
    assert (result.exit_code, result.stderr) == (2, "--no-tables: only --keep writes CSV tables\n")
    assert not (variants / "base/report.html").exists()


@pytest.mark.parametrize("text", ["[]", "3", "null", '{"name": "a web page"}', '{"created": 1, "finished": 2}'])
@pytest.mark.parametrize("verb", [("report",), ("status",), ("compare", "mine"), ("keep-base", "kept")])
def test_a_manifest_of_another_tool_is_reported_in_one_line(
    events: dict[str, float], verb: tuple[str, ...], text: str
) -> None:
    Path("mine").mkdir()
    Path("mine/manifest.json").write_text(text)
    result = call(verb[0], "mine", *verb[1:])
    assert (result.exit_code, result.stderr) == (2, "mine/manifest.json: not a manifest of lvnav-trade\n")
    assert not Path("kept").exists()
