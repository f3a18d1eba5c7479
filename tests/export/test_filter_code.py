"""The files of a filter's C, the compiler of the machine, what a replay says."""

from __future__ import annotations

import pytest

from lvnav_trade.api import case_of
from lvnav_trade.export import filter_code as made
from lvnav_trade.quantities.errors import InputError


@pytest.fixture(scope="module")
def smoke():
    return case_of("smoke", [], None)


def test_without_runs_there_is_the_code_alone(smoke):
    found = made.filter_code(*smoke, runs=0, progress=lambda _: None)
    assert set(found.files) == {"nav_filter.h", "nav_filter.c", "README.md"}
    assert found.differences is None
    assert found.agrees
    assert smoke[1].id in str(found.files["nav_filter.h"])


def test_a_compiler_is_that_of_the_environment(monkeypatch):
    monkeypatch.setenv("CC", "no_such_compiler")
    assert made.compiler_of_machine() == ""
    monkeypatch.delenv("CC")
    monkeypatch.setenv("PATH", "")
    assert made.compiler_of_machine() == ""


def test_what_cannot_be_compiled_is_one_line(smoke, monkeypatch, tmp_path):
    broken = tmp_path / "cc"
    broken.write_text("#!/bin/sh\necho 'nav_filter.c:1: error: no' >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("CC", str(broken))
    files = made.filter_code(*smoke, runs=0, progress=lambda _: None).files
    with pytest.raises(InputError, match="could not compile the filter"):
        made._replay(files, str(broken), 0)


def test_a_negative_number_of_runs_is_refused(smoke):
    with pytest.raises(InputError, match="--runs -1: should be 0 or more"):
        made.filter_code(*smoke, runs=-1, progress=lambda _: None)


def test_a_label_is_no_markup_of_the_page_and_no_comment_within_one(smoke):
    campaign, case = smoke
    found = made.filter_code(campaign, case._replace(label="<img src=x> [a](b) `c` */ /* d"), 0, lambda _: None)
    page = str(found.files["README.md"])
    assert "\\<img src=x\\> \\[a\\](b) \\`c\\`" in page
    assert "/* d (" not in str(found.files["nav_filter.h"])
