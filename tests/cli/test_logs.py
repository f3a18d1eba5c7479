"""fit-unit on the command line: a card that a campaign can name, a figure, mistakes in one line."""

from __future__ import annotations

import json

from lvnav_trade.campaign.reading.load import load
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
