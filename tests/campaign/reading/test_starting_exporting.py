"""The flight of a card or case as files of the user's own."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade import api
from lvnav_trade.campaign.reading.flights import read_card
from lvnav_trade.campaign.reading.starting import is_card, refuse_existing, write_flight, write_new
from lvnav_trade.quantities.errors import InputError

CAMPAIGN = """\
name: both
seed: 1
base:
  trajectory: trajectories/two_stage_leo
  imu: imu/tactical_fog
  constellation: constellations/gps_24
  receiver: receivers/l1_two_metre
  filter: filters/tight
  initial: {tilt: "0.1 deg", heading: "0.05 deg", position: "1 m", velocity: "0.01 m/s"}
axes:
  - {path: trajectory, cards: [trajectories/two_stage_leo, out]}
monte_carlo: {runs: 8}
covariance: {budget: false, adjoint: false, observability: false, nonlinearity: false, spot_check: 0}
report: {sections: []}
"""


def test_a_case_on_a_card_and_on_its_export_agree(tmp_path, monkeypatch):
    """RMS of the same eight runs and both sigmas of linear covariance agree to 1e-5 at all events and phases."""
    monkeypatch.chdir(tmp_path)
    written = api.export_trajectory("trajectories/two_stage_leo", "out.csv")
    assert written.card.name == "out.yaml"
    (tmp_path / "both.yaml").write_text(CAMPAIGN)
    rows = api.run("both.yaml", folder=tmp_path / "results", jobs=1, report=False).rms
    key = ["phase_or_event", "metric", "axis"]
    first, second = (rows[rows.case == name].set_index(key) for name in rows.case.unique())
    # The last row of a file is an event of its flight: one more row of the two phases that reach the end.
    second = second[second.index.get_level_values(0) != "end"]
    assert list(first.index) == list(second.index)
    to_the_end = first.index.get_level_values(0).isin(["flight", "stage2_cutoff to end"])
    first, second = first[~to_the_end], second[~to_the_end]
    assert len(first) > 300
    for column in ("rms", "formal_sigma", "lincov_true_sigma"):
        assert np.allclose(first[column], second[column], rtol=1e-5, atol=0.0)


def test_files_that_are_there_are_not_written_over(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    card = read_card("trajectories/two_stage_leo", tmp_path)
    (tmp_path / "mine.yaml").write_text("mine: true\n")
    with pytest.raises(InputError, match=r"mine.yaml: exists already; nothing was written"):
        write_flight(card, tmp_path / "mine.csv", 10.0)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["mine.yaml"]
    with pytest.raises(InputError, match="exists already"):
        refuse_existing(tmp_path / "mine.yaml")
    with pytest.raises(FileExistsError):
        write_new(tmp_path / "mine.yaml", "")


def test_the_rows_are_csv(tmp_path):
    with pytest.raises(InputError, match=r"end it in \.csv"):
        write_flight(read_card("trajectories/two_stage_leo", tmp_path), tmp_path / "mine.parquet", 10.0)


def test_a_case_of_a_campaign_is_exported_and_a_card_takes_no_case(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = api.export_trajectory("smoke", "case.csv", rate=5.0)
    assert found.events["injection"] == pytest.approx(549.308, abs=1e-3)
    assert found.difference["position_m"] < 1e-4
    assert is_card("trajectories/two_stage_leo", tmp_path)
    assert not is_card("smoke", tmp_path)
    with pytest.raises(InputError, match="is a trajectory card"):
        api.export_trajectory("trajectories/two_stage_leo", "other.csv", case="a")
