"""Memory against run count: the largest resident set of a campaign's processes at 100, 1,000 and 10,000 runs."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.common import HERE

COUNTS = (100, 1_000, 10_000)


def _resident_mib(root: int) -> float:
    """Return the resident memory of a process and its descendants (MiB), from /proc."""
    parents: dict[int, int] = {}
    sizes: dict[int, float] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            status = dict(line.split(":", 1) for line in (folder / "status").read_text().splitlines())
        except OSError:
            continue
        parents[int(folder.name)] = int(status["PPid"])
        sizes[int(folder.name)] = float(status.get("VmRSS", "0 kB").split()[0]) / 1024.0
    family, grown = {root}, True
    while grown:
        more = {pid for pid, parent in parents.items() if parent in family} - family
        family |= more
        grown = bool(more)
    return sum(sizes.get(pid, 0.0) for pid in family)


def peak(runs: int) -> float:
    """Return the largest memory (MiB) that a campaign of so many runs takes, workers included."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "lvnav_trade", "run", str(HERE / "flight.yaml"), "--fresh", "--quiet"]
        command += ["--results", folder, "--set", f"monte_carlo.runs={runs}"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        highest = 0.0
        while process.poll() is None:
            highest = max(highest, _resident_mib(process.pid))
            time.sleep(0.2)
        return highest


def measure() -> dict[str, float]:
    """Return the peak at each count."""
    return {f"peak_mib_{count}_runs": peak(count) for count in COUNTS}
