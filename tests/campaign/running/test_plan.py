"""What is left to do: blocks at fixed places, and what they will take."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest

from lvnav_trade import api
from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running.plan import Estimate, blocks, estimate
from lvnav_trade.campaign.running.provenance import manifest
from lvnav_trade.campaign.running.stopping import Stopping

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
    assert estimated(study, runs=400).seconds > 1.5 * base.seconds
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


def test_the_selected_cases_have_all_runs_and_the_others_fewer(study) -> None:
    study.append(f"{TWO}monte_carlo: {{runs: 100, selected: {{imu: poor}}}}\n")
    campaign = load(study.path)
    found = cases(campaign)
    assert [(unit.case.label, unit.first_run, unit.n_run) for unit in blocks(campaign, found, {})] == [
        ("imu=good", 0, 40), ("imu=poor", 0, 40), ("imu=poor", 40, 40), ("imu=poor", 80, 20),
    ]  # fmt: skip
    made = estimate(campaign, Path("results"), {case.id: 600.0 for case in found})
    assert [row["runs"] for row in made.cases] == [40, 100]
    stopping = Stopping(campaign)
    assert [stopping.runs(case.id) for case in found] == [40, 100]
    assert manifest(campaign, found)["asked_runs_of"] == {found[0].id: 40, found[1].id: 100}


def test_the_other_cases_may_do_without_runs(study) -> None:
    study.append(f"{TWO}monte_carlo: {{runs: 40, selected: {{imu: poor}}, other_runs: 0}}\n")
    campaign = load(study.path)
    assert [unit.case.label for unit in blocks(campaign, cases(campaign), {})] == ["imu=poor"]


SMALL = ("axes=[{path: filter, cards: [filters/tight, filters/tight_extended]}]", "monte_carlo.runs=80")


def taken(folder: Path, *sets: str) -> tuple[float, float]:
    """Return seconds of the processor and megabytes on disk of a campaign run in this process."""
    start = time.process_time()
    api.run("smoke", sets, folder, jobs=1, report=False)
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return time.process_time() - start, size / 1e6


@pytest.mark.slow
def test_a_campaign_takes_the_time_and_the_place_that_plan_says(tmp_path: Path) -> None:
    """Kernels are compiled before: `plan` leaves that out. Of the time half to double, because machines differ."""
    taken(tmp_path / "first", *SMALL)
    seconds, size = taken(tmp_path / "second", *SMALL)
    found = api.plan("smoke", SMALL, tmp_path / "third")
    assert 0.5 < seconds / found.seconds < 2.0
    assert 1.0 / 1.5 < size / found.disk_mb < 1.5
    linear = (SMALL[0], "monte_carlo=null")
    seconds, size = taken(tmp_path / "linear", *linear)
    found = api.plan("smoke", linear, tmp_path / "third")
    assert 0.5 < seconds / found.seconds < 2.0
    assert 1.0 / 1.5 < size / found.disk_mb < 1.5
