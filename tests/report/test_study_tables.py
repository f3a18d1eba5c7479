"""Tables of a campaign of a study, from synthetic results."""

from __future__ import annotations

from types import SimpleNamespace

import pandas as pd
import pytest

from lvnav_trade.report.blocks import Table, Text
from lvnav_trade.report.study_tables import study_tables
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.tables.read import load
from tests import synthetic


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("study_tables"), n_run=40))


def cells(blocks, column):
    (table,) = (block for block in blocks if isinstance(block, Table))
    return [row[table.head.index(column)] for row in table.rows]


def test_nothing_is_shown_that_is_not_asked_for(tables):
    assert study_tables(tables, (), "") == []
    assert study_tables(tables, ("logic",), "") == []  # no filter here has one


def test_requirements_are_a_cell_each_that_passes_or_fails(tables):
    blocks = study_tables(tables, ("requirements",), "")
    assert isinstance(blocks[0], Text)
    assert " cells pass: at least " in blocks[0].text
    assert set(cells(blocks, "verdict")) <= {"pass", "fail", "undecided"}
    assert len(cells(blocks, "case")) == len(tables.campaign["requirements"]) * len(tables.labels)


@pytest.mark.parametrize(
    ("second", "words"),
    [
        (0.6827, "1 of 2 cells pass: at least 68.27 % of flights within"),
        (0.9973, "1 of 2 cells pass: at least 68.27 % (position) or 99.73 % (velocity) of flights within"),
    ],
)
def test_different_required_probabilities_are_all_named(tables, monkeypatch, second, words):
    frame = METRICS["requirements"](tables).head(2).copy()
    frame["requirement"] = ["position", "velocity"]
    frame["verdict"] = ["met", "violated"]
    frame["probability"] = [0.6827, second]
    monkeypatch.setitem(METRICS, "requirements", lambda _: frame)
    text, _ = study_tables(tables, ("requirements",), "")
    assert text.text.startswith(words)


def test_a_bounded_noise_is_reported_by_case_with_its_weakest_direction():
    row = {
        "case": "a",
        "rank_count": 15,
        "state_count": 15,
        "lower_bound_si": 1e-9,
        "upper_bound_si": 3.0,
        "weakest_direction": "+1.00 gyro bias x",
    }
    rows = [
        {**row, "matrix": "Q", "unit": "initial sigma^2"},
        {**row, "matrix": "R", "unit": "m", "lower_bound_si": 2.0},
    ]
    short = [{**one, "case": "b", "rank_count": 12} for one in rows]
    silent = [rows[0] | {"case": "c"}, {**rows[1], "case": "c", "lower_bound_si": 0.0}]
    shown = SimpleNamespace(
        error_bound=pd.DataFrame(rows + short + silent), labels={"a": "one", "b": "two", "c": "three"}
    )
    blocks = study_tables(shown, ("error_bound",), "")
    assert cells(blocks, "holds") == ["yes", "no", "no"]
    assert cells(blocks, "rank of Q / states") == ["15 / 15", "12 / 15", "15 / 15"]
    assert cells(blocks, "measurement noise")[0] == "2.00 to 3.00 m"
    assert study_tables(SimpleNamespace(error_bound=shown.error_bound[:0]), ("error_bound",), "") == []


def test_coverage_and_parting_have_their_columns(tables):
    assert set(cells(study_tables(tables, ("coverage",), ""), "honest")) <= {"yes", "no"}
    assert set(cells(study_tables(tables, ("paired",), "imu"), "levels")) == {"fine and coarse"}
