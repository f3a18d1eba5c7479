"""Work items of a campaign, each computed by one worker: linear covariance of a case, a block of runs, tables."""

import gc
import hashlib
import itertools
import math
import multiprocessing
import os
import signal
import threading
import time
import traceback
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.interrupts import raise_if_interrupted
from lvnav_trade.campaign.running import stopping
from lvnav_trade.campaign.running.plan import Block
from lvnav_trade.covariance import history as lincov
from lvnav_trade.covariance.diagnostics import case_diagnostics
from lvnav_trade.covariance.diagnostics.confirming_runs import add_alarms, add_nominal_alarms
from lvnav_trade.covariance.injection_covariance import merge_sources
from lvnav_trade.gnss.recorded_errors import refuse_short
from lvnav_trade.gnss.satellites import satellites
from lvnav_trade.quantities.errors import InputError, Mistake
from lvnav_trade.quantities.reads import FieldReads
from lvnav_trade.quantities.records import CovarianceRequest, CovHistory, Output, ProtectionRisks
from lvnav_trade.results.tables import scratch
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation import montecarlo, nozzle, settings_read, statistics
from lvnav_trade.simulation.preparation import initial_draws as starts
from lvnav_trade.simulation.preparation.cache import trajectory_of
from lvnav_trade.simulation.preparation.prepare import PreparedCase, prepare
from lvnav_trade.simulation.preparation.signals.recorded_solution import table_of
from lvnav_trade.trajectory.truth import Remark

Save = Callable[[Path, Any, str], None]  # `scratch.save` or `scratch.cache`
FAILURE_REASONS = {1: "is not finite", 2: "diverged"}


class Engine(NamedTuple):
    """Functions that compute the work items; tests replace them."""

    events: Callable[[Scenario], dict[str, float]]  # (scenario): event names and times (s)
    prepare: Callable[[Scenario, float], Any]  # (scenario, history step): case prepared for the engines
    run_block: Callable[[Any, int, int, int], Any]  # (prepared case, seed, first run, number of runs): RunBlock
    covariance: Callable[[Any], CovHistory]  # (prepared case): linear covariance
    summarise: Callable[..., Any]  # (block, events, scale, outputs): BlockSummary
    # (prepared case, request): compiles the backward pass and the runs in advance
    compile_kernels: Callable[[Any, CovarianceRequest], None]
    diagnose: Callable[..., Any]  # (scenario, prepared case, covariance, request): diagnostics
    # (requirements, case, prepared case, covariance, summary): numbers of violating runs
    count_violations: Callable[..., stopping.Counts]
    start_draws: Callable[[Any, int, int], Any]  # (prepared case, seed, n): initial draws of the first n runs
    control: Callable[[Scenario, int, int], Any]  # (scenario, seed, n): missions under control, or None
    # (prepared case, paths read): settings with an effect
    effective_settings: Callable[[Any, Collection[str]], settings_read.EffectiveSettings | None]
    remarks: Callable[[Scenario], tuple[Remark, ...]] = lambda scenario: ()  # on the flight


class TrajectorySummary(NamedTuple):
    """Events and remarks of a trajectory."""

    events: dict[str, float]  # times (s) by name
    remarks: tuple[Remark, ...] = ()  # notes for the user, such as a quantity outside validated limits


def _events(scenario: Scenario) -> dict[str, float]:
    """Return the event times (s) of a trajectory; InputError if it, the satellites or a recorded table is invalid."""
    with _add_error_path("base.trajectory"):
        flight = trajectory_of(scenario)
    with _add_error_path("base.constellation"):
        satellites(scenario.constellation, scenario.trajectory.epoch)
    table = table_of(scenario)
    if table is not None:
        with _add_error_path("base.receiver.solution.error_table"):
            refuse_short(table, flight.start, flight.end)
    return dict(flight.events)


def _remarks(scenario: Scenario) -> tuple[Remark, ...]:
    """Return the remarks on a trajectory that `_events` has accepted, each with the name of the trajectory."""
    name = scenario.trajectory.name
    return tuple(remark._replace(text=f"{name}: {remark.text}") for remark in trajectory_of(scenario).remarks)


@contextmanager
def _add_error_path(path: str) -> Iterator[None]:
    """Add the path of a field to input errors raised within the block."""
    try:
        yield
    except InputError as error:
        raise InputError(records=[record._replace(path=record.path or path) for record in error.records]) from None


