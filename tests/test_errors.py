"""A mistake is one line for people and a record for programs."""

from __future__ import annotations

import errno
import pickle

import pytest

from lvnav_trade.errors import (
    InputError,
    Mistake,
    is_full_disk,
    printable,
    quoted,
    shortened,
    system_message,
    told_by_system,
)


@pytest.mark.parametrize(
    ("mistake", "line"),
    [
        (Mistake("is missing"), "is missing"),
        (Mistake("is missing", "base.imu"), "base.imu: is missing"),
        (Mistake("no such file", "", "a.yaml"), "a.yaml: no such file"),
        (Mistake("is missing", "base.imu", "a.yaml", 3, 5), "a.yaml:3:5: base.imu: is missing"),
        (Mistake("unknown path", "sead", "--set"), "--set: sead: unknown path"),
    ],
)
def test_a_mistake_says_where_as_far_as_that_is_known(mistake: Mistake, line: str) -> None:
    assert str(mistake) == line


def test_an_error_of_several_mistakes_has_a_line_for_each() -> None:
    error = InputError(records=[Mistake("one", "a"), Mistake("two", "b")])
    assert str(error) == "a: one\nb: two"
    assert [record.path for record in error.records] == ["a", "b"]


def test_an_error_of_one_sentence_has_a_record_too() -> None:
    assert InputError("no results here").records == (Mistake("no results here"),)


def test_an_error_comes_back_whole_from_a_worker_process() -> None:
    error = InputError(records=[Mistake("one", "a", "f.yaml", 1, 2), Mistake("two")])
    again = pickle.loads(pickle.dumps(error))
    assert isinstance(again, InputError)
    assert again.records == error.records
    assert str(again) == str(error)


@pytest.mark.parametrize(("number", "full"), [(errno.ENOSPC, True), (errno.EDQUOT, True), (errno.EACCES, False)])
def test_a_full_disk_is_told_from_other_trouble(number: int, full: bool) -> None:
    assert is_full_disk(OSError(number, "trouble")) is full
    assert not is_full_disk(ValueError("trouble"))


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (OSError(errno.ENOSPC, "long words", "a/b"), "a/b: No space left on device; the same command resumes once"),
        (OSError(errno.EROFS, "long words"), "results: Read-only file system; the same command resumes once that is"),
        (OSError("no number"), "results: no number; the same command resumes once that is mended"),
    ],
)
def test_what_the_system_refused_is_told_with_what_to_do(error: OSError, line: str) -> None:
from lvnav_trade.errors import (
)
