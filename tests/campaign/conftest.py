"""The small study, made fresh in the working folder of the test."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest


def _module(name: str) -> ModuleType:
    """Load a helper that stands beside this file; tests are no package."""
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # so that what it defines can be pickled
    spec.loader.exec_module(module)
    return module


class Study:
    """A folder with cards and a campaign, and how to change them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._study = _module("study")
        self.path = self._study.make(folder)

    def append(self, text: str) -> Path:
        """Append lines to the campaign."""
        self.path = self._study.make(self.folder, text)
        return self.path

    def write(self, name: str, text: str) -> Path:
        """Write another file of the study."""
        return self._study.write(self.folder, name, text)

    def edit(self, name: str, old: str, new: str) -> None:
        """Replace text in a file of the study."""
        path = self.folder / name
        text = path.read_text(encoding="utf-8")
        assert old in text, f"{old!r} is not in {name}"
        path.write_text(text.replace(old, new), encoding="utf-8")


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Study:
    """Return the study, with the working folder in it."""
    monkeypatch.chdir(tmp_path)
    return Study(tmp_path)


@pytest.fixture
def fakes() -> ModuleType:
    """Return the small engine and the small store."""
    return _module("fakes")
