"""Numbers written as text: decimal digits of ASCII, wherever a file or a setting states them.

Python's own `float` and `int` also read ``1_000`` and the digits of other scripts, which no instrument writes.
"""

import math

DECIMAL = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
"""Pattern of a number."""


def is_plain(text: str) -> bool:
    """Return whether a text has neither separators nor letters beyond ASCII; only then Python reads it as written."""
    return text.isascii() and "_" not in text


def decimal(text: str) -> float:
    """Return the number of a text, blanks around it allowed; ValueError where it is none, or not finite."""
    value = decimal_or_endless(text)
    if not math.isfinite(value):
        raise ValueError(f"{text.strip()} is not a finite number")
    return value


def decimal_or_endless(text: str) -> float:
    """Return the same where the caller names what is not finite: nan and inf are read."""
    if not is_plain(text):
        raise ValueError("not a decimal number")
    return float(text)


def whole(text: str) -> int:
    """Return the whole number of a text, blanks around it allowed; ValueError where it is none."""
    if not is_plain(text):
        raise ValueError("not a decimal number")
    return int(text)
