"""What is installed stands alone: package, cards and campaigns work far from the checkout."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

PIP = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]


def _run(command: list[str], **options) -> subprocess.CompletedProcess[str]:
    answer = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    if answer.returncode:
        pytest.fail(
            f"{' '.join(command)} ended with {answer.returncode}:\n{answer.stdout}{answer.stderr}", pytrace=False
        )
    return answer


@pytest.fixture(scope="module")
def installed(root, tmp_path_factory) -> Path:
    """Folder into which the package was installed from its wheel, without its dependencies."""
    pytest.importorskip("hatchling", reason="hatchling builds the wheel")
    wheels, target = tmp_path_factory.mktemp("wheels"), tmp_path_factory.mktemp("installed")
    _run([*PIP, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(wheels), str(root)])
    (wheel,) = wheels.glob("*.whl")
    _run([*PIP, "install", "--no-deps", "--no-index", "--target", str(target), str(wheel)])
    return target


@pytest.mark.parametrize("folder", ["configs", "campaigns"])
def test_the_wheel_holds_every_card_and_campaign(installed, root, folder):
    inside = installed / "lvnav_trade" / "_data" / folder

    def files(place: Path) -> set[Path]:
        found = (path.relative_to(place) for path in place.rglob("*") if path.is_file())
        return {path for path in found if path.suffix != ".pyc"}  # of scripts that were run

    assert files(root / folder)
    assert files(inside) == files(root / folder)


def test_the_wheel_holds_every_file_of_the_package(installed, root):
    def package(folder: Path) -> set[Path]:
        names = (path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
        return {name for name in names if name.suffix != ".pyc" and name.parts[0] != "_data"}

    assert package(installed / "lvnav_trade") == package(root / "lvnav_trade")
    assert package(installed / "lvnav_studies") == package(root / "lvnav_studies")
    assert Path("py.typed") in package(installed / "lvnav_trade")  # else type checkers take every name for Any


def test_the_demo_campaign_is_accepted_by_the_installed_tool_outside_the_checkout(installed, tmp_path):
    # A cache of its own: compiled code is kept by the path of its source, which here is a new one every time.
    environment = {**os.environ, "PYTHONPATH": str(installed), "NUMBA_CACHE_DIR": str(tmp_path / "compiled")}
    where = [sys.executable, "-c", "import lvnav_trade; print(lvnav_trade.__file__)"]
    assert Path(_run(where, cwd=tmp_path, env=environment).stdout.strip()).is_relative_to(installed)
    check = [sys.executable, "-c", "from lvnav_trade.cli import main; main()", "check", "demo"]
    _run(check, cwd=tmp_path, env=environment)


def test_a_study_of_the_tool_is_found_outside_the_checkout_by_its_name(installed, tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(installed), "NUMBA_CACHE_DIR": str(tmp_path / "compiled")}
    asked = (
        "from lvnav_trade.api.studies import script_of; found = script_of('drdc'); print(found.folder, *found.claims)"
    )
    folder, *claims = _run([sys.executable, "-c", asked], cwd=tmp_path, env=environment).stdout.split()
    assert Path(folder) == installed / "lvnav_trade/_data/campaigns/drdc"
    assert "nozzle" in claims
