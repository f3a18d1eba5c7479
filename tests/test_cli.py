"""The command line: verbs, exit codes, one line per mistake, one JSON object."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from lvnav_trade import api
from lvnav_trade.campaign import work
from lvnav_trade.campaign.work import Engine
from lvnav_trade.cli import app

SMOKE = "campaigns/smoke.yaml"


def call(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


@pytest.fixture
def events(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, float]:
    """Let every trajectory have the same events, so that nothing is flown; work in an empty folder."""
    monkeypatch.chdir(tmp_path)
    times = {"liftoff": 0.0, "stage1_cutoff": 150.0, "stage2_ignition": 200.0, "injection": 600.0}

    def none(*_: object) -> None:
        raise AssertionError("nothing should be computed")

    monkeypatch.setattr(work, "engine", lambda: Engine(lambda scenario: times, none, none, none, none))
    return times


def test_help_names_every_verb_and_exit_code() -> None:
    text = call("--help").output
    for word in ("run", "check", "plan", "status", "schema", "cards", "report", "replay", "undecided", "130"):
        assert word in text


def test_help_comes_in_half_a_second() -> None:
    def once() -> float:
        start = time.perf_counter()
        subprocess.run([sys.executable, "-m", "lvnav_trade", "--help"], check=True, capture_output=True)
        return time.perf_counter() - start

    assert min(once() for _ in range(3)) < 0.5


def test_the_version_is_one_line() -> None:
    result = call("--version")
    assert result.exit_code == 0
    assert result.output.startswith("lvnav-trade ")
    assert result.output.count("\n") == 1


@pytest.mark.parametrize("name", ["demo", "smoke", "falcon9_formosat5"])
def test_a_campaign_of_the_tool_is_good_from_any_folder(events: dict[str, float], name: str) -> None:
    result = call("check", f"campaigns/{name}.yaml")
    assert result.output.startswith(f"campaigns/{name}.yaml: good, ")
    assert result.exit_code == 0


def test_a_mistake_is_one_line_and_exit_code_two(events: dict[str, float]) -> None:
    Path("bad.yaml").write_text("name: x\nsead: 1\n")
    result = call("check", "bad.yaml")
    assert result.exit_code == 2
    assert result.stdout == ""
    assert "bad.yaml:2:1: sead: unknown key (did you mean 'seed'?)" in result.stderr.splitlines()


def test_a_mistake_is_a_json_object_where_that_is_asked_for(events: dict[str, float]) -> None:
    Path("bad.yaml").write_text("name: x\nsead: 1\n")
    result = call("check", "bad.yaml", "--json")
    content = json.loads(result.stdout)
    assert result.exit_code == content["exit_code"] == 2
    found = [mistake for mistake in content["mistakes"] if mistake["path"] == "sead"]
    assert found == [
        {"message": "unknown key (did you mean 'seed'?)", "path": "sead", "file": "bad.yaml", "line": 2, "column": 1}
    ]


def test_a_mistake_is_a_note_on_its_line_in_a_workflow(events, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    Path("bad.yaml").write_text("name: x\nsead: 1\n")
    result = call("check", "bad.yaml")
    assert "::error file=bad.yaml,line=2,col=1::sead: unknown key (did you mean 'seed'?)" in result.stderr.splitlines()


def test_a_fault_after_the_flight_is_refused(events: dict[str, float]) -> None:
    result = call("check", SMOKE, "--set", "faults=[{start: 621 s, duration: 5 s, kind: satellite_outage}]")
    assert result.exit_code == 2
    assert result.stderr == "--set: base.faults.0.start: '621 s' is 621 s, at or after the end of the flight (620 s)\n"


def test_a_requirement_at_an_unknown_event_is_refused(events: dict[str, float]) -> None:
    result = call("check", "campaigns/demo.yaml", "--set", "requirements.0.at=injektion")
    assert result.exit_code == 2
    assert result.stderr == (
        "--set: requirements.0.at: 'injektion' is not an event of the trajectory (did you mean 'injection'?)\n"
    )


@pytest.mark.parametrize("jobs", ["0", "-2"])
def test_an_impossible_number_of_jobs_is_refused(events: dict[str, float], jobs: str) -> None:
    result = call("run", SMOKE, f"--jobs={jobs}")
    assert result.exit_code == 2
    assert result.stderr == f"--jobs {jobs}: give a number of worker processes, or -1 for all cores\n"


@pytest.mark.parametrize("arguments", [["fly"], ["run"], ["run", SMOKE, "--jobs", "two"], ["check", SMOKE, "--fast"]])
def test_bad_usage_is_exit_code_two(arguments: list[str]) -> None:
    assert call(*arguments).exit_code == 2


def test_a_campaign_that_is_not_there_is_exit_code_two(events: dict[str, float]) -> None:
    result = call("run", "nothing.yaml")
    assert (result.exit_code, result.stderr) == (2, "nothing.yaml: no such file\n")


def test_an_internal_error_is_one_line_and_exit_code_five(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)

    def broken() -> Engine:
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(work, "engine", broken)
    result = call("check", SMOKE)
    assert result.exit_code == 5
    assert result.stderr == (
        "internal error: ZeroDivisionError: division by zero (--debug shows where; please report it)\n"
    )
    assert isinstance(call("check", SMOKE, "--debug").exception, ZeroDivisionError)


def test_a_full_disk_is_exit_code_four_wherever_it_shows(events, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(api, "build_report", full)
    monkeypatch.setattr(api, "load", lambda folder: None)
    result = call("report", "results/smoke")
    assert result.exit_code == 4
    assert result.stderr == "No space left on device; the same command resumes once there is space\n"


def test_what_the_system_refuses_to_a_verb_is_no_internal_error(events, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied", "results/report.html")

    monkeypatch.setattr(api, "build_report", refuse)
    monkeypatch.setattr(api, "load", lambda folder: None)
    result = call("report", "results/smoke")
    assert result.exit_code == 2
    assert result.stderr == "results/report.html: Permission denied; the same command resumes once that is mended\n"


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="no device that is always full")
@pytest.mark.parametrize("more", [(), ("--json",), ("imu/tactical_fog",)])
def test_output_to_a_full_disk_is_one_line_and_exit_code_four(more: tuple[str, ...]) -> None:
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "lvnav_trade", "cards", *more]
        found = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    told = "No space left on device; the same command resumes once there is space\n"
    assert (found.returncode, found.stderr) == (4, told)


def test_ctrl_c_is_exit_code_130(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)

    def interrupted() -> Engine:
        raise KeyboardInterrupt

    monkeypatch.setattr(work, "engine", interrupted)
    result = call("check", SMOKE)
    assert (result.exit_code, result.stderr) == (130, "interrupted; the same command resumes\n")


def test_the_plan_shows_cases_and_what_is_done(events: dict[str, float]) -> None:
    content = json.loads(call("plan", "campaigns/demo.yaml", "--json").stdout)
    assert [case["label"] for case in content["cases"]][:2] == [
        "imu=tactical_fog, filter=loose",
        "imu=tactical_fog, filter=tight",
    ]
    assert content["blocks"] == 6 * 5
    assert {case["done"] for case in content["cases"]} == {0}
    part = Path("results/demo/parts", content["cases"][0]["id"])
    part.mkdir(parents=True)
    (part / "0-40.parquet").touch()
    again = json.loads(call("plan", "campaigns/demo.yaml", "--json").stdout)
    assert again["cases"][0]["done"] == 40
    assert again["blocks"] == 6 * 5 - 1
    assert 0 < again["seconds"] < content["seconds"]
    assert "about" in call("plan", "campaigns/demo.yaml").stdout


def test_the_schema_knows_cards_and_every_key() -> None:
    schema = json.loads(call("schema").stdout)
    assert set(schema["properties"]) >= {"name", "seed", "base", "axes", "design", "monte_carlo", "requirements"}
    assert schema["additionalProperties"] is False
    imu = schema["$defs"]["ImuCard"]["anyOf"]
    assert imu[0]["type"] == "string"
    assert "card" in imu[1]["properties"]


def test_the_cards_are_listed_and_shown_with_their_sources(events: dict[str, float]) -> None:
    listed = call("cards").stdout
    assert "imu/tactical_fog" in listed
    assert "Trigo and Theil" in listed
    shown = call("cards", "imu/tactical_fog").stdout
    assert 'random_walk: "0.03 deg/sqrt(h)"' in shown
    wrong = call("cards", "imu/tactical_fogg")
    assert (wrong.exit_code, wrong.stderr) == (2, "no card 'imu/tactical_fogg' (did you mean 'imu/tactical_fog'?)\n")


def test_a_folder_without_results_is_refused(events: dict[str, float]) -> None:
    Path("empty").mkdir()
    for verb in (["report", "empty"], ["replay", "empty", "0", "0"]):
        result = call(*verb)
        assert result.exit_code == 2
        assert result.stderr.startswith("empty: no results here")


def test_the_status_is_told_in_words_and_as_json(variants: Path) -> None:
    result = call("status", str(variants / "base"))
    assert (result.exit_code, result.stdout.startswith(f"{variants / 'base'}: finished: ")) == (0, True)
    content = json.loads(call("status", str(variants / "base"), "--json").stdout)
    assert (content["verb"], content["state"], content["damaged"]) == ("status", "finished", [])
    assert call("status", str(variants)).exit_code == 2


def test_a_replay_of_an_unknown_case_is_refused(events: dict[str, float]) -> None:
    result = call("replay", "campaigns/demo.yaml", "imu=tactical_fog, filter=tigth", "0")
    assert result.exit_code == 2
    assert "(did you mean 'imu=tactical_fog, filter=tight'?)" in result.stderr


@pytest.fixture(scope="module")
def variants(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with results and three candidates."""
    from lvnav_trade.store import load
    from tests import synthetic
    from tests.metrics.variants import variant, worse

    folder = tmp_path_factory.mktemp("variants")
    base = load(synthetic.results(folder / "base", n_run=40))
    variant(base, folder / "same", runs=worse(1.0))
    variant(base, folder / "larger", runs=worse(1.3))
    variant(base, folder / "close", runs=worse(1.05, 0.05))
    variant(base, folder / "other", campaign=lambda campaign: campaign | {"seed": 8})
    return folder


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


def test_what_a_repository_keeps_of_a_base_is_told(variants: Path, tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    assert call("keep-base", str(variants / "base"), str(kept)).stdout == f"base: {kept}\n"
    assert call("compare", str(kept), str(variants / "same"), "--effect", "rare=none").exit_code == 0
