"""What is read is a regular file of bounded size; whatever else is reported in one line and never waited for."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.input_files import read_bytes, refuse_irregular, text_lines


def test_a_regular_file_is_read_whole(tmp_path: Path) -> None:
    file = tmp_path / "data"
    file.write_bytes(b"abc")
    assert read_bytes(file, 3) == b"abc"


def test_a_file_beyond_the_limit_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "data"
    file.write_bytes(b"abcd")
    with pytest.raises(InputError, match=r"data: 4 bytes; at most 3 are read$"):
        read_bytes(file, 3)


def test_a_pipe_that_nobody_writes_to_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match=r"pipe: is not a regular file$"):
        read_bytes(tmp_path / "pipe", 10)


@pytest.mark.parametrize("name", ["/dev/zero", "/dev/null", "/"])
def test_a_device_and_a_folder_are_refused(name: str) -> None:
    with pytest.raises(InputError, match=r"is not a regular file$"):
        read_bytes(name, 10)


@pytest.mark.parametrize("name", ["missing", "x" * 300, "a\0b"])
def test_a_name_without_a_file_is_reported(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="cannot be read") as caught:
        read_bytes(tmp_path / name, 10)
    assert str(caught.value).isprintable()


def test_lines_that_say_something_come_with_their_numbers(tmp_path: Path) -> None:
    (tmp_path / "data").write_bytes(b"\xef\xbb\xbf# a comment\n\na,b\n  # another\n1,2\r\n")
    assert list(text_lines(tmp_path / "data", 100)) == [(3, "a,b"), (5, "1,2")]
    (tmp_path / "data").write_bytes(b"\x00\x01")
    with pytest.raises(InputError, match="is not a text file"):
        list(text_lines(tmp_path / "data", 100))


@pytest.mark.parametrize("place", [".lock", ".lock-holder", "manifest.json", "runs.parquet", "parts/abc/0.parquet"])
def test_a_pipe_among_results_is_refused_before_anything_opens_it(tmp_path: Path, place: str) -> None:
    (tmp_path / "parts" / "abc").mkdir(parents=True)
    (tmp_path / "other" / "deep").mkdir(parents=True)
    (tmp_path / "kept").symlink_to("nowhere")
    os.mkfifo(tmp_path / "other" / "pipe")  # no file of results
    refuse_irregular(tmp_path)
    os.mkfifo(tmp_path / place)
    with pytest.raises(InputError, match=rf"{place}: is not a regular file$"):
        refuse_irregular(tmp_path)
