"""Studies from Python: refused before anything is computed."""

from __future__ import annotations

import pytest

from lvnav_trade import api
from lvnav_trade.quantities.errors import InputError


def test_a_folder_of_the_user_is_no_place_for_a_report(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="did not write"):
        api.study("dlr", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_a_study_that_there_is_not_is_one_line(tmp_path):
    with pytest.raises(InputError):
        api.study(tmp_path / "nothing", tmp_path / "kept")
    assert not (tmp_path / "kept").exists()
