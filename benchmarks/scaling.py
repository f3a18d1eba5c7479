"""Two workers over one: blocks of runs flown and stored as a campaign does it, by its own functions."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.common import HERE
from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load, resolved_text
from lvnav_trade.campaign.running import work
from lvnav_trade.campaign.running.plan import Block
from lvnav_trade.campaign.running.pool import map_items
from lvnav_trade.campaign.running.provenance import manifest
from lvnav_trade.results.tables.write import open_results

BLOCKS, RUNS, REPEATS = 64, 40, 3


def _seconds(jobs: int, folder: Path) -> float:
    campaign = load(HERE / "flight.yaml", ())
    case = cases(campaign)[0]
    results = open_results(folder, campaign.name, resolved_text(campaign), manifest(campaign, [case]), "fresh")
    job = work.Job(
        work.ENGINE,
        results,
        campaign.seed,
        campaign.keep.history,
        work.covariance_request(campaign),
        folder / ".scratch",
    )

    def fly(numbers: range) -> None:
        for done in map_items(
            jobs, work.simulate_block, ((job, Block(case, RUNS * number, RUNS)) for number in numbers)
        ):
            if done.error:
                raise RuntimeError(done.error)

    for found in map_items(
        jobs, work.compute_covariance, [(job, case)]
    ):  # what the histograms of the runs are counted in units of
        if found.error:
            raise RuntimeError(found.error)
    fly(range(BLOCKS, BLOCKS + 6 * jobs))  # every worker loads its kernels and builds the flight
    start = time.perf_counter()
    fly(range(BLOCKS))
    return time.perf_counter() - start


def _in_a_process_of_its_own(jobs: int) -> float:
    """Return what `_seconds` gives in a fresh process, as a campaign has one: what was timed before does not matter."""
    command = [sys.executable, "-m", "benchmarks.scaling", str(jobs)]
    return float(subprocess.run(command, capture_output=True, text=True, check=True, cwd=HERE.parent).stdout)


def measure() -> dict[str, float]:
    """Return how much faster two workers fly the same blocks than one, each the best of several repetitions."""
    seconds = [(_in_a_process_of_its_own(1), _in_a_process_of_its_own(2)) for _ in range(REPEATS)]
    one, two = map(min, zip(*seconds, strict=True))
    return {"two_workers_over_one": one / two}


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        print(_seconds(int(sys.argv[1]), Path(folder)))
