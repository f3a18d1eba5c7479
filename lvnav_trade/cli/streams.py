"""Standard streams that are closed, full or cut off: the work goes on, and lost output is reported at the end."""

import errno
import os
import sys
from collections.abc import Callable
from typing import Any, TextIO, cast

from lvnav_trade.quantities.errors import visible


class Stream:
    """A text stream that takes no more after the first write that the system refuses, and remembers why."""

    def __init__(self, stream: TextIO, hides: bool = False) -> None:
        """hides: hidden characters are written as they are, as a progress bar needs them."""
        self._stream, self._hides = stream, hides
        self.refused: OSError | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write a text, or drop it where the stream takes no more."""
        self._attempt(self._stream.write, text if self._hides else visible(text))
        return len(text)

    def flush(self) -> None:
        """Hand over what is buffered."""
        self._attempt(self._stream.flush)

    def _attempt(self, call: Callable[..., object], *text: str) -> None:
        """Let what is buffered go to the null device after a refusal, or Python would complain of it when it ends."""
        if self.refused is None:
            try:
                call(*text)
            except OSError as error:
                self.refused = error
                null = os.open(os.devnull, os.O_WRONLY)
                os.dup2(null, self._stream.fileno())
                os.close(null)


def guard() -> Stream:
    """Put standard output and standard error behind a `Stream` and return the first.

    A stream that is closed becomes the null device, also for worker processes: its number would else be given to the
    next file that is opened, and what is printed would be written into that.
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
        stream.reconfigure(errors="backslashreplace")  # of a character that the stream's encoding lacks
    sys.stdout, sys.stderr = cast(TextIO, out), cast(TextIO, err)
    return out


def complaint(stream: Stream) -> str:
    """Return in one line why standard output could not be written; empty where it could, or its reader had enough."""
    stream.flush()
    if stream.refused is None or stream.refused.errno == errno.EPIPE:
        return ""
    return f"standard output: {os.strerror(stream.refused.errno or 0)}; not all of it was written"
