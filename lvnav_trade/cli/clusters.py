"""Commands and options of campaigns on several machines: merge, and the workers of a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from lvnav_trade.cli.answers import answer_of, covariance_collector
from lvnav_trade.cli.console import Jobs, Json, Quiet, VerbResult, folder_option, verb
from lvnav_trade.quantities.errors import InputError


class Backend(StrEnum):
    """Workers of a campaign: processes of this machine, or a Dask cluster."""

    PROCESSES = "processes"
    DASK = "dask"


@contextmanager
def workers(backend: Backend, scheduler: str | None, folder: Path, jobs: int) -> Iterator[tuple[Path, int]]:
    """Yield the folder of results and the number of workers for `api.run`; with Dask, while the cluster runs.

    Parameters
    ----------
    backend : Backend
        Workers.
    scheduler : str, optional
        Address of a running Dask scheduler; by default a cluster on this machine.
    folder : Path
        Folder of results.
    jobs : int
        Number of workers; -1 for all.

    Raises
    ------
    InputError
        The options contradict each other.
    """
    if backend == Backend.PROCESSES:
        if scheduler is not None:
            raise InputError("--scheduler: goes with --backend dask")
        yield folder, jobs
        return
    if scheduler is not None and jobs != -1:
        raise InputError("--jobs: a scheduler has the workers that were started for it")
    from lvnav_trade.api import dask

    place = folder.resolve()
    with dask(place, scheduler, jobs) as count:
        yield place, count


@verb("results/demo")
def merge(
    place: Annotated[Path, typer.Argument(metavar="DIR", help="the folder with the folders of all shards")],
    out: Annotated[Path | None, folder_option("the results", "DIR/merged")] = None,
    jobs: Jobs = -1,
    report: Annotated[bool, typer.Option("--report/--no-report", help="build the report at the end")] = True,
    quiet: Quiet = False,
    as_json: Json = False,
) -> VerbResult:
    """Combine the shards of a campaign.

    Tables and report equal those of the undivided campaign.
    """
    from lvnav_trade import api
    from lvnav_trade.campaign.running.progress import choose

    covariance_rows, show = covariance_collector(as_json)
    results = api.merge(place, out, jobs, report, choose(quiet), show)
    return answer_of(results, covariance_rows, report)