def _compile_kernels(prepared_case: PreparedCase, request: CovarianceRequest) -> None:
    if request.adjoint:  # first: another worker needs it right after the forward pass, the runs begin later
        lincov.compile_backward(prepared_case)
    montecarlo.compile_kernels(prepared_case)


ENGINE = Engine(
    _events,
    prepare,
    montecarlo.run_block,
    lincov.covariance,
    statistics.summarise,
    _compile_kernels,
    case_diagnostics.diagnose,
    stopping.violating_runs,
    starts.start_draws,
    nozzle.nozzle_statistics,
    settings_read.effective_settings,
    _remarks,
)


class Job(NamedTuple):
    """Data that all work items of a campaign have in common."""

    engine: Engine
    results: Any  # writer of the results
    seed: int  # of all random draws
    history_step: float  # step of the stored histories, s
    request: CovarianceRequest  # results required of linear covariance
    scratch: Path  # folder of scratch files
    requirements: tuple[dict[str, Any], ...] = ()  # requirements that decide when the runs of a case stop


def job_of(campaign: Campaign, engine: Engine, folder: Path) -> Job:
    """Return the job of a campaign, without results; it has the requirements only if they decide when runs stop."""
    is_early = campaign.monte_carlo is not None and campaign.monte_carlo.stop is not None
    requirements = tuple(requirement.model_dump(mode="json") for requirement in campaign.requirements if is_early)
    request = covariance_request(campaign)
    return Job(engine, None, campaign.seed, campaign.keep.history, request, folder / scratch.FOLDER, requirements)


def covariance_request(campaign: Campaign) -> CovarianceRequest:
    """Return the results that a campaign requires of linear covariance."""
    card = campaign.covariance
    events: dict[str, None] = {}
    for requirement in campaign.requirements:
        events |= dict.fromkeys(requirement.events)
    protection = None if card.protection is None else ProtectionRisks(**card.protection.model_dump())
    settings = card.model_dump()
    settings["event"] = settings.pop("at") or ""
    settings["window"] = card.window or 0.0
    settings["protection"] = protection
    return CovarianceRequest(events=tuple(events), seed=campaign.seed, allan=campaign.keep.allan or 0.0, **settings)


class CovarianceResult(NamedTuple):
    """Result of linear covariance for a case at one event: RMS of the true error (with its mean) and formal sigma."""

    case: str  # digest
    event: str  # name of the event
    rows: tuple[tuple[str, float, float, str], ...] = ()  # quantity, true, formal, unit
    error: str = ""  # reason why there is no result
    mistakes: tuple[Mistake, ...] = ()  # input errors that appear only when the case is prepared
    effective_settings: settings_read.EffectiveSettings | None = None  # None if they are not determined
    is_whole: bool = False  # whether diagnostics and tables of the case are finished too


class WorkOutcome(NamedTuple):
    """Outcome of a work item."""

    case: str  # digest
    first_run: int
    n_run: int
    failures: tuple[tuple[int, str], ...] = ()  # failed runs: number and reason
    error: str = ""  # error that lost the whole item
    violation_counts: stopping.Counts = ()  # violating runs by requirement, if these decide when a case stops


def trajectory_summary(engine: Engine, case: Case) -> TrajectorySummary | InputError:
    """Return events and remarks of a case's trajectory, or the input error that makes it invalid."""
    try:
        return TrajectorySummary(engine.events(case.scenario), engine.remarks(case.scenario))
    except InputError as error:
        return error


def compute_covariance(job: Job, case: Case, save: Save = scratch.save) -> CovarianceResult:
    """Compute a case's linear covariance and save it: by default to a scratch file that all workers can read."""
    try:
        prepared_case, effective_settings = _prepared_and_settings(job, case)
        file, identity = _covariance_file(job, case)
        if not scratch.is_sound(file, CovHistory, identity):
            save(file, job.engine.covariance(prepared_case), identity)
        covariance = _load_covariance(job, case)
        result = _covariance_result(case, prepared_case, covariance)
        return result._replace(effective_settings=effective_settings)
    except InputError as error:
        return CovarianceResult(case.id, "", mistakes=error.records)
    except Exception as error:
        return CovarianceResult(case.id, "", error=message_of(error))


def diagnose(job: Job, case: Case, save: Save = scratch.save) -> WorkOutcome:
    """Compute the diagnostics of a case's linear covariance and save them, as `compute_covariance` saves its result."""
    try:
        file, identity = diagnostics_file(job, case)
        if not scratch.is_sound(file, case_diagnostics.CaseDiagnostics, identity):
            covariance = _load_covariance(job, case)
            prepared_case = prepared_of(job, case)
            diagnostics = job.engine.diagnose(case.scenario, prepared_case, covariance, job.request)
            save(file, diagnostics, identity)
        return WorkOutcome(case.id, 0, 0)
    except Exception as error:
        return WorkOutcome(case.id, 0, 0, error=message_of(error))


