"""Interrupts (Ctrl-C, the end of a batch job) that arrive as another error, or that a library has discarded.

Python raises KeyboardInterrupt wherever the program is. Within compiled code it arrives as a SystemError, and within a
call back from C it is printed and discarded; so the request is remembered too.
"""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

_requested = threading.Event()


@contextmanager
def remembering_interrupts() -> Iterator[None]:
    """Let SIGINT and SIGTERM raise KeyboardInterrupt, and be remembered within the context. Main thread only.

    A SIGINT that is ignored (``nohup``) or has a handler of the caller's own is left as it is.
    """
    signal.signal(signal.SIGTERM, _raise)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _raise)
    try:
        yield
    finally:
        _requested.clear()


def _raise(_number: int, _frame: FrameType | None) -> NoReturn:
    _requested.set()
    raise KeyboardInterrupt


def raise_if_interrupted(error: BaseException | None = None) -> None:
    """Raise KeyboardInterrupt where an interrupt is remembered, or an error has one among its causes."""
    seen: list[BaseException] = []
    cause = error
    while cause is not None and cause not in seen and not isinstance(cause, KeyboardInterrupt):
        seen.append(cause)
        cause = cause.__cause__ or cause.__context__
    if (cause is not None and cause not in seen) or _requested.is_set():
        raise KeyboardInterrupt from error
