"""Inverse questions of linear covariance."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.definition.searches import Solve, Vary
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.search.solve import parse_problem, solve, span
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.report.search import solution_blocks


def test_the_words_of_the_command_line_are_the_block_of_the_campaign() -> None:
    asked = parse_problem(["initial.heading=0.01 deg:2 deg"], log=True, meet=["x"])
    assert asked == Solve(vary=(Vary(path="initial.heading", between=("0.01 deg", "2 deg"), log=True),), meet=("x",))
    ends, grid = span(asked.vary[0])
    assert (ends.unit, grid[0], grid[-1]) == ("deg", 0.01, pytest.approx(2.0))
    with pytest.raises(InputError, match="should be PATH=LEAST:LARGEST"):
        parse_problem(["initial.heading"], log=False, meet=[])
    with pytest.raises(InputError, match="a logarithm needs ends above zero"):
        span(Vary(path="x", between=("0 deg", "1 deg"), log=True))


SHORT = [
    "monte_carlo={runs: 80}",
    "requirements=[{name: tilt, metric: attitude_error_3d, at: liftoff, probability: 0.95, below: 3 mrad}]",
]


@pytest.fixture(scope="module")
def campaign():
    return load("campaigns/smoke.yaml", SHORT)


@pytest.mark.slow
def test_frozen_and_re_tuned_are_found_on_a_flight_and_runs_confirm_both_sides(campaign) -> None:
    asked = Solve(vary=(Vary(path="initial.tilt", between=("0.01 deg", "1 deg"), log=True, points=3),), margin=0.3)
    found = solve(campaign, asked)
    answers = found.answers.set_index("tuning")
    assert set(answers.index) == {"re-tuned", "frozen"}
    assert (answers.limiting_requirement == "tilt").all()
    np.testing.assert_allclose(answers.base_value, np.degrees(cases(campaign)[0].scenario.initial.tilt))
    assert found.confirmed.agree.all()
    below, above = (found.confirmed[found.confirmed["value"] < answers.answer.min()], found.confirmed)
    assert below.beyond.mean() < above.beyond.max()


def test_an_unknown_requirement_is_refused(campaign) -> None:
    asked = parse_problem(["initial.tilt=0.01 deg:1 deg"], log=False, meet=["rol"])
    with pytest.raises(InputError, match="no requirement 'rol'"):
        solve(campaign, asked)


def test_an_answer_that_linear_covariance_does_not_describe_says_so_in_its_table_and_on_its_report() -> None:
    """A mode logic decides run by run."""
    logic = "base.filter={card: filters/loose, feedback: open, logic: {start_after: 5, correct_after: 60 s}}"
    campaign = load("campaigns/smoke.yaml", ["monte_carlo=null", *SHORT[1:], logic])
    found = solve(campaign, Solve(vary=(Vary(path="initial.tilt", values=("0.01 deg", "0.02 deg")),)))
    assert found.answers.remark.str.contains("met up to the largest value; not applicable, confirm by runs").all()
    assert found.answers.remark.str.contains("a logic of its own").all()
    said = solution_blocks(found.answers, found.intervals, found.scanned, found.confirmed, found.names)[0]
    assert "Not applicable, confirm by runs: the filter starts" in str(said)
