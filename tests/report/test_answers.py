"""Each requirement is answered in words."""

from __future__ import annotations

import pandas as pd

from lvnav_trade.report.answers import _largest_sources, _undecided_sentences, answers
from lvnav_trade.results.tables.read import load


def test_each_requirement_is_answered_in_words(text):
    said = text[text.index('id="requirements"') : text.index('id="trajectory"')]
    assert "<strong>Met by:</strong> imu=fine" in said
    assert "3D velocity error below 2 m/s at injection in 90 % of flights" in said
    assert "Attitude error roll below 1000 mrad (57.3 deg) at injection" in said
    assert "further runs each without a failure would decide" in said
    assert (
        "<strong>To comply:</strong> imu=coarse: reduce the gyro bias to 82.6 % of the present size (1 sigma), "
        "estimated with frozen gains. This error contributes 72 % of the mean-square velocity error at injection."
    ) in said
    assert "<strong>Linear covariance alone:</strong> imu=fine: met, more than 99.9 % of flights" in said


def test_the_worst_run_has_the_command_that_flies_it_again(page):
    tables = load(page.parent)
    worst = next(block for block in answers(tables) if block.block_type == "table")
    digests = {label: case for case, label in tables.labels.items()}
    for _, case, run, error, command in worst.rows:
        assert command == f"lvnav-trade replay . {digests[case]} {run}"
        assert error
    pictures = next(
        block for block in answers(tables) if block.block_type == "more" and "worst runs" in block.title
    ).blocks
    assert {one.name for one in pictures} == {f"worst_run-{digests[row[1]]}-{row[2]}" for row in worst.rows}


def test_a_violated_phase_names_the_largest_source_at_its_worst_event(page):
    tables = load(page.parent)
    asked = {"name": "a", "metric": "velocity_error_3d", "during": "flight", "below": "0.1 m/s", "probability": 0.9}
    violated = pd.DataFrame({"case": ["imu=coarse"]})
    assert _largest_sources(tables, asked, violated) == [
        "Largest source in the 3D error, by linear covariance: imu=coarse: gyro bias (75 % of the variance at "
        "injection)."
    ]


def test_of_many_cases_the_first_are_named_and_the_others_counted():
    cases = [f"case {k}" for k in range(36)]
    rows = pd.DataFrame({"case": cases, "runs_to_decide": 5})
    (said,) = _undecided_sentences(rows)
    assert (
        said
        == "case 0 and case 1 and case 2 and case 3 and 32 more (5 further runs each without a failure would decide)"
    )
    assert _undecided_sentences(rows[:5]) == [
        f"{' and '.join(cases[:5])} (5 further runs each without a failure would decide)"
    ]
