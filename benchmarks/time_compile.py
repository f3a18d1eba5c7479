"""Processor time to compile what a first run of the demo needs, stage by stage, and what two free cores wait for it.

Each stage is a process of its own. All stages share one cache, which is empty at first and then filled; the difference
is the compilation. Processor time hardly depends on what else the machine does. A campaign compiles the ascent on one
worker and the statistics of runs on another. Then one worker compiles adjoint and simulation, and the other linear
covariance and its diagnostics.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

from benchmarks.common import HERE
from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running import work
from lvnav_trade.simulation import statistics

STAGES = ("ascent", "statistics", "simulation", "covariance")


def _print_times(stage: str) -> None:
    """Carry a stage out and print the processor seconds of its parts. All but the statistics begin with the ascent."""
    times = [time.process_time()]
    if stage == "statistics":
        statistics.compile_kernels()
        times.append(time.process_time())
    else:
        campaign = load(HERE.parent / "campaigns" / "demo.yaml")
        scenario, engine = cases(campaign)[0].scenario, work.ENGINE
        request = work.covariance_request(campaign)
        times = [time.process_time()]
        engine.events(scenario)
        prepared_case = engine.prepare(scenario, campaign.keep.history)
        times.append(time.process_time())
    if stage == "simulation":
        engine.compile_kernels(prepared_case, request)
        times.append(time.process_time())
    if stage == "covariance":
        covariance = engine.covariance(prepared_case)
        times.append(time.process_time())
        engine.diagnose(scenario, prepared_case, covariance, request)
        times.append(time.process_time())
    print(*(end - start for start, end in pairwise(times)))


def _spent(stage: str, folder: str) -> list[float]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": folder}
    command = [sys.executable, "-m", "benchmarks.time_compile", stage]
    text = subprocess.run(command, env=environment, cwd=HERE.parent, capture_output=True, text=True, check=True).stdout
    return [float(word) for word in text.split()]


def measure() -> dict[str, float]:
    """Return processor seconds of compilation by stage, and the waiting of a machine with two free cores."""
    with tempfile.TemporaryDirectory() as folder:
        cold, warm = ([_spent(stage, str(Path(folder) / "kernels-cold")) for stage in STAGES] for _ in range(2))
    (ascent,), (statistics_s,), (_, simulation), (_, covariance, diagnostics) = (
        [a - b for a, b in zip(*pair, strict=True)] for pair in zip(cold, warm, strict=True)
    )
    return {
        "compile_ascent_cpu_s": ascent,
        "compile_statistics_cpu_s": statistics_s,
        "compile_adjoint_and_simulation_cpu_s": simulation,
        "compile_covariance_cpu_s": covariance,
        "compile_diagnostics_cpu_s": diagnostics,
        "compile_wait_two_cores_s": max(ascent, statistics_s) + max(simulation, covariance + diagnostics),
    }


if __name__ == "__main__":
    _print_times(sys.argv[1])
