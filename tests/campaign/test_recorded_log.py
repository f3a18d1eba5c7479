"""A log whose errors are those that the filter assumes: outages end inside three sigma, NEES is about one."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.recorded_log import OutagePlan, outage_summary, process, read_card
from lvnav_trade.quantities.errors import InputError
from tests import recorded_log, recorded_sets


def test_outages_of_a_filter_that_knows_its_errors(tmp_path):
    squares, inside = [], []
    for seed in range(4):
        folder = tmp_path / str(seed)
        folder.mkdir()
        card, _ = recorded_log.write(folder, seed)
        done = process(load(folder / "drive.yaml"), card, OutagePlan((15.0, 60.0), 20.0, 10.0))
        squares.append(done.summary.nees_ratio.to_numpy())
        inside.append(done.outages.inside.mean())
        assert list(done.summary.outages) == [9, 4]
    assert np.mean(inside) > 0.95
    assert 0.5 < np.mean(squares) < 1.6  # 52 outages, many of which share solutions
    track = done.track
    assert np.degrees(recorded_log.PLACE[0]) == pytest.approx(track.latitude_deg.mean(), abs=1e-3)
    late = track[track.t_s > 60.0]
    assert late.error_position_north_m.std() == pytest.approx(recorded_log.SIGMA_P, rel=0.3)


def test_a_summary_counts_and_averages():
    rows = pd.DataFrame(
        {"case": "a", "length_s": 15.0, "position_error_m": [3.0, 4.0], "velocity_error_m_per_s": [0.0, 1.0],
         "nees_ratio": [0.5, 1.5], "inside": [True, False], "failed": False}
    )  # fmt: skip
    (found,) = outage_summary(rows).itertuples()
    assert (found.outages, found.inside_percent, found.nees_ratio, found.position_worst_m) == (2, 50.0, 1.0, 4.0)
    assert found.position_rms_m == pytest.approx(np.sqrt(12.5))


def test_mistakes_of_a_card_are_said_with_their_line(tmp_path):
    card, _ = recorded_log.write(tmp_path)
    card.write_text(card.read_text().replace("still:", "stil:"))
    with pytest.raises(InputError, match=r"log.yaml:6:1: stil: unknown key"):
        read_card(card)


def test_the_card_of_the_manual_is_one(tmp_path):
    (sample,) = re.findall(r"```yaml\n(.*?)```", Path("docs/recorded_data.md").read_text(), re.S)
    (tmp_path / "log.yaml").write_text(sample)
    card = read_card(tmp_path / "log.yaml")
    assert (card.imu.axes, card.imu.delay, card.still) == (("x", "-y", "-z"), 0.004, (2.0, 30.0))


def test_outages_that_do_not_fit_are_refused(tmp_path):
    card, _ = recorded_log.write(tmp_path)
    with pytest.raises(InputError, match="no outage of 300 s fits"):
        process(load(tmp_path / "drive.yaml"), card, OutagePlan((300.0,)))


@pytest.mark.skipif(not recorded_sets.SHARED.is_dir(), reason="no recorded sets on this machine")
@pytest.mark.parametrize(
    ("name", "asked", "enough", "short"),
    [
        ("walk", OutagePlan(), "filter=walking", "filter=datasheet"),
        ("drive", OutagePlan((15.0, 30.0), 10.0, 1.0), "filter=as in a street", "filter=as at rest"),
    ],
)
def test_recorded_outages_end_inside_three_sigma_of_a_filter_with_enough_noise(tmp_path, name, asked, enough, short):
    done = process(load(f"campaigns/recorded/{name}.yaml"), getattr(recorded_sets, name)(tmp_path), asked)
    found = dict(iter(done.summary.groupby("case")))
    assert (found[enough].inside_percent >= 95.0).all()
    assert (found[enough].nees_ratio >= 0.3).all()
    assert (found[short].nees_ratio > found[enough].nees_ratio.to_numpy()).all()
    assert found[short].inside_percent.min() < 95.0  # what unit and receiver show at rest is not enough


@pytest.mark.skipif(not recorded_sets.SHARED.is_dir(), reason="no recorded sets on this machine")
def test_a_recorded_drive_by_ranges_and_broadcast_ephemerides(tmp_path):
    card = recorded_sets.drive(tmp_path)
    above = f"base.constellation={{kind: rinex, rinex: {tmp_path / 'drive.nav'}}}"
    done = process(load("campaigns/recorded/drive_tight.yaml", [above]), card, OutagePlan((15.0, 30.0), 10.0, 1.0))
    assert (done.summary.inside_percent >= 95.0).all()
    assert done.summary.nees_ratio.between(0.3, 1.5).all()
