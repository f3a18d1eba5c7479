"""The verb study: a folder of campaigns, one page."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests import synthetic
from tests.campaign.reading.test_study_card import CAMPAIGN
from tests.cli.calling import call


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a study of one campaign whose results are there; the working folder is beside it."""
    monkeypatch.chdir(tmp_path)
    references = synthetic.CAMPAIGN.partition("references:")[2]
    axis = "{path: imu, cards: [imu/tactical_fog, imu/tactical_mems], labels: [fine, coarse]}"
    more = f"monte_carlo: {{runs: 40}}\naxes: [{axis}]\nreferences:{references}"
    (tmp_path / "papers").mkdir()
    (tmp_path / "papers" / "synthetic.yaml").write_text(CAMPAIGN.format(name="synthetic", more=more))
    synthetic.results(tmp_path / "results" / "papers" / "synthetic", n_run=40)
    return tmp_path


def test_the_page_is_made_of_results_that_are_there(folder: Path) -> None:
    result = call("study", "papers", "--keep", "kept", "--only-page")
    assert result.exit_code == 0, result.stderr
    assert result.stdout.splitlines()[0] == "synthetic: 2 cases, 0 failed runs"
    assert result.stdout.splitlines()[-1] == "kept: kept/report.md"
    assert Path("kept/references.csv").exists()
    content = json.loads(call("study", "papers", "--keep", "kept", "--only-page", "--json").stdout)
    assert (content["verb"], content["published"], content["hold"]) == ("study", 2, 0)
    assert content["campaigns"] == {"synthetic": [2, 0]}


def test_a_mistake_in_any_campaign_is_reported_before_anything_runs(folder: Path) -> None:
    Path("papers/wrong.yaml").write_text("name: wrong\nsead: 1\n")
    result = call("study", "papers", "--keep", "kept")
    assert result.exit_code == 2
    assert "papers/wrong.yaml:2:1: sead: unknown key (did you mean 'seed'?)" in result.stderr.splitlines()
    assert not Path("kept").exists()


def test_without_results_there_is_no_page(folder: Path) -> None:
    result = call("study", "papers", "--keep", "kept", "--only-page", "--out", "elsewhere")
    assert (result.exit_code, result.stderr) == (2, "elsewhere/synthetic: no results here (no manifest.json)\n")


def test_a_folder_of_the_users_own_is_refused_before_anything_runs(folder: Path) -> None:
    Path("kept/figures").mkdir(parents=True)
    for name in ("kept/flight.kml", "kept/figures/photo.png"):
        Path(name).write_text("mine")
    result = call("study", "papers", "--keep", "kept", "--out", "elsewhere")
    reported = "kept: holds files that lvnav-trade did not write (no contents.json)"
    assert (result.exit_code, result.stderr) == (2, f"{reported}; nothing was changed; give another folder\n")
    assert not Path("elsewhere").exists()
    assert sorted(str(path) for path in Path("kept").rglob("*.*")) == ["kept/figures/photo.png", "kept/flight.kml"]
