"""Standard streams that are closed, full or cut off: work continues, and lost output is reported at the end."""

import errno
import os
import sys
from collections.abc import Callable
from typing import Any, TextIO, cast

from lvnav_trade.quantities.errors import visible


class Stream:
    """A text stream that discards output after the first failed write, and stores the error.

    refused : Error of the first failed write; None if there was none.
    """

    def __init__(self, stream: TextIO, hides: bool = False) -> None:
        """With `hides`, hidden characters are written unchanged, as a progress bar needs them."""
        self._stream, self._hides = stream, hides
        self.refused: OSError | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write a text, or discard it after a failed write; return its length."""
        self._attempt(self._stream.write, text if self._hides else visible(text))
        return len(text)

    def flush(self) -> None:
        """Flush the buffer."""
        self._attempt(self._stream.flush)

    def _attempt(self, call: Callable[..., object], *text: str) -> None:
        """Call a function of the stream; after an OSError redirect the stream to the null device.

        Otherwise Python would report the unwritten buffer when it exits.
        """
        if self.refused is None:
            try:
                call(*text)
            except OSError as error:
                self.refused = error
                null = os.open(os.devnull, os.O_WRONLY)
                os.dup2(null, self._stream.fileno())
                os.close(null)


def guard() -> Stream:
    """Replace standard output and standard error by `Stream` objects; return that of standard output.

    A closed stream is redirected to the null device, also for worker processes. Otherwise the next file that is opened
    gets its descriptor, and printed text would be written into that file.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            null = os.open(os.devnull, os.O_RDWR)
            os.dup2(null, number)
            if null != number:
                os.close(null)
    out = Stream(sys.stdout or open(os.devnull, "w"))  # noqa: SIM115
    err = Stream(sys.stderr or open(os.devnull, "w"), hides=True)  # noqa: SIM115
    for stream in (out, err):
        stream.reconfigure(errors="backslashreplace")  # for characters that the encoding of the stream lacks
    sys.stdout, sys.stderr = cast(TextIO, out), cast(TextIO, err)
    return out


def complaint(stream: Stream) -> str:
    """Return a line on why standard output could not be written.

    Empty if it was written, or if its reader closed the pipe (EPIPE).
    """
    stream.flush()
    if stream.refused is None or stream.refused.errno == errno.EPIPE:
        return ""
    return f"standard output: {os.strerror(stream.refused.errno or 0)}; not all of it was written"
