"""Container and conda recipe install what pyproject.toml states; they are built where the tools for it are."""

from __future__ import annotations

import shutil
import subprocess
import tomllib

import pytest
from ruamel.yaml import YAML

ENGINES = [
    found
    for found in (shutil.which("podman"), shutil.which("docker"))
    if found and subprocess.run([found, "info"], capture_output=True, check=False).returncode == 0
]
CONDA = shutil.which("conda-build")


@pytest.fixture(scope="module")
def project(root):
    return tomllib.loads((root / "pyproject.toml").read_text())["project"]


def test_the_conda_recipe_has_the_projects_dependencies_and_version(root, project):
    recipe = YAML(typ="safe").load((root / "packaging/conda/meta.yaml").read_text())
    stated = {
        entry.replace(" ", "").replace("matplotlib-base", "matplotlib") for entry in recipe["requirements"]["run"]
    }
    assert stated == {f"python{project['requires-python']}", *project["dependencies"]}
    assert recipe["package"] == {"name": project["name"], "version": project["version"]}
    ((name, place),) = project["scripts"].items()
    assert recipe["build"]["entry_points"] == [f"{name} = {place}"]


def test_the_container_copies_what_the_wheel_is_made_of(root, project):
    text = (root / "packaging/Containerfile").read_text()
    copied = {word for line in text.splitlines() if line.startswith("COPY") for word in line.split()[1:-1]}
    wheel = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    needed = {
        "pyproject.toml",
        project["readme"],
        *project["license-files"],
        *wheel["packages"],
        *wheel["force-include"],
    }
    assert copied == needed
    assert all((root / name).exists() for name in copied)


@pytest.mark.slow
@pytest.mark.skipif(not ENGINES, reason="neither podman nor docker runs on this machine")
def test_the_container_checks_the_demo(root):
    subprocess.run(
        [ENGINES[0], "build", "-q", "-t", "lvnav-trade-test", "-f", "packaging/Containerfile", "."],
        cwd=root,
        check=True,
    )
    said = subprocess.run(
        [ENGINES[0], "run", "--rm", "lvnav-trade-test", "check", "demo"], capture_output=True, text=True, check=True
    )
    assert "good" in said.stdout


@pytest.mark.slow
@pytest.mark.skipif(CONDA is None, reason="no conda-build on this machine")
def test_the_conda_recipe_builds(root, tmp_path):
    command = [CONDA, "-c", "conda-forge", "--output-folder", str(tmp_path), "packaging/conda"]
    subprocess.run(command, cwd=root, check=True)
    assert list(tmp_path.rglob("lvnav-trade-*"))
