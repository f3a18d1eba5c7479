"""Run a campaign: linear covariance of all cases first, then blocks of runs, then the tables."""

import os
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

from joblib.externals.loky.process_executor import TerminatedWorkerError

from lvnav_trade.campaign.definition.axes import Case, probes
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.interrupts import raise_if_interrupted
from lvnav_trade.campaign.reading import flights
from lvnav_trade.campaign.reading.effect import Effects
from lvnav_trade.campaign.reading.load import resolved_text
from lvnav_trade.campaign.running import replay, work
from lvnav_trade.campaign.running.checking import check_effect, check_flight
from lvnav_trade.campaign.running.conduct import (
    STORE,
    CampaignOutcome,
    DesignStage,
    Mode,
    OnAnswers,
    RunOptions,
    Scope,
    Store,
    analyse_case,
    compile_kernels,
    covariance_or_early_task,
)
from lvnav_trade.campaign.running.plan import Block, blocks
from lvnav_trade.campaign.running.pool import WorkList, end_workers, map_items, numbered_result
from lvnav_trade.campaign.running.progress import Progress
from lvnav_trade.campaign.running.provenance import manifest, without_folders
from lvnav_trade.campaign.running.shards import Shard
from lvnav_trade.campaign.running.status import folder_lock
from lvnav_trade.campaign.running.stopping import Stopping
from lvnav_trade.kernels.cache_folder import is_filled
from lvnav_trade.quantities.errors import InputError, refuse_all, system_message
from lvnav_trade.results.tables import scratch
from lvnav_trade.simulation import statistics

_DEATHS = 3
COMPILING = (
    "compiling the ascent, the runs, linear covariance and its backward pass, once on this machine; this usually takes "
    "15 s on two free cores, 25 s on one"
)


class Halted(Exception):
    """The campaign stopped early and can be resumed; the message says why in one line."""


RESUMED, WHOLE = RunOptions(), Scope()


