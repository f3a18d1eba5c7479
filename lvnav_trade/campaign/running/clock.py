"""Time of day before the lines of a log."""

import sys
import time


def stamped(line: str) -> str:
    """Return a line for standard error, with the local time of day in front if standard error is not a terminal."""
    return line if sys.stderr.isatty() else f"{time.strftime('%H:%M:%S')} {line}"
