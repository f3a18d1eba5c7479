"""Run a campaign: linear covariance of all cases first, then blocks of runs, then the tables."""

import itertools
import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from joblib.externals.loky.process_executor import TerminatedWorkerError

from lvnav_trade.campaign.definition.axes import Case, probes
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.interrupts import raise_if_interrupted
from lvnav_trade.campaign.reading import flights
from lvnav_trade.campaign.reading.effect import Effects
from lvnav_trade.campaign.reading.load import resolved
from lvnav_trade.campaign.running import replay, work
from lvnav_trade.campaign.running.checking import check_effect, check_flight
from lvnav_trade.campaign.running.conduct import Conduct, DesignStage, Mode, OnAnswers, Scope, analyse_case
from lvnav_trade.campaign.running.plan import Block, blocks
from lvnav_trade.campaign.running.pool import WorkList, each, end_workers, numbered
from lvnav_trade.campaign.running.progress import Progress
from lvnav_trade.campaign.running.provenance import manifest, without_folders
from lvnav_trade.campaign.running.shards import Shard
from lvnav_trade.campaign.running.status import locked
from lvnav_trade.campaign.running.stopping import Stopping
from lvnav_trade.kernels.cache_folder import is_filled
from lvnav_trade.quantities.errors import InputError, refuse_all, system_message
from lvnav_trade.results.tables import scratch
from lvnav_trade.results.tables.contents import owned
from lvnav_trade.results.tables.write import open_results

_DEATHS = 3
COMPILING = (
    "compiling the ascent, the runs, linear covariance and its backward pass, once on this machine; this usually takes "
    "20 s on two free cores, 30 s on one"
)


class Halted(Exception):
    """The campaign stopped early and can be resumed; the message says why in one line."""


class CampaignOutcome(NamedTuple):
    """What a campaign left: linear covariance's answers, failed units and runs as lines."""

    answers: tuple[work.CovarianceResult, ...]
    failures: tuple[str, ...]


class Store(NamedTuple):
    """How results are kept; another one takes its place in tests."""

    open_results: Callable[..., Any]
    check_folder: Callable[[Path], object]


STORE = Store(open_results, partial(owned, kind="results"))
RESUMED, WHOLE = Conduct(), Scope()


