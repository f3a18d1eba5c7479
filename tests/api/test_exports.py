"""Exports from Python: reference vectors, and the filter of a case as C; both are of the same runs."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade import api
from lvnav_trade.quantities.errors import InputError
from tests.export.translation.compiled import needs_compiler

SETS = ("base.filter=filters/tight",)


def test_from_python_without_runs(tmp_path):
    found = api.export_filter("smoke", tmp_path / "code", runs=0)
    assert (tmp_path / "code" / "nav_filter.c").read_text() == found.files["nav_filter.c"]


@needs_compiler
def test_the_vectors_are_the_numbers_that_the_c_is_replayed_on(tmp_path):
    api.export_filter("smoke", tmp_path / "code", runs=1, sets=SETS)
    found = api.export_vectors("smoke", tmp_path / "vectors", sets=SETS)
    numbers = np.fromfile(tmp_path / "code" / "run_0.bin")
    start = found.tables["estimates"].iloc[0, 3:13].to_numpy(float)
    assert (numbers[:10] == start).all()
    in_order = found.tables["imu"].iloc[:20, 2:].to_numpy().ravel()
    assert any((numbers[at : at + in_order.size] == in_order).all() for at in range(10, 200))
    last = found.tables["estimates"].iloc[-1, 3:13].to_numpy(float)
    assert any((numbers[at : at + 10] == last).all() for at in range(numbers.size - 200, numbers.size - 9))


@pytest.mark.parametrize("export", [api.export_vectors, api.export_filter])
def test_a_folder_of_the_user_is_refused_first(export, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="did not write"):
        export("smoke", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
