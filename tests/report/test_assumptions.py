"""The section on assumptions, and the first screen's sentence on what a ranking rests on."""

from __future__ import annotations

import pandas as pd
import pytest

from lvnav_trade.report.assumptions import assumptions, cases_in_words, orbit_warning, ranking_warning
from lvnav_trade.report.blocks import Table, Text
from lvnav_trade.report.build import make
from lvnav_trade.report.summary import summary
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.assumed_numbers import varied_assumptions
from lvnav_trade.results.tables.read import load
from tests import synthetic
from tests.injections import with_injections
from tests.results.evaluation.test_assumed_numbers import BASE


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    head = synthetic.CAMPAIGN.partition("requirements:")[0]
    return load(synthetic.results(tmp_path_factory.mktemp("marked"), n_run=8, campaign=head + BASE))


def test_every_mark_stands_once_with_the_cases_that_it_affects(tables) -> None:
    (listed,) = (block for block in assumptions(tables) if isinstance(block, Table))
    assert listed.rows == (
        ("imu", "fine", "rate (200 Hz)", "assumed", "usual", "imu=fine"),
        ("imu", "fine", "resources (cost 5, mass 1 kg)", "assumed", "no price", "imu=fine"),
        ("imu", "fine", "gyro.bias_repeatability (1 deg/h)", "second hand", "a paper", "imu=fine"),
        ("imu", "coarse", "rate (200 Hz)", "assumed", "usual", "imu=coarse"),
        ("receiver", "patch", "rate (1 Hz)", "assumed", "usual", "all"),
        ("receiver.antennas", "a, b", "cutoff (100 deg)", "assumed", "hidden", "all"),
        ("filter", "tight", "update_rate (1 Hz)", "assumed", "usual", "all"),
    )


def test_the_first_screen_says_by_which_assumed_numbers_products_are_ranked(tables) -> None:
    (warning,) = ranking_warning(tables)
    assert warning.text == (
        "IMU: gyro bias repeatability (second hand in 1 of 2 cases). Errors and ranking of the cases are only as "
        "reliable as these numbers. IMU: cost (assumed in 1 of 2 cases). Only the section Cost and performance uses "
        "them. Errors and margins do not depend on them. See Assumptions."
    )
    assert warning.lead == "The comparison of the cases uses numbers that are not from the manufacturer's datasheet."
    assert warning in summary(tables)


def test_assumed_costs_are_said_to_decide_no_error(tables, monkeypatch) -> None:
    frame = varied_assumptions(tables)
    assert set(frame.field) == {"resources.cost", "gyro.bias_repeatability"}
    monkeypatch.setattr(
        "lvnav_trade.report.assumptions.varied_assumptions", lambda _: frame[frame.field.str.startswith("resources.")]
    )
    (warning,) = ranking_warning(tables)
    assert warning == Text(
        "IMU: cost (assumed in 1 of 2 cases). Only the section Cost and performance uses them. Errors and margins do "
        "not depend on them. See Assumptions.",
        "The comparison of cost and performance uses numbers that are not from the manufacturer's datasheet.",
    )


def test_without_marks_there_is_neither_sentence_nor_section_nor_table(tmp_path) -> None:
    plain = load(synthetic.results(tmp_path, n_run=8))
    assert ranking_warning(plain) == []
    made = make(plain)
    assert "assumptions" not in [section.name for section in made.sections]
    assert "assumptions.csv" not in made.csv


def test_cases_are_named_by_what_they_have_in_common(tables) -> None:
    assert cases_in_words(tables, tables.labels.values()) == "all"
    assert cases_in_words(tables, ["imu=coarse"]) == "imu=coarse"


def test_the_first_screen_names_the_assumed_spreads_that_are_drawn_and_no_others(tables, monkeypatch) -> None:
    """Of linear covariance the vehicle has the sources thrust and dry mass; the wind of its card is not drawn."""
    fields = ("thrust", "dry_mass", "wind", "wind_length", "thrust_misalignment")
    place, case = "trajectory.vehicle.dispersions", next(iter(tables.labels.values()))
    frame = pd.DataFrame({"case": case, "place": place, "field": fields, "mark": "assumed"})
    monkeypatch.setitem(METRICS, "assumptions", lambda _: frame)
    (warning,) = orbit_warning(with_injections(tables))
    assert warning.text.startswith("Thrust, dry mass. Errors of the achieved orbit are only as")
    assert warning.lead == "The achieved orbit depends on assumed dispersions of the vehicle."
    assert orbit_warning(tables) == []
