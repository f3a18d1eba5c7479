"""Progress on standard error: a bar with the remaining time on a terminal, lines with the time of day elsewhere."""

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich import console, progress

from lvnav_trade.quantities.errors import visible_text


def stamped_line(line: str) -> str:
    """Return a line for standard error, with the local time of day in front if standard error is not a terminal."""
    return line if sys.stderr.isatty() else f"{time.strftime('%H:%M:%S')} {line}"


class Progress:
    """Receiver of the progress of a campaign; this base class shows nothing."""

    def stage(self, name: str, total: int, is_uniform: bool = True) -> None:
        """Begin a stage of `total` work items; `is_uniform`: all take equally long but the first, which may compile."""

    def advance(self, count: int) -> None:
        """Count work items as done."""

    def note(self, line: str) -> None:
        """Print one line immediately, such as a failed run."""

    def close(self) -> None:
        """End the display, after an error as well."""


class Plain(Progress):
    """One line per tenth of a stage, for logs."""

    def stage(self, name: str, total: int, is_uniform: bool = True) -> None:
        """Begin a stage and print its name."""
        self.name = name
        self.total = total
        self.stage_start = self.timing_start = time.monotonic()
        self.done_count = self.tenth = self.first_count = 0
        self.is_first_pending = is_uniform
        self.note(f"{name}: {total}")

    def advance(self, count: int) -> None:
        """Count work items, and print every tenth of the stage with the remaining time."""
        if self.is_first_pending:  # the first item compiles or loads kernels, so it is not part of the estimate
            self.first_count, self.timing_start, self.is_first_pending = count, time.monotonic(), False
        self.done_count += count
        tenth = 10 * self.done_count // max(self.total, 1)
        if tenth > self.tenth:
            self.tenth = tenth
            items = self.done_count - self.first_count
            if items:
                seconds = time.monotonic() - self.timing_start
            else:  # only the first item is done yet
                items = self.first_count
                seconds = self.timing_start - self.stage_start
            remaining_seconds = seconds * (self.total - self.done_count) / max(items, 1)
            self.note(f"{self.name}: {self.done_count}/{self.total}, {remaining_seconds:.0f} s left")

    def note(self, line: str) -> None:
        """Print a line."""
        sys.stderr.write(f"{stamped_line(visible_text(line))}\n")
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

    def stage(self, name: str, total: int, is_uniform: bool = True) -> None:
        """Show a new bar."""
        self.bar.start()
        for task in self.bar.task_ids:
            self.bar.remove_task(task)
        self.bar.add_task(name, total=total)

    def advance(self, count: int) -> None:
        """Advance the bar."""
        for task in self.bar.task_ids:
            self.bar.advance(task, count)

    def note(self, line: str) -> None:
        """Print a line above the bar."""
        self.bar.console.print(visible_text(line), highlight=False, markup=False)

    def close(self) -> None:
        """Remove the bar."""
        self.bar.stop()


@contextmanager
def progress_stage(display: Progress | None, name: str, total: int = 1) -> Iterator[Callable[[], None]]:
    """Report the work within a ``with`` block as one stage.

    The function that it yields counts one step; the end of the block is the last step. The steps take different times,
    so the remaining time is estimated from all of them.

    Parameters
    ----------
    display : Progress or None
        Output of the progress; None for none.
    name : str
        Name of the stage.
    total : int
        Number of steps, including the end of the block.
    """
    if display is None:
        yield lambda: None
        return
    display.stage(name, total, is_uniform=False)
    try:
        yield lambda: display.advance(1)
        display.advance(1)
    finally:
        display.close()


def choose(quiet: bool) -> Progress:
    """Return the display for standard error: none if quiet, a bar on a terminal, lines otherwise."""
    if quiet:
        return Progress()
    is_terminal = sys.stderr.isatty() and not os.environ.get("CI")
    return Bar() if is_terminal else Plain()
