"""Mutants of data files, campaigns and results are refused in short lines or read; none is an error of another kind."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.fuzzing import data_files, results
from tests.fuzzing.__main__ import main


def test_mutants_of_data_files_are_refused_or_read(tmp_path: Path) -> None:
    found = [data_files.try_one(seed, tmp_path) for seed in range(200)]
    assert {one.read for one in found} == {True, False}


def test_mutants_of_results_are_refused_or_read(tmp_path: Path) -> None:
    found = [results.try_one(seed, tmp_path / "mutant") for seed in range(7)]
    assert len({one.change[:6] for one in found}) == 7  # every verb


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "count"), [("data", 10_000), ("campaigns", 3_000), ("results", 1_000)])
def test_so_are_many(kind: str, count: int) -> None:
    assert main(kind, count) == 0
