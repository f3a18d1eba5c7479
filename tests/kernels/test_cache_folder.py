"""Compiled kernels have a folder per version of the sources, or a temporary one."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from lvnav_trade.kernels.cache_folder import is_filled, set_cache_folder, source_digest
from tests.kernels.stored import LOADED, run


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Return a small package: a kernel, a module that holds one, and one that holds none."""
    for name, text in {
        "kernels/earth.py": "a = 1\n",
        "simulation/flight_loop.py": "from lvnav_trade.kernels.jit import jit\n",
        "report/page.py": "b = 2\n",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.mark.parametrize("name", ["kernels/earth.py", "simulation/flight_loop.py"])
def test_an_edit_of_any_module_that_holds_a_kernel_gives_another_folder(package: Path, name: str) -> None:
    before = source_digest(package)
    (package / name).write_text((package / name).read_text() + "\n")
    assert source_digest(package) != before


def test_an_edit_elsewhere_compiles_nothing_again(package: Path) -> None:
    before = source_digest(package)
    (package / "report/page.py").write_text("b = 3\n")
    assert source_digest(package) == before


def test_a_kernel_under_another_name_gives_another_folder(package: Path) -> None:
    before = source_digest(package)
    (package / "kernels/earth.py").rename(package / "kernels/globe.py")
    assert source_digest(package) != before


def folder_with(monkeypatch: pytest.MonkeyPatch, **environment: str) -> Path:
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "HOME", "NUMBA_BOUNDSCHECK"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    set_cache_folder()
    return Path(os.environ["NUMBA_CACHE_DIR"])


@pytest.mark.parametrize(
    ("environment", "parent"),
    [
        ({"NUMBA_CACHE_DIR": "mine", "XDG_CACHE_HOME": "cache", "HOME": "users/a"}, "mine"),
        ({"XDG_CACHE_HOME": "cache", "HOME": "users/a"}, "cache/lvnav_trade"),
        ({"HOME": "users/a"}, "users/a/.cache/lvnav_trade"),
    ],
)
def test_the_users_choice_of_a_cache_folder_is_kept(tmp_path, monkeypatch, environment, parent: str) -> None:
    found = folder_with(monkeypatch, **{name: str(tmp_path / place) for name, place in environment.items()})
    assert found.parent == tmp_path / parent
    assert found.name.startswith("kernels-")


def test_kernels_with_bounds_checks_have_a_folder_of_their_own(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = folder_with(monkeypatch, NUMBA_CACHE_DIR=str(tmp_path), NUMBA_BOUNDSCHECK="0")
    checked = folder_with(monkeypatch, NUMBA_CACHE_DIR=str(tmp_path), NUMBA_BOUNDSCHECK="1")
    assert plain == folder_with(monkeypatch, NUMBA_CACHE_DIR=str(tmp_path)) != checked


def test_a_worker_process_inherits_the_folder_as_it_is(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = folder_with(monkeypatch, NUMBA_CACHE_DIR=str(tmp_path))
    assert folder_with(monkeypatch, NUMBA_CACHE_DIR=str(found)) == found


def test_without_a_folder_that_can_be_written_a_temporary_one_is_used_and_named_in_one_line(tmp_path: Path) -> None:
    nowhere = {"XDG_CACHE_HOME": "/proc/none", "TMPDIR": str(tmp_path)}
    found = [run(tmp_path, LOADED, **nowhere) for _ in range(2)]
    assert [one.stdout for one in found] == ["3.0 0\n", "3.0 1\n"]  # the next command finds them
    (place,) = tmp_path.glob("lvnav_trade-*")
    assert stat.S_IMODE(place.stat().st_mode) == 0o700
    (line,) = found[0].stderr.splitlines()
    assert line.startswith("compiled kernels cannot be stored in /proc/none/lvnav_trade (No such file or directory)")
    assert line.endswith(f"are in {place}; set NUMBA_CACHE_DIR to a folder of yours that stays")


def test_a_temporary_folder_that_others_can_write_is_not_used(tmp_path: Path) -> None:
    place = tmp_path / f"lvnav_trade-{os.getuid()}"
    place.mkdir()
    place.chmod(0o777)
    found = run(tmp_path, LOADED, XDG_CACHE_HOME="/proc/none", TMPDIR=str(tmp_path))
    assert found.stdout == "3.0 0\n"
    assert list(place.iterdir()) == []
    assert [path.name for path in tmp_path.glob("lvnav_trade-*")] == [place.name]  # its own is gone


def test_a_folder_without_kernels_of_this_version_is_not_filled(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    folder = folder_with(monkeypatch, NUMBA_CACHE_DIR=str(tmp_path))
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "0")
    assert not is_filled()
    (folder / "kernels_1").mkdir(parents=True)
    (folder / "kernels_1" / "earth.gravity.nbi").touch()
    assert is_filled()


def test_what_numba_compiles_alone_has_another_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    ours = folder_with(monkeypatch, NUMBA_CACHE_DIR=str(tmp_path))
    assert ours != folder_with(monkeypatch, NUMBA_CACHE_DIR=str(tmp_path), LVNAV_TRADE_PLAIN_NUMBA="1")
