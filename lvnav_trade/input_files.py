"""Input files: regular files of bounded size; a device, a pipe or a file that is too large is refused in one line."""

import os
import stat
from collections.abc import Iterator
from pathlib import Path

from lvnav_trade.errors import InputError, quoted


def read_bytes(path: str | Path, most: int) -> bytes:
    """Return the content of a regular file of at most `most` bytes.

    Raises
    ------
    InputError
        No such file, not a regular file, larger than `most`, or not readable.
    """
    try:
        # without blocking: a pipe that nobody writes to would wait for ever
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except (OSError, ValueError) as error:
        raise InputError(f"{_shown(path)}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    state = os.fstat(handle)
    if not stat.S_ISREG(state.st_mode):
        os.close(handle)
        raise InputError(f"{_shown(path)}: is not a regular file")
    with os.fdopen(handle, "rb") as file:
        if state.st_size > most:
            raise InputError(f"{_shown(path)}: {state.st_size} bytes; at most {most} are read")
        try:
            data = file.read(most + 1)
        except OSError as error:
            raise InputError(f"{_shown(path)}: cannot be read: {error.strerror}") from None
    if len(data) > most:
        raise InputError(f"{_shown(path)}: more than {most} bytes")
    return data


def text_lines(path: str | Path, most: int) -> Iterator[tuple[int, str]]:
    """Yield the numbered lines of a text file of at most `most` bytes that say something; # begins a comment line.

    InputError as of `read_bytes`, and where the file is not text.
    """
    try:
        text = read_bytes(path, most).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not a text file") from None
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield number, line


def _shown(path: str | Path) -> str:
    """Return a path as a message repeats it: whole, unless it is too long to be one."""
    text = str(path)
    return text if len(text) <= 255 else quoted(text)