def simulate_block(job: Job, block: Block) -> WorkOutcome:
    """Simulate a block of runs and store its statistics."""
    outcome = WorkOutcome(block.case.id, block.first_run, block.n_run)
    try:
        prepared_case = prepared_of(job, block.case)
        covariance = _load_covariance(job, block.case)
        runs = job.engine.run_block(prepared_case, job.seed, block.first_run, block.n_run)
        if job.request.protection is not None and job.request.protection.alarms:
            protection = _load_diagnostics(*diagnostics_file(job, block.case)).protection
            runs = add_alarms(runs, prepared_case, protection, job.seed)
        events = case_diagnostics.flight_events(prepared_case)
        summary = job.engine.summarise(runs, events, covariance.true_sigma, prepared_case.outputs)
        job.results.write_block(block.case.id, summary)
        violation_counts: stopping.Counts = ()
        if job.requirements:
            violation_counts = job.engine.count_violations(
                job.requirements, block.case.id, prepared_case, covariance, summary
            )
        return outcome._replace(failures=tuple(_failed_runs(runs, block.first_run)), violation_counts=violation_counts)
    except Exception as error:
        return outcome._replace(error=message_of(error))


def stored_block_violations(job: Job, case: Case) -> list[WorkOutcome]:
    """Count the runs that violate each requirement, in each stored block of a case, with one block in memory."""
    prepared_case = prepared_of(job, case)
    covariance = _load_covariance(job, case)
    outcomes = []
    for summary in job.results.block_summaries(case.id):
        violation_counts = job.engine.count_violations(job.requirements, case.id, prepared_case, covariance, summary)
        outcomes.append(WorkOutcome(case.id, summary.first_run, summary.n_run, violation_counts=violation_counts))
    return outcomes


def write_tables(job: Job, case: Case, runs: int) -> WorkOutcome:
    """Merge the blocks of a case's first `runs` runs and write its tables."""
    try:
        prepared_case = prepared_of(job, case)
        covariance = _load_covariance(job, case)
        if not job.request.budget:
            injection = merge_sources(covariance.injection)
            covariance = covariance._replace(sources=(), budget=covariance.budget[:, :0], injection=injection)
        block_summaries = job.results.block_summaries(case.id, runs) if runs else None
        file, identity = diagnostics_file(job, case)
        diagnostics = protection = None
        if scratch.exists(file, identity):
            diagnostics = scratch.load(file, case_diagnostics.CaseDiagnostics, identity)
            protection = diagnostics.protection
        covariance = add_nominal_alarms(covariance, prepared_case, protection)
        draws = job.engine.start_draws(prepared_case, job.seed, runs) if runs else None
        control = job.engine.control(case.scenario, job.seed, runs) if runs else None
        job.results.write_case(case, prepared_case, covariance, block_summaries, diagnostics, draws, control)
        return WorkOutcome(case.id, 0, runs)
    except Exception as error:
        return WorkOutcome(case.id, 0, runs, error=message_of(error))


KEPT_CASES = 2
"""Number of prepared cases that a worker keeps, each of 10 MB and more."""
_prepared_cases: dict[tuple[Any, str, float], tuple[Any, settings_read.EffectiveSettings | None]] = {}


def prepared_of(job: Job, case: Case) -> Any:
    """Return a case prepared for the engines."""
    prepared_case, _ = _prepared_and_settings(job, case)
    return prepared_case


def _prepared_and_settings(job: Job, case: Case) -> tuple[Any, settings_read.EffectiveSettings | None]:
    """Return the prepared case and its effective settings; the last cases are cached, as blocks come in order."""
    key = (job.engine.prepare, case.id, job.history_step)
    if key not in _prepared_cases:
        while len(_prepared_cases) >= KEPT_CASES:
            del _prepared_cases[next(iter(_prepared_cases))]
        _prepared_cases[key] = prepared_with(job.engine, case, job.history_step)
    return _prepared_cases[key]


def prepared_with(engine: Engine, case: Case, history: float) -> tuple[Any, settings_read.EffectiveSettings | None]:
    """Return a prepared case and the settings with an effect on it; `history` is the step of its history (s)."""
    reads = FieldReads(case.scenario)
    prepared_case = engine.prepare(reads.card, history)
    return prepared_case, engine.effective_settings(prepared_case, frozenset(reads.paths))


