"""The map of the package names every folder, and nothing that is not there."""

from __future__ import annotations

import re


def test_every_package_is_on_the_map(root):
    text = (root / "docs" / "map.md").read_text(encoding="utf-8")
    packages = {path.parent.name for path in (root / "lvnav_trade").glob("*/__init__.py")}
    assert {package for package in packages if f"`{package}/`" not in text} == set()


def test_every_module_that_the_map_names_is_there(root):
    text = (root / "docs" / "map.md").read_text(encoding="utf-8")
    named = {name for name in re.findall(r"[\w/]+\.py\b", text) if not name.endswith("NAME.py")}
    files = {str(path.relative_to(root)) for path in [*root.glob("lvnav_*/**/*.py"), *root.glob("tests/**/*.py")]}
    assert named
    assert {name for name in named if not any(file == name or file.endswith(f"/{name}") for file in files)} == set()
