"""Compiled kernels on disk: damage, two processes at once and folders that cannot be written stop nothing."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lvnav_trade.kernels.jit import jit
from tests.kernels.stored import LOADED, run


@jit
def same(a):
    return a


@pytest.fixture
def files(tmp_path: Path) -> Callable[[], Any]:
    """Return a function that opens the files of one kernel as a process does."""
    kind = type(same._cache._cache_file)
    return lambda: kind(str(tmp_path), "kernel", "stamp")


def test_two_processes_that_save_two_versions_at_once_leave_both(files) -> None:
    """The first is stopped after it has read the index; the second would give its version the same file name."""
    first, second = files(), files()
    is_in, go_on, write = threading.Event(), threading.Event(), first._open_for_write

    def stopped(path: str) -> Any:
        is_in.set()
        assert go_on.wait(20.0)
        return write(path)

    first._open_for_write = stopped
    threads = [
        threading.Thread(target=one.save, args=(f"key of {name}", name)) for one, name in ((first, "a"), (second, "b"))
    ]
    threads[0].start()
    assert is_in.wait(20.0)
    threads[1].start()
    threads[1].join(0.3)
    go_on.set()
    for thread in threads:
        thread.join()
    assert [files().load(f"key of {name}") for name in "ab"] == ["a", "b"]


def test_a_file_of_another_version_is_not_taken_for_the_one_that_the_index_names(files, tmp_path: Path) -> None:
    for name in "ab":
        files().save(f"key of {name}", name)
    one, other = sorted(tmp_path.glob("*.nbc"))
    one.write_bytes(other.read_bytes())
    assert files().load("key of a") is None
    assert files().load("key of b") == "b"


def cut(content: bytes) -> bytes:
    return content[: len(content) // 2]


def flipped(content: bytes) -> bytes:
    at = 2 * len(content) // 3
    return content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", [lambda content: b"", cut, flipped], ids=["empty", "cut", "flipped"])
def test_a_damaged_file_counts_as_missing_and_is_replaced(files, tmp_path: Path, ending: str, damage) -> None:
    files().save("key", list(range(100)))
    (path,) = tmp_path.glob(f"*.{ending}")
    path.write_bytes(damage(path.read_bytes()))
    assert files().load("key") is None
    files().save("key", "again")
    assert files().load("key") == "again"


def test_kernels_whose_files_are_damaged_are_compiled_again(tmp_path: Path) -> None:
    place = {"NUMBA_CACHE_DIR": str(tmp_path / "kernels-here")}
    assert run(tmp_path, LOADED, **place).stdout == "3.0 0\n"
    assert run(tmp_path, LOADED, **place).stdout == "3.0 1\n"
    for number, path in enumerate(sorted((tmp_path / "kernels-here").rglob("*.nb?"))):
        path.write_bytes((cut, flipped)[number % 2](path.read_bytes()))
    assert run(tmp_path, LOADED, **place).stdout == "3.0 0\n"
    assert run(tmp_path, LOADED, **place).stdout == "3.0 1\n"


def test_kernels_that_cannot_be_saved_are_used_all_the_same(tmp_path: Path) -> None:
    """As with a disk that is full, or a folder of another user within one's own."""
    found = run(tmp_path, LOADED, NUMBA_CACHE_DIR="/proc/none/kernels-here")
    assert found.stdout == "3.0 0\n"
    (line,) = found.stderr.splitlines()
    assert line.startswith("compiled kernels cannot be stored in /proc/none (No such file or directory); every command")