@lru_cache(maxsize=2)
def _load_diagnostics(file: Path, identity: str) -> case_diagnostics.CaseDiagnostics:
    return scratch.read(file, case_diagnostics.CaseDiagnostics, identity)


def _covariance_file(job: Job, case: Case) -> tuple[Path, str]:
    return job.scratch / f"{case.id}.{job.history_step!r}.covariance", _identity(job, case)


def diagnostics_file(job: Job, case: Case) -> tuple[Path, str]:
    """Return the scratch file of a case's diagnostics and its identity; other required results have another file."""
    request_text = repr((job.request, job.history_step))
    digest = hashlib.sha256(request_text.encode()).hexdigest()[:8]
    return job.scratch / f"{case.id}.{digest}.explained", _identity(job, case, request_text)


def _identity(job: Job, case: Case, request_text: str = "") -> str:
    """Return the origin of a scratch file: campaign, case, code, step of the history, required results."""
    return f"{job.results.identity_of_case(case.id)} history={job.history_step!r} {request_text}"


def _load_covariance(job: Job, case: Case) -> CovHistory:
    file, identity = _covariance_file(job, case)
    history: CovHistory = scratch.load(file, CovHistory, identity)
    return history


def _covariance_result(case: Case, prepared_case: Any, covariance: CovHistory) -> CovarianceResult:
    events = case_diagnostics.flight_events(prepared_case)
    event = "injection" if "injection" in events else max(events, key=events.__getitem__, default="end")
    t_event = events.get(event, covariance.t[-1])
    k = int(np.argmin(np.abs(covariance.t - t_event)))
    rows = []
    for label, index in navigation(prepared_case.outputs):
        true_sigma = covariance.true_sigma[k, index]
        mean = covariance.mean[k, index]
        formal_sigma = covariance.formal_sigma[k, index]
        true_error = math.hypot(*true_sigma, *mean) * label.label_factor
        formal_error = math.hypot(*formal_sigma) * label.label_factor
        rows.append((label.quantity, true_error, formal_error, label.label_unit))
    return CovarianceResult(case.id, event, tuple(rows))


def navigation(outputs: Sequence[Output]) -> Iterator[tuple[Output, list[int]]]:
    """Yield for position, velocity and attitude the first of their outputs, and the indices of all of them."""
    for quantity in ("position", "velocity", "attitude"):
        index = [i for i, output in enumerate(outputs) if output.quantity == quantity]
        if index:
            yield outputs[index[0]], index


def _failed_runs(runs: Any, first_run: int) -> Iterator[tuple[int, str]]:
    """Yield number and reason of each failed run of a block."""
    for index in np.flatnonzero(np.asarray(runs.failed)):
        t_failed, code = float(runs.t_failed[index]), int(runs.failed[index])
        reason = FAILURE_REASONS.get(code, f"failed with code {code}")
        if not math.isnan(t_failed):
            reason = f"{reason} at {t_failed:g} s"
        yield first_run + int(index), reason


def message_of(error: Exception) -> str:
    """Return the error of a work item in one line; raise an input error, an interrupt, a full disk."""
    raise_if_interrupted(error)
    if isinstance(error, InputError | OSError):
        raise error
    if os.environ.get("LVNAV_TRADE_DEBUG"):
        traceback.print_exc()
    lines = str(error).strip().splitlines() or ["no message"]
    return f"{type(error).__name__}: {lines[0]}"


_item_counter = itertools.count()  # number of work items that this process has begun


def begin_worker() -> None:
    """Prepare a worker process for its next work item.

    It ignores Ctrl-C, which the parent handles, and ends when the parent is killed. Loaded objects (200,000, most of
    them of numba) are excluded from garbage collection, which took a tenth of the time. The first work items still
    load objects, so the exclusion is repeated at increasing intervals.
    """
    parent = multiprocessing.parent_process()
    if parent is not None and parent.pid is not None:
        if threading.current_thread() is threading.main_thread():  # Dask workers run work items in other threads
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal sends the signal to all processes
        _follow_parent(parent.pid)
        item_number = next(_item_counter)
        if item_number & (item_number - 1) == 0:  # 0, 1, 2, 4, 8, ...
            gc.collect()
            gc.freeze()


@lru_cache(maxsize=1)
def _follow_parent(parent: int) -> None:
    """End this process when its parent is killed: otherwise it would go on and interfere with the next campaign."""

    def wait() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
