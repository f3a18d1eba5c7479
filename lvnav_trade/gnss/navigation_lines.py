"""Lines and numbers of navigation files; every error names file and line."""

import gzip
import io
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from lvnav_trade.quantities.errors import InputError, quoted
from lvnav_trade.quantities.input_files import decimal_or_endless, integer, read_bytes
from lvnav_trade.quantities.input_limits import DATA_BYTES

GZIP_MAGIC = b"\x1f\x8b"
COMPRESS_MAGIC = b"\x1f\x9d"  # files .Z of the older program `compress`


class NumberBounds(NamedTuple):
    """Allowed range of a number.

    low : Smallest number, included.
    high : Largest number, included.
    read : Function that returns the number of a text, or raises ValueError.
    """

    low: float
    high: float
    read: Callable[[str], float] = decimal_or_endless


def number(where: str, text: str, bounds: NumberBounds) -> float:
    """Return the number in a text, also with a Fortran exponent, within its bounds.

    Parameters
    ----------
    where : str
        File and line, for messages.
    text : str
        Text of the number; surrounding blanks are ignored.
    bounds : NumberBounds

    Raises
    ------
    InputError
        The text is no number, or the number is outside the bounds, as nan and inf always are.
    """
    plain_text = text.strip().upper().replace("D", "E")
    try:
        value = bounds.read(plain_text)
    except ValueError:
        number_type = "a whole number" if bounds.read is integer else "a number"
        raise InputError(f"{where}: {quoted(text)} is not {number_type}") from None
    if not bounds.low <= value <= bounds.high:  # also refuses nan and inf
        raise InputError(f"{where}: {text.strip()} is outside {bounds.low:g} to {bounds.high:g}")
    return value


def read_lines(path: str | Path, file_type: str) -> list[str]:
    """Return the lines of a text file, which may be compressed by gzip; `file_type` is the kind of file for messages.

    Characters outside ASCII occur only in names and remarks, so that their encoding does not matter. InputError if the
    file cannot be read, is a truncated gzip file or a .Z file, or is not text.
    """
    data = read_bytes(path, DATA_BYTES)
    try:
        if data.startswith(GZIP_MAGIC):
            data = _unpack(path, data)
    except (EOFError, gzip.BadGzipFile, zlib.error):
        raise InputError(f"{path}: a broken or truncated gzip file") from None
    if data.startswith(COMPRESS_MAGIC):
        raise InputError(f"{path}: packed by 'compress' (.Z); unpack it, or pack it by gzip")
    if b"\0" in data:
        raise InputError(f"{path}:1: not a text file, so not a {file_type}")
    return data.decode("latin-1").splitlines()


def _unpack(path: str | Path, data: bytes) -> bytes:
    """Return the content of a gzip file; InputError if it is larger than `DATA_BYTES`."""
    with gzip.GzipFile(fileobj=io.BytesIO(data)) as archive:
        content = archive.read(DATA_BYTES + 1)
    if len(content) > DATA_BYTES:
        raise InputError(f"{path}: unpacked more than {DATA_BYTES} bytes")
    return content
