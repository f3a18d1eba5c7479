"""Campaigns from Python: check, plan, run, self-check, repeat a run, show progress."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from lvnav_trade.api.choosing import case_of
from lvnav_trade.api.results import Results
from lvnav_trade.api.shown import CampaignStatus
from lvnav_trade.api.types import CheckedCampaign, Plan, ReplayedRun, SelfCheck
from lvnav_trade.campaign.definition.axes import probes
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.load import load as load_campaign
from lvnav_trade.campaign.running import execute, work
from lvnav_trade.campaign.running.checking import Checked, check_effect, check_flight
from lvnav_trade.campaign.running.conduct import Conduct, Mode, Scope
from lvnav_trade.campaign.running.demonstrable import undemonstrable
from lvnav_trade.campaign.running.plan import estimate
from lvnav_trade.campaign.running.progress import Progress, staged
from lvnav_trade.campaign.space.designs import Designs
from lvnav_trade.campaign.space.plan import planned, refuse_too_large
from lvnav_trade.campaign.space.stage import Space
from lvnav_trade.campaign.syntax.tree import hint
from lvnav_trade.errors import InputError, refuse_all
from lvnav_trade.store import remote
from lvnav_trade.store.contents import RESOLVED


def check(campaign: str | Path, sets: Sequence[str] = (), strict: bool = False) -> CheckedCampaign:
    """Check a campaign without running it.

    Everything is checked that needs no run: its trajectories too, and that every setting has an effect on a case.

    Parameters
    ----------
    campaign : str or Path
        Campaign file, or name of a campaign that comes with the tool.
    sets : sequence of str
        Assignments such as ``monte_carlo.runs=500``.
    strict : bool
        Refuse requirements that the runs could not show even if all of them were good.

    Returns
    -------
    CheckedCampaign
        The campaign, its cases, and remarks.

    Raises
    ------
    InputError
        One line per mistake, with file, line and column.
    """
    found = load_campaign(campaign, sets)
    remarks = _checked(found).remarks
    check_effect(found.probe, probes(found), work.ENGINE)
    open_ones = undemonstrable(found)
    if strict:
        refuse_all(list(open_ones))
    remarks = remarks | {"warnings": [*remarks.get("warnings", ()), *map(str, open_ones)]}
    designs = len(Designs(found)) if found.is_space else 0
    kinds = {name: tuple(lines) for name, lines in remarks.items()}
    return CheckedCampaign(found, tuple(probes(found)), designs=designs, **kinds)


def plan(
    campaign: str | Path, sets: Sequence[str] = (), folder: str | Path | None = None, strict: bool = False
) -> Plan:
    """Return the cases of a campaign, what they take, and what is done already.

    Parameters
    ----------
    campaign : str or Path
        Campaign file, or name of a campaign that comes with the tool.
    sets : sequence of str
        Assignments such as ``monte_carlo.runs=500``.
    folder : str or Path, optional
        Folder of its results; ``results/NAME`` if absent.
    strict : bool
        Refuse requirements that the runs could not show.

    Returns
    -------
    Plan
        Cases, seconds of one core, megabytes.

    Raises
    ------
    InputError
        A mistake in the campaign.
    """
    found = load_campaign(campaign, sets)
    flights = _checked(found).events
    duration = {case: max(times.values()) - min(times.values()) for case, times in flights.items()}
    open_ones, place = undemonstrable(found), place_of(found, folder)
    if strict:
        refuse_all(list(open_ones))
    import pandas as pd

    warnings = tuple(map(str, open_ones))
    if found.is_space:
        many = planned(found, place, flights)
        empty = pd.DataFrame(columns=["id", "label", "runs", "done"])
        return Plan(empty, 0, many.seconds, many.disk_mb, many.memory_mb, warnings, many)
    made = estimate(found, place, duration)
    return Plan(pd.DataFrame(made.cases), made.blocks, made.seconds, made.disk_mb, made.memory_mb, warnings)


def place_of(campaign: Campaign, folder: str | Path | None) -> Path:
    """Return where results go: `folder`, or else ``results/NAME``."""
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
        Times (s) by the digest of the case and by name of the event.

    Raises
    ------
    InputError
        The campaign does not fit its flights.
    """
    return {case: dict(times) for case, times in _checked(campaign).events.items()}


def _checked(campaign: Campaign) -> Checked:
    """Return events and remarks of the cases; InputError where the campaign does not fit its flights."""
    _check_sections(campaign)
    return check_flight(campaign.probe, probes(campaign), work.ENGINE, jobs=1)


class Task(NamedTuple):
    """How a campaign is run.

    jobs : worker processes, -1 for all cores.
    fresh : begin again instead of resuming what the folder holds.
    fail_fast : stop at the first failed run.
    report : build the report too.
    copy_to : place that fsspec knows, where the results are copied.
    progress : what watches.
    on_answers : called with linear covariance's answers and the cases, as soon as they are there.
    shards : folders of shards, whose blocks are taken first.
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

    Linear covariance comes first, then Monte Carlo. The same call resumes what was interrupted.

    Parameters
    ----------
    campaign : str, Path or Campaign
        Campaign file, name of a campaign that comes with the tool, or a loaded one (``check(...).campaign``).
    sets : sequence of str
        Assignments such as ``monte_carlo.runs=500``.
    folder : str or Path, optional
        Where results go; ``results/NAME`` if absent.
    jobs : int
        Worker processes, -1 for all cores.
    fresh : bool
        Begin again instead of resuming what the folder holds.
    fail_fast : bool
        Stop at the first failed run.
    report : bool
        Build the report too.
    copy_to : str
        Place that fsspec knows, such as ``s3://bucket/demo``, to which the results are copied.

    Returns
    -------
    Results
        Tables, summary, figures.

    Raises
    ------
    InputError
        A mistake in the campaign, or a folder that cannot be used.
    campaign.running.execute.Halted
        Stopped early; the same call resumes.
    """
    if not isinstance(campaign, Campaign):
        campaign = load_campaign(campaign, sets)
    elif sets:
        raise InputError("a loaded campaign takes no assignments; give the file, or change the campaign")
    return carry_out(campaign, folder, Task(jobs, fresh, fail_fast, report, copy_to))


