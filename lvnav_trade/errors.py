"""Input errors: one line with the place and the remedy."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple, TypeGuard

from lvnav_trade.limits import MESSAGE_LENGTH, MESSAGES, QUOTED_LENGTH

# Control characters but for tabs and line breaks, and those that change the direction of what follows
HIDDEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ufeff]")
# Within an address: name and password, to its last @ (a secret may have a slash), and what a query signs
_USER, _QUERY = re.compile(r"(?<=://)[^\s'\"]*@"), re.compile(r"(://[^\s'\"?#]*)[?#][^\s'\"]*")


def visible(text: str) -> str:
    """Return the text with hidden characters written as their escape sequences; lines and tabs stay."""
    return HIDDEN.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def without_credentials(text: str) -> str:
    """Return the text with the user, password, query and fragment of every address in it replaced by asterisks."""
    return _QUERY.sub(r"\1?***", _USER.sub("***@", text)) if "://" in text else text


def credentials(address: str) -> list[str]:
    """Return the parts of an address that are secret, the longest first: other programs quote them in messages."""
    found = [
        part
        for text in (*_USER.findall(address), *(one.partition("?")[2] for one in address.split()))
        if text
        for part in (text.rstrip("@"), *re.split("[:&=]", text.rstrip("@")))
    ]
    return sorted({part for part in found if len(part) > 3}, key=len, reverse=True)


def printable(text: str) -> str:
    """Return the text in one line and without control characters: each is written as its escape sequence."""
    return "".join(one if one.isprintable() else one.encode("unicode_escape").decode() for one in text)


def shortened(text: str, most: int) -> str:
    """Return the text with its middle left out where it is longer than `most` characters."""
    return text if len(text) <= most else f"{text[: most - 20]} ... {text[-15:]}"


def quoted(value: object) -> str:
    """Return a value of the user in quotes as a message repeats it, in a bounded number of characters."""
    if isinstance(value, str):
        return repr(shortened(value, QUOTED_LENGTH))
    if isinstance(value, dict | list | tuple):
        return "a mapping" if isinstance(value, dict) else "a list"
    if isinstance(value, int) and abs(value) >= 10**QUOTED_LENGTH:
        return "a number of too many digits"
    return shortened(repr(value), QUOTED_LENGTH)


class Mistake(NamedTuple):
    """One thing to mend: file, line and column (from 1; 0 where there is none), dotted path of the field, message."""

    message: str
    path: str = ""
    file: str = ""
    line: int = 0
    column: int = 0

    def cleaned(self) -> Mistake:
        """Return the same fit to be printed: each part in one bounded line without control characters and passwords."""
        message, path = (shortened(printable(without_credentials(text)), MESSAGE_LENGTH) for text in self[:2])
        return self._replace(message=message, path=path, file=printable(without_credentials(self.file)))

    def __str__(self) -> str:
        where = f"{self.file}:{self.line}:{self.column}" if self.line else self.file
        return ": ".join(part for part in (where, self.path, self.message) if part)


def is_full_disk(error: BaseException) -> TypeGuard[OSError]:
    """Whether the error means that no more can be written: no mistake, and the work resumes once there is space."""
    return isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)


def system_message(error: OSError, place: object = "") -> str:
    """Return in one line what the operating system refused and what to do; `place` where it names no file."""
    said = os.strerror(error.errno) if error.errno else str(error)
    mended = "there is space" if is_full_disk(error) else "that is mended"
    return f"{error.filename or place}: {said}; the same command resumes once {mended}".removeprefix(": ")


class InputError(Exception):
    """Bad usage or bad input; the command line prints one line per mistake and leaves with exit code 2.

    Attributes
    ----------
    records : tuple of Mistake
        The same as data, for ``--json``.
    """

    def __init__(self, message: str = "", records: Sequence[Mistake] = ()) -> None:
        found = list(records) or [Mistake(message)]
        more = len(found) - MESSAGES
        if more > 1:
            found = [*found[:MESSAGES], Mistake(f"and {more} more")]
        self.records = tuple(record.cleaned() for record in found)
        super().__init__("\n".join(str(record) for record in self.records))

    def __reduce__(self) -> tuple[type[InputError], tuple[str, tuple[Mistake, ...]]]:
        return type(self), ("", self.records)  # worker processes hand it back whole


def refuse_all(mistakes: Sequence[Mistake]) -> None:
    """Raise the InputError of these mistakes, where there are any."""
    if mistakes:
        raise InputError(records=mistakes)


@contextmanager
def writing(place: object, refused: str, resumes: bool = False) -> Iterator[None]:
    """Raise InputError where the operating system refuses what is done within; `refused` says what that was.

    resumes : let a full disk through: the same command goes on once there is space
    """
    try:
        yield
    except OSError as error:
        if resumes and is_full_disk(error):
            raise
        raise InputError(f"{place}: {refused}: {error.strerror or error}") from error
