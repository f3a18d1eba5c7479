"""What many designs take, and what this machine has no room for."""

from __future__ import annotations

import shutil

import pytest

from lvnav_trade.campaign.definition.run_counts import MonteCarlo
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.space import design_plan as module
from lvnav_trade.campaign.space.design_plan import estimate_designs, refuse_too_large
from lvnav_trade.quantities.errors import InputError

FLIGHTS = {"a case": {"liftoff": 0.0, "staging": 150.0, "injection": 600.0}}


def test_time_and_disk_grow_with_the_designs(written, tmp_path) -> None:
    few, many = (estimate_designs(load(written, [f"samples={n}"]), tmp_path, FLIGHTS) for n in (1000, 10_000))
    assert (few.designs, many.designs, few.whole, few.runs) == (1000, 10_000, 9, 0)
    assert 8.0 < many.seconds / few.seconds < 10.0
    assert few.disk_mb < many.disk_mb < 200.0


def test_runs_are_those_of_the_designs_that_are_analysed_whole_at_most(campaign, tmp_path) -> None:
    card = MonteCarlo(runs=80, cases="front", most_cases=5)
    found = estimate_designs(campaign.model_copy(update={"monte_carlo": card}), tmp_path, FLIGHTS)
    assert (found.whole, found.runs) == (14, 14 * 80)


def test_errors_at_events_are_numbers_more_of_every_row(written, tmp_path) -> None:
    """Three events with attitude, velocity, position and one requirement each: 12 numbers more."""
    metrics, events = (
        estimate_designs(load(written, ["samples=10000", f"store={one}"]), tmp_path, FLIGHTS)
        for one in ("metrics", "events")
    )
    assert (metrics.store, events.store) == ("metrics", "events")
    assert events.disk_mb - metrics.disk_mb == pytest.approx(10_000 * 12 * 27e-6)
    assert events.seconds == metrics.seconds


def test_blocks_of_runs_take_disk_only_meanwhile(written, tmp_path) -> None:
    runs = ["monte_carlo={runs: 400, cases: front, most_cases: 5}"]
    alone, flown = (estimate_designs(load(written, sets), tmp_path, FLIGHTS) for sets in ([], runs))
    beside = [one.most_mb - one.disk_mb for one in (alone, flown)]
    assert flown.disk_mb > alone.disk_mb
    tables = alone.disk_mb - 40 * 1170e-6
    assert beside[0] == pytest.approx(40 * 1160e-6 + 2.0 * tables)
    assert beside[1] - beside[0] > 14 * 10 * 1.0  # 14 designs with ten blocks, each of a megabyte or more


def test_more_than_the_disk_or_the_memory_holds_is_one_line(campaign, tmp_path, monkeypatch) -> None:
    found = estimate_designs(campaign, tmp_path, FLIGHTS)
    refuse_too_large(found, tmp_path / "not there yet")
    monkeypatch.setattr(module, "_memory_mb", lambda: 1.0)
    with pytest.raises(InputError, match=r"40 designs take about \d+ MB of memory; there are 1 MB"):
        refuse_too_large(found, tmp_path)
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(module.shutil, "disk_usage", lambda _: usage._replace(free=1_000_000))
    with pytest.raises(InputError, match=r"40 designs take about \d+ MB of disk; 1 MB are free"):
        refuse_too_large(found, tmp_path)
