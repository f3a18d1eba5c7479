"""A folder of campaigns is a study: what its file says, and mistakes in it."""

from __future__ import annotations

from pathlib import Path

import pytest

from lvnav_trade.campaign.reading.study_card import load_study
from lvnav_trade.quantities.errors import InputError

CAMPAIGN = """\
name: {name}
description: What comes out?
seed: 1
base:
  trajectory: trajectories/two_stage_leo
  imu: imu/tactical_fog
  constellation: constellations/gps_24
  receiver: receivers/l1_two_metre
  filter: filters/tight
  initial: {{tilt: "0.1 deg", heading: "0.05 deg", position: "1 m", velocity: "0.01 m/s"}}
{more}
"""
STUDY = """\
title: A paper again
description: What a paper says
campaigns:
  - {campaign: second, question: Does it hold?, figures: [{plot: errors, quantity: velocity}]}
  - {campaign: first}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "first.yaml").write_text(CAMPAIGN.format(name="first", more="monte_carlo: {runs: 200, block: 8}"))
    (tmp_path / "second.yaml").write_text(CAMPAIGN.format(name="second", more=""))
    return tmp_path


def test_the_file_gives_order_and_questions(folder: Path) -> None:
    (folder / "study.yaml").write_text(STUDY)
    study, questions = load_study(folder)
    assert (study.title, study.name) == ("A paper again", folder.name)
    assert [one.campaign.name for one in questions] == ["second", "first"]
    assert questions[0].study_campaign.figures[0].quantity == "velocity"


def test_without_a_file_the_campaigns_stand_by_name(folder: Path) -> None:
    study, questions = load_study(folder)
    assert (study.title, [one.campaign.name for one in questions]) == (folder.name, ["first", "second"])


def test_the_runs_asked_for_take_the_place_of_the_campaigns_own(folder: Path) -> None:
    first, second = load_study(folder, runs=16)[1]
    assert first.campaign.monte_carlo is not None
    assert (first.campaign.monte_carlo.runs, first.campaign.monte_carlo.block) == (16, 8)
    assert second.campaign.monte_carlo is None  # linear covariance alone stays so
    with pytest.raises(InputError, match=r"^--runs 0: 0 runs; give at least 1"):
        load_study(folder, runs=0)


@pytest.mark.parametrize(
    ("change", "reported"),
    [
        (
            ("campaign: second", "campaign: secnd"),
            r"study.yaml:4:16: campaigns.0.campaign: no campaign 'secnd'.*second",
        ),
        (("plot: errors", "plot: erors"), r"study.yaml:4:\d+: campaigns.0.figures.0.plot: "),
        (
            ("plot: errors", "plot: errors, settings: {run: 1}"),
            r"figures.0.settings: no effect: the study's script",
        ),
        (
            ("title:", "units: {atitude: deg}\ntitle:"),
            r"study.yaml:1:\d+: units.atitude: no error is of 'atitude' \(did",
        ),
        (("title:", "units: {attitude: m}\ntitle:"), r"study.yaml:1:\d+: units.attitude: "),
        (
            ("quantity: velocity}", "quantity: velocity}, {plot: locus, axis: imu, study_level: x}"),
            r"study.yaml:4:\d+: campaigns.0.figures.1.study_level: no axis 'imu'",
        ),
        (("title:", "titel:"), r"titel: unknown key \(did you mean 'title'\?\)"),
        (("campaign: second", "campaign: first"), "a campaign is listed twice"),
    ],
)
def test_a_mistake_in_the_file_is_reported_with_its_place(folder: Path, change: tuple[str, str], reported: str) -> None:
    (folder / "study.yaml").write_text(STUDY.replace(*change))
    with pytest.raises(InputError, match=reported):
        load_study(folder)


def test_a_folder_without_campaigns_is_no_study(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no campaigns here"):
        load_study(tmp_path)
    with pytest.raises(InputError, match="nowhere: no such folder of campaigns"):
        load_study("nowhere")
