"""What the benchmarks share: scenarios of the benchmark's work, a clock, and the machine's name."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.scenario.scenario import Scenario

HERE = Path(__file__).resolve().parent


def scenario(*sets: str) -> Scenario:
    """Return the benchmark's one case: a tight filter of 17 states on the two-stage ascent, with `--set` changes."""
    return cases(load(HERE / "flight.yaml", sets))[0].scenario


def best(function: Callable[[], Any], repeats: int = 5) -> float:
    """Return the shortest wall time (s) of several calls, the first one (compilation, caches) left out."""
    function()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def machine() -> dict[str, Any]:
    """Return what a figure depends on: processor, cores, Python and library versions."""
    packages = ("lvnav-trade", "numba", "numpy", "llvmlite", "python-ins", "jax", "filterpy")
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "versions": {name: _version(name) for name in packages},
    }
