"""A mistake is one line for people and a record for programs."""

from __future__ import annotations

import errno
import pickle

import pytest

from lvnav_trade.quantities.errors import (
    InputError,
    Mistake,
    credentials,
    is_full_disk,
    printable_text,
    quoted,
    shorten,
    system_message,
    without_credentials,
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
def test_a_full_disk_is_reported_from_other_trouble(number: int, full: bool) -> None:
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
def test_what_the_system_refused_is_reported_with_what_to_do(error: OSError, line: str) -> None:
    assert system_message(error, "results").startswith(line)


def test_what_a_message_repeats_has_no_control_characters_and_a_bounded_length() -> None:
    given = Mistake("not\x1b[2J\nso" + "x" * 9_000, "a\x1b]0;b\u202e", "f\n.yaml", 3, 5)
    record = InputError(records=[given]).records[0]
    assert str(record).isprintable()
    assert record.path == r"a\x1b]0;b\u202e"
    assert record.file == r"f\n.yaml"
    assert len(record.message) <= 1_000
    assert record.message.startswith(r"not\x1b[2J\nso")


def test_a_text_is_made_printable_letter_by_letter() -> None:
    assert printable_text("9 \u00b5m\t\u2028") == "9 \u00b5m" + r"\t\u2028"


def test_a_long_text_loses_its_middle() -> None:
    assert shorten("short", 60) == "short"
    found = shorten("a" * 100 + "z" * 100, 60)
    assert len(found) <= 60
    assert found.startswith("aaa")
    assert found.endswith("zzz")


@pytest.mark.parametrize(("value", "shown"), [("a\nb", r"'a\nb'"), ({"a": 1}, "a mapping"), ([1], "a list"), (5, "5")])
def test_a_value_is_quoted_in_few_characters(value: object, shown: str) -> None:
    assert quoted(value) == shown


def test_a_number_of_too_many_digits_is_not_written_out() -> None:
    assert quoted(10**5_000) == "a number of too many digits"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("memory://user:SECRET@host/x", "memory://***@host/x"),
        ("s3://KEY:SEC/RE+T@bucket/demo: cannot be reached", "s3://***@bucket/demo: cannot be reached"),
        ("https://h/c?sig=SECRET&x=SECRET#SECRET 'https://SECRET@h/'", "https://h/c?*** 'https://***@h/'"),
        ("s3://bucket/demo and a/b@c?d", "s3://bucket/demo and a/b@c?d"),
    ],
)
def test_the_credentials_of_an_address_are_not_shown(text: str, shown: str) -> None:
    assert without_credentials(text) == shown
    assert str(InputError(text)) == shown


def test_the_secret_parts_of_an_address_are_known_by_themselves() -> None:
    assert credentials("s3://KEYS:SEC/RET@bucket/demo?sig=TOKEN") == [
        "KEYS:SEC/RET",
        "sig=TOKEN",
        "SEC/RET",
        "TOKEN",
        "KEYS",
    ]
    assert credentials("s3://bucket/demo") == []
