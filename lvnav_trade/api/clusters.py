"""Campaigns on several machines: Dask's workers, or shards that a batch system does one by one, and their merging."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from lvnav_trade.api.campaigns import Task, carry_out, place_of
from lvnav_trade.api.results import Results
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running import execute, pool, shards
from lvnav_trade.campaign.running.conduct import Conduct, Mode, Scope
from lvnav_trade.campaign.running.progress import Progress
from lvnav_trade.campaign.space.stage import Space
from lvnav_trade.errors import InputError
from lvnav_trade.store.contents import RESOLVED
from lvnav_trade.store.parts import span
from lvnav_trade.store.versions import code_digest

_CONNECT_S, _WORKERS_S = 10, 60  # how long a scheduler, and its first worker, are waited for


class Shared(NamedTuple):
    """What a shard left: its folder, the runs and cases that are stored there, failed runs and lost work as lines."""

    folder: Path
    runs: int
    cases: int
    failures: tuple[str, ...]


def run_shard(
    campaign: str | Path | Campaign,
    shard: str,
    sets: Sequence[str] = (),
    folder: str | Path | None = None,
    jobs: int = -1,
    fresh: bool = False,
    fail_fast: bool = False,
    progress: Progress | None = None,
) -> Shared:
    """Compute the share of a campaign that a batch system gave to this machine, in a folder of its own.

    The same call goes on with what was interrupted; `merge` makes results of all shards.

    Parameters
    ----------
    campaign : str, Path or Campaign
        Campaign file, name of a campaign that comes with the tool, or a loaded one.
    shard : str
        Which share, such as ``2/8``.
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
        What watches.

    Returns
    -------
    Shared
        Folder of the shard, runs and cases stored there, failures.

    Raises
    ------
    InputError
        A mistake in the campaign or in the shard's number.
    """
    found = campaign if isinstance(campaign, Campaign) else load(campaign, sets)
    part = shards.parse(shard)
    place = place_of(found, folder) / part.folder
    mode: Mode = "fresh" if fresh else "resume"
    space = Space(found) if found.is_space else None
    conduct = Conduct(jobs, mode, fail_fast, progress)
    outcome = execute.run(found, place, conduct, Scope(shard=part, space=space))
    if space is not None:
        return Shared(place, 0, space.count(part.of(range(space.parts))), outcome.failures)
    stored = [(path.parent.name, span(path)[1]) for path in (place / "parts").glob("*/*.parquet")]
    return Shared(place, sum(runs for _, runs in stored), len(outcome.answers), outcome.failures)


def merge(
    place: str | Path,
    folder: str | Path | None = None,
    jobs: int = -1,
    report: bool = True,
    progress: Progress | None = None,
    on_answers: Callable[..., None] | None = None,
) -> Results:
    """Put the shards of a campaign together; the results are, byte for byte, those of the campaign in one piece.

    Parameters
    ----------
    place : str or Path
        The folder with the folders of all shards.
    folder : str or Path, optional
        Folder of the results; ``merged`` next to the shards if absent.
    jobs : int
        Worker processes, -1 for all cores.
    report : bool
        Build the report too.
    progress : Progress, optional
        What watches.
    on_answers : callable, optional
        Called with linear covariance's answers and the cases, as soon as they are there.

    Returns
    -------
    Results
        Tables, summary, figures.

    Raises
    ------
    InputError
        A shard is missing, not finished, or of another campaign or code.
    """
    found = shards.complete(Path(place))
    campaign = load(found[0] / RESOLVED)
    target = Path(folder) if folder is not None else Path(place) / "merged"
    task = Task(jobs, report=report, progress=progress, on_answers=on_answers, shards=found)
    return carry_out(campaign, target, task)


@contextmanager
def dask(folder: Path, scheduler: str | None = None, jobs: int = -1) -> Iterator[int]:
    """Let the workers of a Dask cluster do the work items of campaigns, within a ``with`` block.

    Parameters
    ----------
    folder : Path
        Where results go, an absolute path that every worker sees.
    scheduler : str, optional
        Its address, such as ``tcp://10.0.0.5:8786``; without one a cluster of this machine is started.
    jobs : int
        Workers of the cluster of this machine, -1 for all cores.

    Returns
    -------
    context manager of int
        Number of workers, for the argument `jobs` of `run`.

    Raises
    ------
    InputError
        Dask is not installed; the scheduler cannot be reached or has no workers; these have more than one thread,
        another code, or do not see the folder.
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
            yield from _connected(client, folder)
        return
    with _client(Client, scheduler) as client:
        yield from _connected(client, folder)


def _client(kind: Any, scheduler: str) -> Any:
    """Return a client of a scheduler; InputError where it cannot be reached."""
    try:
        return kind(scheduler, timeout=_CONNECT_S)
    except (OSError, ValueError, TimeoutError) as error:
        fault = _first_line(error)
    # The client of a failed attempt closes itself when it is collected, which waits for a lock of all clients. If that
    # happened while the next one starts, which holds the lock, it would wait forever; so it is collected here, when the
    # error no longer refers to it.
    gc.collect()
    raise InputError(f"--scheduler {scheduler}: cannot be reached: {fault}")


def _connected(client: Any, folder: Path) -> Iterator[int]:
    """Hold a cluster against what its work needs, and give the number of its workers while it is used."""
    address = client.scheduler.address
    try:
        client.wait_for_workers(1, timeout=_WORKERS_S)
    except TimeoutError:
        raise InputError(f"--scheduler {address}: has no workers after {_WORKERS_S} s") from None
    threads = client.nthreads()
    if max(threads.values()) > 1:
        raise InputError(f"--scheduler {address}: its workers need one thread each: dask worker --nthreads 1")
    folder.mkdir(parents=True, exist_ok=True)
    mine = code_digest()
    for worker, (is_there, code) in client.run(_sees, str(folder)).items():
        if not is_there:
            raise InputError(f"--scheduler {address}: worker {worker} does not see {folder}; all need the same folders")
        if code != mine:
            raise InputError(f"--scheduler {address}: worker {worker} has another code of lvnav-trade ({code}, {mine})")
    with pool.on_dask(client):
        yield len(threads)


def _sees(folder: str) -> tuple[bool, str]:
    return Path(folder).is_dir(), code_digest()


def _first_line(error: Exception) -> str:
    return str(error).strip().partition("\n")[0] or type(error).__name__
