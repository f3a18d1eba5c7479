"""What a campaign takes beside its engines, in processor time: runs stored, cases of linear covariance, `check`."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.common import HERE
from lvnav_trade import api
from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.reading.load import load, resolved_text
from lvnav_trade.campaign.running import work
from lvnav_trade.campaign.running.conduct import analyse_case
from lvnav_trade.campaign.running.plan import Block
from lvnav_trade.campaign.running.provenance import manifest
from lvnav_trade.results.tables.write import open_results

BLOCKS, RUNS, CASES = 12, 40, 8


def _seconds(function: Callable[[], Any]) -> float:
    start = time.process_time()
    function()
    return time.process_time() - start


def _opened(file: str, sets: tuple[str, ...], folder: Path, count: int) -> tuple[work.Job, list[Case]]:
    """Return a job with results in a folder, and the first cases of a campaign."""
    campaign = load(HERE / file, sets)
    found = cases(campaign)[:count]
    results = open_results(folder, campaign.name, resolved_text(campaign), manifest(campaign, found), "fresh")
    return work.job_of(campaign, work.ENGINE, folder)._replace(results=results), found


def _throughput(folder: Path) -> float:
    """Return the share of the processor time of stored runs that their flight takes: fly, add up, store, merge."""
    job, (case, *_) = _opened("flight.yaml", (), folder, 1)
    work.compute_covariance(job, case)

    def stored(first: int, count: int) -> float:
        flown = _seconds(
            lambda: [work.simulate_block(job, Block(case, RUNS * k, RUNS)) for k in range(first, first + count)]
        )
        return flown + _seconds(lambda: work.write_tables(job, case, RUNS * (first + count)))

    prepared_case = job.engine.prepare(case.scenario, job.history_step)
    stored(0, 2)
    few, many = stored(2, 2), stored(4, BLOCKS)  # what each further run takes: the tables of a case cost the same
    kernel = _seconds(
        lambda: [job.engine.run_block(prepared_case, job.seed, RUNS * k, RUNS) for k in range(BLOCKS - 2)]
    )
    return kernel / (many - few)


def _sweep(folder: Path, *sets: str) -> float:
    """Return processor time of cases of linear covariance, tables and all, over that of their covariance."""
    job, found = _opened("sweep.yaml", sets, folder, 2 + 2 * CASES)
    for case in found[:2]:
        analyse_case(job, case)
    flown = _seconds(lambda: [analyse_case(job, case) for case in found[2 : 2 + CASES]])
    engine, history = job.engine, job.history_step
    alone = _seconds(lambda: [engine.covariance(engine.prepare(case.scenario, history)) for case in found[2 + CASES :]])
    done = [case.id for case in found[: 2 + CASES]]
    return (flown + _seconds(lambda: job.results.finish({"cases": done})) * CASES / len(done)) / alone


def measure() -> dict[str, float]:
    """Return the ratios, and the processor time (s) of checking one case and 400."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        found["campaign_over_kernel"] = _throughput(Path(folder) / "runs")
        found["sweep_over_covariance"] = _sweep(Path(folder) / "plain")
        found["sweep_with_spot_check_over_covariance"] = _sweep(Path(folder) / "spot", "covariance.spot_check=32")
    whole = HERE / "sweep.yaml"
    found["check_1_case_cpu_s"] = _seconds(lambda: api.check(HERE / "flight.yaml"))
    found["check_400_cases_cpu_s"] = _seconds(lambda: api.check(whole))
    return found


if __name__ == "__main__":
    print(measure())
