"""Standard streams that are closed, full or cut off: work continues, and lost output is reported at the end."""

import errno
import os
import sys
from collections.abc import Callable
from typing import Any, TextIO, cast

from lvnav_trade.quantities.errors import visible_text


class Stream:
    """A text stream that discards output after the first failed write, and stores the error.

    write_error : Error of the first failed write; None if there was none.
    """

    def __init__(self, stream: TextIO, is_raw: bool = False) -> None:
        """With `is_raw`, hidden characters are written unchanged, as a progress bar needs them."""
        self._stream, self._is_raw = stream, is_raw
        self.write_error: OSError | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write a text, or discard it after a failed write; return its length."""
        self._attempt(self._stream.write, text if self._is_raw else visible_text(text))
        return len(text)

    def flush(self) -> None:
        """Flush the buffer."""
        self._attempt(self._stream.flush)

    def _attempt(self, call: Callable[..., object], *text: str) -> None:
        """Call a function of the stream; after an OSError redirect the stream to the null device.

        Otherwise Python would report the unwritten buffer when it exits.
        """
        if self.write_error is None:
            try:
                call(*text)
            except OSError as error:
                self.write_error = error
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
    output_stream = Stream(sys.stdout or open(os.devnull, "w"))  # noqa: SIM115
    error_stream = Stream(sys.stderr or open(os.devnull, "w"), is_raw=True)  # noqa: SIM115
    for stream in (output_stream, error_stream):
        stream.reconfigure(errors="backslashreplace")  # for characters that the encoding of the stream lacks
    sys.stdout, sys.stderr = cast(TextIO, output_stream), cast(TextIO, error_stream)
    return output_stream


def output_error_text(stream: Stream) -> str:
    """Return a line on why standard output could not be written.

    Empty if it was written, or if its reader closed the pipe (EPIPE).
    """
    stream.flush()
    if stream.write_error is None or stream.write_error.errno == errno.EPIPE:
        return ""
    return f"standard output: {os.strerror(stream.write_error.errno or 0)}; not all of it was written"
