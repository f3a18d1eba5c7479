"""A campaign over a trajectory file of the user's own: what identifies it, and what is refused before it flies."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from lvnav_trade import api
from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.cli import app
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.simulation.preparation.cache import trajectory_of

CAMPAIGN = """\
name: mine
seed: 1
base:
  trajectory: {card: trajectories/example_table, file: mine.csv}
  imu: imu/navigation
  constellation: constellations/gps_24
  receiver: receivers/l1_two_metre
  filter: filters/tight
  initial: {tilt: "0.1 deg", heading: "0.05 deg", position: "1 m", velocity: "0.01 m/s"}
"""


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, root: Path) -> Path:
    """Return the shipped example's rows as a user's own file beside her campaign."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "campaign.yaml").write_text(CAMPAIGN)
    (tmp_path / "mine.csv").write_bytes((root / "configs/trajectories/example_table.csv").read_bytes())
    return tmp_path / "mine.csv"


def raise_height(file: Path, after: float, rate: float) -> None:
    """Let the heights of a file grow at a rate (m/s) beside their velocity, after a time (s)."""
    lines = file.read_text().splitlines()
    for k, line in enumerate(lines[2:], start=2):
        fields = line.split(",")
        fields[3] = f"{float(fields[3]) + rate * max(0.0, float(fields[0]) - after):.4f}"
        lines[k] = ",".join(fields)
    file.write_text("\n".join(lines) + "\n")


def test_one_line_of_yaml_brings_a_file_of_ones_own(mine: Path) -> None:
    assert api.check("campaign.yaml").cases[0].scenario.trajectory.file == str(mine.resolve())


def test_the_digest_of_a_case_changes_with_the_content_of_the_file(mine: Path) -> None:
    first = cases(load("campaign.yaml"))[0].id
    Path("other.csv").write_bytes(mine.read_bytes())
    assert cases(load("campaign.yaml", ["trajectory.file=other.csv"]))[0].id == first
    raise_height(Path("other.csv"), 0.0, 1e-5)
    assert cases(load("campaign.yaml", ["trajectory.file=other.csv"]))[0].id != first


def test_a_file_that_changes_while_the_tool_is_open_is_another_flight(mine: Path) -> None:
    scenario = cases(load("campaign.yaml"))[0].scenario
    before = trajectory_of(scenario)
    raise_height(mine, 0.0, 1e-5)
    after = trajectory_of(scenario)
    assert before is not after
    assert trajectory_of(scenario) is after


def test_a_file_that_contradicts_itself_is_refused_at_its_place_in_the_campaign(mine: Path) -> None:
    raise_height(mine, 200.0, 0.1)
    with pytest.raises(InputError) as caught:
        api.check("campaign.yaml")
    (line,) = str(caught.value).splitlines()
    assert line.startswith("campaign.yaml:4:3: base.trajectory: ")
    assert "mine.csv: its velocity, integrated, and its position part by " in line
    with pytest.raises(InputError, match="integrated, and its position part by"):
        api.run("campaign.yaml", folder="results", report=False)
    assert not Path("results").exists()


def test_every_unit_of_an_axis_checks_the_file(mine: Path) -> None:
    raise_height(mine, 400.0, 0.1)
    raise_height(mine, 549.3, -0.1)
    assert api.check("campaign.yaml", ["imu=imu/tactical_fog"])
    Path("campaign.yaml").write_text(CAMPAIGN + "axes: [{path: imu, cards: [imu/tactical_fog, imu/navigation]}]\n")
    with pytest.raises(InputError, match="of what 'Navigation RLG"):
        api.check("campaign.yaml")


def bend_attitude(file: Path, at: float) -> None:
    """Turn the body by 60 deg about its y axis in the row of one time (s): a wrong digit of an angle does as much."""
    lines = file.read_text().splitlines()
    for k, line in enumerate(lines):
        fields = line.split(",")
        if not line.startswith(("#", "time")) and float(fields[0]) == at:
            q = np.array([float(one) for one in fields[-4:]])
            c, s = np.cos(np.pi / 6.0), np.sin(np.pi / 6.0)
            w, x, y, z = q
            turned = [w * c - y * s, x * c - z * s, y * c + w * s, z * c + x * s]
            lines[k] = ",".join([*fields[:-4], *(f"{one:.9f}" for one in turned)])
    file.write_text("\n".join(lines) + "\n")


