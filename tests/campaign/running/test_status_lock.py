"""One process at a time works on a folder of results, and a killed one leaves no lock."""

from __future__ import annotations

import json
import multiprocessing
import os
import platform
import shutil
import signal
import subprocess
import sys
import time
from multiprocessing.synchronize import Event
from pathlib import Path

import pytest
from filelock import FileLock

from lvnav_trade.campaign.running.status import folder_lock, holder
from lvnav_trade.quantities.errors import InputError

REFUSED = """\
import json, sys
from pathlib import Path
from lvnav_trade.campaign.running.status import folder_lock
from lvnav_trade.quantities.errors import InputError
refused = {}
for folder in sys.argv[1:]:
    try:
        with folder_lock(Path(folder)):
            pass
    except InputError as error:
        refused[folder] = str(error)
print(json.dumps(refused))
"""
ROOT = Path(__file__).resolve().parents[3]


def test_two_do_not_share_a_folder_and_two_folders_are_two(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with folder_lock(Path("results")):
        with folder_lock(Path("others")):
            pass
        with (
            pytest.raises(
                InputError,
                match=r"^results: process \d+ on .* these results; wait, or give another folder$",
            ),
            folder_lock(Path("results")),
        ):
            pass


def test_who_holds_the_lock_is_known_to_whoever_asks(tmp_path: Path) -> None:
    assert holder(tmp_path) == holder(tmp_path / "none") == ""
    with folder_lock(tmp_path):
        assert holder(tmp_path) == f"process {os.getpid()} on {platform.node()}"
        assert holder(tmp_path).startswith("process")  # asking takes nothing away
    assert holder(tmp_path) == ""


def test_a_file_system_without_locks_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(37, "No locks available")

    monkeypatch.setattr(FileLock, "acquire", refuse)
    with pytest.raises(InputError, match=r"cannot be locked: No locks available$"), folder_lock(tmp_path):
        pass


def test_the_lock_is_given_back_even_after_an_error(tmp_path: Path) -> None:
    for _ in range(2):
        with pytest.raises(ZeroDivisionError), folder_lock(tmp_path):
            raise ZeroDivisionError


def hold(folder: Path, held: Event) -> None:
    """Lock a folder until this process is killed."""
    with folder_lock(folder):
        held.set()
        time.sleep(600)


def test_a_process_that_is_killed_leaves_no_lock(tmp_path: Path) -> None:
    forks = multiprocessing.get_context("fork")  # a fork need not import the package again
    held = forks.Event()
    process = forks.Process(target=hold, args=(tmp_path, held))
    process.start()
    assert held.wait(60)
    with pytest.raises(InputError, match=rf"process {process.pid} .* is working"), folder_lock(tmp_path):
        pass
    process.kill()
    process.join(600)
    assert process.exitcode == -signal.SIGKILL
    with folder_lock(tmp_path):
        pass


def test_a_folder_that_is_not_there_is_made(tmp_path: Path) -> None:
    with folder_lock(tmp_path / "a" / "b"):
        assert (tmp_path / "a" / "b").is_dir()


@pytest.fixture(scope="module")
def refusals(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Return the messages for a read-only folder and for a folder below it, from a process without root's rights."""
    place = tmp_path_factory.mktemp("closed")
    (place / "results").mkdir(mode=0o500)
    drop = []
    if os.geteuid() == 0:  # root may write anywhere, unless it drops that right
        if shutil.which("setpriv") is None:
            pytest.skip("root may write anywhere")
        drop = ["setpriv", "--bounding-set=-dac_override,-dac_read_search"]
    command = [*drop, sys.executable, "-c", REFUSED, "results", "results/deeper"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    found = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True, check=True)
    refused: dict[str, str] = json.loads(found.stdout)
    return refused


@pytest.mark.parametrize("folder", ["results", "results/deeper"])
def test_a_folder_that_cannot_be_written_is_refused(refusals: dict[str, str], folder: str) -> None:
    assert refusals[folder] == f"{folder}: cannot be written: Permission denied"


def test_a_file_in_place_of_the_folder_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("results").write_text("")
    for folder in ("results", "results/deeper"):
        with pytest.raises(InputError, match=rf"^{folder}: cannot be written: "), folder_lock(Path(folder)):
            pass


def test_a_full_disk_is_no_mistake_of_the_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "touch", full)
    with pytest.raises(OSError, match="No space left"), folder_lock(tmp_path):
        pass


def test_a_file_of_another_tool_is_not_taken_for_a_lock(tmp_path: Path) -> None:
    (tmp_path / ".lock").write_text("mine\n")
    reported = r"\.lock: is no lock of lvnav-trade; move it, or give another folder$"
    with pytest.raises(InputError, match=reported), folder_lock(tmp_path):
        pass
    assert (tmp_path / ".lock").read_text() == "mine\n"


def test_the_name_of_the_machine_stays_no_longer_than_the_lock(tmp_path: Path) -> None:
    with folder_lock(tmp_path):
        assert (tmp_path / ".lock-holder").read_text() == f"{os.getpid()} on {platform.node()}"
    assert not (tmp_path / ".lock-holder").exists()


def test_a_lock_of_an_earlier_version_is_taken(tmp_path: Path) -> None:
    (tmp_path / ".lock").write_text("12 on host")
    with folder_lock(tmp_path):
        assert holder(tmp_path) == f"process {os.getpid()} on {platform.node()}"


@pytest.mark.parametrize("name", [".lock", ".lock-holder"])
def test_neither_a_link_nor_a_pipe_nor_a_file_of_the_user_is_written_to(tmp_path: Path, name: str) -> None:
    """As in a folder that was unpacked from an archive of somebody else."""
    folder, precious = tmp_path / "results", tmp_path / "precious.txt"
    folder.mkdir()
    for make in (
        lambda path: path.symlink_to(precious),
        lambda path: path.symlink_to(tmp_path / "made.txt"),
        lambda path: path.write_text("my notes"),
        lambda path: os.mkfifo(path),
    ):
        precious.write_text("precious")
        make(folder / name)
        with (
            pytest.raises(InputError, match=r"is no lock of lvnav-trade; move it|is not a regular file"),
            folder_lock(folder),
        ):
            pass
        assert precious.read_text() == "precious"
        assert sorted(path.name for path in tmp_path.iterdir()) == ["precious.txt", "results"]
        assert [path.name for path in folder.iterdir()] == [name]
        if not (folder / name).is_symlink() and (folder / name).is_file():
            assert (folder / name).read_text() == "my notes"
        (folder / name).unlink()


def test_the_holder_that_a_killed_process_left_is_replaced(tmp_path: Path) -> None:
    (tmp_path / ".lock-holder").write_text("12 on host")
    with folder_lock(tmp_path):
        assert holder(tmp_path) == f"process {os.getpid()} on {platform.node()}"