def carry_out(campaign: Campaign, folder: str | Path | None, task: Task) -> Results:
    """Run a loaded campaign as a task says; the results are in `folder`, or else ``results/NAME``.

    InputError and Halted as of `run`.
    """
    place = place_of(campaign, folder)
    _check_sections(campaign)
    if task.copy_to:
        remote.refuse_foreign_place(task.copy_to)
    if campaign.is_space:
        refuse_too_large(planned(campaign, place, _checked(campaign).events), place)
    mode: Mode = "fresh" if task.fresh else "resume"
    conduct = Conduct(task.jobs, mode, task.fail_fast, task.progress, task.on_answers)
    space = Space(campaign) if campaign.is_space else None
    execute.run(campaign, place, conduct, Scope(shards=task.shards, space=space))
    if task.report:
        from lvnav_trade.report import SECTIONS, build

        with staged(task.progress, "report", len(campaign.report.sections or SECTIONS) + 1) as step:
            build(place, step=step)
    else:
        from lvnav_trade.report import verdict_tables

        verdict_tables(place)
    if task.copy_to:
        remote.copy_to(place, task.copy_to)
    return Results(place)


def _check_sections(campaign: Campaign) -> None:
    """Refuse a section that the report does not have before anything is computed for it."""
    if campaign.report.sections is None:
        return
    from lvnav_trade.report import SECTIONS

    wrong = [
        campaign.written.mistake(f"report.sections.{index}", f"no section {name!r}{hint(name, SECTIONS)}")
        for index, name in enumerate(campaign.report.sections)
        if name not in SECTIONS
    ]
    refuse_all(wrong)


def selfcheck(
    campaign: str | Path, sets: Sequence[str] = (), jobs: int = -1, progress: Progress | None = None
) -> SelfCheck:
    """Check the configuration of every distinct case by itself.

    Error definitions, Jacobians, propagation over gaps, innovations and draws. The statistics of a campaign fail by
    chance with 1 %; the same campaign always gives the same figures.

    Parameters
    ----------
    campaign : str or Path
        Campaign file, or name of a campaign that comes with the tool.
    sets : sequence of str
        Assignments such as ``imu=imu/tactical_fog``.
    jobs : int
        Worker processes, -1 for all cores.
    progress : Progress, optional
        What watches.

    Returns
    -------
    SelfCheck
        Each check with its figure, what is allowed and the verdict.

    Raises
    ------
    InputError
        A mistake in the campaign: nothing has been checked.
    """
    from lvnav_trade.campaign.running.selfcheck import selfcheck as checks

    return SelfCheck(tuple(checks(check(campaign, sets).campaign, jobs, progress)))


def replay(
    source: str | Path, case: str, run: int, sets: Sequence[str] = (), folder: str | Path | None = None
) -> ReplayedRun:
    """Repeat one run, bit for bit, and keep every step.

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
        Where the trace is written; the folder of the results if absent.

    Returns
    -------
    ReplayedRun
        Errors at the events and at every covariance step.

    Raises
    ------
    InputError
        No such results, case or run.
    """
    from lvnav_trade.campaign.running import replay as again

    loaded, results = _campaign_of(source, sets)
    _, chosen = case_of(loaded, (), case)
    found = again.replay(loaded, chosen, run)
    trace = again.write_trace(found, Path(folder) if folder is not None else results, chosen, run)
    import pandas as pd

    rows = [
        (event, t, name, size, units[name])
        for event, t, sizes, units in found.at_events
        for name, size in sizes.items()
    ]
    events = pd.DataFrame(rows, columns=["event", "t_s", "quantity", "error", "unit"])
    return ReplayedRun(chosen.id, chosen.label, run, found.failure, events, found.trace, trace)


def _campaign_of(source: str | Path, sets: Sequence[str]) -> tuple[Campaign, Path]:
    """Return the campaign of a file or of a folder of results, and the folder of its results."""
    folder = Path(source)
    if not folder.is_dir():
        loaded = load_campaign(source, sets)
        return loaded, Path("results") / loaded.name
    frozen = folder / RESOLVED
    if not frozen.is_file():
        raise InputError(f"{folder}: no results here (no {RESOLVED})")
    return load_campaign(frozen, sets), folder


def status(folder: str | Path) -> CampaignStatus:
    """Show the progress of a campaign: running, unfinished, damaged or finished; blocks and tables are checked.

    Parameters
    ----------
    folder : str or Path
        Folder of its results.

    Returns
    -------
    CampaignStatus
        State, runs required, stored and failed, by case too; damaged files; `text` in words.

    Raises
    ------
    InputError
        There are no results.
    """
    from lvnav_trade.campaign.running.status import status as look

    return CampaignStatus(*look(Path(folder)))
