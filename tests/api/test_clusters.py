"""A campaign in shards, through every room: merged, its tables are those of the campaign in one piece."""

from __future__ import annotations

import gc
import os
import signal
from pathlib import Path

import pytest

from lvnav_trade import api
from lvnav_trade.api import clusters
from lvnav_trade.api.campaigns import Task, carry_out
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running.progress import Progress
from lvnav_trade.quantities.errors import InputError

SMALL = ("monte_carlo.runs=24", "monte_carlo.block=8", "covariance.spot_check=0")
PLAIN = (*SMALL, *(f"covariance.{name}=false" for name in ("budget", "adjoint", "observability", "nonlinearity")))


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("clusters") / "whole"
    api.run("smoke", SMALL, folder, jobs=1, report=False)
    return folder


def table_bytes(folder: Path) -> dict[str, bytes]:
    """Return the bytes of the tables of results by name."""
    found = {file.name: file.read_bytes() for file in folder.glob("*.parquet")}
    assert {"cases.parquet", "history.parquet", "runs.parquet"} <= set(found)
    return found


@pytest.mark.parametrize("total", [2, 3])
def test_merged_shards_are_the_campaign_byte_for_byte(total: int, whole: Path, tmp_path: Path) -> None:
    for number in range(total, 0, -1):
        done = clusters.run_shard("smoke", f"{number}/{total}", SMALL, tmp_path, jobs=1)
        assert done.failures == ()
        assert done.folder == tmp_path / f"shard-{number}-of-{total}"
    results = clusters.merge(tmp_path, jobs=1, report=False)
    assert results.folder == tmp_path / "merged"
    assert table_bytes(results.folder) == table_bytes(whole)


def test_where_a_verdict_ends_a_case_the_runs_after_it_do_not_count(tmp_path: Path) -> None:
    requirement = "requirements=[{name: a, metric: position_error_3d, probability: 0.5, below: 1 km, confidence: 0.5}]"
    early = (*PLAIN, "monte_carlo.stop=decided", requirement)
    whole = api.run("smoke", early, tmp_path / "whole", jobs=1, report=False)
    assert whole.tables.cases.run_count.tolist() == [8]
    assert clusters.run_shard("smoke", "1/2", early, tmp_path, jobs=1).runs == 8
    assert clusters.run_shard("smoke", "2/2", early, tmp_path, jobs=1).runs == 16
    merged = clusters.merge(tmp_path, jobs=1, report=False)
    assert table_bytes(merged.folder) == table_bytes(whole.folder)


def test_what_is_merged_is_not_flown_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number in (1, 2):
        clusters.run_shard("smoke", f"{number}/2", PLAIN, tmp_path, jobs=1)

    def refuse(*_: object) -> None:
        raise AssertionError("flown again")

    monkeypatch.setattr("lvnav_trade.campaign.running.work.simulate_block", refuse)
    assert clusters.merge(tmp_path, tmp_path / "out", jobs=1, report=False).failures == []


def test_a_shard_that_is_missing_is_named(tmp_path: Path) -> None:
    clusters.run_shard("smoke", "2/2", PLAIN, tmp_path, jobs=1)
    with pytest.raises(InputError, match=r": of 2 shards these are missing: 1$"):
        clusters.merge(tmp_path)


class Kills(Progress):
    """Ends a process when the first block of runs is in."""

    def __init__(self, pid: int) -> None:
        self.pid, self.is_flying, self.is_done = pid, False, False

    def stage(self, name: str, total: int, is_uniform: bool = True) -> None:
        self.is_flying = name == "runs"

    def advance(self, count: int) -> None:
        if self.is_flying and not self.is_done:
            os.kill(self.pid, signal.SIGKILL)
            self.is_done = True


def test_a_cluster_that_loses_a_worker_leaves_the_same_bytes(whole: Path, tmp_path: Path) -> None:
    """A real scheduler with two worker processes, of which one is killed while runs are flown."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        progress = Kills(cluster.workers[0].pid)
        with clusters.dask(tmp_path, cluster.scheduler_address) as count:
            assert count == 2
            task = Task(jobs=count, report=False, progress=progress)
            results = carry_out(load("smoke", SMALL), tmp_path, task)
        assert progress.is_done
    assert results.failures == []
    assert table_bytes(tmp_path) == table_bytes(whole)


def test_a_scheduler_that_cannot_be_reached_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is left of the attempt: a client that is collected later may wait for a lock that the next one holds."""
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(clusters, "_CONNECT_S", 0.5)
    for address, said in (("tcp://127.0.0.1:9", "cannot be reached: "), ("nonsense://x", "cannot be reached: ")):
        with pytest.raises(InputError) as caught, clusters.dask(tmp_path, address):
            pass
        assert str(caught.value).startswith(f"--scheduler {address}: {said}")
        assert "\n" not in str(caught.value)
        left = [one for one in gc.get_objects() if type(one) is distributed.Client]
        assert [one.status for one in left if one.status != "closed"] == []


def test_workers_with_several_threads_are_refused(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None) as cluster,
        pytest.raises(InputError, match=r"its workers need one thread each: dask worker --nthreads 1$"),
        clusters.dask(tmp_path, cluster.scheduler_address),
    ):
        pass


def test_results_of_a_short_campaign_show_themselves_and_a_run_is_repeated(whole: Path, tmp_path: Path) -> None:
    results = api.load(whole)
    short = results.summary()
    assert (short.cases, short.runs, short.exit_code) == (1, (24, 24), 0)
    assert "1 cases, 24 runs each" in results._repr_html_()
    assert results.plot.envelope("base", "position")._repr_png_().startswith(b"\x89PNG")
    assert api.status(whole).state == "finished"
    again = api.replay(whole, "base", 5, folder=tmp_path)
    (row,) = again.events[(again.events.event == "injection") & (again.events.quantity == "position")].itertuples()
    run = results.runs[(results.runs.run_number == 5) & (results.runs.event == "injection")]
    assert row.unit == "m"
    assert row.error == pytest.approx(run.position_3d_error_m.item(), rel=1e-9)
    assert again.trace == tmp_path / "traces" / f"{again.case}-5.parquet"
    assert len(again.history) > 6000
