"""fit-unit and process-log on the command line: a card that a campaign can name, a figure, mistakes in one line."""

from __future__ import annotations

import json

from lvnav_trade.campaign.reading.load import load
from tests import recorded_log
from tests.campaign.test_unit_card import log_of
from tests.cli.calling import call


def test_a_log_becomes_a_card_that_a_campaign_names(tmp_path):
    card, figure = tmp_path / "unit.yaml", tmp_path / "allan.png"
    done = call("fit-unit", log_of(tmp_path, walk=3e-6), "-o", str(card), "--plot", str(figure), "--json")
    assert done.exit_code == 0, done.output
    content = json.loads(done.output)
    shown = {(one["sensor"], one["coefficient"]): one for one in content["coefficients"]}
    imu = load("campaigns/smoke.yaml", [f"base.imu={card}"]).base.imu
    assert imu.rate == 10.0
    written = imu.gyro.random_walk[1] / 2.908882086657216e-4
    assert abs(written / shown["gyro y", "random_walk"]["estimate"] - 1.0) < 1e-3
    assert figure.stat().st_size > 5000


def test_faults_of_a_log_are_one_line_and_nothing_is_written(tmp_path):
    card = tmp_path / "unit.yaml"
    for log, said in ((log_of(tmp_path, 100), "too short"), (str(tmp_path / "none.csv"), "cannot be read")):
        done = call("fit-unit", log, "-o", str(card))
        assert done.exit_code == 2
        assert said in done.output
        assert done.output.count("\n") == 1
        assert not card.exists()


def test_a_recorded_log_is_processed_and_nothing_else_is_touched(tmp_path):
    card, _ = recorded_log.write(tmp_path)
    out = tmp_path / "out"
    command = [
        "process-log",
        str(tmp_path / "drive.yaml"),
        str(card),
        "-o",
        str(out),
        "--outage",
        "15 s",
        "--every",
        "20",
    ]
    done = call(*command, "--json")
    assert done.exit_code == 0, done.output
    content = json.loads(done.output)
    assert [row["outages"] for row in content["summary"]] == [5]
    assert {"report.html", "report.md", "outages.csv", "summary.csv", "track.csv"} <= {
        one.name for one in out.iterdir()
    }
    assert call(*command).exit_code == 0  # again, over its own files
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    done = call(*command[:3], "-o", str(tmp_path / "mine"))
    assert done.exit_code == 2
    assert done.output.count("\n") == 1


def test_mistakes_of_process_log_are_one_line(tmp_path):
    card, _ = recorded_log.write(tmp_path)
    campaign, out = str(tmp_path / "drive.yaml"), str(tmp_path / "out")
    for changed, said in (
        ([campaign, str(tmp_path / "none.yaml"), "-o", out], "none.yaml"),
        ([campaign, str(card), "-o", out, "--outage", "15 m"], "15 m"),
        ([campaign, str(card), "-o", out, "--every", "0"], "above zero"),
        (["campaigns/smoke.yaml", str(card), "-o", out], "the filter takes"),
    ):
        done = call("process-log", *changed)
        assert done.exit_code == 2, done.output
        assert said in done.output
        assert done.output.strip().count("\n") == 0
    assert not (tmp_path / "out").exists()
