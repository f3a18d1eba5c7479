"""What all tests share: reference data that may be absent, property tests that repeat, figures without a screen."""

from __future__ import annotations

import gc
import os
import resource
from collections.abc import Iterator
from pathlib import Path

import matplotlib
import pytest
from hypothesis import settings

ROOT = Path(__file__).resolve().parents[1]

matplotlib.use("Agg")
os.environ["MPLBACKEND"] = "Agg"  # for the processes that tests start

# The same examples on every machine and every day: a property test that fails must fail again when looked at.
settings.register_profile("repeatable", derandomize=True, deadline=None, database=None, print_blob=True)
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def root() -> Path:
    """Folder of the project."""
    return ROOT


class RefData:
    """The folder of reference data: ``refdata / "gnss/sp3/igs15904.sp3"`` is a path, or skips the test by that name."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __truediv__(self, name: str) -> Path:
        path = self.folder / name
        if not path.exists():
            pytest.skip(f"reference data absent: {name}")
        return path


@pytest.fixture(scope="session")
def refdata() -> RefData:
    """Reference data in the folder that LVNAV_REFDATA names, or else in ../shared/refdata beside the project."""
    return RefData(Path(os.environ.get("LVNAV_REFDATA") or ROOT.parent / "shared" / "refdata"))


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder for results, with the test's working directory beside it."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "results"
    folder.mkdir()
    return folder


def pytest_collection_finish() -> None:
    """Exclude the objects that exist before the first test from garbage collection: nearly all remain to the end."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(hookwrapper=True)
def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> Iterator[None]:
    """Show what tests measured; count and name what was skipped: a run without reference data is not a full one."""
    yield
    for report in terminalreporter.stats.get("passed", []):
        for name, value in report.user_properties:
            terminalreporter.write_line(f"measured: {name}: {value}")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    terminalreporter.write_line(f"measured: largest memory of the process: {peak:.0f} MB")
    reasons: dict[str, int] = {}
    for report in terminalreporter.stats.get("skipped", []):
        text = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        reason = text.removeprefix("Skipped: ")
        reasons[reason] = reasons.get(reason, 0) + 1
    named = "; ".join(f"{reason} ({count})" for reason, count in sorted(reasons.items()))
    terminalreporter.write_line(f"skipped tests: {sum(reasons.values())}" + (f": {named}" if named else ""))
