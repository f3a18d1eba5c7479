"""What every verb does alike: help, one line per mistake, exit codes, one JSON object."""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from joblib.externals.loky.process_executor import TerminatedWorkerError
from typer.main import get_command

from lvnav_trade import api
from lvnav_trade.api import clusters
from lvnav_trade.campaign.running import work
from lvnav_trade.cli import app
from lvnav_trade.cli.console import GROUPS, _duration
from tests.cli.calling import call

SMOKE = "campaigns/smoke.yaml"


def test_help_names_every_verb_and_exit_code() -> None:
    text = call("--help").output
    for word in ("run", "check", "plan", "status", "schema", "cards", "report", "replay", "undecided", "130"):
        assert word in text


def test_the_version_is_one_line() -> None:
    result = call("--version")
    assert result.exit_code == 0
    assert result.output.startswith("lvnav-trade ")
    assert result.output.count("\n") == 1


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


@pytest.mark.parametrize("jobs", ["0", "-2"])
def test_an_impossible_number_of_jobs_is_refused(events: dict[str, float], jobs: str) -> None:
    result = call("run", SMOKE, f"--jobs={jobs}")
    assert result.exit_code == 2
    assert result.stderr == f"--jobs {jobs}: give a number of worker processes, or -1 for all cores\n"


@pytest.mark.parametrize("arguments", [["fly"], ["run"], ["run", SMOKE, "--jobs", "two"], ["check", SMOKE, "--fast"]])
def test_bad_usage_is_exit_code_two(arguments: list[str]) -> None:
    assert call(*arguments).exit_code == 2


def test_an_internal_error_is_one_line_and_exit_code_five(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)

    def broken(scenario: object) -> dict[str, float]:
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(work, "ENGINE", work.ENGINE._replace(events=broken))
    result = call("check", SMOKE)
    assert result.exit_code == 5
    assert result.stderr == (
        "internal error: ZeroDivisionError: division by zero (--debug shows where; please report it)\n"
    )
    assert isinstance(call("check", SMOKE, "--debug").exception, ZeroDivisionError)


