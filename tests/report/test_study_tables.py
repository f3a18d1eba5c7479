"""Tables that a study asks for: verdicts by case, coverage, two levels, missions, process noise."""

from __future__ import annotations

from types import SimpleNamespace

import pandas as pd
import pytest

from lvnav_trade.report.blocks import Table, Text
from lvnav_trade.report.study_tables import missions_table, noise_table, study_tables
from lvnav_trade.store import load
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


def test_a_bounded_noise_is_reported_by_case_with_its_weakest_direction():
    row = {
        "case": "a",
        "rank_count": 15,
        "state_count": 15,
        "low_si": 1e-9,
        "high_si": 3.0,
        "weakest": "+1.00 gyro bias x",
    }
    rows = [{**row, "matrix": "Q", "unit": "initial sigma^2"}, {**row, "matrix": "R", "unit": "m", "low_si": 2.0}]
    short = [{**one, "case": "b", "rank_count": 12} for one in rows]
    silent = [rows[0] | {"case": "c"}, {**rows[1], "case": "c", "low_si": 0.0}]
    shown = SimpleNamespace(
        error_bound=pd.DataFrame(rows + short + silent), labels={"a": "one", "b": "two", "c": "three"}
    )
    blocks = study_tables(shown, ("error_bound",), "")
    assert cells(blocks, "holds") == ["yes", "no", "no"]
    assert cells(blocks, "rank of Q / states") == ["15 / 15", "12 / 15", "15 / 15"]
    assert cells(blocks, "noise of rows")[0] == "2.00 to 3.00 m"
    assert study_tables(SimpleNamespace(error_bound=shown.error_bound[:0]), ("error_bound",), "") == []


def test_coverage_and_parting_have_their_columns(tables):
    assert set(cells(study_tables(tables, ("coverage",), ""), "honest")) <= {"yes", "no"}
    assert set(cells(study_tables(tables, ("paired",), "imu"), "levels")) == {"fine and coarse"}


def test_missions_stand_in_rows_and_ours_below_them(tables):
    flown = [
        {
            "item": f"{name}, apogee",
            "metric": "velocity_error_3d",
            "value": value,
            "unit": "m/s",
            "case": {"imu": "fine"},
        }
        for name, value in (("C20", 1e-9), ("C19", 1e9))
    ]
    (block,) = missions_table(tables, flown)
    column = [dict(zip(block.head, row, strict=True)) for row in block.rows]
    assert [row["mission"] for row in column] == ["C20", "C19", "ours, RMS", "ours, 50 %", "ours, 95 %"]
    assert [row["ours below it, apogee (%)"] for row in column[:2]] == ["0", "100"]
    assert missions_table(tables, []) == []


def test_process_noise_is_reported_in_the_units_of_people():
    noise = SimpleNamespace(attitude=2.9088820866572158e-06, velocity=0.001, position=0.0)
    found = SimpleNamespace(whole=noise, phases=(("liftoff to stage1_cutoff", 0.0, 1.0, noise),), steps=pd.DataFrame())
    block = noise_table(found, 10.0)
    assert block.rows[0][:2] == ("whole flight", "0.0100")  # deg/sqrt(h)
    assert block.rows[1][0] == "liftoff to stage1 cutoff"
    assert "10 s" in block.caption
