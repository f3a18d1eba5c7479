"""Mutants of texts and files by seed, and what must be true of whatever reads one."""

from __future__ import annotations

import random
import re
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from lvnav_trade.quantities.errors import InputError

LIMIT_S = 60.0  # of processor time, of one mutant
NUMBERS = (
    "0",
    "-1",
    "1e400",
    "nan",
    "inf",
    "-0.0",
    "1e-320",
    "9" * 40,
    "1_000",
    "1,5",
    "",
    " ",
    "1e15",
    "٣",
    "--1",
    "0x1F",
)
TEXTS = (
    "\x00",
    "\x1b[2J",
    "\u202e",
    "é🚀",
    "<script>",
    "../../x",
    "'" * 3,
    "*" * 200,
    "\t",
    "\ufeff",
    "#",
    "&",
    "A" * 5_000,
)


class Outcome(NamedTuple):
    """What became of a mutant. read: it was accepted; message: why not; change: what was changed."""

    read: bool
    message: str
    change: str


def numbers_of(text: str) -> list[re.Match[str]]:
    return list(re.finditer(r"[-+]?\d+(?:\.\d+)?(?:[eEdD][-+]?\d+)?", text))


def mutated(text: str, draw: random.Random) -> tuple[str, str]:
    """Return a text with one to three of its numbers, words, lines or characters changed, and what was done."""
    done = []
    for _ in range(draw.choice((1, 1, 1, 2, 3))):
        lines = text.split("\n")
        at = draw.randrange(len(lines))
        kind = draw.choice(
            ("number", "number", "scale", "word", "line", "repeat", "swap", "character", "cut", "insert")
        )
        found = numbers_of(text)
        if kind in ("number", "scale") and found:
            one = draw.choice(found)
            new = draw.choice(NUMBERS)
            if kind == "scale":
                new = f"{float(one[0].lower().replace('d', 'e')) * draw.choice((-1.0, 1e-9, 1e3, 1e9)):g}"
            text = text[: one.start()] + new + text[one.end() :]
            done.append(f"{one[0]!r} at {one.start()} -> {new!r}")
            continue
        place = draw.randrange(len(text) + 1)
        if kind == "word" and (words := list(re.finditer(r"[A-Za-z_]+", text))):
            one, other = draw.choice(words), draw.choice(words)
            text = text[: one.start()] + other[0] + text[one.end() :]
        elif kind == "line":
            del lines[at]
            text = "\n".join(lines)
        elif kind == "repeat":
            text = "\n".join([*lines[: at + 1], *lines[at : at + 1] * draw.randint(1, 3), *lines[at + 1 :]])
        elif kind == "swap":
            other_at = draw.randrange(len(lines))
            lines[at], lines[other_at] = lines[other_at], lines[at]
            text = "\n".join(lines)
        elif kind == "character":
            text = text[:place] + chr(draw.randrange(32, 127)) + text[place + 1 :]
        elif kind == "cut":
            text = text[:place]
        else:
            text = text[:place] + draw.choice(TEXTS) + text[place:]
        done.append(f"{kind} at {place if kind in ('character', 'cut', 'insert') else at}")
    return text, "; ".join(done)


def flipped(content: bytes, draw: random.Random) -> tuple[bytes, str]:
    """Return bytes that are cut, or have some bits flipped, and what was done."""
    kind = draw.choice(("cut", "flip", "flip", "flip", "empty"))
    if kind == "empty":
        return b"", kind
    at = draw.randrange(len(content))
    if kind == "cut":
        return content[:at], f"cut at {at}"
    found = bytearray(content)
    places = [draw.randrange(len(content)) for _ in range(draw.choice((1, 1, 4)))]
    for place in places:
        found[place] ^= 1 << draw.randrange(8)
    return bytes(found), f"bits flipped at {places}"


@contextmanager
def bounded(seconds: float = LIMIT_S) -> Iterator[None]:
    """Raise TimeoutError after so many seconds of the processor's time."""

    def late(*_: object) -> None:
        raise TimeoutError(f"more than {seconds:g} s")

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def outcome_of(read: Callable[[], Any], change: str) -> Outcome:
    """Read a mutant: it is accepted, or refused in lines that a terminal can show; every other error is a defect."""
    with bounded():
        try:
            read()
        except InputError as error:
            message = str(error)
            lines = message.split("\n")
            assert all(line.strip() and line.isprintable() for line in lines), message
            assert len(lines) <= 101, message[:500]
            assert max(map(len, lines)) < 2_500, message[:500]
            return Outcome(False, message, change)
    return Outcome(True, "", change)
