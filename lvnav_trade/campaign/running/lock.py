"""One process at a time works on a folder of results."""

import os
import platform
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from lvnav_trade.errors import InputError, writing

_NAME, _HOLDER = ".lock", ".lock-holder"
_LONGEST = 300
_CONTENT = re.compile(rb"(\d+ on [^\n]*)?")  # earlier versions wrote the holder into the lock itself
_GLANCE_S = 0.1  # longer than `holder` looks


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder's lock; InputError where another process holds it or the folder cannot be written.

    The operating system gives a killed process's lock back. Who holds it stands in a file beside the lock, for the lock
    itself may not be read on every system while it is held.
    """
    with writing(folder, "cannot be written", resumes=True):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / _NAME).touch()
        with (folder / _NAME).open("rb") as file:
            is_own = bool(_CONTENT.fullmatch(file.read(_LONGEST + 1)))
    if not is_own:
        raise InputError(f"{folder / _NAME}: is no lock of lvnav-trade; move it, or give another folder")
    lock = FileLock(folder / _NAME)
    with writing(folder, "cannot be locked"):
        if not _taken(lock):
            time.sleep(_GLANCE_S)
            if not _taken(lock):
                raise InputError(f"{folder}: {_who(folder)} is working on these results; wait, or give another folder")
    try:
        (folder / _HOLDER).write_text(f"{os.getpid()} on {platform.node()}")
        yield
    finally:
        with suppress(OSError):
            (folder / _HOLDER).unlink(missing_ok=True)  # the name of the machine stays no longer than the lock
        lock.release()


def holder(folder: Path) -> str:
    """Return who works on a folder of results, such as "process 12 on host"; empty where nobody does."""
    if not (folder / _NAME).is_file():
        return ""
    lock = FileLock(folder / _NAME)
    try:
        is_free = _taken(lock)
        lock.release()
    except (OSError, NotImplementedError):  # not ours to lock, or a file system without locks
        return ""
    return "" if is_free else _who(folder)


def _taken(lock: FileLock) -> bool:
    try:
        lock.acquire(timeout=0)
    except Timeout:
        return False
    except NotImplementedError as error:
        raise OSError(38, "the file system has no locks") from error
    return True


def _who(folder: Path) -> str:
    try:
        text = (folder / _HOLDER).read_text(errors="replace")[:200]
    except OSError:
        text = ""
    return f"process {text}" if text else "another process"