def test_a_flight_beyond_what_is_usual_is_refused_at_the_field_that_would_allow_it(mine: Path) -> None:
    bend_attitude(mine, 200.0)
    with pytest.raises(InputError) as caught:
        api.check("campaign.yaml")
    (line,) = str(caught.value).splitlines()
    where, text = line.split(": base.trajectory.highest_rate: ")
    assert re.fullmatch(r".*\.yaml:\d+:\d+", where)
    assert re.search(
        r"mine\.csv: pitch and yaw rate of [\d.]+ deg/s at (199|200)\S* s; at most 60 deg/s is usual: is a", text
    )
    assert text.endswith("; if it is true, raise highest_rate")
    done = CliRunner().invoke(app, ["check", "campaign.yaml"])
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)


def test_a_limit_that_is_set_too_low_is_named_where_it_was_written(mine: Path) -> None:
    own = CAMPAIGN.replace("file: mine.csv}", "file: mine.csv, highest_load: 2 g}")
    Path("campaign.yaml").write_text(own)
    with pytest.raises(
        InputError, match=r"^campaign.yaml:4:\d+: base.trajectory.highest_load: .* at most 2 g is allowed"
    ):
        api.check("campaign.yaml")


def test_what_a_card_allows_beyond_the_usual_leads_what_check_prints(mine: Path) -> None:
    bend_attitude(mine, 200.0)
    allowed = ["--set", "trajectory.highest_rate=900 deg/s"]
    done = CliRunner().invoke(app, ["check", "campaign.yaml", *allowed])
    assert done.exit_code == 0
    first, last = done.output.splitlines()
    assert first.startswith("beyond usual limits: example_table: pitch and yaw rate of ")
    assert first.endswith("(usually at most 60 deg/s)")
    assert last == "campaign.yaml: good, 1 case"
    found = json.loads(CliRunner().invoke(app, ["check", "campaign.yaml", *allowed, "--json"]).output)
    assert first == f"beyond usual limits: {found['beyond_limits'][0]}"
    assert (found["warnings"], found["notes"]) == ([], [])
    unneeded = api.check("campaign.yaml", ["trajectory.highest_rate=900 deg/s", "trajectory.highest_load=90 g"]).remarks
    assert unneeded["beyond_limits"] == found["beyond_limits"]


def test_events_that_are_not_declared_are_suggested_by_check(mine: Path) -> None:
    done = CliRunner().invoke(app, ["check", "campaign.yaml", "--set", "trajectory.events.stage2_ignition=170 s"])
    said = "the specific force jumps where no event is declared; as YAML: events: {stage"
    (line,) = done.stderr.splitlines() if done.exit_code else done.output.splitlines()[:1]
    assert f"{said}2_ignition: 158.49 s}}" in line
    done = CliRunner().invoke(app, ["check", "campaign.yaml", "--set", "trajectory.events={}"])
    assert done.exit_code == 2
    assert f"{said}1_cutoff: 150.49 s, stage2_ignition: 158.49 s, stage2_cutoff: 549.31 s}}" in done.stderr


def test_the_verb_writes_the_flight_of_a_card(mine: Path) -> None:
    done = CliRunner().invoke(app, ["kml", "trajectories/example_table", "-o", "flight.kml"])
    assert (done.exit_code, done.output) == (0, "kml: flight.kml\n")
    names = [name.text for name in ET.parse("flight.kml").getroot().findall(".//{*}name")]
    assert {"example_table", "liftoff", "injection"} <= set(names)


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (["trajectories/none", "-o", "a.kml"], "no card 'trajectories/none'"),
        (["trajectories/example_table", "-o", "a.kml", "--ellipses"], "a trajectory has no errors; give a folder"),
        (["trajectories/example_table", "-o", "a.kml", "--every", "0"], "should be above zero"),
        ([".", "-o", "a.kml"], "no results here"),
    ],
)
def test_a_wrong_call_of_the_verb_is_one_line(mine: Path, arguments: list[str], fault: str) -> None:
    done = CliRunner().invoke(app, ["kml", *arguments])
    assert done.exit_code == 2
    assert fault in done.output


def test_an_event_outside_a_file_is_reported_once_for_cases_that_differ_in_their_imu(mine: Path) -> None:
    text = Path("campaign.yaml").read_text()
    imus = "axes:\n  - {path: imu, cards: [imu/navigation, imu/tactical_fog, imu/tactical_mems]}\n"
    Path("campaign.yaml").write_text(text + imus)
    with pytest.raises(InputError) as refused:
        api.check("campaign.yaml", ["trajectory.events.injection=9000 s"])
    (record,) = refused.value.records
    assert "event 'injection' at 9000 s is outside the rows" in str(record)
