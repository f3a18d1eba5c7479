"""A first campaign around a user's file passes the tool's own check, and nothing that is there is overwritten."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lvnav_trade import api
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.reading.starting import start
from lvnav_trade.errors import InputError
from lvnav_trade.world.user_file.rows import column_names, read_columns

EXAMPLE = Path("configs/trajectories/example_table.csv")
EPOCH = "2024-03-20T12:00:00Z"  # that of its card
EVENTS = {"stage1_cutoff": 150.4932, "stage2_ignition": 158.4932, "injection": 549.3082}


def test_the_example_is_read_as_its_card_says(tmp_path: Path) -> None:
    found = start(tmp_path, EXAMPLE, EPOCH)
    assert found.events.keys() == EVENTS.keys()
    for name, time in EVENTS.items():
        assert float(found.events[name].removesuffix(" s")) == pytest.approx(time, abs=0.02)
    wanted = load("campaigns/demo.yaml", ["base.trajectory=trajectories/example_table"]).base.trajectory
    campaign = load(found.campaign).base.trajectory
    for part in ("time", "position", "velocity", "attitude", "epoch", "pad_hold"):
        assert getattr(campaign, part) == getattr(wanted, part), part
    assert api.check(found.campaign).requirements[0].at == "injection"


def test_a_file_with_other_columns_units_and_delimiters_passes_the_check(tmp_path: Path) -> None:
    names = column_names(str(EXAMPLE))[:7]
    rows = read_columns(str(EXAMPLE), names, ",")[0] * [1, 1, 1, 1e-3, 1e-3, 1e-3, 1e-3]
    file = tmp_path / "Our Flight.csv"
    titles = "met;lat_deg;lon_deg;alt [km];vn [km/s];ve [km/s];vd [km/s]"
    np.savetxt(file, rows, fmt="%.12g", delimiter=";", header=titles, comments="")
    found = start(tmp_path / "mine", file)
    assert found.campaign == tmp_path / "mine" / "our_flight.yaml"
    assert "attitude" not in {one.part for one in found.guesses}
    assert "# attitude: along the specific force" in found.card.read_text()
    assert api.check(found.campaign).name == "our_flight"


@pytest.mark.parametrize("there", ["example_table.yaml", "configs/trajectories/example_table.yaml"])
def test_what_is_there_is_not_overwritten(there: str, tmp_path: Path) -> None:
    (tmp_path / there).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / there).write_text("mine")
    with pytest.raises(InputError, match=r"example_table.yaml: exists already; nothing was written"):
        start(tmp_path, EXAMPLE)
    assert (tmp_path / there).read_text() == "mine"
    assert len([path for path in tmp_path.rglob("*") if path.is_file()]) == 1


def test_a_file_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none.csv: no such file$"):
        start(tmp_path, tmp_path / "none.csv")
