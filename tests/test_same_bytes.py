"""The same numbers to the last byte, on the real engines: whatever the workers, the order of asking, the run again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lvnav_trade import api
from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running import replay

pytestmark = pytest.mark.slow

TWO = [
    "axes=[{path: imu, cards: [imu/tactical_fog, imu/tactical_mems]}]",
    "keep.history=5 s",
    "requirements=[{name: lost, metric: position_error_3d, probability: 0.5, below: 100 km}]",
]
Ask = Callable[..., dict[str, str]]


@pytest.fixture(scope="module")
def ask(tmp_path_factory: pytest.TempPathFactory) -> Ask:
    """Return what carries the campaign out in a folder of that name, and gives the digests of its tables."""
    place = tmp_path_factory.mktemp("same")

    def call(name: str, runs: int, jobs: int = 1) -> dict[str, str]:
        monte_carlo = f"monte_carlo={{runs: {runs}, block: 8}}"
        api.run("campaigns/smoke.yaml", [*TWO, monte_carlo], place / name, jobs, report=False)
        return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in (place / name).glob("*.parquet")}

    call.place = place  # type: ignore[attr-defined]
    return call


@pytest.fixture(scope="module")
def whole(ask: Ask) -> dict[str, str]:
    """Return the tables of 40 runs, flown in one go by this process."""
    return ask("whole", 40)


def test_the_tables_are_there(whole: dict[str, str]) -> None:
    assert {"cases.parquet", "runs.parquet", "history.parquet", "budget.parquet"} <= set(whole)


@pytest.mark.parametrize("jobs", [2, 4])
def test_any_number_of_workers_leaves_the_same_bytes(ask: Ask, whole: dict[str, str], jobs: int) -> None:
    assert ask(f"by{jobs}", 40, jobs) == whole


def test_twenty_runs_and_then_twenty_more_are_forty(ask: Ask, whole: dict[str, str]) -> None:
    first = ask("grown", 20)
    assert first != whole
    assert ask("grown", 40) == whole


def test_fewer_runs_than_are_there_give_what_they_give_alone(ask: Ask, whole: dict[str, str]) -> None:
    alone = ask("alone", 20)
    ask("shrunk", 40, 2)
    assert ask("shrunk", 20, 2) == alone
    assert ask("shrunk", 40, 2) == whole


def test_a_run_flown_again_is_the_run_that_was_stored(ask: Ask, whole: dict[str, str]) -> None:
    folder: Path = ask.place / "whole"  # type: ignore[attr-defined]
    campaign = load(folder / "campaign.resolved.yaml")
    stored = pd.read_parquet(folder / "runs.parquet")
    for case in cases(campaign):
        again = replay.replay(campaign, case, 13)
        rows = stored[(stored.case == case.id) & (stored.run_number == 13)]
        columns = [name for name in again.trace.columns if "_error_" in name]
        assert len(rows) >= 8
        assert len(columns) >= 15
        for row in rows.itertuples():
            at = int(np.argmin(np.abs(again.trace.t_s - row.t_s)))
            assert [again.trace[name][at] for name in columns] == [getattr(row, name) for name in columns], row.event


def test_the_manifest_says_what_made_the_tables(ask: Ask, whole: dict[str, str]) -> None:
    manifest = json.loads((ask.place / "whole/manifest.json").read_text())  # type: ignore[attr-defined]
    assert manifest["seed"] == 1
    assert len(manifest["cases"]) == 2
    assert {"tool", "code_digest", "numpy", "timings_s"} <= set(manifest)
