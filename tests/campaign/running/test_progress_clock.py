"""A line of a log has the time of day before it; on a terminal it has not."""

from __future__ import annotations

import io
import re
import sys

import pytest

from lvnav_trade.campaign.running.progress import stamped_line


class Terminal(io.StringIO):
    """A standard error that is a terminal."""

    def isatty(self) -> bool:
        return True


def test_a_line_of_a_log_begins_with_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    assert re.fullmatch(r"[0-2][0-9]:[0-5][0-9]:[0-5][0-9] runs: 40", stamped_line("runs: 40"))


def test_a_line_on_a_terminal_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    assert stamped_line("runs: 40") == "runs: 40"
