"""A trajectory card alone becomes the tables that a figure needs."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.campaign.reading.flights import preview, read_card
from lvnav_trade.quantities.errors import InputError


def test_a_shipped_card_is_read_by_its_name_and_flown(tmp_path):
    seen = preview(read_card("trajectories/example_table", tmp_path))
    assert seen.name == "example_table"
    height = np.interp(seen.events["t_s"], seen.reference["t_s"], seen.reference["altitude_m"])
    at = dict(zip(seen.events["event"], height, strict=True))
    assert at["liftoff"] == pytest.approx(20.0, abs=0.01)
    assert at["injection"] == pytest.approx(355e3, abs=1e3)
    assert seen.reference["t_s"][0] == -60.0
    assert set(seen.events["t_s"]) <= set(seen.reference["t_s"])


def test_a_card_of_the_users_own_may_be_a_path(tmp_path, root):
    text = (root / "configs/trajectories/example_table.yaml").read_text()
    file = root / "configs/trajectories/example_table.csv"
    (tmp_path / "mine.yaml").write_text(text.replace("example_table.csv", str(file)))
    assert read_card(str(tmp_path / "mine.yaml"), tmp_path).name == "example_table"


def test_a_card_that_is_wrong_or_not_there_is_reported_in_its_line(tmp_path, root):
    with pytest.raises(
        InputError, match=r"no card 'trajectories/two_stage' \(did you mean 'trajectories/two_stage_leo'"
    ):
        read_card("trajectories/two_stage", tmp_path)
    text = (root / "configs/trajectories/example_table.yaml").read_text()
    (tmp_path / "mine.yaml").write_text(text.replace("example_table.csv", "none.csv"))
    with pytest.raises(InputError, match=r"mine\.yaml:7:7: trajectory\.file: no such file: 'none\.csv'"):
        read_card(str(tmp_path / "mine.yaml"), tmp_path)
    file = root / "configs/trajectories/example_table.csv"
    (tmp_path / "mine.yaml").write_text(text.replace("example_table.csv", str(file)).replace("unit: m/s}", "unit: m}"))
    with pytest.raises(InputError, match=r"mine\.yaml:10:\d+: trajectory\.velocity\.unit: '1 m' has the wrong unit"):
        read_card(str(tmp_path / "mine.yaml"), tmp_path)
