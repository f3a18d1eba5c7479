"""The section on many designs: what it says, and what would make a reviewer doubt it."""

from __future__ import annotations

import base64
import json

import numpy as np
import pytest

from lvnav_trade.metrics.designs import designs
from lvnav_trade.report.blocks import Designs, More, Table, Text
from lvnav_trade.report.space import space
from lvnav_trade.store.read import load
from tests import many_designs, synthetic


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory):
    return many_designs.tables(tmp_path_factory.mktemp("space"))


def texts(tables) -> list[str]:
    return [block.text for block in space(tables) if isinstance(block, Text)]


def test_the_first_line_counts_the_designs_that_meet_all(tables) -> None:
    met = (many_designs.frame().verdict == "met").sum()
    first, *_ = texts(tables)
    assert first.startswith(f"{met} of 398 designs meet the requirement by linear covariance")


def test_it_says_how_many_of_these_have_a_filter_that_cannot_be_trusted(tables) -> None:
    frame = many_designs.frame()
    met = frame[frame.verdict == "met"]
    doubtful = (met.nees_per_state_ratio > 2.0).sum()
    assert 0 < doubtful < len(met)
    assert f"cannot be trusted in {doubtful} of these {len(met)}" in texts(tables)[1]


def test_impossible_designs_are_counted_by_their_reason(tables) -> None:
    assert texts(tables)[2] == "2 further designs are impossible: 2 times filter: the update rate is above … Hz."


def test_it_ends_with_what_the_other_sections_are_about(tables) -> None:
    last = [block for block in space(tables) if isinstance(block, Text)][-1]
    assert "the 2 designs analysed whole" in last.text
    assert "best: 1" in last.text


def test_the_best_designs_are_the_cheapest_with_the_command_of_their_full_analysis(tables) -> None:
    (best,) = [block for block in space(tables) if isinstance(block, Table)]
    frame = many_designs.frame()
    met = frame[frame.verdict == "met"].sort_values(["cost", "error_ratio"], kind="stable")
    assert [row[-1] for row in best.rows] == [f"lvnav-trade run mine.yaml --case {case}" for case in met.case[:20]]
    assert "filter loose" in best.rows[0][0]
    assert "deg/h" in best.rows[0][0]
    titles = [block.title for block in space(tables) if isinstance(block, More)]
    assert titles[:2] == ["The nearest misses", "The Pareto front of those that meet all"]


def test_the_page_has_the_numbers_of_every_possible_design(tables) -> None:
    (block,) = [block for block in space(tables) if isinstance(block, Designs)]
    data = json.loads(block.data)
    frame = designs(tables)
    frame = frame[frame.case != ""]
    columns = {column["name"]: column for column in data["columns"]}
    values = np.frombuffer(base64.b64decode(columns["error over limit"]["values"]), "<f4")
    np.testing.assert_allclose(values, frame.error_ratio, rtol=1e-6)
    assert columns["filter"]["levels"] == list(dict.fromkeys(frame.axis_filter))
    assert columns["bias repeatability"]["unit"] == "deg/h"
    assert [data["words"][k] for k in data["verdicts"]] == list(frame.verdict)
    assert data["cases"] == list(frame.case)


def test_results_that_hold_each_case_whole_have_no_such_section(tmp_path) -> None:
    assert space(load(synthetic.results(tmp_path, n_run=8))) == []
