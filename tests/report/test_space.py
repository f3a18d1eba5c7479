"""The section on many designs: what it says, and what would make a reviewer doubt it."""

from __future__ import annotations

import base64
import json

import numpy as np
import pytest

from lvnav_trade.report.blocks import DesignExplorer, Details, Picture, Table, Text
from lvnav_trade.report.sentences import say
from lvnav_trade.report.space import space
from lvnav_trade.results.evaluation.designs import designs
from lvnav_trade.results.tables.read import load
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
    assert "the 2 designs with full analysis" in last.text
    assert "best: 1" in last.text


def test_the_best_designs_are_the_cheapest_with_the_command_of_their_full_analysis(tables) -> None:
    (best,) = [block for block in space(tables) if isinstance(block, Table)]
    frame = many_designs.frame()
    met = frame[frame.verdict == "met"].sort_values(["cost", "error_ratio"], kind="stable")
    assert [row[-1] for row in best.rows] == [f"lvnav-trade run mine.yaml --case {case}" for case in met.case[:20]]
    assert "filter loose" in best.rows[0][0]
    assert "deg/h" in best.rows[0][0]
    titles = [block.title for block in space(tables) if isinstance(block, Details)]
    assert titles[:2] == ["Nearest misses", "Pareto front of the designs that meet all requirements"]


def test_the_page_has_the_numbers_of_every_possible_design(tables) -> None:
    (block,) = [block for block in space(tables) if isinstance(block, DesignExplorer)]
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


def test_it_says_how_many_meet_each_requirement_where_there_are_several(tmp_path) -> None:
    found = many_designs.tables(tmp_path, 60)
    frame = found.designs.assign(
        verdict="violated",
        verdicts=[json.dumps({"fast": word or "met", "true": "violated"}) for word in found.designs.verdict],
    )
    asked = [many_designs.REQUIREMENT, {**many_designs.REQUIREMENT, "name": "true"}]
    both = found.with_frames(designs=frame)
    both.__dict__["campaign"] = {**found.campaign, "requirements": asked}
    met = (found.designs.verdict == "met").sum()
    assert f"Each requirement alone: fast {met}, true none." in texts(both)[0]
    assert next(block.caption for block in space(both) if isinstance(block, Table)).startswith(
        "Designs nearest to meeting"
    )


def test_a_sample_has_intervals_and_a_grid_has_none(tables, tmp_path) -> None:
    grid = many_designs.grid(tmp_path)
    assert "95 % interval" in texts(tables)[0]
    met = (grid.designs.verdict == "met").sum()
    assert texts(grid)[0].startswith(f"{met} of 42 designs meet the requirement by linear covariance")
    assert "interval" not in texts(grid)[0]
    for found, count in ((tables, 3), (grid, 0)):
        captions = [block.caption for block in space(found) if isinstance(block, Picture)]
        assert len(captions) == 3
        assert sum("95 % interval" in caption for caption in captions) == count
        shown = [block for more in space(found) if isinstance(more, Details) for block in more.blocks]
        headings = [heading for one in shown if isinstance(one, Table) for heading in one.head]
        assert headings.count("95 % interval") == count


def test_a_level_and_an_interval_without_length_are_one_number(tmp_path) -> None:
    grid = many_designs.grid(tmp_path)
    shown = [block for more in space(grid) if isinstance(more, Details) for block in more.blocks]
    (regions,) = [one for one in shown if isinstance(one, Table) and "part" in one.head]
    parts = [row[1] for row in regions.rows if row[0] == "heading"]
    assert parts == ["0.01 deg", "0.1 deg", "1 deg"]
    whole = many_designs.tables(tmp_path / "met", 60)
    frame = whole.designs.assign(verdict="met")
    first = texts(whole.with_frames(designs=frame))[0]
    assert "58 of 58" in first
    assert " 95 % interval 93.8 to 100.0 %" in first
    facts = {"designs": 9, "possible": 9, "met": 9, "undescribed": 0, "requirements": 1, "which": {}}
    assert "(100 %, 95 % interval 100.0 % of such designs)" in say("space", share=(0.9999, 1.0), **facts)


def test_it_says_that_designs_drawn_at_random_have_runs(tables) -> None:
    about = {**tables.manifest["space"], "whole": {"best": 1, "at random": 8, "undecided": 5}}
    found = tables.with_frames()
    found.__dict__["manifest"] = {**tables.manifest, "space": about}
    found.__dict__["campaign"] = {**tables.campaign, "monte_carlo": {"runs": 852, "stop": None}}
    last = texts(found)[-1]
    assert last.startswith("The sections below describe the 2 designs with full analysis")
    assert "Each has 852 runs, including the 8 drawn at random." in last
    found.__dict__["campaign"] |= {"monte_carlo": None, "report": {"sections": ["summary", "space"]}}
    again = texts(found)[-1]
    assert again.startswith("The other sections describe")
    assert "runs" not in again


def test_results_that_hold_each_case_whole_have_no_such_section(tmp_path) -> None:
    assert space(load(synthetic.results(tmp_path, n_run=8))) == []


def test_one_design_analysed_whole_is_not_counted() -> None:
    said = say("space_whole", where="below", cases=1, why={"best": 1}, runs=40, is_most=True)
    assert said == (
        "The sections below describe the design with full analysis: history, budget and diagnostics (best: 1). "
        "It has up to 40 runs."
    )


def test_the_scatter_begins_with_the_axis_that_the_deciding_requirement_follows(tables) -> None:
    (block,) = [block for block in space(tables) if isinstance(block, DesignExplorer)]
    data = json.loads(block.data)
    assert data["columns"][data["x"]]["name"] == "bias repeatability"
