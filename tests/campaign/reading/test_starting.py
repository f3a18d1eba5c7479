"""A first campaign around a user's file passes the tool's own check, and nothing that is there is overwritten."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lvnav_trade import api
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.reading.starting import start
from lvnav_trade.quantities.data_file import column_names, read_columns
from lvnav_trade.quantities.errors import InputError

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
    checked = api.check(found.campaign).campaign
    assert checked.requirements[0].at == "injection"
    (filters,) = (axis for axis in checked.axes if axis.path == "filter")
    assert filters.labels == ("tight", "tight_extended")  # that models what the first neglects


def test_a_file_with_other_columns_units_and_delimiters_passes_the_check(tmp_path: Path) -> None:
    names = column_names(str(EXAMPLE))[:7]
    rows = read_columns(str(EXAMPLE), names, ",")[0] * [1, 1, 1, 1e-3, 1e-3, 1e-3, 1e-3]
    file = tmp_path / "Our Flight.csv"
    titles = "met;lat_deg;lon_deg;alt [km];vn [km/s];ve [km/s];vd [km/s]"
    np.savetxt(file, rows, fmt="%.12g", delimiter=";", header=titles, comments="")
    found = start(tmp_path / "mine", file)
    assert found.campaign == tmp_path / "mine" / "our_flight.yaml"
    assert "attitude" not in {one.field for one in found.guesses}
    assert "# attitude: along the specific force" in found.card.read_text()
    assert api.check(found.campaign).campaign.name == "our_flight"


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


def _plain() -> pd.DataFrame:
    """Rows of the example without its attitude, which takes long to compare."""
    return pd.read_csv(EXAMPLE, comment="#").iloc[:, :7]


@pytest.mark.parametrize("title", ["tow", "Zeit"])
def test_a_time_of_week_is_known_or_named_and_lift_off_is_where_the_vehicle_leaves_the_ground(
    tmp_path: Path, title: str
) -> None:
    rows = _plain()
    rows = rows.assign(time_s=rows.time_s + 124_218.0).rename(columns={"time_s": title})
    rows.to_csv(tmp_path / "flight.csv", index=False)
    found = start(tmp_path / "new", tmp_path / "flight.csv", EPOCH, None if title == "tow" else title)
    time = next(one.content for one in found.guesses if one.field == "time")
    assert time["column"] == title
    assert time["liftoff"] == pytest.approx(124_218.0, abs=0.5)
    assert float(found.events["stage1_cutoff"].removesuffix(" s")) == pytest.approx(150.49, abs=0.5)  # from lift-off
    assert '"liftoff": 124218' in found.card.read_text(encoding="utf-8")
    assert api.check(found.campaign)


def test_columns_that_no_part_takes_are_named_in_the_card(tmp_path: Path) -> None:
    _plain().assign(**{"q [Pa]": 1.0, "stage": 2}).to_csv(tmp_path / "flight.csv", index=False)
    card = start(tmp_path / "new", tmp_path / "flight.csv", EPOCH).card.read_text(encoding="utf-8")
    assert '# left out: ["q [Pa]", "stage"]\n' in card


@pytest.mark.parametrize(
    ("clock", "shown", "week"),
    [("tow", 302_418.0, 2306), ("tow", 302_418.0, 258), ("unix_time", 1_710_936_000.0, None)],
)
def test_the_epoch_is_that_of_the_clock_of_the_file(tmp_path: Path, clock: str, shown: float, week: int | None) -> None:
    # 2024-03-20 12:00:00 UTC: GPS week 2306 (258 of its era of 1024 weeks), 3.5 days and 18 leap seconds
    rows = _plain()
    rows = rows.assign(time_s=rows.time_s + shown, **({"gps_week": week} if week else {}))
    rows.rename(columns={"time_s": clock}).to_csv(tmp_path / "flight.csv", index=False)
    card = start(tmp_path / "new", tmp_path / "flight.csv").card.read_text(encoding="utf-8")
    line = next(one for one in card.splitlines() if one.startswith("epoch:"))
    assert '"2024-03-20T12:00:00' in line
    assert ("ten bits" in line) == (week == 258)


def test_two_rows_at_one_time_are_an_event(tmp_path: Path) -> None:
    rows = _plain()
    at = int(np.argmin(np.abs(rows.time_s - 150.4932)))
    rows.loc[at, "time_s"] = 150.4932  # a row of the cut-off, and again with another point of reference
    after = rows.iloc[at:].assign(height_m=rows.height_m[at:] + 8.0)
    pd.concat([rows.iloc[: at + 1], after]).to_csv(tmp_path / "flight.csv", index=False)
    assert start(tmp_path / "new", tmp_path / "flight.csv", EPOCH).events["stage1_cutoff"] == "150.4932 s"
