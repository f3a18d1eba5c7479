"""The section on numeric axes."""

from __future__ import annotations

from lvnav_trade.report.blocks import Picture, Table
from lvnav_trade.report.space import curves
from lvnav_trade.results.tables.read import load
from tests import synthetic
from tests.results.requirements.test_limit_crossings import FACTORS, tables


def test_a_numeric_axis_has_a_figure_and_its_crossings(tmp_path):
    found = curves(tables(tmp_path, [f"{factor} deg" for factor in FACTORS]))
    assert [block.name for block in found if isinstance(block, Picture)] == ["curves-1"]
    assert found[0].lead == "The limit is reached at:"
    assert found[0].text.endswith(").")
    (listed,) = (block for block in found if isinstance(block, Table))
    assert {row[2] for row in listed.rows} <= {"north", "fast"}


def test_without_a_numeric_axis_there_is_no_section(tmp_path):
    assert curves(load(synthetic.results(tmp_path, n_run=8))) == []
