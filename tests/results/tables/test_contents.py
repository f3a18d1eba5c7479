"""A folder of the tool lists what it wrote there; no other file is replaced or removed, and no other folder is used."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.tables.contents import CONTENTS, owned_folder
from lvnav_trade.results.tables.table_files import replace_file
from lvnav_trade.results.tables.write import open_results
from tests import synthetic
from tests.synthetic import CAMPAIGN


def tree(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def kept(folder: Path, *names: str):
    place = owned_folder(folder, "report")
    place.publish("report", {name: name for name in names})
    return place


def test_what_a_later_writing_has_not_is_removed_with_the_folder_that_is_empty_then(tmp_path):
    kept(tmp_path / "a", "report.md", "figures/one.png", "old.csv")
    kept(tmp_path / "a", "report.md", "new.csv")
    assert set(tree(tmp_path / "a")) == {"report.md", "new.csv", CONTENTS}
    assert owned_folder(tmp_path / "a", "report").names == {"report.md", "new.csv"}
    assert not (tmp_path / "a" / "figures").exists()


def test_the_users_own_files_stay_and_are_not_replaced(tmp_path):
    kept(tmp_path, "report.md")
    (tmp_path / "rms.csv").write_text("mine")
    before = tree(tmp_path)
    with pytest.raises(InputError, match=r"rms\.csv: was not written by lvnav-trade; move it, or give another folder"):
        owned_folder(tmp_path, "report").claim("report", ["report.md", "rms.csv"])
    assert tree(tmp_path) == before


FOREIGN = {
    "a file": {"notes.txt": "mine"},
    "a manifest of another tool": {"manifest.json": '{"name": "my web page", "version": 3}'},
    "a manifest that is no object": {"manifest.json": "[1, 2]"},
    "a manifest that is no JSON": {"manifest.json": "mine"},
    "parts": {"parts/a/0-8.parquet": "mine", "manifest.json": "{}"},
    "a table": {"cases.parquet": "mine"},
    "a list of another tool": {CONTENTS: '{"files": ["a"]}'},
    "a list that is no JSON": {CONTENTS: "{"},
    "a list of wrong types": {
        CONTENTS: '{"lvnav_trade_contents": 1, "kind": "results", "files": {"a": 1}, "cases": []}'
    },
    "a list of a later version": {
        CONTENTS: '{"lvnav_trade_contents": 9, "kind": "results", "files": {}, "cases": []}'
    },
    "a kept report": {CONTENTS: '{"lvnav_trade_contents": 1, "kind": "report", "files": {}, "cases": []}'},
    "names that lead elsewhere": {
        CONTENTS: '{"lvnav_trade_contents": 1, "kind": "results", "files": {"run": ["../mine.txt"]}, "cases": []}'
    },
    "a case that leads elsewhere": {
        CONTENTS: '{"lvnav_trade_contents": 1, "kind": "results", "files": {}, "cases": ["../.."]}'
    },
}  # fmt: skip


@pytest.mark.parametrize("mode", ["fresh", "resume"])
@pytest.mark.parametrize("what", FOREIGN)
def test_a_folder_that_is_not_the_tools_is_refused_in_one_line_and_nothing_is_lost(tmp_path, what, mode):
    (tmp_path / "mine.txt").write_text("mine")
    folder = tmp_path / "folder"
    for name, text in FOREIGN[what].items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    before = tree(tmp_path)
    with pytest.raises(InputError, match=r"nothing was changed; give another folder$") as caught:
        open_results(folder, "x", CAMPAIGN, {}, mode)
    assert "\n" not in str(caught.value)
    assert "--fresh" not in str(caught.value)
    assert tree(tmp_path) == before


def test_fresh_removes_what_the_list_names_and_nothing_else(tmp_path):
    synthetic.results(tmp_path, n_run=8)
    own = ["notes.txt", "parts/aaaaaaaaaaaa/notes.txt", "parts/mine/0-8.parquet", "parts/aaaaaaaaaaaa/my-8.parquet"]
    own += ["figures/a.png", "mine.csv", ".scratch/aaaaaaaaaaaa.txt", "tables.parquet"]
    for name in own:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("mine")
    results = open_results(tmp_path, "x", CAMPAIGN.replace("seed: 7", "seed: 8"), {}, "fresh")
    assert set(tree(tmp_path)) == {*own, CONTENTS, "manifest.json", "campaign.resolved.yaml"}
    assert all((tmp_path / name).read_text() == "mine" for name in own)
    assert results.block_spans("aaaaaaaaaaaa") == []


def test_blocks_of_runs_are_removed_and_nothing_else(tmp_path):
    synthetic.results(tmp_path, n_run=8)
    before = set(tree(tmp_path))
    mine = tmp_path / "parts/aaaaaaaaaaaa/notes.txt"
    mine.write_text("mine")
    blocks = {name for name in before if name.endswith("/0-8.parquet")}
    assert len(blocks) == 2
    owned_folder(tmp_path, "results").remove_blocks()
    assert set(tree(tmp_path)) == before - blocks | {"parts/aaaaaaaaaaaa/notes.txt"}


def test_a_link_is_not_followed(tmp_path):
    place = kept(tmp_path / "a", "report.md", "figures/one.png")
    (tmp_path / "photos").mkdir()
    for name in ("photos/one.png", "mine.md"):
        (tmp_path / name).write_text("mine")
    (tmp_path / "a/figures/one.png").unlink()
    (tmp_path / "a/figures").rmdir()
    (tmp_path / "a/figures").symlink_to(tmp_path / "photos")
    with pytest.raises(InputError, match="is a link, which is not followed"):
        owned_folder(tmp_path / "a", "report")
    with pytest.raises(InputError, match="is a link, which is not followed"):
        place.publish("report", {})
    (tmp_path / "a/figures").unlink()
    (tmp_path / "a/report.md").unlink(missing_ok=True)
    (tmp_path / "a/report.md").symlink_to(tmp_path / "mine.md")
    with pytest.raises(InputError, match="is a link, which is not followed"):
        owned_folder(tmp_path / "a", "report").claim("report", ["report.md"])
    replace_file(tmp_path / "a/report.md", "ours")
    assert (tmp_path / "photos/one.png").read_text() == (tmp_path / "mine.md").read_text() == "mine"


@pytest.mark.parametrize("name", ["../a.png", "/a.png", "figures/../../a.png", "", "a\0b"])
def test_a_name_that_leads_out_of_the_folder_is_refused(tmp_path, name):
    with pytest.raises(InputError, match="leads out of the folder"):
        owned_folder(tmp_path / "a", "report").claim("report", [name])
    assert not (tmp_path / "a").exists()


def test_a_name_that_no_file_can_have_is_refused_in_a_short_line(tmp_path):
    with pytest.raises(InputError, match="is longer than 255 bytes") as refusal:
        owned_folder(tmp_path / "a", "report").claim("report", ["figures/" + "x" * 9_000])
    assert len(str(refusal.value)) < 400


def test_results_of_an_earlier_version_are_known_by_their_manifest(tmp_path):
    synthetic.results(tmp_path, n_run=8)
    (tmp_path / CONTENTS).unlink()
    (tmp_path / "report.md").write_text("of an earlier report")
    assert owned_folder(tmp_path, "results").listed_names("run")
    place = owned_folder(tmp_path, "results")
    place.publish("report", {"report.md": "new"})
    assert (tmp_path / "report.md").read_text(encoding="utf-8") == "new"
    with pytest.raises(InputError, match="holds the results of a campaign, not a kept base"):
        owned_folder(tmp_path, "base")
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert manifest["cases"] == owned_folder(tmp_path, "results").cases or manifest["cases"] == []


def test_what_a_killed_process_left_half_written_is_removed_and_no_other_hidden_file(tmp_path):
    synthetic.results(tmp_path, n_run=8)
    parts = tmp_path / "parts/aaaaaaaaaaaa"
    litter = [tmp_path / ".runs.parquet.1", tmp_path / f".{CONTENTS}.1", parts / ".8-8.parquet.1"]
    litter.append(parts / "tables/.runs.parquet.1")
    own = [tmp_path / ".notes.json.1", tmp_path / ".lock", parts / ".mine.parquet.1", tmp_path / ".runs.parquet"]
    for path in (*litter, *own):
        path.write_text("")
    owned_folder(tmp_path, "results").sweep()
    assert not any(path.exists() for path in litter)
    assert all(path.exists() for path in own)


def test_a_file_is_replaced_whole_and_a_hard_link_keeps_its_content(tmp_path):
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "a").hardlink_to(tmp_path / "mine")
    replace_file(tmp_path / "a", "ours")
    assert (tmp_path / "mine").read_text() == "mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "mine"]
