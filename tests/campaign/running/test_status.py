"""What is said of a folder of results is so, whatever happened to it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from lvnav_trade.campaign.running.status import CaseStatus, folder_lock, status
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.tables.parts import paths
from tests import synthetic

CASES = [case.id for case, _ in synthetic.CASES]


def asked(folder: Path, runs: int, finished: bool = True) -> None:
    """Write into the manifest what the campaign's execution writes."""
    path = folder / "manifest.json"
    manifest = json.loads(path.read_text())
    labels = {case.id: case.label for case, _ in synthetic.CASES}
    manifest |= {"asked_cases": labels, "asked_runs": runs, "asked_block": 40}
    if not finished:
        del manifest["finished"]
    path.write_text(json.dumps(manifest))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = synthetic.results(tmp_path_factory.mktemp("status") / "results", n_run=100, failing=(3, 50))
    asked(folder, 100)
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    """Return finished results of 100 runs in blocks of 40, two of each case failed."""
    return Path(shutil.copytree(made, tmp_path / "results"))


def test_finished_results_are_finished(folder: Path) -> None:
    found = status(folder)
    assert (found.state, found.required_runs, found.stored_runs, found.failed_runs) == ("finished", 200, 200, 4)
    assert found.cases[0] == CaseStatus("aaaaaaaaaaaa", "imu=fine", 100, 100, 2)
    assert found.damaged_files == found.lost_items == ()
    assert found.text.splitlines()[0] == f"{folder}: finished: 200 of 200 runs are stored, 4 of them failed"


def test_looking_changes_nothing(folder: Path) -> None:
    paths(folder / "parts" / CASES[0])[0].write_bytes(b"PAR1")
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    status(folder)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_a_campaign_that_ended_early_is_unfinished_and_says_what_is_left(folder: Path) -> None:
    asked(folder, 100, finished=False)
    for path in paths(folder / "parts" / CASES[1])[1:]:
        path.unlink()
    found = status(folder)
    assert (found.state, found.stored_runs) == ("unfinished", 140)
    assert [case.stored_runs for case in found.cases] == [100, 40]
    assert found.text.startswith(f"{folder}: unfinished; the same command resumes: 140 of 200 runs are stored")


def test_a_last_block_that_more_runs_would_replace_does_not_count(folder: Path) -> None:
    asked(folder, 200, finished=False)
    assert [case.stored_runs for case in status(folder).cases] == [80, 80]


def test_whoever_works_on_it_is_named(folder: Path) -> None:
    with folder_lock(folder):
        found = status(folder)
    assert found.state == "running"
    assert found.text.startswith(f"{folder}: running, process ")
    assert status(folder).state == "finished"


def test_a_damaged_block_is_named_and_does_not_count(folder: Path) -> None:
    path = paths(folder / "parts" / CASES[0])[1]
    path.write_bytes(path.read_bytes()[:-100])
    found = status(folder)
    assert (found.state, found.stored_runs) == ("damaged", 160)
    assert found.damaged_files[0].startswith(f"{path}: damaged part: ")
    assert found.text.startswith(f"{folder}: damaged; the same command mends it: 160 of 200")


def test_a_damaged_or_missing_table_is_named(folder: Path) -> None:
    (folder / "budget.parquet").unlink()
    content = bytearray((folder / "history.parquet").read_bytes())
    content[len(content) // 2] ^= 1
    (folder / "history.parquet").write_bytes(content)
    found = status(folder)
    assert found.state == "damaged"
    assert sorted(Path(line.partition(": ")[0]).name for line in found.damaged_files) == [
        "budget.parquet",
        "history.parquet",
    ]


def test_what_was_lost_is_reported(folder: Path) -> None:
    path = folder / "manifest.json"
    lost = {"lost": ["imu=fine, runs 0 to 39: ZeroDivisionError: x"], "workers_died": 1}
    path.write_text(json.dumps(json.loads(path.read_text()) | lost))
    text = status(folder).text.splitlines()
    assert text[0].startswith(f"{folder}: finished, except for lost work items; the same command computes them: ")
    assert text[1:3] == ["workers that died: 1", "lost: imu=fine, runs 0 to 39: ZeroDivisionError: x"]


def test_results_of_another_code_are_not_said_to_resume(folder: Path) -> None:
    asked(folder, 100, finished=False)
    path = folder / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"numba": "0.1"}))
    found = status(folder)
    assert found.state == "unfinished"
    assert found.text.startswith(f"{folder}: was computed with another numba (0.1, this is ")
    assert "resumes" not in found.text


def test_a_folder_without_results_and_a_torn_manifest_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no results here"):
        status(tmp_path)
    (tmp_path / "manifest.json").write_text('{"created":')
    with pytest.raises(InputError, match=r"manifest\.json: damaged: "):
        status(tmp_path)
    (tmp_path / "manifest.json").write_text('{"campaign_digest": "a"}')
    with pytest.raises(InputError, match="a kept base"):
        status(tmp_path)
