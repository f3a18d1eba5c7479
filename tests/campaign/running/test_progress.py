"""Progress goes to standard error: lines in logs, a bar on a terminal, nothing when quiet."""

from __future__ import annotations

import io
import re
import sys
from pathlib import Path

import pytest

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running import execute
from lvnav_trade.campaign.running.conduct import RunOptions
from lvnav_trade.campaign.running.progress import Bar, Plain, Progress, choose, progress_stage

STAMP = re.compile(r"^[0-2][0-9]:[0-5][0-9]:[0-5][0-9] ")


def said(text: str) -> list[str]:
    """Return the lines of a log without the time of day, which each of them begins with."""
    lines = text.splitlines()
    assert all(STAMP.match(line) for line in lines)
    return [STAMP.sub("", line) for line in lines]


def go_through(progress: Progress, total: int = 40) -> None:
    progress.stage("runs", total)
    for _ in range(total):
        progress.advance(1)
    progress.note("base, run 3 diverged")
    progress.close()


def test_a_log_gets_a_line_for_every_tenth_and_no_more(capsys: pytest.CaptureFixture[str]) -> None:
    go_through(Plain(), 1000)
    out, err = capsys.readouterr()
    lines = said(err)
    assert out == ""
    assert lines[0] == "runs: 1000"
    assert [line.partition(",")[0] for line in lines[1:11]] == [f"runs: {n}00/1000" for n in range(1, 11)]
    assert lines[10] == "runs: 1000/1000, 0 s left"
    assert lines[11:] == ["base, run 3 diverged"]


def test_the_time_left_is_that_of_the_units_left(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter([100.0, 130.0])
    monkeypatch.setattr("lvnav_trade.campaign.running.progress.time.monotonic", lambda: next(clock))
    progress = Plain()
    progress.stage("runs", 40)
    progress.advance(10)  # 30 s for a quarter
    assert said(capsys.readouterr().err)[-1] == "runs: 10/40, 90 s left"


def test_the_first_unit_which_compiles_does_not_count_in_the_time_left(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter([0.0, 60.0, 61.0])
    monkeypatch.setattr("lvnav_trade.campaign.running.progress.time.monotonic", lambda: next(clock))
    progress = Plain()
    progress.stage("cases", 10)
    progress.advance(1)
    progress.advance(1)
    assert said(capsys.readouterr().err)[-1] == "cases: 2/10, 8 s left"


def test_of_steps_that_are_unlike_the_first_counts_too(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter([0.0, 20.0, 21.0])  # the first step of a report reads the tables that the others take up
    monkeypatch.setattr("lvnav_trade.campaign.running.progress.time.monotonic", lambda: next(clock))
    progress = Plain()
    progress.stage("report", 10, is_uniform=False)
    progress.advance(1)
    assert said(capsys.readouterr().err)[-1] == "report: 1/10, 180 s left"
    progress.advance(1)
    assert said(capsys.readouterr().err)[-1] == "report: 2/10, 84 s left"


def test_a_stage_of_nothing_is_no_division_by_zero(capsys: pytest.CaptureFixture[str]) -> None:
    for progress in (Plain(), Progress(), Bar()):
        go_through(progress, 0)
    assert "runs: 0" in capsys.readouterr().err


def test_quiet_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    go_through(choose(quiet=True))
    assert capsys.readouterr() == ("", "")


class Terminal(io.StringIO):
    """A standard error that is a terminal."""

    def isatty(self) -> bool:
        return True


def test_a_bar_is_for_terminals_and_not_for_continuous_integration(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CI", raising=False)
    monkeypatch.setattr(sys, "stderr", Terminal())
    assert isinstance(choose(quiet=False), Bar)
    monkeypatch.setenv("CI", "true")
    assert isinstance(choose(quiet=False), Plain)
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    monkeypatch.delenv("CI")
    assert isinstance(choose(quiet=False), Plain)


def test_a_note_on_a_terminal_is_said_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    progress = Bar()
    progress.stage("runs", 4)
    progress.note("run 3 [diverged]")  # brackets are no markup
    progress.close()
    assert "run 3 [diverged]" in sys.stderr.getvalue()  # type: ignore[attr-defined]


def test_the_page_is_a_stage_of_its_own_that_ends_whatever_happens(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_stage(Plain(), "report"):
        assert said(capsys.readouterr().err) == ["report: 1"]
    assert said(capsys.readouterr().err) == ["report: 1/1, 0 s left"]
    with progress_stage(None, "report") as step:
        step()
    with pytest.raises(OSError, match="full"), progress_stage(Plain(), "report"):
        raise OSError("full")
    assert said(capsys.readouterr().err) == ["report: 1"]
    with progress_stage(Plain(), "report", 3) as step:
        step()
        step()
        assert "report: 2/3" in capsys.readouterr().err


class Heard(Progress):
    """What a run says."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def note(self, line: str) -> None:
        self.lines.append(line)


@pytest.mark.parametrize("filled", [False, True])
def test_a_first_run_says_what_is_compiled_and_how_long_that_takes(study, fakes, monkeypatch, filled: bool) -> None:
    watch = Heard()
    monkeypatch.setattr(execute, "is_filled", lambda: filled)
    conduct = RunOptions(jobs=1, progress=watch)
    execute.run(load(study.path), Path("results"), conduct, engine=fakes.Fake().engine(), store=fakes.store(None))
    assert [line for line in watch.lines if "usually takes" in line] == ([] if filled else [execute.COMPILING])
