"""Input errors: one line with the place and the remedy."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple, TypeGuard

from lvnav_trade.quantities.input_limits import MESSAGE_LENGTH, MESSAGES, QUOTED_LENGTH

# Control characters except tabs and line breaks, and characters that change the direction of the text
HIDDEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ufeff]")
# Within an address: name and password up to the last @ (a secret may contain a slash), and the signed query
_USER, _QUERY = re.compile(r"(?<=://)[^\s'\"]*@"), re.compile(r"(://[^\s'\"?#]*)[?#][^\s'\"]*")


def visible_text(text: str) -> str:
    """Return the text with hidden characters written as their escape sequences; line breaks and tabs stay."""
    return HIDDEN.sub(lambda match: match[0].encode("unicode_escape").decode(), text)


def without_credentials(text: str) -> str:
    """Return the text with the user, password, query and fragment of every address in it replaced by asterisks."""
    if "://" not in text:
        return text
    without_user = _USER.sub("***@", text)
    return _QUERY.sub(r"\1?***", without_user)


def credentials(address: str) -> list[str]:
    """Return the secret parts of an address, longest first.

    Other programs quote them in their messages, from which they are then removed.
    """
    users = [user.rstrip("@") for user in _USER.findall(address)]
    queries = [word.partition("?")[2].rstrip("@") for word in address.split()]
    secrets = set()
    for text in (*users, *queries):
        secrets.add(text)
        secrets.update(re.split("[:&=]", text))
    return sorted((secret for secret in secrets if len(secret) > 3), key=len, reverse=True)


def printable_text(text: str) -> str:
    """Return the text on one line, with control characters written as their escape sequences."""
    return "".join(char if char.isprintable() else char.encode("unicode_escape").decode() for char in text)


def shorten(text: str, max_length: int) -> str:
    """Return the text with its middle replaced by dots if it is longer than `max_length` characters."""
    return text if len(text) <= max_length else f"{text[: max_length - 20]} ... {text[-15:]}"


def quoted(value: object) -> str:
    """Return an input value as messages quote it, in a bounded number of characters."""
    if isinstance(value, str):
        return repr(shorten(value, QUOTED_LENGTH))
    if isinstance(value, dict | list | tuple):
        return "a mapping" if isinstance(value, dict) else "a list"
    if isinstance(value, int) and abs(value) >= 10**QUOTED_LENGTH:
        return "a number of too many digits"
    return shorten(repr(value), QUOTED_LENGTH)


class Mistake(NamedTuple):
    """An input error with its place.

    message : Error and remedy, one line.
    path : Dotted path of the field.
    file : File, as the user named it.
    line, column : Place in the file, from 1; 0 if there is none.
    """

    message: str
    path: str = ""
    file: str = ""
    line: int = 0
    column: int = 0

    def clean(self) -> Mistake:
        """Return the error as it may be printed: bounded lines without control characters and passwords."""
        texts = [printable_text(without_credentials(text)) for text in (self.message, self.path, self.file)]
        message, path, file = texts
        return self._replace(
            message=shorten(message, MESSAGE_LENGTH),
            path=shorten(path, MESSAGE_LENGTH),
            file=file,
        )

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}:{self.column}" if self.line else self.file
        texts = (place, self.path, self.message)
        return ": ".join(text for text in texts if text)


def is_full_disk(error: BaseException) -> TypeGuard[OSError]:
    """Whether a write failed for lack of space. This is no input error: the work resumes once there is space."""
    return isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)


def system_message(error: OSError, place: object = "") -> str:
    """Return the error of the operating system and the remedy on one line.

    place : File or folder to name if the error names none.
    """
    reason = os.strerror(error.errno) if error.errno else str(error)
    remedy = "there is space" if is_full_disk(error) else "that is mended"
    return f"{error.filename or place}: {reason}; the same command resumes once {remedy}".removeprefix(": ")


class InputError(Exception):
    """Bad usage or bad input. The command line prints one line per error and exits with code 2.

    Attributes
    ----------
    records : tuple of Mistake
        The errors with their places, for ``--json``.
    """

    def __init__(self, message: str = "", records: Sequence[Mistake] = ()) -> None:
        mistakes = list(records) or [Mistake(message)]
        surplus = len(mistakes) - MESSAGES
        if surplus > 1:
            remark = Mistake(f"and {surplus} more")
            mistakes = [*mistakes[:MESSAGES], remark]
        self.records = tuple(record.clean() for record in mistakes)
        super().__init__("\n".join(str(record) for record in self.records))

    def __reduce__(self) -> tuple[type[InputError], tuple[str, tuple[Mistake, ...]]]:
        return type(self), ("", self.records)  # pickled by worker processes: keep the records, not only the text


def refuse_all(mistakes: Sequence[Mistake]) -> None:
    """Raise one InputError with all of these mistakes; do nothing without any."""
    if mistakes:
        raise InputError(records=mistakes)


@contextmanager
def writing(place: object, failure_text: str, resumes: bool = False) -> Iterator[None]:
    """Turn an error of the operating system within the context into an InputError.

    Parameters
    ----------
    place : object
        File or folder, printed first.
    failure_text : str
        The failed action, such as "cannot be written".
    resumes : bool
        Whether to pass on the error of a full disk, after which the same command resumes.
    """
    try:
        yield
    except OSError as error:
        if resumes and is_full_disk(error):
            raise
        raise InputError(f"{place}: {failure_text}: {error.strerror or error}") from error
