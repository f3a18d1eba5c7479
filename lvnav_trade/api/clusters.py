"""Campaigns on several machines: Dask workers, or shards computed by a batch system and merged afterwards."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from lvnav_trade.api.campaigns import Task, carry_out, results_folder
from lvnav_trade.api.results import Results
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running import execute, pool, shards
from lvnav_trade.campaign.running.conduct import Mode, RunOptions, Scope
from lvnav_trade.campaign.running.progress import Progress
from lvnav_trade.campaign.space.stage import SpaceEvaluation
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.tables.contents import RESOLVED
from lvnav_trade.results.tables.parts import span
from lvnav_trade.results.tables.versions import code_digest

_CONNECT_S, _WORKERS_S = 10, 60  # s, time-out of the connection to a scheduler and of its first worker


class ShardOutcome(NamedTuple):
    """Outcome of a shard."""

    folder: Path  # folder of the shard
    runs: int  # number of runs stored there
    cases: int  # number of cases, or designs, stored there
    failures: tuple[str, ...]  # one line per failed run and per lost work item


def run_shard(
    campaign: str | Path | Campaign,
    shard: str,
    sets: Sequence[str] = (),
    folder: str | Path | None = None,
    jobs: int = -1,
    fresh: bool = False,
    fail_fast: bool = False,
    progress: Progress | None = None,
) -> ShardOutcome:
    """Compute one shard of a campaign in a separate folder.

    A batch system starts one call per shard, on any number of machines. Repeating the call resumes an interrupted
    shard. `merge` combines all shards into results.

    Parameters
    ----------
    campaign : str, Path or Campaign
        Campaign file, name of a campaign that comes with the tool, or a loaded one.
    shard : str
        Number of the shard and number of shards, such as ``2/8``.
    sets : sequence of str
        Assignments such as ``monte_carlo.runs=500``.
    folder : str or Path, optional
        Folder of all shards; ``results/NAME`` if absent.
    jobs : int
        Worker processes, -1 for all cores.
    fresh : bool
        Begin again instead of resuming.
    fail_fast : bool
        Stop at the first failed run.
    progress : Progress, optional
        Receives the progress.

    Returns
    -------
    ShardOutcome
        Folder of the shard, runs and cases stored there, failures.

    Raises
    ------
    InputError
        The campaign or the number of the shard has an input error.
    """
    loaded_campaign = campaign if isinstance(campaign, Campaign) else load(campaign, sets)
    number = shards.parse(shard)
    place = results_folder(loaded_campaign, folder) / number.folder
    mode: Mode = "fresh" if fresh else "resume"
    space = SpaceEvaluation(loaded_campaign) if loaded_campaign.is_space else None
    options = RunOptions(jobs, mode, fail_fast, progress)
    outcome = execute.run(loaded_campaign, place, options, Scope(shard=number, space=space))
    if space is not None:
        n_design = space.count(number.select(range(space.item_count)))
        return ShardOutcome(place, 0, n_design, outcome.failures)
    n_run = 0
    for path in (place / "parts").glob("*/*.parquet"):
        _, count = span(path)
        n_run += count
    return ShardOutcome(place, n_run, len(outcome.answers), outcome.failures)


def merge(
    place: str | Path,
    folder: str | Path | None = None,
    jobs: int = -1,
    report: bool = True,
    progress: Progress | None = None,
    on_answers: Callable[..., None] | None = None,
) -> Results:
    """Merge the shards of a campaign; the results are identical, byte for byte, to those of an undivided campaign.

    Parameters
    ----------
    place : str or Path
        Folder that contains the folders of all shards.
    folder : str or Path, optional
        Folder of the results; ``merged`` next to the shards if absent.
    jobs : int
        Worker processes, -1 for all cores.
    report : bool
        Build the report too.
    progress : Progress, optional
        Receives the progress.
    on_answers : callable, optional
        Called with the results of linear covariance and the cases as soon as they are available.

    Returns
    -------
    Results
        Tables, summary, figures.

    Raises
    ------
    InputError
        A shard is missing, unfinished, or of another campaign or version of the code.
    """
    folders = shards.all_shard_folders(Path(place))
    campaign = load(folders[0] / RESOLVED)
    target = Path(folder) if folder is not None else Path(place) / "merged"
    task = Task(jobs, report=report, progress=progress, on_answers=on_answers, shards=folders)
    return carry_out(campaign, target, task)


@contextmanager
def dask(folder: Path, scheduler: str | None = None, jobs: int = -1) -> Iterator[int]:
    """Compute the work items of campaigns on a Dask cluster, within a ``with`` block.

    Parameters
    ----------
    folder : Path
        Folder of results, an absolute path that every worker can access.
    scheduler : str, optional
        Address of the scheduler, such as ``tcp://10.0.0.5:8786``; if absent, a cluster is started on this machine.
    jobs : int
        Workers of a cluster started on this machine, -1 for all cores.

    Returns
    -------
    context manager of int
        Number of workers, for the argument `jobs` of `run`.

    Raises
    ------
    InputError
        Dask is not installed. The scheduler cannot be reached or has no workers. A worker has more than one thread,
        another version of the code, or no access to the folder.
    """
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        raise InputError("--backend dask: Dask is not installed; pip install 'lvnav-trade[dask]'") from None
    if scheduler is None:
        count = (os.cpu_count() or 1) if jobs < 1 else jobs
        with (
            LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=None) as cluster,
            Client(cluster) as client,
        ):
            yield from _use_cluster(client, folder)
        return
    with _client(Client, scheduler) as client:
        yield from _use_cluster(client, folder)


def _client(client_class: Any, scheduler: str) -> Any:
    """Return a client of a scheduler; InputError if the scheduler cannot be reached."""
    try:
        return client_class(scheduler, timeout=_CONNECT_S)
    except (OSError, ValueError, TimeoutError) as error:
        fault = _first_line(error)
    # The client of a failed attempt closes itself when it is garbage-collected, and closing waits for a lock that all
    # clients share. If the next client, which takes this lock, were starting at that moment, the two would deadlock.
    # So the failed client is collected here, where the error no longer refers to it.
    gc.collect()
    raise InputError(f"--scheduler {scheduler}: cannot be reached: {fault}")


def _use_cluster(client: Any, folder: Path) -> Iterator[int]:
    """Check that a cluster is fit for the work items; yield the number of its workers while it is in use."""
    address = client.scheduler.address
    try:
        client.wait_for_workers(1, timeout=_WORKERS_S)
    except TimeoutError:
        raise InputError(f"--scheduler {address}: has no workers after {_WORKERS_S} s") from None
    threads = client.nthreads()
    if max(threads.values()) > 1:
        raise InputError(f"--scheduler {address}: its workers need one thread each: dask worker --nthreads 1")
    folder.mkdir(parents=True, exist_ok=True)
    local_code = code_digest()
    for worker, (is_there, code) in client.run(_inspect_worker, str(folder)).items():
        if not is_there:
            raise InputError(f"--scheduler {address}: worker {worker} does not see {folder}; all need the same folders")
        if code != local_code:
            raise InputError(
                f"--scheduler {address}: worker {worker} has another code of lvnav-trade ({code}, {local_code})"
            )
    with pool.dask_workers(client):
        yield len(threads)


def _inspect_worker(folder: str) -> tuple[bool, str]:
    """Return whether a worker sees a folder, and the digest of its code."""
    return Path(folder).is_dir(), code_digest()


def _first_line(error: Exception) -> str:
    return str(error).strip().partition("\n")[0] or type(error).__name__
