"""The first section answers in words."""

from __future__ import annotations

import json
import re
import shutil

import pandas as pd

from lvnav_trade.metrics import METRICS
from lvnav_trade.report import build
from lvnav_trade.report.blocks import Text, number
from lvnav_trade.report.summary import SIGNS, _largest_sources, _undecided, answers, summary
from lvnav_trade.store.read import load
from tests import synthetic


def test_the_first_section_answers_in_a_few_lines(text):
    first = text[text.index('id="summary"') : text.index('id="requirements"')]
    lines = re.findall(r"<p>(.*?)</p>", first)
    assert len(lines) <= 5
    assert "<strong>All 3 requirements together.</strong> 2 cases: violated: 2 (" in lines[0]
    assert "<strong>Margins.</strong> worst: imu=coarse (" in lines[1]
    assert "2 of 160 runs failed and count against every requirement, the first at 50 s: from its failure on" in first
    assert "best velocity first. Runs that failed before are left out of it." in first


def test_the_matrix_has_all_cases_the_smallest_margin_first(page):
    tables = load(page.parent)
    matrix = next(block for block in summary(tables) if block.kind == "table")
    assert [row[0] for row in matrix.rows] == ["imu=coarse", "imu=fine"]
    frame = METRICS["margins"](tables)
    for row in matrix.rows:
        for name, cell in zip(matrix.head[1:4], row[1:4], strict=True):
            found = frame[(frame.case == row[0]) & (frame.requirement == name)].iloc[0]
            estimate, limit = found.estimate, found.limit
            assert found.margin_ratio == 1.0 - estimate / limit
            over = f"{100 * found.margin_ratio:+.0f} %" if estimate < 2 * limit else f"{number(estimate / limit)} times"
            assert cell.startswith(f"{SIGNS[found.verdict]} {over}")


def test_without_runs_margins_are_those_of_linear_covariance(tmp_path):
    tables = load(synthetic.results(tmp_path, n_run=0))
    frame = METRICS["margins"](tables)
    alone = METRICS["expected"](tables).set_index(["requirement", "case"])
    assert set(frame.by) == {"LinCov"}
    for row in frame.itertuples():
        assert (row.verdict, row.estimate, row.unit) == tuple(
            alone.loc[(row.requirement, row.case), ["verdict", "estimate", "unit"]]
        )
    assert "linear covariance's" in next(block for block in summary(tables) if block.kind == "table").caption


def test_each_requirement_is_answered_in_words(text):
    said = text[text.index('id="requirements"') : text.index('id="trajectory"')]
    assert "<strong>Met by:</strong> imu=fine" in said
    assert "3D velocity error below 2 m/s at injection in 90 % of flights" in said
    assert "Attitude error roll below 1000 mrad (57.3 deg) at injection" in said
    assert "further good runs each would decide" in said
    assert "imu=coarse: sigma of gyro bias times 0.826 (72 % of the mean square)" in said
    assert "<strong>Linear covariance alone:</strong> imu=fine: met, more than 99.9 % of flights" in said


def test_the_worst_run_has_the_command_that_flies_it_again(page):
    tables = load(page.parent)
    worst = next(block for block in answers(tables) if block.kind == "table")
    digests = {label: case for case, label in tables.labels.items()}
    for _, case, run, error, command in worst.rows:
        assert command == f"lvnav-trade replay . {digests[case]} {run}"
        assert error
    pictures = next(block for block in answers(tables) if block.kind == "more" and "worst runs" in block.title).blocks
    assert {one.name for one in pictures} == {f"worst_run-{digests[row[1]]}-{row[2]}" for row in worst.rows}


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
        "a: specific force 33.7 g at 268 s; b: roll rate 3000 deg/s. All results below rest on that.",
        "Beyond usual limits:",
    )
    leads = [getattr(block, "lead", "") for block in others]
    assert leads.index("Note:") == leads.index("Warning:") + 1
    assert "Beyond usual limits:" not in leads
    plain = [getattr(block, "lead", "") for block in summary(load(page.parent))]
    assert not {"Beyond usual limits:", "Note:"} & set(plain)


def test_a_violated_phase_names_the_largest_source_at_its_worst_event(page):
    tables = load(page.parent)
    asked = {"name": "a", "metric": "velocity_error_3d", "during": "flight", "below": "0.1 m/s", "probability": 0.9}
    violated = pd.DataFrame({"case": ["imu=coarse"]})
    assert _largest_sources(tables, asked, violated) == [
        "Largest source in the 3D error, by linear covariance: imu=coarse: gyro bias (75 % of the variance at "
        "injection)."
    ]


def test_cases_that_linear_covariance_does_not_describe_name_no_source_by_it_and_one_reason(tmp_path):
    page = build(synthetic.results(tmp_path, n_run=40, rejects=0.03), ["summary"])
    first = page.read_text(encoding="utf-8")
    assert first.count("Not applicable:") == 1
    assert "imu=coarse" in first[first.index("Not applicable:") :]
    tables = load(tmp_path)
    asked = {"name": "a", "metric": "velocity_error_3d", "at": "injection", "below": "0.1 m/s", "probability": 0.9}
    assert _largest_sources(tables, asked, pd.DataFrame({"case": list(tables.labels.values())})) == []


def test_of_many_cases_the_first_are_named_and_the_others_counted():
    cases = [f"case {k}" for k in range(36)]
    rows = pd.DataFrame({"case": cases, "runs_to_decide": 5})
    (said,) = _undecided(rows)
    assert said == "case 0 and case 1 and case 2 and case 3 and 32 more (5 further good runs each would decide)"
    assert _undecided(rows[:5]) == [f"{' and '.join(cases[:5])} (5 further good runs each would decide)"]
