"""Closed, full and cut-off streams: no traceback, and an exit code of an answer only from an answer."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROBE = """\
import os, sys
from lvnav_trade.cli import console

@console.verb("", with_json=False)
def probe(code: int) -> console.VerbResult:
    sys.stderr.write("progress\\n")
    for _ in range(2000):
        print("a line of the answer, long enough to fill the buffer of a pipe sooner or later")
    sys.stdout.flush()
    with open("file", "w") as file:  # gets the lowest number that is free
        assert file.fileno() > 2, file.fileno()
        os.system("echo of a worker; echo of a worker >&2")
    if code < 0:
        raise {-1: EOFError, -2: BrokenPipeError(32, "Broken pipe"), -3: KeyboardInterrupt}[code]
    return console.VerbResult("the last line", code=code)

console.main()
"""


def probe(shell: str, code: int, folder: Path, *more: str) -> subprocess.CompletedProcess[str]:
    """Call a verb that answers with an exit code, its streams as the shell says."""
    python = [sys.executable, "-c", PROBE, "probe", *more, "--", str(code)]
    found = subprocess.run(
        ["bash", "-o", "pipefail", "-c", f'"$@" {shell}; echo $? > code', "bash", *python],
        cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    found.returncode = int((folder / "code").read_text())
    return found


@pytest.mark.parametrize("code", [0, 1, 3])
@pytest.mark.parametrize("shell", [">&-", "2>&-", ">&- 2>&- <&-", "2>/dev/full", "| head -c 1"])
def test_the_answer_is_given_by_its_exit_code_where_nobody_reads_it(tmp_path: Path, shell: str, code: int) -> None:
    found = probe(shell, code, tmp_path)
    assert found.returncode == code
    assert "Traceback" not in found.stderr
    assert "Exception ignored" not in found.stderr
    assert (tmp_path / "file").read_text() == ""


@pytest.mark.parametrize("code", [0, 1, 2, 3, 4])
def test_an_answer_that_could_not_be_written_is_none(tmp_path: Path, code: int) -> None:
    found = probe(">/dev/full", code, tmp_path)
    assert found.returncode == {2: 2}.get(code, 4)
    lines = [line for line in found.stderr.splitlines() if "of a worker" not in line]
    assert lines == ["progress", "standard output: No space left on device; not all of it was written"]


@pytest.mark.parametrize(("way", "code"), [(-1, 5), (-2, 2), (-3, 130)])
@pytest.mark.parametrize("more", [(), ("--debug",)])
def test_no_error_ends_in_the_exit_code_of_an_answer(tmp_path: Path, way: int, code: int, more: tuple[str]) -> None:
    expected = 5 if more and code == 2 else code
    for shell in ("", ">&- 2>&-"):
        assert probe(shell, way, tmp_path, *more).returncode == expected


def test_a_character_that_the_stream_lacks_is_written_by_its_number(tmp_path: Path) -> None:
    code = "from lvnav_trade.cli.streams import guard; guard(); print('\\u2212 1')"
    environment = {**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONPATH": str(ROOT)}
    found = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert found.stdout == "\\u2212 1\n"
