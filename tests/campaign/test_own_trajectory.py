"""A campaign over a trajectory file of the user's own: what identifies it, and what is refused before it flies."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lvnav_trade import api
from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.cli import app
from lvnav_trade.engines.setup.prepare import trajectory_of
from lvnav_trade.errors import InputError

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
    assert cases(api.check("campaign.yaml"))[0].scenario.trajectory.file == str(mine.resolve())


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
    with pytest.raises(InputError, match="of what 'Navigation grade"):
        api.check("campaign.yaml")


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
