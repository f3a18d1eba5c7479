"""The same from Python, end to end: a small campaign through every room."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lvnav_trade
from lvnav_trade import api
from lvnav_trade.quantities.errors import InputError

REQUIREMENT = "requirements=[{name: lost, metric: position_error_3d, probability: 0.5, below: 100 km, confidence: 0.5}]"


def test_the_conventions_stand_on_the_front_page() -> None:
    for word in ("Frames", "Rotations", "Truth and estimate", "Units", "Noise", "Shapes", "Randomness"):
        assert word in (lvnav_trade.__doc__ or "")


def test_importing_the_package_imports_no_heavy_room() -> None:
    code = (
        "import sys, lvnav_trade; print([m for m in ('numba', 'pandas', 'pydantic', 'matplotlib') if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout == "[]\n"


def test_the_names_of_the_package_are_those_of_the_api() -> None:
    assert lvnav_trade.run is api.run
    assert lvnav_trade.load is api.load
    assert lvnav_trade.check is api.check
    assert lvnav_trade.InputError is InputError
    with pytest.raises(AttributeError):
        lvnav_trade.fly  # noqa: B018


@pytest.mark.parametrize(
    ("verdicts", "failures", "code"),
    [
        ([], [], 0),
        (["met", "met"], [], 0),
        (["met", "violated", "undecided"], [], 1),
        (["met", "undecided"], [], 3),
        (["met", "violated"], ["run 3 diverged"], 4),
    ],
)
def test_the_exit_code_tells_the_verdict(verdicts: list[str], failures: list[str], code: int) -> None:
    assert api.exit_code(verdicts, failures) == code


def test_a_section_that_the_report_does_not_have_is_refused_first(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as caught:
        api.run("campaigns/smoke.yaml", ["report.sections=[sumary]"])
    assert str(caught.value) == "--set: report.sections.0: no section 'sumary' (did you mean 'summary'?)"
    assert not Path("results").exists()


def test_a_folder_without_results_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no results here"):
        api.load(tmp_path)


@pytest.fixture(scope="module")
def smoke_results(tmp_path_factory: pytest.TempPathFactory) -> api.Results:
    """Return the results of the small campaign, computed by this process."""
    folder = tmp_path_factory.mktemp("computed") / "smoke"
    return api.run("campaigns/smoke.yaml", [REQUIREMENT], folder, jobs=1)


@pytest.mark.slow
def test_a_campaign_leaves_tidy_frames_with_units(smoke_results: api.Results) -> None:
    assert len(smoke_results.cases) == 1
    assert set(smoke_results.runs.run_number) == set(range(8))
    assert {"t_s", "position_3d_error_m", "velocity_3d_error_m_per_s"} <= set(smoke_results.runs.columns)
    assert {"case", "metric", "unit", "rms"} <= set(smoke_results.rms.columns)
    assert list(smoke_results.requirements.verdict) == ["met"]
    assert smoke_results.exit_code == 0


@pytest.mark.slow
def test_a_campaign_leaves_a_report_and_csv_tables(smoke_results: api.Results) -> None:
    names = {file.name for file in smoke_results.folder.iterdir()}
    assert {"report.html", "rms.csv", "requirements.csv", "campaign.resolved.yaml"} <= names


@pytest.mark.slow
def test_a_replay_equals_the_stored_run_bit_for_bit(smoke_results: api.Results, monkeypatch) -> None:
    monkeypatch.chdir(smoke_results.folder.parent)
    out = _call("replay", str(smoke_results.folder), "base", "5", "--json")
    content = json.loads(out.stdout)
    import pandas as pd

    trace = pd.read_parquet(content["trace"])
    stored = smoke_results.runs[smoke_results.runs.run_number == 5].set_index("event")
    columns = [name for name in trace.columns if "_error_" in name]
    assert len(columns) >= 15
    for event, row in stored.iterrows():
        again = trace.iloc[int(np.argmin(np.abs(trace.t_s - row.t_s)))]
        assert list(again[columns]) == list(row[columns]), event


@pytest.mark.slow
def test_the_command_line_leaves_the_same_tables(smoke_results: api.Results, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    out = _call("run", "campaigns/smoke.yaml", "--set", REQUIREMENT, "--jobs", "2", "--no-report", "--json", "--quiet")
    assert out.stderr == ""
    content = json.loads(out.stdout)
    assert out.returncode == content["exit_code"] == 0
    for file in sorted(smoke_results.folder.glob("*.parquet")):
        assert (tmp_path / "results/smoke" / file.name).read_bytes() == file.read_bytes(), file.name


def _call(*arguments: str) -> subprocess.CompletedProcess[str]:
    root = Path(__file__).resolve().parents[1]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    command = [sys.executable, "-m", "lvnav_trade", *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=False)


@pytest.mark.slow
def test_failed_runs_are_rows_and_exit_code_four_even_when_nothing_is_flown_again(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    # A limit that some of the runs exceed: the error near the first cut-off is some metres.
    for _ in range(2):
        out = _call("run", "campaigns/smoke.yaml", "--set", "diverged=4 m", "--jobs", "1", "--no-report", "--quiet")
        assert out.returncode == 4
        reported = [line for line in out.stdout.splitlines() if line.startswith("failed: base, run ")]
        assert 0 < len(reported) < 8
        assert "diverged at" in reported[0]
        assert "lvnav-trade replay results/smoke" in reported[0]
    runs = api.load("results/smoke").runs
    assert (runs.failure == "diverged").any()
    assert (runs.failure == "").any()


@pytest.mark.slow
def test_a_scale_factor_five_percent_worse_is_reported_with_eighty_runs(tmp_path: Path) -> None:
    runs, unit = "monte_carlo.runs=80", "imu.accel.scale_factor"
    folders = {
        name: api.run("campaigns/smoke.yaml", [runs, *change], tmp_path / name, jobs=1, report=False).folder
        for name, change in {"base": (), "same": (), "worse": (f"{unit}=1575 ppm",)}.items()
    }

    def verdict(candidate: str, effect: str) -> Any:
        found = api.compare(folders["base"], folders[candidate], [f"velocity_error_3d={effect}"])
        return found.frame.set_index("metric").loc["velocity_error_3d"]

    assert verdict("same", "2 %").verdict == "not worse"
    worse = verdict("worse", "2 %")
    assert (worse.verdict, worse.runs) == ("worse", 80)
    assert worse.effective_runs > 10_000
    assert verdict("worse", f"{100.0 * worse.change:.4f} %").verdict == "undecided"
    assert verdict("worse", "10 %").verdict == "not worse"
