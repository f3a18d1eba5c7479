"""Results at places of fsspec: copied whole, fetched byte for byte; foreign places, unknown protocols are refused."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lvnav_trade import api
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.tables import remote
from lvnav_trade.results.tables.contents import CONTENTS
from tests import synthetic
from tests.cli.calling import call


@pytest.fixture
def results(tmp_path):
    return synthetic.results(tmp_path / "results", n_run=20)


@pytest.fixture
def store(request):
    """Return the address of an empty store in this process."""
    import fsspec

    memory = fsspec.filesystem("memory")
    memory.store.clear()
    memory.pseudo_dirs[:] = [""]
    return "memory://team/demo"


def the_same(one: Path, other: Path) -> bool:
    files = [path for path in one.rglob("*") if path.is_file() and "parts" not in path.parts]
    names = [path.relative_to(one) for path in files if not path.name.startswith(".")]
    return len(names) > 20 and all((one / name).read_bytes() == (other / name).read_bytes() for name in names)


def test_what_is_copied_comes_back_byte_for_byte(results, store, tmp_path):
    assert remote.copy_to(results, store) > 20
    assert the_same(results, remote.fetch_results(store, tmp_path / "back"))
    assert api.load(store).cases.equals(api.load(results).cases)
    with pytest.raises(InputError, match="is not empty"):
        remote.fetch_results(store, tmp_path / "back")


def test_a_second_copy_removes_what_the_first_left_and_nothing_else(results, store):
    import fsspec

    files = fsspec.filesystem("memory")
    remote.copy_to(results, store)
    listed = json.loads((results / CONTENTS).read_text())
    listed["files"]["report"] = [*listed["files"].get("report", []), "old.csv"]
    files.pipe_file("/team/demo/old.csv", b"1")
    files.pipe_file("/team/demo/notes.txt", b"mine")
    files.pipe_file(f"/team/demo/{CONTENTS}", json.dumps(listed).encode())
    remote.copy_to(results, store)
    assert not files.exists("/team/demo/old.csv")
    assert files.cat_file("/team/demo/notes.txt") == b"mine"


def test_a_foreign_place_is_refused_before_anything_is_computed(store, tmp_path, monkeypatch):
    import fsspec

    fsspec.filesystem("memory").pipe_file("/team/demo/notes.txt", b"mine")
    with pytest.raises(InputError, match="did not copy there; nothing was changed"):
        api.run("smoke", folder=tmp_path / "out", copy_to=store)
    assert not (tmp_path / "out").exists()
    fsspec.filesystem("memory").pipe_file(f"/team/demo/{CONTENTS}", b"{}")
    with pytest.raises(InputError, match="did not copy there"):
        remote.refuse_foreign_place(store)


def test_a_campaign_is_copied_when_it_is_done(store, tmp_path):
    few = ("monte_carlo.runs=8", "covariance.spot_check=0")
    command = ["run", "smoke", "--set", few[0], "--set", few[1], "--out", str(tmp_path / "out"), "--quiet"]
    done = call(*command, "--jobs", "1", "--copy-to", store)
    assert done.exit_code in (0, 1, 3), done.output
    assert the_same(tmp_path / "out", remote.fetch_results(store))
    refused = call("run", "smoke", "--shard", "1/2", "--copy-to", store)
    assert refused.exit_code == 2


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("nowhere://a/b", "nowhere://a/b: "),
        ("memory://nothing/here", "no results here"),
        ("file:///proc/nothing", "no results here"),
    ],
)
def test_a_place_that_is_none_is_one_line(url, said):
    with pytest.raises(InputError, match=said) as found:
        api.load(url)
    assert "\n" not in str(found.value)


def test_a_path_of_this_machine_may_be_named_by_its_protocol(results, tmp_path):
    url = f"file://{tmp_path}/elsewhere"
    remote.copy_to(results, url)
    assert the_same(results, tmp_path / "elsewhere")
    assert remote.is_remote(url)
    assert not remote.is_remote(tmp_path)


def test_results_go_to_a_real_server_of_s3_and_back(results, tmp_path, monkeypatch):
    pytest.importorskip("s3fs")
    pytest.importorskip("moto.server")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    for name, value in (("KEY_ID", "a"), ("SECRET_ACCESS_KEY", "b")):
        monkeypatch.setenv(f"AWS_{'ACCESS_' if name == 'KEY_ID' else ''}{name}", value)
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}")
    server = subprocess.Popen([sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)])
    try:
        for _ in range(100):
            with socket.socket() as tried:
                if tried.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.2)
        import s3fs

        s3fs.S3FileSystem().mkdir("designs")
        remote.copy_to(results, "s3://designs/team/demo")
        assert the_same(results, remote.fetch_results("s3://designs/team/demo", tmp_path / "back"))
        with pytest.raises(InputError, match=r"cannot be reached|no results here"):
            api.load("s3://no-such-bucket/demo")
    finally:
        server.terminate()
        server.wait(30)


def test_the_credentials_of_a_place_are_in_no_message(results, monkeypatch):
    def fails(*_, **__):
        raise OSError("host: user:SECRET refused; SECRET is wrong")

    monkeypatch.setattr("fsspec.core.url_to_fs", fails)
    with pytest.raises(InputError, match=r"^memory://\*\*\*@host/x: cannot be reached: ") as found:
        remote.copy_to(results, "memory://user:SECRET@host/x")
    assert "SECRET" not in str(found.value)
