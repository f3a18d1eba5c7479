"""How a campaign is run, and how much of it; a case without runs as one work item."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.running import work
from lvnav_trade.campaign.running.progress import Progress
from lvnav_trade.campaign.running.shards import Shard
from lvnav_trade.results.tables import scratch

Mode = Literal["resume", "fresh"]
OnAnswers = Callable[[Sequence[work.CovarianceResult], Sequence[Case]], None]


class DesignStage(Protocol):
    """Many designs, of which a few are analysed whole; see `campaign.space.stage`."""

    @property
    def parts(self) -> int:
        """Number of work items."""

    def evaluate(self, job: work.Job, stage: Callable[..., Iterator[Any]], parts: Sequence[int] | None = None) -> None:
        """Evaluate every design, or those of some parts, and store what is found."""

    def finish(self, job: work.Job) -> Any:
        """Store the table of all designs; return the cases that are analysed whole, and what the manifest says."""

    def names(self, folder: Path) -> list[str]:
        """Return the names that parts of the designs are left under in a folder of scratch files."""


class Conduct(NamedTuple):
    """How a campaign is run."""

    jobs: int = -1
    """Worker processes; -1 all cores; 1 works in this process."""
    mode: Mode = "resume"
    """Resume what the folder holds of the same campaign, or begin afresh."""
    fail_fast: bool = False
    """Stop at the first failed run."""
    progress: Progress | None = None
    """What shows the progress; none if absent."""
    on_answers: OnAnswers | None = None
    """Called with linear covariance's answers as soon as they are there."""


class Scope(NamedTuple):
    """What of a campaign is computed, where that is not simply all of it."""

    shard: Shard | None = None
    """Only its share of blocks is flown and left in the folder, without tables, for a campaign with `shards`."""
    shards: Sequence[Path] = ()
    """Folders of shards, whose blocks are taken before anything is computed."""
    space: DesignStage | None = None
    """The designs of a campaign that stores metrics; those that it chooses are then computed whole."""


class Finished(NamedTuple):
    """Record of a finished case."""

    answer: work.CovarianceResult  # result of linear covariance
    tables: tuple[tuple[str, int], ...]  # names and sizes (bytes) of its tables


def analyse_case(job: work.Job, case: Case) -> work.CovarianceResult:
    """Compute linear covariance, diagnostics and tables of a case without runs.

    A finished case whose tables are unchanged is not computed again. If the diagnostics or the tables fail, the case is
    left to the stages of a campaign with runs, which repeat the failure and report it.
    """
    file, identity = work.diagnostics_file(job, case)
    file = file.with_suffix(".whole")
    if scratch.is_sound(file, Finished, identity):
        earlier: Finished = scratch.read(file, Finished, identity)
        if earlier.tables == job.results.sizes(case.id):
            return earlier.answer
    answer = work.answer(job, case, scratch.cache)
    if answer.error or answer.mistakes:
        return answer
    if work.diagnose(job, case, scratch.cache).error or work.close(job, case, 0).error:
        return work.answer(job, case)  # again on disk, for the stage that reports the failure
    answer = answer._replace(is_whole=True)
    scratch.write(file, Finished(answer, job.results.sizes(case.id)), identity)
    return answer
