"""A case without runs, computed as one work item; only what a resumed campaign reads is written to disk."""

from typing import NamedTuple

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.running import work
from lvnav_trade.store import scratch


class Finished(NamedTuple):
    """The answer of a case whose tables are written, and their names and sizes (bytes)."""

    answer: work.Answer
    tables: tuple[tuple[str, int], ...]


def whole(job: work.Job, case: Case) -> work.Answer:
    """Answer a case without runs, with diagnostics and tables; what fails of these is reported by their stage.

    A case that is finished, with the tables that it left, is not done again.
    """
    file, identity = work.explained_file(job, case)
    file = file.with_suffix(".whole")
    if scratch.is_sound(file, Finished, identity):
        before: Finished = scratch.read(file, Finished, identity)
        if before.tables == job.results.sizes(case.id):
            return before.answer
    found = work.answer(job, case, scratch.hold)
    if found.error or found.mistakes:
        return found
    if work.explain(job, case, scratch.hold).error or work.close(job, case, 0).error:
        return work.answer(job, case)  # on disk, for the stage that reports it
    found = found._replace(is_whole=True)
    scratch.write(file, Finished(found, job.results.sizes(case.id)), identity)
    return found
