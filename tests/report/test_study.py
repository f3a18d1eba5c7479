"""The page of a study: every number traceable, what is out of band reported first."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest

from lvnav_trade.campaign.reading.study_card import StudyCard
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.report.script import StudyResult
from lvnav_trade.report.study import build, heading
from lvnav_trade.results.evaluation.published import references
from lvnav_trade.results.tables.read import load
from tests import synthetic

STUDY = StudyCard.model_validate(
    {
        "name": "papers",
        "title": "A paper again",
        "description": "What a paper says, held against our runs.",
        "assumptions": ["The filter's noise is not published."],
        "campaigns": [
            {
                "campaign": "synthetic",
                "question": "Which grade?",
                "kml": {"imu": "fine"},
                "text": "It holds.\n\nSo does this.",
                "figures": [
                    {"plot": "errors", "quantity": "velocity", "caption": "Both grades."},
                    {"plot": "locus", "axis": "imu", "metric": "velocity_error_3d", "unit": "m/s", "published": 0.3},
                    {"plot": "envelope", "case": {"imu": "fine"}, "quantity": "position"},
                    {"plot": "sky", "case": {"imu": "fine"}},
                    {"plot": "autocorrelation", "channels": "range"},
                ],
            }
        ],
    }
)


@pytest.fixture(scope="module")
def answered(tmp_path_factory):
    tables = load(synthetic.results(tmp_path_factory.mktemp("study"), n_run=40))
    single = {"source": "A paper", "item": "one flight", "case": {"imu": "fine"}, "metric": "velocity_error_3d"}
    single |= {"value": 0.5, "unit": "m/s", "single": True}
    stated = tables.campaign | {"references": [*tables.campaign["references"], single]}
    campaign = SimpleNamespace(name="synthetic", description="", model_dump=lambda mode: stated)
    return [StudyResult(STUDY.campaigns[0], campaign, tables)]


@pytest.fixture(scope="module")
def page(answered, tmp_path_factory):
    return build(STUDY, answered, tmp_path_factory.mktemp("kept") / "papers")


def test_the_tables_hold_every_row_with_its_campaign(page, answered):
    found = pd.read_csv(page.parent / "references.csv")
    mine = references(answered[0].tables, answered[0].campaign.model_dump("json"))
    assert list(found.columns) == list(mine.columns)
    assert list(found["case"]) == ["synthetic: " + case for case in mine["case"]]
    assert found.ours.tolist() == pytest.approx(mine.ours.tolist(), rel=1e-5)
    agreement = pd.read_csv(page.parent / "agreement.csv")
    assert list(agreement.columns) == [
        "case", "event", "state", "unit", "monte_carlo", "lincov", "ratio", "low", "high", "agree",
    ]  # fmt: skip
    assert set(agreement["case"]) == {"synthetic: imu=fine", "synthetic: imu=coarse"}


def test_the_page_says_what_holds_and_what_does_not(page):
    text = page.read_text()
    assert text.startswith("# A paper again\n\nWhat a paper says, held against our runs.\n")
    assert "Of 3 published results that count, 1 are reproduced: 1 of 3 numbers are reproduced, " in text
    assert "The most important results that are not reproduced, with the reason." in text
    for words in (
        "1. The filter's noise is not published.",
        "Which grade?",
        "It holds.\n\nSo does this.",
        "Both grades.",
    ):
        assert words in text
    assert "lvnav-trade study papers --keep reports/papers" in text


def test_every_picture_of_the_page_is_kept_and_no_other(page):
    shown = set(re.findall(r"\(figures/([^)]+)\)", page.read_text()))
    assert shown == {path.name for path in (page.parent / "figures").glob("*.png")}
    assert {"ratios.png", "synthetic-1-errors.png", "synthetic-2-locus.png", "synthetic-spread.png"} <= shown


def test_the_flight_of_the_case_asked_for_is_kept_with_its_errors(page):
    text = (page.parent / "synthetic.kml").read_text()
    assert "<name>synthetic: imu=fine</name>" in text
    assert "3 sigma of position" in text
    assert "imu=coarse" not in text
    assert "synthetic.kml" in page.read_text()


def test_the_same_study_gives_the_same_bytes(page, answered, tmp_path):
    again = build(STUDY, answered, tmp_path)
    for path in sorted(page.parent.rglob("*.*")):
        assert (again.parent / path.relative_to(page.parent)).read_bytes() == path.read_bytes()


def test_a_figure_of_a_case_that_is_not_there_is_refused(answered, tmp_path):
    figure = STUDY.campaigns[0].figures[2].model_copy(update={"case": {"imu": "none"}})
    part = STUDY.campaigns[0].model_copy(update={"figures": (figure,)})
    with pytest.raises(InputError, match="synthetic: no case"):
        build(STUDY, [answered[0]._replace(study_campaign=part)], tmp_path)


def test_a_folder_that_cannot_be_written_is_reported(answered):
    with pytest.raises(InputError, match="cannot be kept there"):
        build(STUDY, answered, Path("/proc/nowhere"))


def test_a_campaign_is_headed_by_its_name_in_words():
    assert [heading(name) for name in ("imu_noise", "ekf_ukf", "delay", "tested_imu")] == [
        "IMU noise", "EKF UKF", "Delay", "Tested IMU",
    ]  # fmt: skip


_ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("study", sorted(path.parent.name for path in (_ROOT / "campaigns").glob("*/study.yaml")))
def test_no_kept_page_has_one_figure_twice(study: str) -> None:
    names: dict[bytes, list[str]] = {}
    for figure in sorted((_ROOT / "reports" / study / "figures").glob("*.png")):
        names.setdefault(hashlib.sha256(figure.read_bytes()).digest(), []).append(figure.name)
    assert names
    assert [same for same in names.values() if len(same) > 1] == []
