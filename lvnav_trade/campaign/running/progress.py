"""Progress on standard error: a bar with the time left on a terminal, plain lines elsewhere, nothing when quiet."""

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich import console, progress

from lvnav_trade.campaign.running.clock import stamped
from lvnav_trade.errors import visible


class Progress:
    """What execution reports to whoever watches; this one says nothing."""

    def stage(self, name: str, total: int, alike: bool = True) -> None:
        """Begin a stage of `total` work items; alike: all take as long, but for the first, which may compile."""

    def advance(self, count: int) -> None:
        """Count work items as done."""

    def note(self, line: str) -> None:
        """Say one line at once, such as a run that failed."""

    def close(self) -> None:
        """End, whatever happened."""


class Plain(Progress):
    """One line per tenth of a stage, for logs."""

    def stage(self, name: str, total: int, alike: bool = True) -> None:
        """Begin a stage and say so."""
        self.start = self.begun = time.monotonic()
        self.name, self.total, self.done, self.tenth, self.first, self.apart = name, total, 0, 0, 0, alike
        self.note(f"{name}: {total}")

    def advance(self, count: int) -> None:
        """Count, and say every tenth with the time left."""
        if self.apart:  # it compiled or loaded kernels: the time left is that of those after it
            self.first, self.begun, self.apart = count, time.monotonic(), False
        self.done += count
        tenth = 10 * self.done // max(self.total, 1)
        if tenth > self.tenth:
            self.tenth = tenth
            later = self.done - self.first
            spent, units = (time.monotonic() - self.begun, later) if later else (self.begun - self.start, self.first)
            left = spent * (self.total - self.done) / max(units, 1)
            self.note(f"{self.name}: {self.done}/{self.total}, {left:.0f} s left")

    def note(self, line: str) -> None:
        """Say a line."""
        sys.stderr.write(f"{stamped(visible(line))}\n")
        sys.stderr.flush()


class Bar(Progress):
    """A bar for terminals."""

    def __init__(self) -> None:
        self.bar = progress.Progress(
            progress.TextColumn("{task.description}"),
            progress.BarColumn(),
            progress.MofNCompleteColumn(),
            progress.TimeRemainingColumn(),
            console=console.Console(stderr=True),
            transient=True,
        )

    def stage(self, name: str, total: int, alike: bool = True) -> None:
        """Show a new bar."""
        self.bar.start()
        for task in self.bar.task_ids:
            self.bar.remove_task(task)
        self.bar.add_task(name, total=total)

    def advance(self, count: int) -> None:
        """Move the bar."""
        for task in self.bar.task_ids:
            self.bar.advance(task, count)

    def note(self, line: str) -> None:
        """Say a line above the bar."""
        self.bar.console.print(visible(line), highlight=False, markup=False)

    def close(self) -> None:
        """Take the bar away."""
        self.bar.stop()


@contextmanager
def staged(watch: Progress | None, name: str, total: int = 1) -> Iterator[Callable[[], None]]:
    """Tell of work that is a stage of its own while it is done; what it yields counts a step, the end is one too.

    Its steps are unlike each other: the time left is estimated from all of them, the first too.
    """
    if watch is None:
        yield lambda: None
        return
    watch.stage(name, total, alike=False)
    try:
        yield lambda: watch.advance(1)
        watch.advance(1)
    finally:
        watch.close()


def choose(quiet: bool) -> Progress:
    """Return what suits where the messages go."""
    return Progress() if quiet else Bar() if sys.stderr.isatty() and not os.environ.get("CI") else Plain()