def test_a_full_disk_is_exit_code_four_wherever_it_shows(events, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(api, "report", full)
    monkeypatch.setattr(api, "load", lambda folder: None)
    result = call("report", "results/smoke")
    assert result.exit_code == 4
    assert result.stderr == "No space left on device; the same command resumes once there is space\n"


def test_what_the_system_refuses_to_a_verb_is_no_internal_error(events, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied", "results/report.html")

    monkeypatch.setattr(api, "report", refuse)
    monkeypatch.setattr(api, "load", lambda folder: None)
    result = call("report", "results/smoke")
    assert result.exit_code == 2
    assert result.stderr == "results/report.html: Permission denied; the same command resumes once that is mended\n"


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="no device that is always full")
@pytest.mark.parametrize("more", [(), ("--json",), ("imu/tactical_fog",)])
def test_output_to_a_full_disk_is_one_line_and_exit_code_four(more: tuple[str, ...], tmp_path: Path) -> None:
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "lvnav_trade", "cards", *more]
        found = subprocess.run(command, cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    reported = "standard output: No space left on device; not all of it was written\n"
    assert (found.returncode, found.stderr) == (4, reported)


def test_ctrl_c_is_exit_code_130(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)

    def interrupted(scenario: object) -> dict[str, float]:
        raise KeyboardInterrupt

    monkeypatch.setattr(work, "ENGINE", work.ENGINE._replace(events=interrupted))
    result = call("check", SMOKE)
    assert (result.exit_code, result.stderr) == (130, "interrupted; the same command resumes\n")


def wrapped(*_: object) -> dict[str, float]:
    """Raise what compiled code makes of an interrupt."""
    try:
        raise KeyboardInterrupt
    except KeyboardInterrupt as cause:
        raise SystemError("returned a result with an exception set") from cause


def discarded(*_: object) -> dict[str, float]:
    """Receive an interrupt that is discarded, as within a call back from C, and fail of it later."""
    with suppress(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    raise ValueError("half a result")


@pytest.mark.parametrize("events", [wrapped, discarded])
def test_so_is_one_that_compiled_code_turns_into_another_error(monkeypatch, tmp_path: Path, events) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(work, "ENGINE", work.ENGINE._replace(events=events))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background has it ignored
    try:
        result = call("check", SMOKE)
    finally:
        signal.signal(signal.SIGINT, before)
    assert (result.exit_code, result.stderr) == (130, "interrupted; the same command resumes\n")


def test_a_worker_that_died_is_one_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def died(scenario: object) -> dict[str, float]:
        raise TerminatedWorkerError("exit codes {SIGKILL(-9)}")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(work, "ENGINE", work.ENGINE._replace(events=died))
    result = call("check", SMOKE)
    reported = "a worker process died (out of memory?); the same command tries again\n"
    assert (result.exit_code, result.stderr) == (4, reported)


def test_what_each_verb_does_is_reported_whole_in_eighty_columns() -> None:
    shown = call("--help").output
    assert "kml" in shown
    assert "..." not in shown.partition("Commands:")[2]


def test_every_example_below_a_help_is_a_call_that_the_command_takes() -> None:
    commands = get_command(app).commands
    assert len(commands) > 15
    for name, command in commands.items():
        _, _, example = command.epilog.partition(f"lvnav-trade {name} ")
        command.make_context(name, shlex.split(example.partition(">")[0]))
        assert "Example: lvnav-trade" in call(name, "--help").output


@pytest.mark.parametrize(("set_by_user", "found"), [(None, "1"), ("2", "2")])
def test_linear_algebra_has_one_thread_unless_the_user_says_otherwise(set_by_user, found):
    """Set before numpy is imported, since its libraries read it then."""
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    if set_by_user is not None:
        environment["OPENBLAS_NUM_THREADS"] = set_by_user
    code = "import os, sys, lvnav_trade.cli; print(os.environ['OPENBLAS_NUM_THREADS'], 'numpy' in sys.modules)"
    shown = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert shown.stdout.split() == [found, "False"]


def test_the_help_lists_every_verb_once_in_a_group() -> None:
    listed = [name for names in GROUPS.values() for name in names]
    assert sorted(listed) == sorted(get_command(app).commands)  # type: ignore[attr-defined]
    text = call("-h").output
    assert text == call("--help").output
    heads = [text.index(f"\n{group}:\n") for group in GROUPS]
    assert heads == sorted(heads)
    assert text.index("  run ") < text.index("Explore:") < text.index("  fields ")


def test_usage_names_what_is_required_without_brackets() -> None:
    assert "run [OPTIONS] CAMPAIGN\n" in call("run", "-h").output


def test_every_verb_that_writes_has_one_form_of_out() -> None:
    for name, command in get_command(app).commands.items():  # type: ignore[attr-defined]
        options = {option for parameter in command.params for option in parameter.opts}
        assert "--output" not in options, name
        assert ("--out" in options) == ("-o" in options), name
        text = call(name, "-h").output
        assert "[default: (" not in text, name
        assert "FOLDER" not in text, name


def test_the_shell_completes_verbs() -> None:
    asked = {"_LVNAV_TRADE_COMPLETE": "complete_bash", "COMP_WORDS": "lvnav-trade sel", "COMP_CWORD": "1"}
    script = "import sys; sys.argv = ['lvnav-trade']; from lvnav_trade.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", script], env=os.environ | asked, capture_output=True, text=True, check=False
    )
    assert done.stdout.split() == ["selfcheck"]


def test_a_terminal_gets_a_sign_before_any_package_is_imported(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    script = (
        "import sys; sys.stderr.isatty = lambda: True; from lvnav_trade.cli import app\n"
        "from lvnav_trade.cli import console\n"
        "console._say = lambda line: print(line, 'numpy' in sys.modules)\n"
        "app(['check', 'none.yaml'])\n"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout == "check: reading none.yaml False\n"
    assert done.returncode == 2


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.04, "0.0 s"),
        (9.96, "10 s"),
        (59.4, "59 s"),
        (59.6, "1 min 0 s"),
        (308.3, "5 min 8 s"),
        (7790.0, "2 h 10 min"),
    ],
)
def test_durations_are_read_at_a_glance(seconds: float, words: str) -> None:
    assert _duration(seconds) == words


def test_a_verb_with_progress_says_how_long_it_took(monkeypatch: pytest.MonkeyPatch) -> None:
    done = clusters.ShardOutcome(Path("shard-1-of-2"), 40, 1, ())
    monkeypatch.setattr(api, "run_shard", lambda *_: done)
    result = call("run", SMOKE, "--shard", "1/2")
    assert re.fullmatch(r"[0-9:]{8} run: [0-9.]+ s in total\n", result.stderr)
    assert call("run", SMOKE, "--shard", "1/2", "--quiet").stderr == ""
