"""Reading of input files: regular files of limited size, numbers of ASCII digits.

Every reader of user files opens them here, so that none waits for a pipe or exhausts the memory.

Python's `float` and `int` also accept ``1_000`` and the digits of other scripts, which no instrument writes.
"""

import codecs
import math
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from lvnav_trade.quantities.errors import InputError, quoted

_ENCODINGS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
_ELSE = "cp1252"  # encoding of text that is not UTF-8, as written by spreadsheets on Windows; numbers are ASCII in both
_BINARY = frozenset(range(32)) - frozenset(b"\t\n\v\f\r\x1a\x1b")  # control characters that do not occur in text


def open_regular(path: str | Path, max_bytes: int) -> BinaryIO:
    """Return a regular file of at most `max_bytes` bytes, open for reading; the caller closes it.

    Raises
    ------
    InputError
        No such file, not a regular file, larger than `max_bytes`, or not readable.
    """
    try:
        # non-blocking: opening a pipe without a writer would wait forever
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except (OSError, ValueError) as error:
        raise InputError(f"{_path_text(path)}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    state = os.fstat(handle)
    if not stat.S_ISREG(state.st_mode):
        os.close(handle)
        raise InputError(f"{_path_text(path)}: is not a regular file")
    if state.st_size > max_bytes:
        os.close(handle)
        raise InputError(f"{_path_text(path)}: {state.st_size} bytes; at most {max_bytes} are read")
    return os.fdopen(handle, "rb")


def read_bytes(path: str | Path, max_bytes: int) -> bytes:
    """Return the content of a regular file of at most `max_bytes` bytes; InputError as of `open_regular`."""
    with open_regular(path, max_bytes) as file:
        try:
            data = file.read(max_bytes + 1)
        except OSError as error:
            raise InputError(f"{_path_text(path)}: cannot be read: {error.strerror}") from None
    if len(data) > max_bytes:
        raise InputError(f"{_path_text(path)}: more than {max_bytes} bytes")
    return data


def refuse_irregular(folder: Path, subfolder: str = "parts") -> None:
    """Raise InputError if a folder, or its subfolder `subfolder`, contains a pipe, a socket or a device.

    For folders of results, whose files libraries open by name: opening one of these would wait forever.
    """
    try:
        with os.scandir(folder) as scan:
            entries = sorted(scan, key=lambda entry: entry.name)
    except OSError:
        return  # the reader of a file in it reports the error
    for entry in entries:
        if entry.is_dir():
            if not entry.is_symlink() and subfolder in (entry.name, "*"):
                refuse_irregular(folder / entry.name, "*")
        elif not entry.is_file() and os.path.exists(entry.path):
            raise InputError(f"{_path_text(entry.path)}: is not a regular file")


def read_text(path: str | Path, max_bytes: int) -> str:
    """Return the content of a text file of at most `max_bytes` bytes.

    The encoding is UTF-8, UTF-16 with a byte-order mark, or Windows-1252. InputError as in `open_regular`, and if the
    file is not text.
    """
    data = read_bytes(path, max_bytes)
    encodings = [name for mark, name in _ENCODINGS.items() if data.startswith(mark)][:1]
    for encoding in encodings or ["utf-8", _ELSE]:
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if _BINARY.isdisjoint(text.encode("ascii", "ignore")):
            return text
        break
    is_unmarked = len(data) > 1 and (data[0] == 0) != (data[1] == 0)  # every other byte of its ASCII is zero
    hint = " (UTF-16 without a mark of its byte order? save it as UTF-8)" if is_unmarked else ""
    raise InputError(f"{_path_text(path)}: is not a text file{hint}")


def text_lines(path: str | Path, max_bytes: int) -> Iterator[tuple[int, str]]:
    """Yield the numbered lines of a text file of at most `max_bytes` bytes, without empty lines and comments (#).

    InputError as in `read_text`.
    """
    lines = read_text(path, max_bytes).splitlines()
    for number, line in enumerate(lines, start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield number, line


def _path_text(path: str | Path) -> str:
    """Return a path as messages print it: whole, unless it is too long for a path."""
    text = str(path)
    return text if len(text) <= 255 else quoted(text)


DECIMAL = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
"""Pattern of a number."""


def is_plain(text: str) -> bool:
    """Return whether a text has neither separators nor characters outside ASCII."""
    return text.isascii() and "_" not in text


def decimal(text: str) -> float:
    """Return the number in a text, which may have blanks around it; ValueError if it is not a finite number."""
    value = decimal_or_endless(text)
    if not math.isfinite(value):
        raise ValueError(f"{text.strip()} is not a finite number")
    return value


def decimal_or_endless(text: str) -> float:
    """Return the number in a text, as `decimal`, but accept nan and inf, which the caller reports."""
    if not is_plain(text):
        raise ValueError("not a decimal number")
    return float(text)


def integer(text: str) -> int:
    """Return the integer in a text, which may have blanks around it; ValueError if it is none."""
    if not is_plain(text):
        raise ValueError("not a decimal number")
    return int(text)
