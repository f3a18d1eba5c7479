"""Requirements that the runs of a campaign cannot show."""

from __future__ import annotations

import json

import pytest

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running.demonstrable import required_run_counts, requirements_beyond_run_count
from lvnav_trade.results.requirements.requirements import decide
from lvnav_trade.results.statistics.probability import is_demonstrated
from tests.cli.calling import call
from tests.cli.conftest import events

__all__ = ["events"]

STATED = "requirements=[{name: orbit, metric: perigee_error, probability: 0.9973, below: 1 km, confidence: 0.9}]"
SENTENCE = "orbit: 200 runs cannot show 99.73 % at 90 % confidence: 852 are needed, 1,080 with stop: decided"


def sets(*more: str) -> list[str]:
    return [part for one in (STATED, *more) for part in ("--set", one)]


def test_the_runs_needed_are_the_fewest_that_decide_without_a_failure() -> None:
    fixed, in_order = required_run_counts(0.9973, 0.9, 40)
    assert is_demonstrated(fixed, 0, 0.9973, 0.9)
    assert not is_demonstrated(fixed - 1, 0, 0.9973, 0.9)
    looks = in_order // 40
    assert decide([0] * looks, 0.9973, 0.9, 40) == ("met", in_order)
    assert decide([0] * (looks - 1), 0.9973, 0.9, 40)[0] == "undecided"


@pytest.mark.parametrize(
    ("card", "count"),
    [
        ("{runs: 200}", 1), ("{runs: 851}", 1), ("{runs: 852}", 0), ("{runs: 1040, stop: decided}", 1),
        ("{runs: 1080, stop: decided}", 0), ("null", 0),
    ],
)  # fmt: skip
def test_fewer_runs_than_that_are_reported(card: str, count: int) -> None:
    found = load("campaigns/smoke.yaml", [STATED, f"monte_carlo={card}"])
    assert len(list(requirements_beyond_run_count(found))) == count


@pytest.mark.parametrize("verb", ["check", "plan"])
def test_check_and_plan_warn_and_are_strict_on_demand(events: dict[str, float], verb: str) -> None:
    asked = (verb, "campaigns/smoke.yaml", *sets("monte_carlo.runs=200"))
    result = call(*asked)
    assert result.exit_code == 0
    assert f"warning: --set: requirements.0: {SENTENCE}" in result.output
    assert SENTENCE in json.loads(call(*asked, "--json").output)["warnings"][0]
    strict = call(*asked, "--strict")
    assert strict.exit_code == 2
    assert strict.stderr.strip().endswith(SENTENCE)
    assert call(verb, "campaigns/smoke.yaml", *sets("monte_carlo.runs=852"), "--strict").exit_code == 0
