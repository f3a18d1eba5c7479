"""The console answers at once: help must not wait for the compiler, the tables or the figures to be loaded."""

from __future__ import annotations

import subprocess
import sys
import time

HELP = [sys.executable, "-c", "from lvnav_trade.cli import main; main()", "--help"]
AIM, BOUND = 0.5, 1.5  # s; the aim on an idle machine, the bound on one that runs other tests meanwhile
HEAVY = ("numba", "scipy", "pandas", "pyarrow", "matplotlib", "pint")


def test_help_is_there_at_once(root, record_property):
    times = []
    for _ in range(3):
        start = time.perf_counter()
        answer = subprocess.run(HELP, cwd=root, capture_output=True, text=True, check=False)
        times.append(time.perf_counter() - start)
        assert answer.returncode == 0, answer.stderr
        assert "run" in answer.stdout.split()
    record_property("console help", f"{min(times):.2f} s (aim {AIM} s)")
    assert min(times) < BOUND


def test_the_console_loads_no_heavy_library_before_it_is_needed(root):
    question = f"import sys, lvnav_trade, lvnav_trade.cli; print([n for n in {HEAVY} if n in sys.modules])"
    answer = subprocess.run([sys.executable, "-c", question], cwd=root, capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "[]"
