"""One process at a time works on a folder of results."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lvnav_trade.errors import InputError, is_full_disk


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder's lock; InputError where another process holds it or the folder cannot be written.

    The lock belongs to the open file, so a killed process leaves none behind.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = (folder / ".lock").open("w")
    except OSError as error:
        if is_full_disk(error):
            raise
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from None
    with handle:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(f"{folder}: another process is working on these results") from None
        yield
