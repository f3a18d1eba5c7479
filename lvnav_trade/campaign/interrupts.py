"""Interrupts (Ctrl-C, the end of a batch job) that arrive as another error, or that a library has discarded.

Python raises KeyboardInterrupt wherever the program is. Within compiled code it becomes a SystemError, and within a
callback from C it is printed and discarded. Therefore the request is also stored.
"""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

_interrupt_event = threading.Event()


@contextmanager
def interrupt_handlers() -> Iterator[None]:
    """Make SIGINT and SIGTERM raise KeyboardInterrupt and store the request within the context. Main thread only.

    SIGINT is not changed if it is ignored (``nohup``) or the caller has installed a handler.
    """
    signal.signal(signal.SIGTERM, _raise)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _raise)
    try:
        yield
    finally:
        _interrupt_event.clear()


def _raise(_number: int, _frame: FrameType | None) -> NoReturn:
    _interrupt_event.set()
    raise KeyboardInterrupt


def raise_if_interrupted(error: BaseException | None = None) -> None:
    """Raise KeyboardInterrupt if an interrupt is stored, or is among the causes of an error."""
    is_interrupt = False
    causes: list[BaseException] = []  # a chain of causes may be a loop
    cause = error
    while cause is not None and cause not in causes:
        if isinstance(cause, KeyboardInterrupt):
            is_interrupt = True
            break
        causes.append(cause)
        cause = cause.__cause__ or cause.__context__
    if is_interrupt or _interrupt_event.is_set():
        raise KeyboardInterrupt from error


def attempt(function: Callable[..., object], *arguments: object) -> None:
    """Call a function and ignore its failure, but not an interrupt; for work that is repeated where it is needed."""
    try:
        function(*arguments)
    except Exception as error:
        raise_if_interrupted(error)
