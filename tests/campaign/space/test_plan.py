"""What many designs take, and what this machine has no room for."""

from __future__ import annotations

import shutil

import pytest

from lvnav_trade.campaign.definition.runs import MonteCarlo
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.space import plan as module
from lvnav_trade.campaign.space.plan import planned, refuse_too_large
from lvnav_trade.errors import InputError


def test_time_and_disk_grow_with_the_designs(written, tmp_path) -> None:
    few, many = (planned(load(written, [f"samples={n}"]), tmp_path, 600.0) for n in (1000, 10_000))
    assert (few.designs, many.designs, few.whole, few.runs) == (1000, 10_000, 9, 0)
    assert 8.0 < many.seconds / few.seconds < 10.0
    assert few.disk_mb < many.disk_mb < 200.0


def test_runs_are_those_of_the_designs_that_are_analysed_whole_at_most(campaign, tmp_path) -> None:
    card = MonteCarlo(runs=80, cases="front", most_cases=5)
    found = planned(campaign.model_copy(update={"monte_carlo": card}), tmp_path, 600.0)
    assert (found.whole, found.runs) == (14, 14 * 80)


def test_more_than_the_disk_or_the_memory_holds_is_one_line(campaign, tmp_path, monkeypatch) -> None:
    found = planned(campaign, tmp_path, 600.0)
    refuse_too_large(found, tmp_path / "not there yet")
    monkeypatch.setattr(module, "_memory_mb", lambda: 1.0)
    with pytest.raises(InputError, match=r"40 designs take about \d+ MB of memory; there are 1 MB"):
        refuse_too_large(found, tmp_path)
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(module.shutil, "disk_usage", lambda _: usage._replace(free=1_000_000))
    with pytest.raises(InputError, match=r"40 designs take about \d+ MB of disk; 1 MB are free"):
        refuse_too_large(found, tmp_path)
