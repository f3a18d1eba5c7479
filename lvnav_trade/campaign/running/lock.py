"""Lock of a folder of results, so that only one process at a time works on it."""

import errno
import os
import platform
import re
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from lvnav_trade.quantities.errors import InputError, writing
from lvnav_trade.quantities.input_files import refuse_irregular
from lvnav_trade.results.tables.files import replace_file

_NAME, _HOLDER = ".lock", ".lock-holder"
_LONGEST = 300
_CONTENT = re.compile(rb"(\d+ on [^\n]*)?")  # earlier versions wrote the holder into the lock itself
# Links are not followed, and opening a pipe does not block
_NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
_GLANCE_S = 0.1  # s, longer than `holder` keeps the lock to test it


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock a folder of results within a ``with`` block; InputError if another process has the lock.

    The operating system releases the lock of a killed process. A second file names the process that has the lock, since
    some systems do not permit reading a locked file. A folder that cannot be written raises an InputError as well.
    """
    with writing(folder, "cannot be written", resumes=True):
        folder.mkdir(parents=True, exist_ok=True)
        refuse_irregular(folder)
        for name in (_NAME, _HOLDER):
            if not _is_own(folder / name):
                raise InputError(f"{folder / name}: is no lock of lvnav-trade; move it, or give another folder")
        (folder / _NAME).touch()
    lock = FileLock(folder / _NAME)
    with writing(folder, "cannot be locked"):
        if not _taken(lock):
            time.sleep(_GLANCE_S)
            if not _taken(lock):
                raise InputError(f"{folder}: {_who(folder)} is working on these results; wait, or give another folder")
    try:
        replace_file(folder / _HOLDER, f"{os.getpid()} on {platform.node()}")
        yield
    finally:
        with suppress(OSError):
            (folder / _HOLDER).unlink(missing_ok=True)  # the name of the machine stays no longer than the lock
        lock.release()


def _is_own(path: Path) -> bool:
    """Whether a file is missing or was written by this tool: no link, no file of the user."""
    try:
        handle = os.open(path, os.O_RDONLY | _NO_LINK)
    except FileNotFoundError:
        return True
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.EMLINK, errno.ENXIO):  # a link; a socket
            return False
        raise
    try:
        is_file = stat.S_ISREG(os.fstat(handle).st_mode)
        return is_file and bool(_CONTENT.fullmatch(os.read(handle, _LONGEST + 1)))
    finally:
        os.close(handle)


def holder(folder: Path) -> str:
    """Return the process that works on a folder of results, such as "process 12 on host"; empty if there is none."""
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
        text = (folder / _HOLDER).read_text(errors="replace")[:200] if _is_own(folder / _HOLDER) else ""
    except OSError:
        text = ""
    return f"process {text}" if text else "another process"
