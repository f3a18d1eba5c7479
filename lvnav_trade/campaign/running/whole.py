"""A case without runs as one work item; only files that a resumed campaign reads are written to disk."""

from typing import NamedTuple

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.running import work
from lvnav_trade.results.tables import scratch


class Finished(NamedTuple):
    """Record of a finished case."""

    answer: work.Answer  # result of linear covariance
    tables: tuple[tuple[str, int], ...]  # names and sizes (bytes) of its tables


def whole(job: work.Job, case: Case) -> work.Answer:
    """Compute linear covariance, diagnostics and tables of a case without runs.

    A finished case whose tables are unchanged is not computed again. If the diagnostics or the tables fail, the case is
    left to the stages of a campaign with runs, which repeat the failure and report it.
    """
    file, identity = work.explained_file(job, case)
    file = file.with_suffix(".whole")
    if scratch.is_sound(file, Finished, identity):
        earlier: Finished = scratch.read(file, Finished, identity)
        if earlier.tables == job.results.sizes(case.id):
            return earlier.answer
    answer = work.answer(job, case, scratch.cache)
    if answer.error or answer.mistakes:
        return answer
    if work.explain(job, case, scratch.cache).error or work.close(job, case, 0).error:
        return work.answer(job, case)  # again on disk, for the stage that reports the failure
    answer = answer._replace(is_whole=True)
    scratch.write(file, Finished(answer, job.results.sizes(case.id)), identity)
    return answer
