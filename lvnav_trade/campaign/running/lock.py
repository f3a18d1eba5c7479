"""One process at a time works on a folder of results."""

import fcntl
import os
import platform
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from lvnav_trade.errors import InputError, writing

_NAME = ".lock"
_LONGEST = 300
_CONTENT = re.compile(rb"(\d+ on [^\n]*)?")
_GLANCE_S = 0.1  # longer than `holder` looks


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder's lock; InputError where another process holds it or the folder cannot be written.

    The lock belongs to the open file, so a killed process leaves none behind.
    """
    with writing(folder, "cannot be written", resumes=True):
        folder.mkdir(parents=True, exist_ok=True)
        handle = (folder / _NAME).open("a+b", buffering=0)
    with handle:
        with writing(folder, "cannot be locked"):
            if not _taken(handle, fcntl.LOCK_EX):
                time.sleep(_GLANCE_S)
                if not _taken(handle, fcntl.LOCK_EX):
                    who = _who(handle)
                    raise InputError(f"{folder}: {who} is working on these results; wait, or give another folder")
        handle.seek(0)
        if not _CONTENT.fullmatch(handle.read(_LONGEST + 1)):
            raise InputError(f"{folder / _NAME}: is no lock of lvnav-trade; move it, or give another folder")
        handle.truncate(0)
        handle.write(f"{os.getpid()} on {platform.node()}".encode())
        try:
            yield
        finally:
            with suppress(OSError):
                handle.truncate(0)  # the name of the machine stays no longer than the lock


def holder(folder: Path) -> str:
    """Return who works on a folder of results, such as "process 12 on host"; empty where nobody does."""
    try:
        with (folder / _NAME).open("rb") as handle:
            return "" if _taken(handle, fcntl.LOCK_SH) else _who(handle)
    except OSError:  # no such file, or a file system without locks: then no campaign runs there
        return ""


def _taken(handle: IO[bytes], kind: int) -> bool:
    try:
        fcntl.flock(handle, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _who(handle: IO[bytes]) -> str:
    handle.seek(0)
    text = handle.read(200).decode(errors="replace")
    return f"process {text}" if text else "another process"
