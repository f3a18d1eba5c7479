"""Two small kernels in a process of their own, with a cache folder that a test chooses."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

KERNELS = """
from lvnav_trade.kernels.jit import jit

@jit
def part(a):
    return a + 1.0

@jit
def entry(a):
    return part(part(a))
"""
LOADED = "print(entry(1.0), sum(entry.stats.cache_hits.values()))"


def run(folder: Path, line: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a line after the kernels in a process without a cache folder of its own, unless the environment names one."""
    (folder / "kernels_here.py").write_text(KERNELS)
    left_out = {"NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "HOME"}
    usual = {name: value for name, value in os.environ.items() if name not in left_out}
    paths = {"PYTHONPATH": os.pathsep.join([str(Path(__file__).resolve().parents[2]), str(folder)])}
    command = [sys.executable, "-c", f"from kernels_here import *\n{line}"]
    return subprocess.run(command, capture_output=True, text=True, check=False, env={**usual, **paths, **environment})
