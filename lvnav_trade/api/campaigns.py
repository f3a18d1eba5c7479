"""Campaigns from Python: check, plan, run, self-check, replay of a run, progress."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from lvnav_trade.api.display import CampaignStatus
from lvnav_trade.api.results import Results
from lvnav_trade.api.selecting import case_of
from lvnav_trade.api.types import CheckedCampaign, Plan, ReplayedRun, SelfCheck
from lvnav_trade.campaign.definition.axes import probes
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.load import load as load_campaign
from lvnav_trade.campaign.running import execute, work
from lvnav_trade.campaign.running.checking import TrajectoryCheck, check_effect, check_flight
from lvnav_trade.campaign.running.conduct import Mode, RunOptions, Scope
from lvnav_trade.campaign.running.demonstrable import requirements_beyond_run_count
from lvnav_trade.campaign.running.plan import estimate
from lvnav_trade.campaign.running.progress import Progress, progress_stage
from lvnav_trade.campaign.space.design_plan import estimate_designs, refuse_too_large
from lvnav_trade.campaign.space.numbered_designs import DesignSpace
from lvnav_trade.campaign.space.stage import SpaceEvaluation
from lvnav_trade.campaign.syntax.tree import hint
from lvnav_trade.quantities.errors import InputError, refuse_all
from lvnav_trade.results.tables import remote
from lvnav_trade.results.tables.contents import RESOLVED


def check(campaign: str | Path, sets: Sequence[str] = (), strict: bool = False) -> CheckedCampaign:
    """Validate a campaign without running it.

    All checks that need no simulation are made. They include the trajectories, and settings without effect.

    Parameters
    ----------
    campaign : str or Path
        Campaign file, or name of a campaign that comes with the tool.
    sets : sequence of str
        Assignments such as ``monte_carlo.runs=500``.
    strict : bool
        Refuse requirements that the number of runs cannot demonstrate even if every run meets them.

    Returns
    -------
    CheckedCampaign
        The campaign, its cases, and remarks.

    Raises
    ------
    InputError
        One line per input error, with file, line and column.
    """
    loaded_campaign = load_campaign(campaign, sets)
    remarks = _check_trajectories(loaded_campaign).remarks
    check_effect(loaded_campaign.probe, probes(loaded_campaign), work.ENGINE)
    not_demonstrable = requirements_beyond_run_count(loaded_campaign)
    if strict:
        refuse_all(list(not_demonstrable))
    remark_lines = {name: tuple(lines) for name, lines in remarks.items()}
    remark_lines["warnings"] = (*remark_lines.get("warnings", ()), *map(str, not_demonstrable))
    designs = len(DesignSpace(loaded_campaign)) if loaded_campaign.is_space else 0
    return CheckedCampaign(loaded_campaign, tuple(probes(loaded_campaign)), designs=designs, **remark_lines)


def plan(
    campaign: str | Path, sets: Sequence[str] = (), folder: str | Path | None = None, strict: bool = False
) -> Plan:
    """Estimate the time, disk and memory of a campaign; list its cases and their stored runs.

    Parameters
    ----------
    campaign : str or Path
        Campaign file, or name of a campaign that comes with the tool.
    sets : sequence of str
        Assignments such as ``monte_carlo.runs=500``.
    folder : str or Path, optional
        Folder of its results; ``results/NAME`` if absent.
    strict : bool
        Refuse requirements that the number of runs cannot demonstrate.

    Returns
    -------
    Plan
        Cases, time on one core (s), disk and memory (MB).

    Raises
    ------
    InputError
        The campaign has an input error.
    """
    import pandas as pd

    loaded_campaign = load_campaign(campaign, sets)
    flights = _check_trajectories(loaded_campaign).events
    duration = {case: max(times.values()) - min(times.values()) for case, times in flights.items()}
    not_demonstrable = requirements_beyond_run_count(loaded_campaign)
    place = results_folder(loaded_campaign, folder)
    if strict:
        refuse_all(list(not_demonstrable))
    warnings = tuple(map(str, not_demonstrable))
    if loaded_campaign.is_space:
        designs = estimate_designs(loaded_campaign, place, flights)
        empty = pd.DataFrame(columns=["id", "label", "runs", "done"])
        return Plan(empty, 0, designs.seconds, designs.disk_mb, designs.memory_mb, warnings, designs)
    cost = estimate(loaded_campaign, place, duration)
    return Plan(pd.DataFrame(cost.cases), cost.blocks, cost.seconds, cost.disk_mb, cost.memory_mb, warnings)


def results_folder(campaign: Campaign, folder: str | Path | None) -> Path:
    """Return the folder of the results of a campaign: `folder`, or ``results/NAME`` if it is None."""
    return Path("results", campaign.name) if folder is None else Path(folder)


def flight_events(campaign: Campaign) -> dict[str, dict[str, float]]:
    """Return the events of every case of a campaign.

    Parameters
    ----------
    campaign : Campaign
        A loaded campaign.

    Returns
    -------
    dict of str to dict of str to float
        Times (s) by the digest of the case and by the name of the event.

    Raises
    ------
    InputError
        A setting of the campaign does not fit a trajectory, such as a requirement at an event that does not occur.
    """
    return {case: dict(times) for case, times in _check_trajectories(campaign).events.items()}


def _check_trajectories(campaign: Campaign) -> TrajectoryCheck:
    """Return the events and remarks of the cases; InputError if a setting does not fit a trajectory."""
    _check_sections(campaign)
    return check_flight(campaign.probe, probes(campaign), work.ENGINE, jobs=1)


class Task(NamedTuple):
    """Options of the execution of a campaign.

    jobs : number of worker processes, -1 for all cores.
    fresh : whether to begin again instead of resuming from the stored runs of the folder.
    fail_fast : whether to stop at the first failed run.
    report : whether to build the report.
    copy_to : address that fsspec supports, to which the results are copied; empty for none.
    progress : receives the progress.
    on_answers : called with the results of linear covariance and the cases as soon as they are available.
    shards : folders of shards; their blocks of runs are used instead of computed.
    """

    jobs: int = -1
    fresh: bool = False
    fail_fast: bool = False
    report: bool = True
    copy_to: str = ""
    progress: Progress | None = None
    on_answers: Callable[..., None] | None = None
    shards: Sequence[Path] = ()


def run(
    campaign: str | Path | Campaign,
    sets: Sequence[str] = (),
    folder: str | Path | None = None,
    jobs: int = -1,
    fresh: bool = False,
    fail_fast: bool = False,
    report: bool = True,
    copy_to: str = "",
) -> Results:
    """Run a campaign and build its report.

    Linear covariance comes first, then Monte Carlo. Repeating the call resumes an interrupted campaign.

    Parameters
    ----------
    campaign : str, Path or Campaign
        Campaign file, name of a campaign that comes with the tool, or a loaded one (``check(...).campaign``).
    sets : sequence of str
        Assignments such as ``monte_carlo.runs=500``.
    folder : str or Path, optional
        Folder of results; ``results/NAME`` if absent.
    jobs : int
        Worker processes, -1 for all cores.
    fresh : bool
        Begin again instead of resuming from the stored runs of the folder.
    fail_fast : bool
        Stop at the first failed run.
    report : bool
        Build the report too.
    copy_to : str
        Address that fsspec supports, such as ``s3://bucket/demo``, to which the results are copied.

    Returns
    -------
    Results
        Tables, summary, figures.

    Raises
    ------
    InputError
        The campaign has an input error, or the folder cannot be used.
    campaign.running.execute.Halted
        The campaign stopped early; repeating the call resumes it.
    """
    if not isinstance(campaign, Campaign):
        campaign = load_campaign(campaign, sets)
    elif sets:
        raise InputError("assignments apply to campaign files; give the file, or change the loaded campaign")
    return carry_out(campaign, folder, Task(jobs, fresh, fail_fast, report, copy_to))


def carry_out(campaign: Campaign, folder: str | Path | None, task: Task) -> Results:
    """Run a loaded campaign, build its report and copy the results.

    Parameters
    ----------
    campaign : Campaign
        A loaded campaign.
    folder : str, Path or None
        Folder of results; ``results/NAME`` if None.
    task : Task
        Options of the execution.

    Returns
    -------
    Results
        Tables, summary, figures.

    Raises
    ------
    InputError, campaign.running.execute.Halted
        As `run`.
    """
    place = results_folder(campaign, folder)
    _check_sections(campaign)
    if task.copy_to:
        remote.refuse_foreign_place(task.copy_to)
    if campaign.is_space:
        refuse_too_large(estimate_designs(campaign, place, _check_trajectories(campaign).events), place)
    mode: Mode = "fresh" if task.fresh else "resume"
    options = RunOptions(task.jobs, mode, task.fail_fast, task.progress, task.on_answers)
    space = SpaceEvaluation(campaign) if campaign.is_space else None
    execute.run(campaign, place, options, Scope(shards=task.shards, space=space))
    if task.report:
        from lvnav_trade.report import SECTIONS, build

        with progress_stage(task.progress, "report", len(campaign.report.sections or SECTIONS) + 1) as step:
            build(place, step=step)
    else:
        from lvnav_trade.report import verdict_tables

        verdict_tables(place)
    if task.copy_to:
        remote.copy_to(place, task.copy_to)
    return Results(place)


def _check_sections(campaign: Campaign) -> None:
    """Refuse unknown sections of the report before anything is computed."""
    if campaign.report.sections is None:
        return
    from lvnav_trade.report import SECTIONS

    mistakes = []
    for k, name in enumerate(campaign.report.sections):
        if name not in SECTIONS:
            message = f"no section {name!r}{hint(name, SECTIONS)}"
            mistakes.append(campaign.source_tree.mistake(f"report.sections.{k}", message))
    refuse_all(mistakes)


def selfcheck(
    campaign: str | Path, sets: Sequence[str] = (), jobs: int = -1, progress: Progress | None = None
) -> SelfCheck:
    """Check the internal consistency of every distinct configuration of a campaign.

    The checks cover error definitions, Jacobians, propagation over gaps, innovations and random draws. All statistical
    checks of a campaign together fail by chance with a probability of 1 %. The same campaign always gives the same
    figures.

    Parameters
    ----------
    campaign : str or Path
        Campaign file, or name of a campaign that comes with the tool.
    sets : sequence of str
        Assignments such as ``imu=imu/tactical_fog``.
    jobs : int
        Worker processes, -1 for all cores.
    progress : Progress, optional
        Receives the progress.

    Returns
    -------
    SelfCheck
        Each check with its figure, the allowed range and the verdict.

    Raises
    ------
    InputError
        The campaign has an input error: nothing has been checked.
    """
    from lvnav_trade.campaign.running.selfcheck import selfcheck as checks

    return SelfCheck(tuple(checks(check(campaign, sets).campaign, jobs, progress)))


def replay(
    source: str | Path, case: str, run: int, sets: Sequence[str] = (), folder: str | Path | None = None
) -> ReplayedRun:
    """Repeat one run bit for bit, and record every covariance step.

    Parameters
    ----------
    source : str or Path
        Campaign file, or folder of results.
    case : str
        Label of a case, or its digest or the beginning of it.
    run : int
        Number of the run, from 0.
    sets : sequence of str
        Assignments such as ``imu=imu/tactical_fog``.
    folder : str or Path, optional
        Folder of the trace; the folder of the results if absent.

    Returns
    -------
    ReplayedRun
        Errors at the events and at every covariance step.

    Raises
    ------
    InputError
        The results, the case or the run do not exist.
    """
    import pandas as pd

    from lvnav_trade.campaign.running import replay as replaying

    loaded_campaign, results = _campaign_and_results(source, sets)
    _, found_case = case_of(loaded_campaign, (), case)
    run_replay = replaying.replay(loaded_campaign, found_case, run)
    trace_folder = Path(folder) if folder is not None else results
    trace = replaying.write_trace(run_replay, trace_folder, found_case, run)
    rows = []
    for event, t, sizes, units in run_replay.event_errors:
        for name, size in sizes.items():
            rows.append((event, t, name, size, units[name]))
    events = pd.DataFrame(rows, columns=["event", "t_s", "quantity", "error", "unit"])
    return ReplayedRun(found_case.id, found_case.label, run, run_replay.failure, events, run_replay.trace, trace)


def _campaign_and_results(source: str | Path, sets: Sequence[str]) -> tuple[Campaign, Path]:
    """Return the campaign of a file or of a folder of results, and the folder of its results."""
    folder = Path(source)
    if not folder.is_dir():
        loaded_campaign = load_campaign(source, sets)
        return loaded_campaign, Path("results") / loaded_campaign.name
    frozen = folder / RESOLVED
    if not frozen.is_file():
        raise InputError(f"{folder}: no results here (no {RESOLVED})")
    return load_campaign(frozen, sets), folder


def status(folder: str | Path) -> CampaignStatus:
    """Show the progress of a campaign: running, unfinished, damaged or finished.

    The stored blocks of runs and the tables are checked for damage.

    Parameters
    ----------
    folder : str or Path
        Folder of its results.

    Returns
    -------
    CampaignStatus
        State; runs required, stored and failed, in total and by case; damaged files; `text` for printing.

    Raises
    ------
    InputError
        The folder has no results.
    """
    from lvnav_trade.campaign.running.status import status as look

    return CampaignStatus(*look(Path(folder)))
