"""Input files: regular files of bounded size; a device, a pipe or a file that is too large is refused in one line.

Whatever reads a file of the user opens it here, so that no reader waits for a pipe or fills the memory.
"""

import codecs
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from lvnav_trade.errors import InputError, quoted

_ENCODINGS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
_ELSE = "cp1252"  # of text that is not UTF-8: spreadsheets on Windows write it; numbers are ASCII in either
_BINARY = frozenset(range(32)) - frozenset(b"\t\n\v\f\r\x1a\x1b")  # control characters that no text has


def open_regular(path: str | Path, most: int) -> BinaryIO:
    """Return a regular file of at most `most` bytes, open for reading; the caller closes it.

    Raises
    ------
    InputError
        No such file, not a regular file, larger than `most`, or not readable.
    """
    try:
        # without blocking: a pipe that nobody writes to would wait for ever
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except (OSError, ValueError) as error:
        raise InputError(f"{_shown(path)}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    state = os.fstat(handle)
    if not stat.S_ISREG(state.st_mode):
        os.close(handle)
        raise InputError(f"{_shown(path)}: is not a regular file")
    if state.st_size > most:
        os.close(handle)
        raise InputError(f"{_shown(path)}: {state.st_size} bytes; at most {most} are read")
    return os.fdopen(handle, "rb")


def read_bytes(path: str | Path, most: int) -> bytes:
    """Return the content of a regular file of at most `most` bytes; InputError as of `open_regular`."""
    with open_regular(path, most) as file:
        try:
            data = file.read(most + 1)
        except OSError as error:
            raise InputError(f"{_shown(path)}: cannot be read: {error.strerror}") from None
    if len(data) > most:
        raise InputError(f"{_shown(path)}: more than {most} bytes")
    return data


def refuse_irregular(folder: Path, below: str = "parts") -> None:
    """InputError where a folder, or anything in its folder `below`, has a pipe, a socket or a device among its files.

    For folders of results, whose files libraries open by their names: one of those would be waited for.
    """
    try:
        with os.scandir(folder) as found:
            entries = sorted(found, key=lambda entry: entry.name)
    except OSError:
        return  # whoever opens a file in it says why that cannot be
    for entry in entries:
        if entry.is_dir():
            if not entry.is_symlink() and below in (entry.name, "*"):
                refuse_irregular(folder / entry.name, "*")
        elif not entry.is_file() and os.path.exists(entry.path):
            raise InputError(f"{_shown(entry.path)}: is not a regular file")


def read_text(path: str | Path, most: int) -> str:
    """Return the content of a text file of at most `most` bytes: UTF-8, UTF-16 with its mark, else Windows-1252.

    InputError as of `open_regular`, and where the file is not text.
    """
    data = read_bytes(path, most)
    marked = next((name for mark, name in _ENCODINGS.items() if data.startswith(mark)), "")
    for encoding in [marked] if marked else ["utf-8", _ELSE]:
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if _BINARY.isdisjoint(text.encode("ascii", "ignore")):
            return text
        break
    unmarked = len(data) > 1 and (data[0] == 0) != (data[1] == 0)  # every other byte of its ASCII is zero
    hint = " (UTF-16 without a mark of its byte order? save it as UTF-8)" if unmarked else ""
    raise InputError(f"{_shown(path)}: is not a text file{hint}")


def text_lines(path: str | Path, most: int) -> Iterator[tuple[int, str]]:
    """Yield the numbered lines of a text file of at most `most` bytes that say something; # begins a comment line.

    InputError as of `read_text`.
    """
    for number, line in enumerate(read_text(path, most).splitlines(), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield number, line


def _shown(path: str | Path) -> str:
    """Return a path as a message repeats it: whole, unless it is too long to be one."""
    text = str(path)
    return text if len(text) <= 255 else quoted(text)
