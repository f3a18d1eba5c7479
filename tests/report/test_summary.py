"""The first section answers in words."""

from __future__ import annotations

import json
import re
import shutil

import pandas as pd
import pytest

from lvnav_trade.report import build
from lvnav_trade.report.answers import _largest_sources
from lvnav_trade.report.blocks import Text, number
from lvnav_trade.report.summary import SIGNS, _verdict, summary
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.requirements.requirements import with_unit
from lvnav_trade.results.tables.read import load
from tests import synthetic


def test_the_first_section_answers_in_a_few_lines(text):
    first = text[text.index('id="summary"') : text.index('id="requirements"')]
    lines = re.findall(r"<p>(.*?)</p>", first)
    assert len(lines) <= 5
    assert (
        "<strong>All 3 requirements together.</strong> None of 2 designs meets all 3 requirements; 2 violate at least "
        "one (loose bound: 1, tight bound: 2)."
    ) in lines[0]
    assert "<strong>Margins.</strong> worst design: imu=coarse (" in lines[1]
    assert (
        "2 of 160 runs failed and count against every requirement, the first at 50 s. After its failure, a run is"
        in first
    )
    assert "best velocity first. Runs that failed before this event are excluded." in first


def test_the_matrix_has_all_cases_the_smallest_margin_first(page):
    tables = load(page.parent)
    matrix = next(block for block in summary(tables) if block.block_type == "table")
    assert [row[0] for row in matrix.rows] == ["imu=coarse", "imu=fine"]
    stated = tables.campaign["requirements"]
    limit = METRICS["margins"](tables).iloc[0]
    assert matrix.caption.startswith(f"Required: {limit.requirement} below {with_unit(limit.limit, limit.unit)} at ")
    assert matrix.caption.count(" of flights") == len(stated)
    frame = METRICS["margins"](tables)
    for row in matrix.rows:
        for name, cell in zip(matrix.head[1:4], row[1:4], strict=True):
            found = frame[(frame.case == row[0]) & (frame.requirement == name)].iloc[0]
            estimate, limit = found.estimate, found.limit
            assert found.margin_ratio == 1.0 - estimate / limit
            column = frame[frame.requirement == name]
            beyond = (column.estimate >= 2 * column.limit).any()  # one scale in a column
            over = f"{number(estimate / limit)} times" if beyond else f"{100 * found.margin_ratio:+.0f} %"
            assert cell.startswith(f"{SIGNS[found.verdict]} {over}")


def test_without_runs_margins_are_those_of_linear_covariance(tmp_path):
    tables = load(synthetic.results(tmp_path, n_run=0))
    frame = METRICS["margins"](tables)
    alone = METRICS["expected_verdicts"](tables).set_index(["requirement", "case"])
    assert set(frame.by) == {"LinCov"}
    for row in frame.itertuples():
        assert (row.verdict, row.estimate, row.unit) == tuple(
            alone.loc[(row.requirement, row.case), ["verdict", "estimate", "unit"]]
        )
    caption = next(block for block in summary(tables) if block.block_type == "table").caption
    assert "Verdicts and margins are by linear covariance." in caption


# case, requirement, verdict, by
_MIXED = [
    ("a", "x", "met", "LinCov"), ("a", "y", "met", "LinCov"), ("b", "x", "met", "runs"), ("b", "y", "met", "runs"),
    ("c", "x", "met", "LinCov"), ("c", "y", "violated", "runs"), ("d", "x", "met", "LinCov"),
    ("d", "y", "violated", "LinCov"), ("e", "x", "met", "LinCov"), ("e", "y", "undecided", "runs"),
]  # fmt: skip


@pytest.mark.parametrize(("rows", "said"), [
    (_MIXED, "2 of 5 designs meet both requirements, 1 shown by runs and 1 by linear covariance; 1 is undecided "
             "(y: 1); 2 violate at least one (y: 2), 1 shown by runs and 1 by linear covariance."),
    (_MIXED[2:6], "1 of 2 designs meets both requirements, shown by runs; 1 violates one (y: 1), shown by runs."),
    ([("a", "x", "met", "runs"), ("a", "y", "met", "LinCov"), ("b", "x", "violated", "runs")],
     "1 of 2 designs meets both requirements, by linear covariance in part; 1 violates one (x: 1), shown by runs."),
    ([(*row[:3], "runs") for row in _MIXED],
     "2 of 5 designs meet both requirements; 1 is undecided (y: 1); 2 violate at least one (y: 2)."),
    ([(*row[:3], "LinCov") for row in _MIXED[:4]],
     "By linear covariance, without a demonstration by runs: 2 of 2 designs meet both requirements.")])  # fmt: skip
def test_what_verdicts_rest_on_is_counted_as_the_matrix_marks_it(rows, said):
    """A design complies by its runs where all its requirements do; the one that it violates counts for the others."""
    (block,) = _verdict(pd.DataFrame(rows, columns=["case", "requirement", "verdict", "by"]))
    assert block == Text(said, "Both requirements together.")


def test_warnings_of_a_campaign_stand_in_the_first_section(page, tmp_path):
    folder = shutil.copytree(page.parent, tmp_path / "warned")
    manifest = json.loads((folder / "manifest.json").read_text())
    line = "imu=fine: filter.gains: computed for the flight 'a', used on 'b'"
    (folder / "manifest.json").write_text(json.dumps({**manifest, "warnings": [line]}))
    texts = [
        block for block in summary(load(folder)) if getattr(block, "lead", getattr(block, "bold", "")) == "Warning:"
    ]
    assert len(texts) == 1
    assert line in str(texts[0])


def test_what_is_beyond_usual_limits_leads_the_first_section_and_notes_follow_warnings(page, tmp_path):
    folder = shutil.copytree(page.parent, tmp_path / "beyond")
    manifest = json.loads((folder / "manifest.json").read_text())
    said = {"beyond_limits": ["a: specific force 33.7 g at 268 s", "b: roll rate 3000 deg/s"], "notes": ["a: a hole"]}
    (folder / "manifest.json").write_text(json.dumps({**manifest, **said, "warnings": ["a: a warning"]}))
    first, *others = summary(load(folder))
    assert first == Text(
        "a: specific force 33.7 g at 268 s; b: roll rate 3000 deg/s. All results below depend on it.",
        "Outside validated limits:",
    )
    leads = [getattr(block, "lead", "") for block in others]
    assert leads.index("Note:") == leads.index("Warning:") + 1
    assert "Outside validated limits:" not in leads
    plain = [getattr(block, "lead", "") for block in summary(load(page.parent))]
    assert not {"Outside validated limits:", "Note:"} & set(plain)


def test_cases_that_linear_covariance_does_not_describe_name_no_source_by_it_and_one_reason(tmp_path):
    page = build(synthetic.results(tmp_path, n_run=40, rejects=0.03), ["summary"])
    first = page.read_text(encoding="utf-8")
    assert first.count("Not applicable:") == 1
    assert "imu=coarse" in first[first.index("Not applicable:") :]
    tables = load(tmp_path)
    asked = {"name": "a", "metric": "velocity_error_3d", "at": "injection", "below": "0.1 m/s", "probability": 0.9}
    assert _largest_sources(tables, asked, pd.DataFrame({"case": list(tables.labels.values())})) == []