def run(
    campaign: Campaign,
    folder: Path,
    conduct: Conduct = RESUMED,
    scope: Scope = WHOLE,
    engine: work.Engine | None = None,
    keep: Store = STORE,
) -> CampaignOutcome:
    """Run a campaign in `folder` and return its outcome.

    Raises
    ------
    InputError
        Before anything is computed: the folder holds another campaign or files that are not the tool's, is locked or
        cannot be written, or an event that a fault or requirement names is not in the flight.
    Halted
        Disk full or gone, workers lost again and again, or a failure with `fail_fast`: the same call resumes.
    KeyboardInterrupt
        After the workers are gone; the same call resumes.
    """
    jobs = (os.cpu_count() or 1) if conduct.jobs < 1 else conduct.jobs
    watch = conduct.progress or Progress()
    conduct = conduct._replace(jobs=jobs, progress=watch)
    try:
        work_to_do = _Run(campaign, folder, conduct, watch, engine or work.ENGINE, scope)
        keep.check_folder(folder)  # before a lock is left in a folder that is not the tool's
        with locked(folder):  # a campaign that is refused leaves no folder
            if scope.shard is not None:
                return work_to_do.share(keep, conduct.mode)
            return work_to_do.all(keep, conduct.mode, conduct.on_answers, scope.shards)
    except KeyboardInterrupt:
        end_workers(jobs)
        raise
    except TerminatedWorkerError as error:
        raise_if_interrupted(error)  # the workers of a process group end with it
        fewer = max(1, jobs // 2)
        raise Halted(f"a worker process died (out of memory?); the same command resumes, try --jobs {fewer}") from None
    except OSError as error:
        end_workers(jobs)
        if error.errno is None:
            raise
        raise Halted(system_message(error, folder)) from None
    finally:
        watch.close()


class _Run:
    def __init__(
        self,
        campaign: Campaign,
        folder: Path,
        conduct: Conduct,
        watch: Progress,
        engine: work.Engine,
        scope: Scope,
    ) -> None:
        self.campaign, self.folder, self.watch = campaign, folder, watch
        self.jobs, self.fail_fast = conduct.jobs, conduct.fail_fast
        shard, space = scope.shard, scope.space
        self.space, stand_ins = space, probes(campaign)
        self.cases = [] if space is not None else stand_ins
        self.labels = {case.id: case.label for case in self.cases}
        self.failures: list[str] = []
        self.lost: list[str] = []
        self.timings: dict[str, float] = {}
        self.deaths = 0
        self.job = work.job_of(campaign, engine, folder)
        self.stopping = Stopping(campaign)
        if not is_filled():
            watch.note(COMPILING)
        self.remarks = check_flight(campaign.probe, stand_ins, engine, self.jobs).remarks
        self.shard, self.units = shard, blocks(campaign, self.cases, {})
        if space is not None:
            # The few designs that are computed whole need not read all that is stated.
            check_effect(campaign.probe, stand_ins, engine)
        elif shard is not None:
            # Whether statements have an effect, and when enough was flown, needs all cases and runs.
            check_effect(campaign, self.cases, engine)
            self.stopping.is_early, self.job = False, self.job._replace(requirements=())
            self.units = list(shard.of(self.units))
            mine = {unit.case.id for unit in self.units} or {case.id for case in self._share_of_cases(shard)}
            self.cases = [case for case in self.cases if case.id in mine]

    def _share_of_cases(self, shard: Shard) -> Sequence[Case]:
        """Return a shard's share of the cases of a campaign without runs."""
        return [] if self.campaign.monte_carlo else shard.of(self.cases)

    def _open(self, keep: Store, mode: Mode) -> None:
        """Open the folder of results; this process holds its lock."""
        if mode == "fresh":
            self._remove_scratch()
        asked, about = self.campaign, {"shard": [*self.shard]} if self.shard is not None else {}
        stated = manifest(asked, self.cases) | about
        self.job = self.job._replace(results=keep.open_results(self.folder, asked.name, resolved(asked), stated, mode))

    def share(self, keep: Store, mode: Mode) -> CampaignOutcome:
        """Compute a shard: linear covariance of its cases, diagnostics of the cases whose first block it has, and its
        blocks of runs.
        """
        self._open(keep, mode)
        if self.space is not None and self.shard is not None:
            self.space.evaluate(self.job, self._designs, self.shard.of(range(self.space.parts)))
        answers = self._answers(None) if self.cases else []
        able = [case for case, found in zip(self.cases, answers, strict=True) if not found.error]
        first = {unit.case.id for unit in self.units if unit.first_run == 0}
        own = [(self.job, case) for case in able if case.id in first or not self.campaign.monte_carlo]
        self._per_case("diagnostics", work.diagnose, own, "covariance diagnostics")
        self._fly(able)
        end_workers(self.jobs)
        self.job.results.leave({"timings_s": self.timings, "lost": self.lost, "shard_finished": not self.lost})
        return CampaignOutcome(tuple(answers), tuple(self.failures))

    def all(
        self, keep: Store, mode: Mode, on_answers: OnAnswers | None, shards: Sequence[Path] = ()
    ) -> CampaignOutcome:
        """Go through the stages."""
        self._open(keep, mode)
        for folder in shards:
            parts = self.space.names(folder / scratch.FOLDER) if self.space is not None else []
            self.job.results.take(folder, [*(case.id for case in self.cases), *parts])
        if self.space is not None:
            self._choose(self.space)
        answers = self._answers(on_answers)
        able = [case for case, found in zip(self.cases, answers, strict=True) if not found.error]
        left = [case for case, found in zip(self.cases, answers, strict=True) if not (found.error or found.is_whole)]
        why = "covariance diagnostics"
        self._per_case("diagnostics", work.diagnose, [(self.job, case) for case in left], why)
        lost = self._fly(able)
        ends = [(self.job, case, self.stopping.runs(case.id)) for case in left if case.id not in lost]
        lost |= self._per_case("tables", work.close, ends, "tables")
        reported = {
            **self.remarks,
            "timings_s": self.timings,
            "lost": [*map(without_folders, self.lost)],
            "workers_died": self.deaths,
            # The order of the plan, not that in which the workers finished: the tables' bytes must not depend on it.
            "cases": [case.id for case in able if case.id not in lost],
            "blocks_removed": self.space is not None and not self.lost,
        }
        is_tested = self.campaign.monte_carlo is not None and bool(self.campaign.requirements)
        self.job.results.finish(reported, self._trace if is_tested else None, partial(each, self.jobs))
        end_workers(self.jobs)  # the page is made by this process alone: their memory is of no use to it
        if not self.lost:  # otherwise the same command repeats what was lost, and merges it with these tables
            self.job.results.remove_case_tables()
            if self.space is not None:  # they are most of what it would leave, and the tables hold every run
                self.job.results.remove_blocks()
            self._remove_scratch()
        return CampaignOutcome(tuple(answers), tuple(self.failures))

    def _choose(self, space: DesignStage) -> None:
        """Evaluate all designs; those that are chosen are the cases that are computed whole."""
        space.evaluate(self.job, self._designs)
        found = space.finish(self.job)
        self.cases = list(found.cases)
        self.labels = {case.id: case.label for case in self.cases}
        self.units = blocks(self.campaign, self.cases, {})
        self.job.results.choose(self.labels, {"space": found.remark})

    def _designs(self, name: str, function: Any, units: Sequence[Any]) -> Iterator[Any]:
        """Yield what parts of the designs leave; Halted where one is lost."""
        self.watch.stage(name, sum(len(unit[-1].numbers) for unit in units))
        for one in self._stage(name, function, units):
            self.watch.advance(one.n_run)
            if one.error:
                raise Halted(f"{one.case}: {one.error}; the same command resumes")
            yield one

    def _trace(self, folder: Path) -> None:
        """Fly the worst runs again and keep them over time."""
        from lvnav_trade.results.requirements.margins import worst_runs
        from lvnav_trade.results.tables.read import Tables

        worst = worst_runs(Tables(folder)).groupby("case", sort=False).run_number
        runs = {str(case): sorted(set(numbers)) for case, numbers in worst}
        units = [(self.job, case, runs[case.id]) for case in self.cases if case.id in runs]
        self._per_case("worst runs", replay.trace, units, "its worst runs over time")

    def _remove_scratch(self) -> None:
        scratch.remove(self.job.scratch, [*self.labels, *(self.space.names(self.job.scratch) if self.space else ())])

    def _stage(self, name: str, function: Any, units: Iterable[Any]) -> Iterator[Any]:
        """Yield the results of a stage in the order in which they come, timed; what a dead worker had is done again."""
        start = time.monotonic()
        work_list = WorkList(units)
        while not work_list.is_done():
            try:
                with closing(each(self.jobs, numbered, ((function, *unit) for unit in work_list.open()))) as found:
                    for number, one in found:
                        work_list.close(number)
                        yield one
            except TerminatedWorkerError as error:
                raise_if_interrupted(error)
                self.deaths += 1
                if self.fail_fast or self.deaths == _DEATHS:
                    raise
                self.jobs = max(2, self.jobs // 2)
                self.watch.note(
                    f"a worker process died (out of memory?); its work is done again by {self.jobs} workers"
                )
        self.timings[name] = round(time.monotonic() - start, 3)

    def _answers(self, on_answers: OnAnswers | None) -> list[work.CovarianceResult]:
        """Find every case's linear covariance; with several workers another compiles the backward pass and the flight
        of the first case beside it, so that a fresh machine compiles on all of them.
        """
        self.watch.stage("compilation and first case", 1)
        found: dict[str, work.CovarianceResult] = {}
        units: list[tuple[Any, ...]] = [(self.job, case) for case in self.cases]
        function: Any = analyse_case
        if self.campaign.monte_carlo or self.shard is not None:
            function, units = work.answer_or_ahead, [(*unit, None) for unit in units]
        if self.campaign.monte_carlo and self.jobs > 1:
            units.insert(0, (self.job, self.cases[0], work.compile_kernels))
            units += [(self.job, self.cases[0], ahead) for ahead in (work.diagnose, work.compile_sums)]
        for one in self._stage("covariance", function, units):
            if one is None:
                continue
            if one.mistakes:
                (case,) = (case for case in self.cases if case.id == one.case)
                raise InputError(records=flights.located(self.campaign, case, one.mistakes))
            found[one.case] = one
            self.watch.advance(1)
            if len(found) == 1 and len(self.cases) > 1:
                self.watch.stage("linear covariance of the others", len(self.cases) - 1)
            if one.error:
                self._fail(f"{self.labels[one.case]}: linear covariance: {one.error}", lost=True)
            if len(found) == len(self.cases):
                if self.shard is None and self.space is None:
                    used = {key: one.used for key, one in found.items()}
                    refuse_all(Effects(self.campaign, self.cases).mistakes(used))
                if on_answers is not None:
                    on_answers([found[case.id] for case in self.cases], self.cases)
        return [found[case.id] for case in self.cases]

    def _per_case(self, name: str, function: Any, units: Sequence[Any], what: str) -> set[str]:
        """Do one work item for each case; return the digests of the cases where it was lost, as a line on `what`."""
        if not units:
            return set()
        self.watch.stage(name, len(units))
        lost = set()
        for one in self._stage(name, function, units):
            self.watch.advance(1)
            if one.error:
                lost.add(one.case)
                self._fail(f"{self.labels[one.case]}: {what}: {one.error}", lost=True)
        return lost

    def _fly(self, able: Sequence[Case]) -> set[str]:
        """Fly all blocks; return the digests of cases of which a block was lost."""
        done = {case.id: self.job.results.done(case.id) for case in able}
        units = [unit for unit in self.units if unit.case.id in done and unit[1:] not in done[unit.case.id]]
        if self.stopping.is_early:
            held = [case for case in able if done[case.id]]
            for one in itertools.chain(*each(self.jobs, work.tally, [(self.job, case) for case in held], ordered=True)):
                self._look(one)
        if units:
            self.watch.stage("runs", sum(unit.n_run for unit in units))
        lost: list[work.WorkOutcome] = []
        for one in self._stage("monte_carlo", work.fly, self._wanted(units)):
            self.watch.advance(one.n_run)
            self._look(one)
            if not self.stopping.wants(one.case, one.first_run):
                continue  # it was flown ahead of a decision
            if one.error:
                lost.append(one)
                last = one.first_run + one.n_run - 1
                self._fail(f"{self.labels[one.case]}, runs {one.first_run} to {last}: {one.error}", lost=True)
            for number, why in one.failures:
                again = f"lvnav-trade replay {self.folder} {one.case} {number}"
                self._fail(f"{self.labels[one.case]}, run {number} {why}; {again}")
        return {one.case for one in lost if self.stopping.wants(one.case, one.first_run)}

    def _look(self, outcome: work.WorkOutcome) -> None:
        """Take a block in where blocks decide when their case ends."""
        if not outcome.error:
            self.stopping.note(outcome.case, outcome.first_run, outcome.n_run, outcome.beyond)

    def _wanted(self, units: Sequence[Block]) -> Iterator[tuple[work.Job, Block]]:
        """Yield the blocks still wanted when their turn comes: a case may be decided by then."""
        for unit in units:
            if self.stopping.wants(unit.case.id, unit.first_run):
                yield self.job, unit
            else:
                self.watch.advance(unit.n_run)

    def _fail(self, line: str, lost: bool = False) -> None:
        """Note a failed run, or a work item that was lost: that leaves no row in the tables."""
        if lost:
            self.lost.append(line)
        self.failures.append(line)
        self.watch.note(line)
        if self.fail_fast:
            raise Halted(f"stopped at the first failure: {line}")
