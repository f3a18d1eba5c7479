"""Shards, merging and clusters on the command line: what goes together, and what is refused in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from lvnav_trade import api
from lvnav_trade.api import clusters
from tests.cli.calling import call

SMOKE = "campaigns/smoke.yaml"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--shard", "3/2"], "--shard 3/2: should be NUMBER/TOTAL, such as 1/4, with a number from 1 to the total"),
        (
            ["--shard", "1/2", "--prefer", "cost"],
            "--shard: goes without --prefer, --copy-to, --backend and --scheduler",
        ),
        (
            ["--shard", "1/2", "--backend", "dask"],
            "--shard: goes without --prefer, --copy-to, --backend and --scheduler",
        ),
        (["--scheduler", "tcp://a:1"], "--scheduler: goes with --backend dask"),
        (
            ["--backend", "dask", "--scheduler", "tcp://a:1", "--jobs", "2"],
            "--jobs: a scheduler has the workers that were started for it",
        ),
    ],
)
def test_options_that_do_not_go_together_are_refused(options: list[str], said: str, tmp_path: Path) -> None:
    result = call("run", SMOKE, "--out", str(tmp_path / "results"), *options)
    assert (result.output, result.exit_code) == (f"{said}\n", 2)
    assert not (tmp_path / "results").exists()


def test_a_shard_says_what_is_stored_and_what_comes_next(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done = clusters.ShardOutcome(tmp_path / "shard-2-of-8", 480, 3, ("a, run 3 diverged",))
    asked: list[object] = []
    monkeypatch.setattr(api, "run_shard", lambda *given: (asked.append(given[1]), done)[1])
    result = call("run", SMOKE, "--shard", "2/8", "--out", str(tmp_path))
    assert result.stdout.splitlines() == [
        "failed: a, run 3 diverged",
        f"480 runs of 3 cases are stored in {tmp_path}/shard-2-of-8",
        f"when all shards are there: lvnav-trade merge {tmp_path}",
    ]
    assert (result.exit_code, asked) == (4, ["2/8"])
    content = json.loads(call("run", SMOKE, "--shard", "2/8", "--out", str(tmp_path), "--json").output)
    assert (content["runs"], content["cases"], content["failures"]) == (480, 3, ["a, run 3 diverged"])


def test_a_folder_without_shards_is_not_merged(tmp_path: Path) -> None:
    result = call("merge", str(tmp_path))
    assert result.output == f"{tmp_path}: no shards here (no folder shard-1-of-2 or the like)\n"
    assert result.exit_code == 2