def run(
    campaign: Campaign,
    folder: Path,
    options: RunOptions = RESUMED,
    scope: Scope = WHOLE,
    engine: work.Engine | None = None,
    store: Store = STORE,
) -> CampaignOutcome:
    """Run a campaign in `folder` and return its outcome.

    Raises
    ------
    InputError
        Before anything is computed: the folder has another campaign or files that are not the tool's, is locked or
        cannot be written, or an event that a fault or requirement names is not in the flight.
    Halted
        Disk full or gone, workers lost again and again, or a failure with `fail_fast`: the same call resumes.
    KeyboardInterrupt
        After the workers are gone; the same call resumes.
    """
    jobs = (os.cpu_count() or 1) if options.jobs < 1 else options.jobs
    progress = options.progress or Progress()
    options = options._replace(jobs=jobs, progress=progress)
    try:
        campaign_run = _Run(campaign, folder, options, engine or work.ENGINE, scope)
        store.check_folder(folder)  # before a lock is written to a folder that is not the tool's
        with folder_lock(folder):  # a campaign that is refused creates no folder
            if scope.shard is not None:
                return campaign_run.compute_shard(store, options.mode)
            return campaign_run.compute_all(store, options.mode, options.on_answers, scope.shards)
    except KeyboardInterrupt:
        end_workers(jobs)
        raise
    except TerminatedWorkerError as error:
        raise_if_interrupted(error)  # the workers of a process group end with it
        fewer_jobs = max(1, jobs // 2)
        raise Halted(
            f"a worker process died (out of memory?); the same command resumes, try --jobs {fewer_jobs}"
        ) from None
    except OSError as error:
        end_workers(jobs)
        if error.errno is None:
            raise
        raise Halted(system_message(error, folder)) from None
    finally:
        progress.close()


class _Run:
    """Stages of one run of a campaign, and their state."""

    def __init__(
        self, campaign: Campaign, folder: Path, options: RunOptions, engine: work.Engine, scope: Scope
    ) -> None:
        self.campaign = campaign
        self.folder = folder
        self.progress = options.progress or Progress()
        self.jobs = options.jobs
        self.fail_fast = options.fail_fast
        self.shard = scope.shard
        self.space = scope.space
        checked_cases = probes(campaign)
        self.cases = [] if self.space is not None else checked_cases
        self.labels = {case.id: case.label for case in self.cases}
        self.failures: list[str] = []
        self.lost_items: list[str] = []
        self.timings: dict[str, float] = {}
        self.deaths = 0
        self.job = work.job_of(campaign, engine, folder)
        self.stopping = Stopping(campaign)
        if not is_filled():
            self.progress.note(COMPILING)
        # another worker compiles kernels that do not depend on the trajectory
        early_tasks = [statistics.compile_kernels] if campaign.monte_carlo and self.jobs > 1 else []
        self.remarks = check_flight(campaign.probe, checked_cases, engine, self.jobs, early_tasks).remarks
        self.blocks = blocks(campaign, self.cases, {})
        if self.space is not None:
            # The few designs that are analysed completely need not read every setting of the campaign.
            check_effect(campaign.probe, checked_cases, engine)
        elif self.shard is not None:
            # which settings have an effect, and when a case has enough runs, is decided by all cases and runs
            check_effect(campaign, self.cases, engine)
            self._select_shard(self.shard)

    def _select_shard(self, shard: Shard) -> None:
        """Keep the blocks of a shard and their cases; without runs, the shard's share of the cases."""
        self.stopping.is_early = False
        self.job = self.job._replace(requirements=())
        self.blocks = list(shard.select(self.blocks))
        case_ids = {block.case.id for block in self.blocks}
        if not case_ids and not self.campaign.monte_carlo:
            case_ids = {case.id for case in shard.select(self.cases)}
        self.cases = [case for case in self.cases if case.id in case_ids]

    def _open_results(self, store: Store, mode: Mode) -> None:
        """Open the folder of results; this process has its lock."""
        if mode == "fresh":
            self._remove_scratch()
        content = manifest(self.campaign, self.cases)
        if self.shard is not None:
            content["shard"] = [*self.shard]
        results = store.open_results(self.folder, self.campaign.name, resolved_text(self.campaign), content, mode)
        self.job = self.job._replace(results=results)

    def compute_shard(self, store: Store, mode: Mode) -> CampaignOutcome:
        """Compute a shard: covariance of its cases, diagnostics of those whose first block it has, its blocks."""
        self._open_results(store, mode)
        if self.space is not None and self.shard is not None:
            self.space.evaluate(self.job, self._evaluate_parts, self.shard.select(range(self.space.item_count)))
        answers = self._covariance_results(None) if self.cases else []
        valid_cases = [case for case, answer in zip(self.cases, answers, strict=True) if not answer.error]
        diagnosed_ids = {block.case.id for block in self.blocks if block.first_run == 0}
        if not self.campaign.monte_carlo:
            diagnosed_ids = {case.id for case in valid_cases}
        items = [(self.job, case) for case in valid_cases if case.id in diagnosed_ids]
        self._process_cases("diagnostics", work.diagnose, items, "covariance diagnostics")
        self._simulate_blocks(valid_cases)
        end_workers(self.jobs)
        self.job.results.finish_shard(
            {"timings_s": self.timings, "lost": self.lost_items, "shard_finished": not self.lost_items}
        )
        return CampaignOutcome(tuple(answers), tuple(self.failures))

    def compute_all(
        self, store: Store, mode: Mode, on_answers: OnAnswers | None, shards: Sequence[Path] = ()
    ) -> CampaignOutcome:
        """Compute all stages: designs, linear covariance, diagnostics, runs, tables."""
        self._open_results(store, mode)
        for folder in shards:
            names = [case.id for case in self.cases]
            if self.space is not None:
                names += self.space.names(folder / scratch.FOLDER)
            self.job.results.copy_cases(folder, names)
        if self.space is not None:
            self._choose_designs(self.space)
        answers = self._covariance_results(on_answers)
        valid_cases, incomplete_cases = [], []
        for case, answer in zip(self.cases, answers, strict=True):
            if not answer.error:
                valid_cases.append(case)
                if not answer.is_whole:
                    incomplete_cases.append(case)
        items = [(self.job, case) for case in incomplete_cases]
        self._process_cases("diagnostics", work.diagnose, items, "covariance diagnostics")
        lost_ids = self._simulate_blocks(valid_cases)
        table_items = [
            (self.job, case, self.stopping.runs(case.id)) for case in incomplete_cases if case.id not in lost_ids
        ]
        lost_ids |= self._process_cases("tables", work.write_tables, table_items, "tables")
        self._finish([case for case in valid_cases if case.id not in lost_ids])
        return CampaignOutcome(tuple(answers), tuple(self.failures))

    def _finish(self, complete_cases: Sequence[Case]) -> None:
        """Merge the tables of the complete cases, write the manifest and remove files that are no longer needed."""
        record = {
            **self.remarks,
            "timings_s": self.timings,
            "lost": [without_folders(line) for line in self.lost_items],
            "workers_died": self.deaths,
            # In the order of the plan, not of completion: the bytes of the tables must not depend on the workers.
            "cases": [case.id for case in complete_cases],
            "blocks_removed": self.space is not None and not self.lost_items,
        }
        is_tested = self.campaign.monte_carlo is not None and bool(self.campaign.requirements)
        trace = self._trace_worst_runs if is_tested else None
        self.job.results.finish(record, trace, partial(map_items, self.jobs))
        end_workers(self.jobs)  # this process alone makes the report and can use their memory
        if self.lost_items:  # the same command repeats the lost work items, and merges them with these tables
            return
        self.job.results.remove_case_tables()
        if self.space is not None:  # the blocks would take most of the disk space, and the tables have every run
            self.job.results.remove_blocks()
        self._remove_scratch()

    def _choose_designs(self, space: DesignStage) -> None:
        """Evaluate all designs; the chosen designs become the cases of the campaign."""
        space.evaluate(self.job, self._evaluate_parts)
        choice = space.finish(self.job)
        self.cases = list(choice.cases)
        self.labels = {case.id: case.label for case in self.cases}
        self.blocks = blocks(self.campaign, self.cases, {})
        self.job.results.add_cases(self.labels, {"space": choice.remark})

    def _evaluate_parts(self, name: str, function: Any, items: Sequence[Any]) -> Iterator[Any]:
        """Yield the outcomes of parts of the designs; raise Halted if a part is lost."""
        self.progress.stage(name, sum(len(item[-1].numbers) for item in items))
        for outcome in self._stage_results(name, function, items):
            self.progress.advance(outcome.n_run)
            if outcome.error:
                raise Halted(f"{outcome.case}: {outcome.error}; the same command resumes")
            yield outcome

    def _trace_worst_runs(self, folder: Path) -> None:
        """Repeat the worst runs and store their errors over time."""
        from lvnav_trade.results.requirements.margins import worst_runs
        from lvnav_trade.results.tables.read import Tables

        table = worst_runs(Tables(folder))
        worst = table.groupby("case", sort=False).run_number
        runs = {str(case): sorted(set(numbers)) for case, numbers in worst}
        items = [(self.job, case, runs[case.id]) for case in self.cases if case.id in runs]
        self._process_cases("worst runs", replay.trace, items, "its worst runs over time")

    def _remove_scratch(self) -> None:
        names = list(self.labels)
        if self.space is not None:
            names += self.space.names(self.job.scratch)
        scratch.remove(self.job.scratch, names)

    def _stage_results(self, name: str, function: Any, items: Iterable[Any]) -> Iterator[Any]:
        """Yield the results of a stage in order of completion and time the stage; repeat the items of dead workers."""
        start = time.monotonic()
        work_list = WorkList(items)
        while not work_list.is_done():
            calls = ((function, *item) for item in work_list.open())
            try:
                with closing(map_items(self.jobs, numbered_result, calls)) as results:
                    for number, result in results:
                        work_list.close(number)
                        yield result
            except TerminatedWorkerError as error:
                raise_if_interrupted(error)
                self.deaths += 1
                if self.fail_fast or self.deaths == _DEATHS:
                    raise
                self.jobs = max(2, self.jobs // 2)
                self.progress.note(
                    f"a worker process died (out of memory?); its work is done again by {self.jobs} workers"
                )
        self.timings[name] = round(time.monotonic() - start, 3)

    def _covariance_results(self, on_answers: OnAnswers | None) -> list[work.CovarianceResult]:
        """Return the linear covariance of every case, in the order of the cases."""
        self.progress.stage("compilation and first case", 1)
        by_case: dict[str, work.CovarianceResult] = {}
        function, items = self._covariance_items()
        for result in self._stage_results("covariance", function, items):
            if result is None:  # a kernel has been compiled
                continue
            if result.mistakes:
                case = next(case for case in self.cases if case.id == result.case)
                raise InputError(records=flights.locate_mistakes(self.campaign, case, result.mistakes))
            by_case[result.case] = result
            self.progress.advance(1)
            if len(by_case) == 1 and len(self.cases) > 1:
                self.progress.stage("linear covariance of the others", len(self.cases) - 1)
            if result.error:
                self._record_failure(f"{self.labels[result.case]}: linear covariance: {result.error}", is_lost=True)
            if len(by_case) == len(self.cases):
                self._report_covariance(by_case, on_answers)
        return [by_case[case.id] for case in self.cases]

    def _covariance_items(self) -> tuple[Any, list[tuple[Any, ...]]]:
        """Return the function and the work items of the covariance stage.

        With several workers, others compile the backward pass and the runs while the first case is computed, so that a
        new machine compiles on all of them.
        """
        items: list[tuple[Any, ...]] = [(self.job, case) for case in self.cases]
        if not self.campaign.monte_carlo and self.shard is None:
            return analyse_case, items
        items = [(*item, None) for item in items]
        if self.campaign.monte_carlo and self.jobs > 1:
            first_case = self.cases[0]
            items.insert(0, (self.job, first_case, compile_kernels))
            items.append((self.job, first_case, work.diagnose))
        return covariance_or_early_task, items

    def _report_covariance(self, by_case: dict[str, work.CovarianceResult], on_answers: OnAnswers | None) -> None:
        """Refuse settings without effect on any case, and pass the results on to `on_answers`."""
        if self.shard is None and self.space is None:
            effective_settings = {case: result.effective_settings for case, result in by_case.items()}
            refuse_all(Effects(self.campaign, self.cases).mistakes(effective_settings))
        if on_answers is not None:
            on_answers([by_case[case.id] for case in self.cases], self.cases)

    def _process_cases(self, name: str, function: Any, items: Sequence[Any], item_name: str) -> set[str]:
        """Compute one work item per case; return the digests of the cases whose item is lost.

        item_name : Name of the item in messages.
        """
        if not items:
            return set()
        self.progress.stage(name, len(items))
        lost_ids = set()
        for outcome in self._stage_results(name, function, items):
            self.progress.advance(1)
            if outcome.error:
                lost_ids.add(outcome.case)
                self._record_failure(f"{self.labels[outcome.case]}: {item_name}: {outcome.error}", is_lost=True)
        return lost_ids

    def _simulate_blocks(self, valid_cases: Sequence[Case]) -> set[str]:
        """Simulate all blocks that are not stored; return the digests of the cases that lost a block."""
        stored_spans = {case.id: self.job.results.block_spans(case.id) for case in valid_cases}
        remaining_blocks = []
        for block in self.blocks:
            span = (block.first_run, block.n_run)
            if block.case.id in stored_spans and span not in stored_spans[block.case.id]:
                remaining_blocks.append(block)
        if self.stopping.is_early:
            resumed_items = [(self.job, case) for case in valid_cases if stored_spans[case.id]]
            for outcomes in map_items(self.jobs, work.stored_block_violations, resumed_items, is_ordered=True):
                for outcome in outcomes:
                    self._note_violations(outcome)
        if remaining_blocks:
            self.progress.stage("runs", sum(block.n_run for block in remaining_blocks))
        lost_blocks: list[work.WorkOutcome] = []
        for outcome in self._stage_results("monte_carlo", work.simulate_block, self._needed_blocks(remaining_blocks)):
            self.progress.advance(outcome.n_run)
            self._note_violations(outcome)
            if not self.stopping.wants(outcome.case, outcome.first_run):
                continue  # simulated before an earlier block decided the case
            if outcome.error:
                lost_blocks.append(outcome)
            self._report_block(outcome)
        # A block that a later decision made unnecessary is not lost.
        return {block.case for block in lost_blocks if self.stopping.wants(block.case, block.first_run)}

    def _report_block(self, outcome: work.WorkOutcome) -> None:
        """Record the failure of a block, or of single runs in it."""
        label = self.labels[outcome.case]
        if outcome.error:
            last_run = outcome.first_run + outcome.n_run - 1
            self._record_failure(f"{label}, runs {outcome.first_run} to {last_run}: {outcome.error}", is_lost=True)
        for number, reason in outcome.failures:
            command = f"lvnav-trade replay {self.folder} {outcome.case} {number}"
            self._record_failure(f"{label}, run {number} {reason}; {command}")

    def _note_violations(self, outcome: work.WorkOutcome) -> None:
        """Pass the violating runs of a block on to the sequential test."""
        if not outcome.error:
            self.stopping.note(outcome.case, outcome.first_run, outcome.n_run, outcome.violation_counts)

    def _needed_blocks(self, remaining_blocks: Sequence[Block]) -> Iterator[tuple[work.Job, Block]]:
        """Yield the blocks that are still needed when a worker becomes free; their case may have been decided."""
        for block in remaining_blocks:
            if self.stopping.wants(block.case.id, block.first_run):
                yield self.job, block
            else:
                self.progress.advance(block.n_run)

    def _record_failure(self, line: str, is_lost: bool = False) -> None:
        """Record a failed run, or a lost work item, which has no row in the tables."""
        if is_lost:
            self.lost_items.append(line)
        self.failures.append(line)
        self.progress.note(line)
        if self.fail_fast:
            raise Halted(f"stopped at the first failure: {line}")
