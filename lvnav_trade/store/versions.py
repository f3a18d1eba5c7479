"""Versions, digests and machine that computed the results; tolerances between machines."""

import hashlib
import importlib.metadata
import platform
import subprocess
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import ruamel.yaml

from lvnav_trade.marks import without_marks
from lvnav_trade.store.schema import TABLES

RESULTS_VERSION = 2  # layout of the files in a folder of results; a block of another layout is computed again
PACKAGE = Path(__file__).resolve().parents[1]
_COMPUTES = ("kernels", "delays", "world", "observables", "receivers", "filters", "engines", "steering")
_COMPUTES_TOO = (
    "layout.py",
    "frames.py",
    "records.py",
    "scenario.py",
    "units.py",
    "unit_list.py",
    "unit_spelling.py",
    "decimals.py",
    "sources.py",
    "rules.py",
    "filter_models.py",
    "limits.py",
    "line_of_sight.py",
    "input_files.py",
    "marks.py",
    "reads.py",
    "resources.py",
    "per_axis.py",
    "noise.py",
    "envelope.py",
)
# Of monte_carlo: how many runs there are, and of which cases
_OF_RUNS = ("runs", "stop", "selected", "other_runs", "cases", "most_cases")
_NOT_THE_RUNS = (
    "description",
    "covariance",
    "requirements",
    "references",
    "report",
    "corridor",
    "compare",
    "document",
    "margin_policy",
)


def tool_version() -> str:
    """Return the version of the installed tool, "unknown" where it runs from a folder that was never installed."""
    try:
        return importlib.metadata.version("lvnav-trade")
    except importlib.metadata.PackageNotFoundError:
        return "unknown"


@cache
def code_digest() -> str:
    """Return a digest of every source file that can move a number: parts of two codes must not be mixed."""
    files = [path for room in _COMPUTES for path in (PACKAGE / room).rglob("*.py")]
    files += [PACKAGE / name for name in _COMPUTES_TOO if (PACKAGE / name).exists()]
    digest = hashlib.sha256()
    for path in sorted(files):
        digest.update(str(path.relative_to(PACKAGE)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@lru_cache(maxsize=4)
def parsed(resolved_yaml: str) -> dict[str, Any]:
    """Return the tree of a resolved campaign, which nobody changes: reading it takes longer than writing the tables."""
    return dict(ruamel.yaml.YAML(typ="safe", pure=True).load(resolved_yaml) or {})


def campaign_digest(resolved_yaml: str) -> str:
    """Return a digest of what a resolved campaign computes: neither its number of runs nor what is asked of them."""
    tree = parsed(resolved_yaml)
    kept = {key: without_marks(value) for key, value in tree.items() if key not in _NOT_THE_RUNS}
    if isinstance(kept.get("monte_carlo"), dict):
        kept["monte_carlo"] = {key: value for key, value in kept["monte_carlo"].items() if key not in _OF_RUNS}
    return hashlib.sha256(_canonical(kept).encode()).hexdigest()[:16]


def _canonical(value: Any) -> str:
    """Write a tree so that equal trees give equal texts whatever the order of keys."""
    if isinstance(value, dict):
        return "{" + ",".join(f"{key!s}:{_canonical(value[key])}" for key in sorted(value, key=str)) + "}"
    return "[" + ",".join(map(_canonical, value)) + "]" if isinstance(value, list | tuple) else repr(value)


def environment() -> dict[str, str]:
    """Return versions and machine, for the manifest."""
    return {
        "tool": tool_version(),
        "code_digest": code_digest(),
        "commit": _commit(),
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in ("numpy", "numba", "scipy", "pyarrow")},
        "system": platform.platform(),
        "cpu": _cpu(),
    }


def _commit() -> str:
    """Return the commit of a git checkout, marked where files differ from it; empty where there is none."""
    if not (PACKAGE.parent / ".git").exists():
        return ""
    git = ["git", "-C", str(PACKAGE.parent)]
    try:
        head = subprocess.run([*git, "rev-parse", "HEAD"], capture_output=True, text=True, timeout=10, check=True)
        changed = subprocess.run([*git, "diff", "--quiet", "HEAD"], capture_output=True, timeout=10, check=False)
    except (OSError, subprocess.SubprocessError):
        return ""
    return head.stdout.strip() + (" with changes" if changed.returncode else "")


def _cpu() -> str:
    """Return the processor's name: Linux tells it in a file, elsewhere the platform module knows what it knows."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


def across_machines() -> dict[str, Any]:
    """Return what the manifest says of the same campaign, tool and seed on another processor or with other libraries.

    bit_equal: tables that are equal; tolerance: for each other table the largest difference of a number as a share of
    the largest size in its column; undetermined: columns of text without a tolerance. With the same processor and
    libraries all tables are equal, whatever the number of workers. Measured, see docs/numbers_across_machines.md.
    """
    bit_equal = ["outputs", "starts"]  # without a rounded number: draws are keyed, and of the same kernels everywhere
    tolerances = {"nonlinearity": 1e-2}  # differences that cancel, measured: 8e-4; of the other tables: 1e-7
    # text with rounded numbers; where singular values are zero but for rounding, any mixture of directions is as good
    undetermined = {"cases": ["facts"], "observability": ["direction", "weakest"]}
    tolerance = {name: tolerances.get(name, 1e-6) for name in TABLES if name not in bit_equal}
    return {"bit_equal": bit_equal, "tolerance": tolerance, "undetermined": undetermined}
