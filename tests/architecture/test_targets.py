"""The outcome of a target of the Makefile does not depend on what other targets have installed."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from fnmatch import fnmatch

import pytest

TARGETS = ("test", "slow", "bounds", "docs", "bench", "test-s3", "fuzz")
DISTRIBUTIONS = {"ruamel": "ruamel.yaml", "PIL": "pillow", "pyins": "python-ins", "dateutil": "python-dateutil"}
WITH_OTHERS = {"llvmlite", "pydantic_core"}  # of numba and pydantic


def names(requirements: list[str]) -> set[str]:
    return {re.split(r"[<>=]", requirement)[0] for requirement in requirements}


def test_the_type_check_follows_no_import_that_the_tests_do_not_need(root) -> None:
    """Else it would pass without the package, and fail with the types that this publishes."""
    stated = tomllib.loads((root / "pyproject.toml").read_text())
    extras = stated["project"]["optional-dependencies"]
    always = names([*stated["project"]["dependencies"], *extras["test"]]) - {"dask", "distributed", "fsspec"}
    skipped = [
        pattern
        for one in stated["tool"]["mypy"]["overrides"]
        if one.get("follow_imports") == "skip" and one.get("ignore_missing_imports")
        for pattern in ([one["module"]] if isinstance(one["module"], str) else one["module"])
    ]
    found = set()
    for place in stated["tool"]["mypy"]["files"]:
        for path in (root / place).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
                modules += [node.module] if isinstance(node, ast.ImportFrom) and node.module and not node.level else []
                found |= {module.partition(".")[0] for module in modules}
    others = found - sys.stdlib_module_names - {"lvnav_trade", "lvnav_studies", "benchmarks"} - WITH_OTHERS
    optional = {module for module in others if DISTRIBUTIONS.get(module, module) not in always}
    assert {"jax", "filterpy", "pyins", "distributed", "fsspec"} <= optional
    assert not [module for module in optional if not any(fnmatch(f"{module}.x", pattern) for pattern in skipped)]


@pytest.mark.skipif(shutil.which("make") is None, reason="no make")
def test_what_a_target_installs_beyond_the_tests_packages_has_a_folder_of_its_own(root, tmp_path) -> None:
    extras = tomllib.loads((root / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for target in TARGETS:
        shown = subprocess.run(
            ["make", "--dry-run", "--always-make", f"VENV={tmp_path}/venv", target],
            cwd=root, capture_output=True, text=True, check=True,
        ).stdout.replace("\\\n", " ")  # fmt: skip
        installs = [line for line in shown.splitlines() if " -m pip " in line]
        assert installs, target
        for line in installs:
            used = re.search(rf"{re.escape(str(tmp_path))}/(venv[\w-]*)/bin/", line)
            assert used is not None
            if used[1] != "venv":
                assert used[1].startswith("venv-"), line
                continue
            asked = re.search(r"--editable '?\.(?:\[(\w+)\])?'?\s*$", line.strip())
            assert asked is not None, f"{target}: {line}"
            assert names(extras.get(asked[1] or "", [])) <= names(extras["test"]), f"{target}: {line}"
