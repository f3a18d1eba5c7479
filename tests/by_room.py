"""Run the tests of each room in a process of its own: `python -m tests.by_room 2` runs two rooms at a time.

Compiled kernels remain in the memory of a process until it ends. One process for all tests grows to 5 GB. Rooms that
compile many kernels are therefore divided into several processes, each below 1.2 GB.
"""

from __future__ import annotations

import math
import os
import re
import resource
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

TESTS = Path(__file__).parent
LONG = (
    "simulation",
    "campaign",
    "trajectory",
    "published",
    "architecture",
    "report",
    "results",
    "both_engines",
    "filter",
    "covariance",
)
"""Rooms that take longest start first, so that no processor waits at the end. `simulation` and `published` need many of
the same kernels and would compile them twice at the same time."""
PARTS = {"simulation": 5, "published": 2, "campaign": 2, "architecture": 2, "both_engines": 3, "filter": 2}
"""Number of processes of a room, 1 for the others."""
TOGETHER = (("gnss", "imu", "mutations", "scenario"), ("fuzzing", "quantities", "studies"))
"""Small rooms in one process each: a process takes two to three seconds until its first test."""
ONE_PROCESSOR = {"LOKY_MAX_CPU_COUNT": "1"}
"""A room draws its figures in its own process. Workers would load the package again, and the other rooms use the
processors."""
NO_TESTS = 5  # exit code of pytest if all tests are left out as slow


class Outcome(NamedTuple):
    """Result of the tests of a room.

    room : Name of the room.
    failed : Whether a test failed, or pytest itself.
    counts : Number of tests by outcome, in the words of pytest (passed, skipped, failed, ...).
    """

    room: str
    failed: bool
    counts: Counter[str]


def rooms() -> dict[str, list[Path]]:
    """Return the folders of tests by name, long ones first and small ones joined, and the tests outside folders."""
    folders = {path.name: [path] for path in sorted(TESTS.iterdir()) if any(path.rglob("test_*.py"))}
    long_first = {name: folders.pop(name) for name in LONG}
    joined = {", ".join(names): [path for name in names for path in folders.pop(name)] for names in TOGETHER}
    return long_first | folders | joined | {"others": sorted(TESTS.glob("test_*.py"))}


def parts(room: str, paths: list[Path]) -> dict[str, list[Path]]:
    """Return the paths of each process of a room, by the name of the room and the number of the part."""
    count = PARTS.get(room, 1)
    if count == 1:
        return {room: paths}
    files = sorted(file for path in paths for file in path.rglob("test_*.py"))
    size = math.ceil(len(files) / count)
    return {f"{room} {k + 1}/{count}": files[k * size : (k + 1) * size] for k in range(count)}


def run(room: str, paths: list[Path]) -> Outcome:
    """Run the tests of a room; write what they measured, and everything if one fails."""
    command = [sys.executable, "-m", "pytest", "-m", "not slow", "--quiet", "--no-header", *map(str, paths)]
    finished = subprocess.run(command, cwd=TESTS.parent, capture_output=True, text=True, env=os.environ | ONE_PROCESSOR)
    lines = (finished.stdout + finished.stderr).splitlines()
    failed = finished.returncode not in (0, NO_TESTS)
    shown = lines if failed else [line for line in lines if line.startswith(("measured:", "skipped tests: "))]
    sys.stdout.write("\n".join([*shown, f"tests/{room}: {lines[-1]}", ""]))
    sys.stdout.flush()
    counts = Counter({outcome: int(number) for number, outcome in re.findall(r"(\d+) ([a-z]+)", lines[-1])})
    return Outcome(room, failed, counts)


def main(processes: int) -> int:
    """Run all rooms, `processes` at a time. Returns 1 if a test fails."""
    start = time.monotonic()
    work = {name: files for room, paths in rooms().items() for name, files in parts(room, paths).items()}
    with ThreadPoolExecutor(processes) as pool:
        outcomes = list(pool.map(run, work.keys(), work.values()))
    total = sum((outcome.counts for outcome in outcomes), Counter())
    counts = ", ".join(f"{total[word]} {word}" for word in ("failed", "errors", "passed", "skipped") if total[word])
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    failed = [f"tests/{outcome.room}" for outcome in outcomes if outcome.failed]
    sys.stdout.write(f"largest memory of a process of the tests: {peak:.0f} MB\n")
    sys.stdout.write(f"failed: {' '.join(failed)}\n" if failed else "")
    sys.stdout.write(f"===== {counts} in {time.monotonic() - start:.2f}s =====\n")
    return int(bool(failed))


if __name__ == "__main__":
    raise SystemExit(main(int(sys.argv[1])))
