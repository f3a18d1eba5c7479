"""Numbers written as text in files and settings: decimal ASCII digits only.

Python's `float` and `int` also accept ``1_000`` and the digits of other scripts, which no instrument writes.
"""

import math

DECIMAL = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
"""Pattern of a number."""


def is_plain(text: str) -> bool:
    """Return whether a text has neither separators nor characters outside ASCII."""
    return text.isascii() and "_" not in text


def decimal(text: str) -> float:
    """Return the number in a text, which may have blanks around it; ValueError if it is not a finite number."""
    value = decimal_or_endless(text)
    if not math.isfinite(value):
        raise ValueError(f"{text.strip()} is not a finite number")
    return value


def decimal_or_endless(text: str) -> float:
    """Return the number in a text, as `decimal`, but accept nan and inf, which the caller reports."""
    if not is_plain(text):
        raise ValueError("not a decimal number")
    return float(text)


def whole(text: str) -> int:
    """Return the integer in a text, which may have blanks around it; ValueError if it is none."""
    if not is_plain(text):
        raise ValueError("not a decimal number")
    return int(text)
