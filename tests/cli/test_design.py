"""estimate-q on the command line: a card that a campaign can name, tables beside it, mistakes in one line."""

from __future__ import annotations

from lvnav_trade.campaign.reading.load import load
from tests.building import LOOSE, flying, hop
from tests.cli.calling import call


def test_the_card_is_written_and_read_again_as_a_filter(tmp_path):
    card = tmp_path / "noise.yaml"
    with flying(hop()):
        done = call("estimate-q", "campaigns/smoke.yaml", "--set", LOOSE, "--runs", "10", "--out", str(card))
    assert done.exit_code == 0, done.output
    assert "whole flight" in done.output
    reported = next(
        line for line in done.output.splitlines() if line.startswith("the card: whole flight beyond")
    ).split()
    written = load("campaigns/smoke.yaml", [f"base.filter={card}"]).base.filter
    assert written.velocity_noise > 0.0
    assert reported[-2] == f"{written.velocity_noise:.3g}"
    assert card.with_suffix(".csv").is_file()
    assert card.with_suffix(".png").stat().st_size > 5000


def test_too_few_runs_and_an_unknown_case_are_reported_in_one_line(tmp_path):
    for more in (("--runs", "3"), ("--case", "nowhere")):
        done = call("estimate-q", "campaigns/smoke.yaml", "--set", LOOSE, "--out", str(tmp_path / "q.yaml"), *more)
        assert done.exit_code == 2


def test_gains_are_written_as_a_card_that_a_filter_names(tmp_path):
    card = tmp_path / "gains.yaml"
    with flying(hop()):
        done = call("schedule-gains", "campaigns/smoke.yaml", "--set", LOOSE, "--by", "time", "--out", str(card))
    assert done.exit_code == 0, done.output
    assert "position x" in done.output
    loaded = load("campaigns/smoke.yaml", [LOOSE, f"base.filter.gains={card}"])
    assert loaded.base.filter.gains.by == "time"


def test_a_filter_without_such_gains_is_reported_in_one_line(tmp_path):
    with flying(hop()):
        done = call(
            "schedule-gains", "campaigns/smoke.yaml", "--out", str(tmp_path / "gains.yaml"),
            "--set", "base.filter=filters/loose",
            "--set", "base.receiver.solution={kind: bancroft, range_sigma: 2 m, rate_sigma: 0.1 m/s}",
        )  # fmt: skip
    assert done.exit_code == 2
