"""`make bench`: ours and its peers in one run, as a table and as benchmarks/results.json.

Figures of one machine in one run: trust their ratios. A peer that is not installed (extra `bench`) is left out and
named.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import sys
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks.common import HERE, machine

PARTS = (
    "time_flight",
    "time_kernels",
    "time_lincov",
    "time_vehicle",
    "time_campaign",
    "time_designs",
    "time_report",
    "time_compile",
    "scaling",
    "memory",
    "peer_python_ins",
    "peer_filterpy",
    "peer_jax",
)
NEEDS = {"peer_python_ins": "pyins", "peer_filterpy": "filterpy", "peer_jax": "jax"}


def _measure(name: str, console: Console) -> dict[str, float]:
    needed = NEEDS.get(name)
    if needed and importlib.util.find_spec(needed) is None:
        console.print(f"{name}: left out, {needed} is not installed (pip install 'lvnav-trade[bench]')")
        return {}
    console.print(f"{name} ...")
    found: dict[str, float] = importlib.import_module(f"benchmarks.{name}").measure()
    return found


def _ratios(found: dict[str, float]) -> dict[str, float]:
    pairs = {
        "identical_over_jax": ("identical_sim_s_per_s_core", "jax_identical_sim_s_per_s"),
        "identical_over_python_ins": ("identical_sim_s_per_s_core", "python_ins_default_sim_s_per_s"),
    }
    return {name: found[a] / found[b] for name, (a, b) in pairs.items() if a in found and b in found}


def main() -> int:
    """Measure every part, on one core where the part is about one, print the table and write it."""
    console = Console(stderr=True)
    found: dict[str, Any] = {}
    every_core = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None
    for name in sys.argv[1:] or PARTS:
        if every_core and name.startswith("peer_jax"):
            os.sched_setaffinity(0, {min(every_core)})  # a figure per core
        found |= _measure(name, console)
        if every_core:
            os.sched_setaffinity(0, every_core)
    found |= _ratios(found)
    table = Table("figure", "value", title="simulated seconds per wall second, ns, s, MiB as named")
    for name, value in found.items():
        table.add_row(name, f"{value:,.4g}")
    Console().print(table)
    file = HERE / "results.json"
    before = json.loads(file.read_text()) if sys.argv[1:] and file.exists() else {}  # some parts anew: keep the others
    file.write_text(json.dumps({**before, **found, "machine": machine()}, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
