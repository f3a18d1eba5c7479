"""Several worker processes: the same bytes as one, and whatever ends them leaves whole blocks."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

HERE = Path(__file__).parent

SCRIPT = """\
import sys
from pathlib import Path
import fakes
from lvnav_trade.campaign.running import conduct, execute
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running.progress import Plain

what = {"held": fakes.Held("go"), "quick": None, "dies": fakes.Dies(), "once": fakes.DiesOnce("mark")}[sys.argv[2]]
try:
    execute.run(load("campaign.yaml"), Path(sys.argv[3]), conduct.RunOptions(int(sys.argv[1]), progress=Plain()),
                engine=fakes.Fake(on_block=what).engine(), store=fakes.store())
except KeyboardInterrupt:
    sys.exit(130)
except execute.Halted as halted:
    print(halted)
    sys.exit(4)
"""

pytestmark = pytest.mark.slow

HANG = 600.0  # s; a process that has not ended by then never will, however busy the machine is


@pytest.fixture
def start(study):
    """Start a campaign in a process group of its own."""
    study.append("axes: [{path: imu, cards: [imu/good, imu/poor]}]\nmonte_carlo: {runs: 200}\n")
    study.write("go.py", SCRIPT)
    root = HERE.parents[1]
    environment = {**os.environ, "PYTHONPATH": f"{HERE}{os.pathsep}{root}"}

    def go(jobs: int, what: str, folder: str) -> subprocess.Popen[str]:
        command = [sys.executable, "go.py", str(jobs), what, folder]
        return subprocess.Popen(
            command, env=environment, start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )

    return go


def kept(folder: str) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in Path(folder).glob("*.p*")}


def wait_for_parts(folder: str, n: int) -> None:
    end = time.monotonic() + HANG
    while len(list(Path(folder).glob("*.part"))) < n:
        assert time.monotonic() < end, "no blocks were stored"
        time.sleep(0.05)


def is_gone(group: int) -> bool:
    end = time.monotonic() + HANG
    while time.monotonic() < end:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.1)
    return False


def test_two_workers_leave_the_same_bytes_as_one(start) -> None:
    for jobs in (1, 2):
        process = start(jobs, "quick", f"by{jobs}")
        assert process.wait(HANG) == 0, process.stderr.read()
    assert kept("by1") == kept("by2")
    assert Path("by1/finished").read_text() == Path("by2/finished").read_text()


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGKILL, -9)])
def test_a_campaign_that_is_ended_goes_on_and_leaves_the_same_bytes(start, sent: signal.Signals, code: int) -> None:
    assert start(2, "quick", "whole").wait(HANG) == 0
    process = start(2, "held", "ended")
    wait_for_parts("ended", 3)
    os.killpg(process.pid, sent)  # to the whole group, as a terminal does
    _, messages = process.communicate(timeout=HANG)
    assert process.returncode == code
    assert "Traceback" not in messages
    assert is_gone(process.pid)
    assert 3 <= len(list(Path("ended").glob("*.part"))) < 10
    assert start(1, "quick", "ended").wait(HANG) == 0
    assert kept("ended") == kept("whole")


def test_a_worker_that_dies_costs_its_block_and_not_the_campaign(start) -> None:
    assert start(2, "quick", "whole").wait(HANG) == 0
    Path("mark").touch()
    process = start(2, "once", "again")
    _, messages = process.communicate(timeout=HANG)
    assert process.returncode == 0
    reported = "a worker process died (out of memory?); its work is done again by 2 workers"
    assert messages.splitlines().count(reported) == 1
    assert not Path("mark").exists()
    assert kept("again") == kept("whole")


def test_workers_that_die_again_and_again_end_the_campaign_in_one_line(start) -> None:
    process = start(2, "dies", "dead")
    output, _ = process.communicate(timeout=HANG)
    assert process.returncode == 4
    assert output == "a worker process died (out of memory?); the same command resumes, try --jobs 1\n"
    assert is_gone(process.pid)


def test_the_workers_of_a_killed_campaign_end_too(start) -> None:
    process = start(2, "held", "killed")
    wait_for_parts("killed", 3)
    process.kill()  # this process alone, as `kill -9` or the system does
    process.communicate(timeout=HANG)
    assert is_gone(process.pid)


def test_workers_that_never_had_work_end_with_their_killed_campaign_too(start) -> None:
    process = start(4, "held", "idle")
    end = time.monotonic() + HANG
    while not Path("idle/.lock").exists():  # after the only flight was checked, which one of the four did
        assert time.monotonic() < end
        time.sleep(0.02)
    process.kill()
    process.communicate(timeout=HANG)
    assert is_gone(process.pid)


def test_a_second_campaign_in_the_folder_is_refused_and_changes_nothing(start) -> None:
    assert start(2, "quick", "whole").wait(HANG) == 0
    first = start(2, "held", "shared")
    wait_for_parts("shared", 1)
    os.killpg(first.pid, signal.SIGSTOP)
    second = start(1, "quick", "shared")
    _, messages = second.communicate(timeout=HANG)
    os.killpg(first.pid, signal.SIGCONT)
    Path("go").touch()
    assert second.returncode == 1
    assert f"shared: process {first.pid} on " in messages.splitlines()[-1]
    first.communicate(timeout=HANG)
    assert first.returncode == 0
    assert kept("shared") == kept("whole")
