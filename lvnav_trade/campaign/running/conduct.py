"""Options and outcome of a run of a campaign, and the work items of its first stage."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.interrupts import attempt
from lvnav_trade.campaign.running import work
from lvnav_trade.campaign.running.progress import Progress
from lvnav_trade.campaign.running.shards import Shard
from lvnav_trade.results.tables import scratch
from lvnav_trade.results.tables.contents import owned_folder
from lvnav_trade.results.tables.write import open_results

Mode = Literal["resume", "fresh"]
OnAnswers = Callable[[Sequence[work.CovarianceResult], Sequence[Case]], None]


class DesignStage(Protocol):
    """Many designs, of which a few are analysed completely; see `campaign.space.stage`."""

    @property
    def item_count(self) -> int:
        """Number of work items."""

    def evaluate(
        self, job: work.Job, stage: Callable[..., Iterator[Any]], item_numbers: Sequence[int] | None = None
    ) -> None:
        """Evaluate every design, or the designs of some work items, and store the results."""

    def finish(self, job: work.Job) -> Any:
        """Store the table of all designs; return the cases to analyse completely, and a remark for the manifest."""

    def names(self, folder: Path) -> list[str]:
        """Return the names of the scratch files of the work items in a folder."""


class Store(NamedTuple):
    """Functions that store results; tests replace them."""

    open_results: Callable[..., Any]  # (folder, campaign name, resolved campaign, manifest, mode): writer
    check_folder: Callable[[Path], object]  # refuses a folder with files that are not the tool's


STORE = Store(open_results, partial(owned_folder, folder_type="results"))


class RunOptions(NamedTuple):
    """How a campaign is run."""

    jobs: int = -1
    """Worker processes; -1: one for each core; 1: everything in this process."""
    mode: Mode = "resume"
    """Resume the stored results of the same campaign, or start again."""
    fail_fast: bool = False
    """Stop at the first failed run."""
    progress: Progress | None = None
    """Display of the progress; None: no display."""
    on_answers: OnAnswers | None = None
    """Called with the results of linear covariance as soon as they are complete."""


class Scope(NamedTuple):
    """Part of a campaign to compute; the defaults are the whole campaign."""

    shard: Shard | None = None
    """Shard to compute: its share of the blocks is stored, without tables; a run with `shards` merges them."""
    shards: Sequence[Path] = ()
    """Folders of shards, whose blocks are copied before anything is computed."""
    space: DesignStage | None = None
    """Designs of a campaign that stores metrics; the chosen designs are then analysed completely."""


class CampaignOutcome(NamedTuple):
    """Outcome of a campaign."""

    answers: tuple[work.CovarianceResult, ...]  # results of linear covariance
    failures: tuple[str, ...]  # failed runs and lost work items, one line each


class FinishedCase(NamedTuple):
    """Record of a finished case."""

    result: work.CovarianceResult  # result of linear covariance
    tables: tuple[tuple[str, int], ...]  # names and sizes (bytes) of its tables


def covariance_or_early_task(
    job: work.Job, case: Case, early_task: Callable[[work.Job, Case], Any] | None
) -> work.CovarianceResult | None:
    """Compute the linear covariance of a case, or carry out a task in advance, such as compiling.

    Parameters
    ----------
    job : work.Job
        Data of the campaign for a worker.
    case : Case
        The case.
    early_task : callable, optional
        Task in advance. A failure is ignored, since the case's own stage reports it.

    Returns
    -------
    CovarianceResult or None
        Result of the case; None after a task in advance.
    """
    if early_task is None:
        return work.compute_covariance(job, case)
    attempt(early_task, job, case)
    return None


def compile_kernels(job: work.Job, case: Case) -> None:
    """Compile the kernels of a case's backward pass and of its runs."""
    job.engine.compile_kernels(work.prepared_of(job, case), job.request)


def analyse_case(job: work.Job, case: Case) -> work.CovarianceResult:
    """Compute linear covariance, diagnostics and tables of a case without runs.

    A finished case whose tables are unchanged is not computed again. If the diagnostics or the tables fail, the stages
    of a campaign with runs compute them again and report the failure.
    """
    file, identity = work.diagnostics_file(job, case)
    file = file.with_suffix(".whole")
    if scratch.is_sound(file, FinishedCase, identity):
        finished_case: FinishedCase = scratch.read(file, FinishedCase, identity)
        if finished_case.tables == job.results.sizes(case.id):
            return finished_case.result
    result = work.compute_covariance(job, case, scratch.cache)
    if result.error or result.mistakes:
        return result
    has_failed = bool(work.diagnose(job, case, scratch.cache).error or work.write_tables(job, case, 0).error)
    if has_failed:
        return work.compute_covariance(job, case)  # stored on disk this time, for the stage that reports the failure
    result = result._replace(is_whole=True)
    scratch.write(file, FinishedCase(result, job.results.sizes(case.id)), identity)
    return result
