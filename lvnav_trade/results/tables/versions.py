"""Versions, digests and machine that computed results, and tolerances between machines."""

import hashlib
import importlib.metadata
import platform
import subprocess
from collections.abc import Mapping
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import ruamel.yaml

from lvnav_trade.quantities.marks import without_marks
from lvnav_trade.results.tables.dictionary import TABLES

RESULTS_VERSION = 3  # version of the file layout of results; blocks of another layout are computed again
_UNSTATED_VERSION = 2  # version of results whose manifest has none
PACKAGE = Path(__file__).resolve().parents[2]
_COMPUTES = (
    "kernels",
    "quantities",
    "imu",
    "trajectory",
    "gnss",
    "sensors",
    "filter",
    "scenario",
    "simulation",
    "covariance",
)
# Settings of monte_carlo that affect the number of runs of cases, not the runs themselves
_RUN_COUNT_SETTINGS = ("runs", "stop", "selected", "other_runs", "cases", "most_cases")
# Settings of a campaign that do not affect its runs
_SETTINGS_WITHOUT_EFFECT = (
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
    """Return the version of the installed tool, or "unknown" if it is not installed."""
    try:
        return importlib.metadata.version("lvnav-trade")
    except importlib.metadata.PackageNotFoundError:
        return "unknown"


@cache
def code_digest() -> str:
    """Return a digest of all source files that affect numbers: parts of different versions must not be mixed."""
    files: list[Path] = []
    for package in _COMPUTES:
        files += (PACKAGE / package).rglob("*.py")
    digest = hashlib.sha256()
    for path in sorted(files):
        digest.update(str(path.relative_to(PACKAGE)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@lru_cache(maxsize=4)
def parse_resolved(resolved_yaml: str) -> dict[str, Any]:
    """Return the tree of a resolved campaign; it is cached and must not be changed, as parsing takes long."""
    return dict(ruamel.yaml.YAML(typ="safe", pure=True).load(resolved_yaml) or {})


def campaign_digest(resolved_yaml: str) -> str:
    """Return a digest of the settings of a resolved campaign that affect its runs.

    The number of runs, requirements, references and the report do not enter, so that changing them permits resuming.
    """
    settings: dict[str, Any] = {}
    for key, value in parse_resolved(resolved_yaml).items():
        if key not in _SETTINGS_WITHOUT_EFFECT:
            settings[key] = without_marks(value)
    monte_carlo = settings.get("monte_carlo")
    if isinstance(monte_carlo, dict):
        settings["monte_carlo"] = {key: value for key, value in monte_carlo.items() if key not in _RUN_COUNT_SETTINGS}
    return hashlib.sha256(_canonical_text(settings).encode()).hexdigest()[:16]


def _canonical_text(value: Any) -> str:
    """Return a tree as text that does not depend on the order of keys."""
    if isinstance(value, dict):
        entries = [f"{key!s}:{_canonical_text(value[key])}" for key in sorted(value, key=str)]
        return "{" + ",".join(entries) + "}"
    if isinstance(value, list | tuple):
        return "[" + ",".join(map(_canonical_text, value)) + "]"
    return repr(value)


def results_version(manifest: Mapping[str, Any]) -> Any:
    """Return the version of the file layout of results from their manifest."""
    return manifest.get("results_version", _UNSTATED_VERSION)


def environment() -> dict[str, Any]:
    """Return versions and machine, for the manifest."""
    return {
        "results_version": RESULTS_VERSION,
        "tool": tool_version(),
        "code_digest": code_digest(),
        "commit": _commit(),
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in ("numpy", "numba", "scipy", "pyarrow")},
        "system": platform.platform(),
        "cpu": _cpu(),
    }


def _commit() -> str:
    """Return the commit of a git repository, with a remark if files are changed; empty outside a repository."""
    if not (PACKAGE.parent / ".git").exists():
        return ""
    git = ["git", "-C", str(PACKAGE.parent)]
    try:
        head = subprocess.run([*git, "rev-parse", "HEAD"], capture_output=True, text=True, timeout=10, check=True)
        diff = subprocess.run([*git, "diff", "--quiet", "HEAD"], capture_output=True, timeout=10, check=False)
    except (OSError, subprocess.SubprocessError):
        return ""
    remark = " with changes" if diff.returncode else ""
    return head.stdout.strip() + remark


def _cpu() -> str:
    """Return the name of the processor: on Linux from /proc/cpuinfo, elsewhere from the platform module."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


def across_machines() -> dict[str, Any]:
    """Return the expected differences of results between processors and versions of libraries, for the manifest.

    bit_equal: tables that are equal. tolerance: for each other table the largest difference of a number, as a fraction
    of the largest magnitude in its column. undetermined: columns of text without a tolerance. With the same processor
    and libraries all tables are equal for any number of workers. Measured, see docs/numbers_across_machines.md.
    """
    bit_equal = ["outputs", "initial_draws"]  # no rounded numbers: random draws are keyed and exact on all machines
    tolerances = {"nonlinearity": 1e-2}  # differences of close numbers: measured 8e-4, of the other tables 1e-7
    # text with rounded numbers; directions of singular values that are zero up to rounding are arbitrary
    undetermined_columns = {"cases": ["facts"], "observability": ["direction", "weakest_direction"]}
    tolerance = {name: tolerances.get(name, 1e-6) for name in TABLES if name not in bit_equal}
    return {"bit_equal": bit_equal, "tolerance": tolerance, "undetermined": undetermined_columns}
