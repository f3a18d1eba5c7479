"""Time and size of reports: of 400 cases of linear covariance, and of the demo, its whole run held against its engines.

Wall time, one worker; the demo is run twice, the second time with its kernels in the cache.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.common import HERE
from lvnav_trade import api
from lvnav_trade.report import build

_ENGINES = ("covariance", "diagnostics", "monte_carlo")


def _seconds(function: Callable[[], Any]) -> float:
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


def _demo(folder: Path) -> dict[str, float]:
    """Return what the report of the demo takes (s), and its warm run over its engines."""
    api.run("demo", folder=folder, jobs=1, fresh=True, report=False)  # kernels
    whole = _seconds(lambda: api.run("demo", folder=folder, jobs=1, fresh=True))
    timings = api.load(folder).tables.manifest["timings_s"]
    engines = sum(timings.get(stage, 0.0) for stage in _ENGINES)
    return {"demo_over_engines": whole / engines, "report_demo_s": _seconds(lambda: build(folder))}


def measure() -> dict[str, float]:
    """Return the rows of the demo, and time (s) and size (MB) of the report of 400 cases."""
    with tempfile.TemporaryDirectory() as folder:
        found = _demo(Path(folder) / "demo")
        many = Path(folder) / "many"
        api.run(HERE / "sweep.yaml", folder=many, report=False)
        found["report_400_cases_s"] = _seconds(lambda: build(many))
        found["report_400_cases_mb"] = (many / "report.html").stat().st_size / 1e6
    return found


if __name__ == "__main__":
    print(measure())
