"""The package as text and as syntax trees, and the files that are published with it."""

from __future__ import annotations

import ast
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

BUILT = {".venv", "results", "wheelhouse", "build", "dist"}


class Module(NamedTuple):
    """One module of the package: dotted name, path relative to the project, text, syntax tree."""

    name: str
    path: Path
    text: str
    tree: ast.Module

    def functions(self) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
        """Walk all functions and methods, nested ones too."""
        return (node for node in ast.walk(self.tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))

    def at(self, node: ast.stmt | ast.expr) -> str:
        """Return where the node stands, as an editor understands it."""
        return f"{self.path}:{node.lineno}"


@pytest.fixture(scope="session")
def modules(root: Path) -> list[Module]:
    """Every module of the package."""
    found = []
    for path in sorted((root / "lvnav_trade").rglob("*.py")):
        relative, text = path.relative_to(root), path.read_text()
        parts = relative.with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found.append(Module(name, relative, text, ast.parse(text)))
    return found


@pytest.fixture(scope="session")
def published(root: Path) -> list[Path]:
    """Every file of the project: what git tracks or would track; in an unpacked archive all but what was built."""
    listing = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    if (root / ".git").exists():
        names = subprocess.run(listing, cwd=root, capture_output=True, check=True, text=True).stdout.split("\0")
        return [root / name for name in names if name and (root / name).is_file()]
    files = [path.relative_to(root) for path in root.rglob("*") if path.is_file()]
    return [root / path for path in files if path.parts[0] not in BUILT and "__pycache__" not in path.parts]
