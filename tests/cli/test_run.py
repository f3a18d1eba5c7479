"""The verbs that compute: what they refuse, and what a plan shows."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from lvnav_trade.campaign.running import selfcheck
from lvnav_trade.covariance.selfcheck.check import CheckResult
from tests.cli.calling import call

SMOKE = "campaigns/smoke.yaml"


@pytest.mark.parametrize("name", ["demo", "smoke", "falcon9_formosat5"])
def test_a_campaign_of_the_tool_is_good_from_any_folder(events: dict[str, float], name: str) -> None:
    result = call("check", f"campaigns/{name}.yaml")
    assert result.output.startswith(f"campaigns/{name}.yaml: good, ")
    assert result.exit_code == 0


def test_gains_of_another_flight_are_a_warning(events: dict[str, float]) -> None:
    gains = "filter=filters/loose_gains_004_12_by_event"
    result = call("check", SMOKE, "--set", gains)
    line = "base: filter.gains: computed for the flight 'recovery_polar', used on "
    assert result.output.startswith(f"warning: {line}")
    assert result.exit_code == 0
    (reported,) = json.loads(call("check", SMOKE, "--set", gains, "--json").output)["warnings"]
    assert reported.startswith(line)


@pytest.mark.parametrize(("figure", "code"), [(0.1, 0), (0.5, 1), (float("nan"), 1)])
def test_a_self_check_prints_a_line_a_check_and_fails_with_one(
    events: dict[str, float], monkeypatch: pytest.MonkeyPatch, figure: float, code: int
) -> None:
    checks = [
        CheckResult("Jacobian", "pseudorange", figure, upper_limit=0.3, remark="position x"),
        CheckResult("draws", "x", reason="none"),
    ]
    monkeypatch.setattr(selfcheck, "check_scenario", lambda *given: checks)
    result = call("selfcheck", SMOKE, "-j", "1", "-q")
    assert result.exit_code == code
    line = next(line for line in result.output.splitlines() if "pseudorange" in line)
    assert line.split()[:3] == ["all", "Jacobian", "pseudorange"]
    assert ("at most 0.3" in line, "passed" in line) == (True, code == 0)
    content = json.loads(call("selfcheck", SMOKE, "-j", "1", "-q", "--json").stdout)
    assert content["exit_code"] == code
    assert content["counts"] == {"passed": 1 - code, "failed": code, "not checked": 1}
    assert (content["checks"][0]["high"], content["checks"][1]["figure"]) == (0.3, None)


def test_a_self_check_of_a_bad_campaign_is_exit_code_two(events: dict[str, float]) -> None:
    assert call("selfcheck", SMOKE, "--set", "filter.gate=-1").exit_code == 2


def test_a_fault_after_the_flight_is_refused(events: dict[str, float]) -> None:
    result = call("check", SMOKE, "--set", "faults=[{start: 621 s, duration: 5 s, kind: satellite_outage}]")
    assert result.exit_code == 2
    assert result.stderr == "--set: base.faults.0.start: '621 s' is 621 s, at or after the end of the flight (620 s)\n"


def test_a_requirement_at_an_unknown_event_is_refused(events: dict[str, float]) -> None:
    result = call("check", "campaigns/demo.yaml", "--set", "requirements.0.at=injektion")
    assert result.exit_code == 2
    assert result.stderr == (
        "--set: requirements.0.at: 'injektion' is not an event of the trajectory (did you mean 'injection'?)\n"
    )


def test_a_campaign_that_is_not_there_is_exit_code_two(events: dict[str, float]) -> None:
    result = call("run", "nothing.yaml")
    assert (result.exit_code, result.stderr) == (2, "nothing.yaml: no such file\n")


def test_the_plan_shows_cases_and_what_is_done(events: dict[str, float]) -> None:
    content = json.loads(call("plan", "campaigns/demo.yaml", "--json").stdout)
    assert [case["label"] for case in content["cases"]][:2] == [
        "imu=tactical_fog, filter=loose",
        "imu=tactical_fog, filter=tight",
    ]
    blocks = 5 + 22  # 40 runs of five cases, 852 of the selected one
    assert content["blocks"] == blocks
    assert {case["done"] for case in content["cases"]} == {0}
    part = Path("results/demo/parts", content["cases"][0]["id"])
    part.mkdir(parents=True)
    (part / "0-40.parquet").touch()
    again = json.loads(call("plan", "campaigns/demo.yaml", "--json").stdout)
    assert again["cases"][0]["done"] == 40
    assert again["blocks"] == blocks - 1
    assert 0 < again["seconds"] < content["seconds"]
    assert "about" in call("plan", "campaigns/demo.yaml").stdout


@pytest.mark.parametrize(
    ("count", "sets", "line"),
    [
        (20, (), None),
        (21, (), "21 cases, 168 runs, 0 of them done; `--json` lists the cases"),
        (21, ("--set", "monte_carlo=null"), "21 cases, linear covariance alone; `--json` lists the cases"),
    ],
)
def test_the_plan_of_many_cases_is_a_summary(count: int, sets: tuple[str, ...], line: str | None) -> None:
    axis = f"axes=[{{path: initial.heading, linspace: [0.1 deg, 2 deg, {count}]}}]"
    lines = call("plan", "smoke", "--set", axis, *sets).stdout.splitlines()
    assert sum("heading=" in one for one in lines) == (0 if line else count)
    assert line is None or line in lines


def test_the_plan_of_many_designs_is_a_line_and_a_record(events: dict[str, float]) -> None:
    sets = ("--set", "samples=600", "--set", "store=events")
    lines = call("plan", "campaigns/trade/space.yaml", *sets).stdout.splitlines()
    assert lines[0] == "600 designs: a row for each (store: events), 14 whole at most, 11928 runs of these at most"
    assert " MB of disk (" in lines[-1]
    found = json.loads(call("plan", "campaigns/trade/space.yaml", *sets, "--json").stdout)
    assert found["cases"] == []
    many = found["designs"]
    assert (many["store"], many["designs"], many["whole"], many["runs"]) == ("events", 600, 14, 11928)
    assert many["most_mb"] > many["disk_mb"] == found["disk_mb"] > 0.0
    assert json.loads(call("plan", "campaigns/demo.yaml", "--json").stdout)["designs"] is None


def test_a_replay_of_an_unknown_case_is_refused(events: dict[str, float]) -> None:
    result = call("replay", "campaigns/demo.yaml", "imu=tactical_fog, filter=tigth", "0")
    assert result.exit_code == 2
    assert "(did you mean 'imu=tactical_fog, filter=tight'?)" in result.stderr
