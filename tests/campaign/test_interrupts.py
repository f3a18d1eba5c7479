"""An interrupt is one wherever it arrives, and is not remembered beyond the command that it ends."""

from __future__ import annotations

import signal
from contextlib import suppress

import pytest

from lvnav_trade.campaign.interrupts import attempt, interrupt_handlers, raise_if_interrupted


def test_an_error_without_an_interrupt_among_its_causes_is_none() -> None:
    error = ValueError("a")
    error.__cause__ = TypeError("b")
    error.__cause__.__context__ = error  # a ring ends
    raise_if_interrupted(error)
    raise_if_interrupted()


@pytest.mark.parametrize("link", ["__cause__", "__context__"])
def test_an_interrupt_among_the_causes_is_raised(link: str) -> None:
    error, between = SystemError("a"), ValueError("b")
    setattr(error, link, between)
    setattr(between, link, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        raise_if_interrupted(error)


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_one_that_was_discarded_is_remembered_within_the_command_alone(sent: signal.Signals) -> None:
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background has it ignored
    try:
        with interrupt_handlers():
            with suppress(KeyboardInterrupt):
                signal.raise_signal(sent)
            with pytest.raises(KeyboardInterrupt):
                raise_if_interrupted(ValueError("a"))
        raise_if_interrupted()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def test_an_interrupt_that_is_ignored_stays_so() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interrupt_handlers():
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_an_attempt_ignores_a_failure_but_no_interrupt():
    def fail(error):
        raise error

    interrupted = SystemError("within a kernel")
    interrupted.__cause__ = KeyboardInterrupt()
    attempt(fail, ValueError("no compiler"))
    with pytest.raises(KeyboardInterrupt):
        attempt(fail, interrupted)
