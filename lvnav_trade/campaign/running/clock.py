"""Time of day before the lines of a log."""

import sys
import time


def stamped(line: str) -> str:
    """Return a line for standard error: with the time of day (local) before it where that is no terminal."""
    return line if sys.stderr.isatty() else f"{time.strftime('%H:%M:%S')} {line}"
