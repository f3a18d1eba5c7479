"""Processor time to compile what a first run of the demo needs, stage by stage, and what two free cores wait for it.

Each stage is a process of its own on a cache of its own, once empty and once filled; the difference is the compilation.
Processor time hardly depends on what else the machine does, so this one may be measured beside other work. A campaign
compiles the ascent first, then the backward pass and the flight on one worker while another compiles linear covariance,
the rest of its explanation and what adds up runs.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.common import HERE
from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running import work
from lvnav_trade.simulation import statistics

STAGES = ("ascent", "flight", "covariance")


def _tell(stage: str) -> None:
    """Go through a stage and print the processor seconds of its parts; the ascent comes first in each."""
    campaign = load(HERE.parent / "campaigns" / "demo.yaml")
    scenario, engine = cases(campaign)[0].scenario, work.ENGINE
    start = time.process_time()
    engine.events(scenario)
    prepared = engine.prepare(scenario, campaign.keep.history)
    spent = [time.process_time()]
    if stage == "flight":
        engine.compile_kernels(prepared, work.covariance_request(campaign))
        spent.append(time.process_time())
    if stage == "covariance":
        found = engine.covariance(prepared)
        spent.append(time.process_time())
        engine.explain(scenario, prepared, found, work.covariance_request(campaign))
        statistics.compile_kernels()
        spent.append(time.process_time())
    print(*(after - before for before, after in zip([start, *spent], spent, strict=False)))


def _spent(stage: str, folder: str) -> list[float]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": folder}
    command = [sys.executable, "-m", "benchmarks.time_compile", stage]
    text = subprocess.run(command, env=environment, cwd=HERE.parent, capture_output=True, text=True, check=True).stdout
    return [float(word) for word in text.split()]


def measure() -> dict[str, float]:
    """Return processor seconds of compilation by stage, and the waiting of a machine with two free cores."""
    with tempfile.TemporaryDirectory() as folder:
        cold, warm = ([_spent(stage, str(Path(folder) / "kernels-cold")) for stage in STAGES] for _ in range(2))
    (ascent,), (_, flight), (_, covariance, explanation) = (
        [a - b for a, b in zip(*pair, strict=True)] for pair in zip(cold, warm, strict=True)
    )
    return {
        "compile_ascent_cpu_s": ascent,
        "compile_backward_and_flight_cpu_s": flight,
        "compile_covariance_cpu_s": covariance,
        "compile_rest_of_explanation_cpu_s": explanation,
        "compile_wait_two_cores_s": ascent + max(flight, covariance + explanation),
    }


if __name__ == "__main__":
    _tell(sys.argv[1])
