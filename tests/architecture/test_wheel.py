"""What is installed stands alone: package, cards and campaigns work far from the checkout."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from ruamel.yaml import YAML

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
    """Folder into which the package was installed from the wheel of its source archive, without its dependencies."""
    pytest.importorskip("hatchling", reason="hatchling builds the wheel")
    wheels, target = tmp_path_factory.mktemp("wheels"), tmp_path_factory.mktemp("installed")
    _run([sys.executable, "-c", f"from hatchling.build import build_sdist; build_sdist({str(wheels)!r})"], cwd=root)
    (source,) = wheels.glob("*.tar.gz")
    _run([*PIP, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(wheels), str(source)])
    (wheel,) = wheels.glob("*.whl")
    _run([*PIP, "install", "--no-deps", "--no-index", "--target", str(target), str(wheel)])
    return target


def test_the_installed_tool_says_its_version(installed, root, tmp_path):
    version = tomllib.loads((root / "pyproject.toml").read_text())["project"]["version"]
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    command = [sys.executable, "-c", "from lvnav_trade.cli import main; main()", "--version"]
    assert _run(command, cwd=tmp_path, env=environment).stdout == f"lvnav-trade {version}\n"


def test_every_file_that_states_the_version_states_the_same(root):
    version = tomllib.loads((root / "pyproject.toml").read_text())["project"]["version"]
    yaml = YAML(typ="safe")
    citation = yaml.load(root / "CITATION.cff")
    assert citation["version"] == version
    assert f'version: "{version}"' in (root / "packaging/conda/meta.yaml").read_text()
    changes = (root / "CHANGELOG.md").read_text()
    assert f"## [{version}] - {citation['date-released']}" in changes


def test_the_list_of_changes_has_at_most_ten_lines_for_a_version(root):
    versions = re.split(r"^## ", (root / "CHANGELOG.md").read_text(), flags=re.MULTILINE)[2:]
    assert len(versions) >= 2
    for text in versions:
        assert len(re.findall(r"^- ", text, re.MULTILINE)) <= 10, text[:20]
        assert len(text.split()) < 350


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
