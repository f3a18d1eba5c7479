"""What is left to do: blocks at fixed places, and what they will take."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running.plan import Estimate, blocks, estimate

TWO = "axes: [{path: imu, cards: [imu/good, imu/poor]}]\n"


def asked(study: Any, *sets: str, runs: int = 100) -> tuple[Campaign, list[Case]]:
    study.append(f"{TWO}monte_carlo: {{runs: {runs}}}\n")
    campaign = load(study.path, sets)
    return campaign, cases(campaign)


def spans(study: Any, runs: int, done: list[tuple[int, int]]) -> list[tuple[int, int]]:
    campaign, found = asked(study, runs=runs)
    left = blocks(campaign, found[:1], {found[0].id: done})
    return [(unit.first_run, unit.n_run) for unit in left]


def test_blocks_do_not_depend_on_what_is_done_already(study) -> None:
    campaign, found = asked(study)
    left = blocks(campaign, found, {found[0].id: [(0, 40), (80, 20)]})
    assert [(unit.case.label, unit.first_run, unit.n_run) for unit in left] == [
        ("imu=good", 40, 40),
        ("imu=poor", 0, 40),
        ("imu=poor", 40, 40),
        ("imu=poor", 80, 20),
    ]


@pytest.mark.parametrize(
    ("runs", "done", "left"),
    [
        (100, [], [(0, 40), (40, 40), (80, 20)]),
        (100, [(0, 40), (40, 10)], [(40, 40), (80, 20)]),  # after 50 runs
        (50, [(0, 40), (40, 40), (80, 20)], [(40, 10)]),  # fewer than are there: the boundary block again
        (80, [(0, 40), (40, 40), (80, 20)], []),
        (8, [(0, 40)], [(0, 8)]),
        (1, [], [(0, 1)]),
    ],
)
def test_an_incomplete_block_is_flown_again_and_a_whole_one_never(study, runs, done, left) -> None:
    assert spans(study, runs, done) == left


def test_a_campaign_without_monte_carlo_has_no_blocks(study) -> None:
    campaign = load(study.path)
    assert blocks(campaign, cases(campaign), {}) == []


def estimated(study: Any, *sets: str, runs: int = 100, folder: Path = Path("results")) -> Estimate:
    campaign, found = asked(study, *sets, runs=runs)
    return estimate(campaign, folder, {case.id: 600.0 for case in found})


def test_time_grows_with_runs_rates_and_states(study) -> None:
    base = estimated(study)
    assert estimated(study, runs=200).seconds > 1.5 * base.seconds
    assert estimated(study, "filter.covariance_rate=100 Hz").seconds > 3.0 * base.seconds
    assert estimated(study, "filter.extra_states=[gyro_scale_factor]").seconds > base.seconds
    assert estimated(study, "filter.measurements=[position, velocity]").seconds < base.seconds


def test_memory_does_not_grow_with_runs_and_disk_does(study) -> None:
    base, more = estimated(study, runs=80), estimated(study, runs=800)
    assert more.memory_mb == base.memory_mb
    assert more.disk_mb > 3.0 * base.disk_mb


def test_what_is_stored_is_not_counted_again(study) -> None:
    campaign, found = asked(study)
    folder = Path("results/parts") / found[0].id
    folder.mkdir(parents=True)
    for name in ("0-40", "40-40", "80-40"):
        (folder / f"{name}.parquet").touch()
    plan = estimate(campaign, Path("results"), {case.id: 600.0 for case in found})
    assert [row["done"] for row in plan.cases] == [80, 0]  # the block of runs 80 to 119 is not that of 80 to 99
    assert plan.blocks == 4
