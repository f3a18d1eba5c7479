"""The sections on linear covariance say what the tables hold."""

from __future__ import annotations

import re

import numpy as np
import pytest

from lvnav_trade.report import build
from lvnav_trade.report import diagnostics as explained
from lvnav_trade.report.blocks import SourceScaling
from lvnav_trade.results.tables.read import load
from tests import synthetic


@pytest.fixture(scope="module")
def tables(page):
    return load(page.parent)


def budget_tables(tables):
    (rest,) = [block for block in explained.budget(tables) if block.block_type == "more"]
    return [block for block in rest.blocks if block.block_type == "table"]


def test_the_budget_table_has_every_event_and_every_quantity(tables):
    shown = budget_tables(tables)
    assert len(shown) == 2 * 3
    assert shown[0].head == ("position (m)", "liftoff", "stage1 cutoff", "injection")
    assert [row[0] for row in shown[0].rows[:3]] == ["gyro bias", "range noise", "all"]
    assert shown[0].rows[0][-1].endswith("(75 %)")


def test_a_mean_error_that_counts_stands_below_the_sources_and_in_the_root_mean_square(tables):
    position, velocity, attitude = budget_tables(tables)[3:]  # the worst case stands first
    assert [row[0] for row in position.rows[3:]] == ["mean, the same in every run", "root mean square"]
    at_liftoff = [float(row[1]) for row in position.rows[2:]]
    assert at_liftoff == [pytest.approx(float(np.hypot.reduce(part)), rel=5e-3) for part in (
        synthetic.SIGMA[6:9], synthetic.MEAN[6:9], [*synthetic.SIGMA[6:9], *synthetic.MEAN[6:9]])]  # fmt: skip
    assert len(velocity.rows) == 5
    assert len(attitude.rows) == 3


def test_frozen_and_retuned_numbers_stand_beside_each_other(tables):
    blocks = explained.grades(tables)
    assert sum(isinstance(block, SourceScaling) for block in blocks) == 1
    table = next(block for block in blocks if block.block_type == "table")
    assert table.head[2:] == ("x 0.1", "x 0.3", "x 1", "x 3", "x 10")
    frozen, retuned = map(float, table.rows[0][6].split(" / "))
    assert retuned / frozen == pytest.approx(synthetic.RETUNED, rel=0.01)


def test_observability_names_rank_and_the_weakest_direction(tables):
    table = explained.observability(tables)[1]
    assert table.rows[0][3] == "4 / 5"
    assert table.rows[0][-1] == "+1.00 attitude roll"


def test_nonlinearity_stands_beside_the_agreement(text):
    section = text[text.index('id="agreement"') : text.index('id="satellites"')]
    assert "Nonlinearity at one-sigma true errors" in section


def test_a_verdict_that_does_not_apply_says_why(tmp_path):
    page = build(synthetic.results(tmp_path, n_run=40, rejects=0.03), ["summary", "agreement"])
    text = page.read_text(encoding="utf-8")
    assert "Not applicable: imu=fine; imu=coarse (the gate rejects 3 % of good rows at 51 s)" in text
    assert re.search(r'class="[^"]*v not-applicable">not applicable<', text)
