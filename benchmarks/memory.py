"""Memory against run count: the most that a campaign's processes take together at 100, 1,000 and 20,000 runs."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.common import HERE

COUNTS = (100, 1_000, 20_000)


def _parents() -> dict[int, int]:
    """Return the parent of every process."""
    found: dict[int, int] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            # the command's name, in brackets, may hold blanks
            found[int(folder.name)] = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
    return found


def _family(root: int) -> set[int]:
    parents, family, grown = _parents(), {root}, True
    while grown:
        more = {pid for pid, parent in parents.items() if parent in family} - family
        family |= more
        grown = bool(more)
    return family


def _memory_mib(root: int) -> float:
    """Return the memory of a process and its descendants (MiB), pages that several share counted once (PSS)."""
    total = 0.0
    for pid in _family(root):
        try:
            text = Path(f"/proc/{pid}/smaps_rollup").read_text()
        except OSError:
            continue
        total += sum(float(line.split()[1]) for line in text.splitlines() if line.startswith("Pss:"))
    return total / 1024.0


def peak(runs: int) -> float:
    """Return the largest memory (MiB) that a campaign of so many runs takes, workers included."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "lvnav_trade", "run", str(HERE / "flight.yaml"), "--fresh", "--quiet"]
        command += ["--out", folder, "--set", f"monte_carlo.runs={runs}"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=HERE.parent)
        highest = 0.0
        while process.poll() is None:
            highest = max(highest, _memory_mib(process.pid))
            time.sleep(0.2)
        return highest


def measure() -> dict[str, float]:
    """Return the peak at each count."""
    return {f"peak_mib_{count}_runs": peak(count) for count in COUNTS}
