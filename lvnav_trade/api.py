"""The same from Python: run, load, check; tidy pandas frames with units in their column names."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.load import load as load_campaign
from lvnav_trade.campaign.running import execute, work
from lvnav_trade.campaign.running.demonstrable import undemonstrable
from lvnav_trade.campaign.running.plan import Estimate, estimate
from lvnav_trade.campaign.running.progress import Progress, staged
from lvnav_trade.campaign.running.replay import find
from lvnav_trade.campaign.syntax.tree import hint
from lvnav_trade.errors import InputError, refuse_all, writing
from lvnav_trade.results import FAILED as FAILED
from lvnav_trade.results import INTERNAL as INTERNAL
from lvnav_trade.results import INTERRUPTED as INTERRUPTED
from lvnav_trade.results import MET as MET
from lvnav_trade.results import UNDECIDED as UNDECIDED
from lvnav_trade.results import USAGE as USAGE
from lvnav_trade.results import VIOLATED as VIOLATED
from lvnav_trade.results import Results as Results
from lvnav_trade.results import exit_code as exit_code
from lvnav_trade.store import remote
from lvnav_trade.store.contents import owned
from lvnav_trade.store.read import load as read

if TYPE_CHECKING:
    from lvnav_trade.campaign.derived import ProcessNoise
    from lvnav_trade.campaign.reading.exporting import Written
    from lvnav_trade.campaign.running.selfcheck import Checked
    from lvnav_trade.filters.scheduled import GainSchedule
    from lvnav_trade.metrics.comparison.comparison import Comparison


def check(campaign: str | Path, sets: Sequence[str] = ()) -> Campaign:
    """Return the campaign of a file after every check that needs no run: those of its trajectories too, and that
    whatever it states has an effect on a case.

    InputError: one line per mistake.
    """
    return examine(campaign, sets)[0]


def examine(campaign: str | Path, sets: Sequence[str] = ()) -> tuple[Campaign, dict[str, list[str]]]:
    """Return the campaign of a file after the checks of `check`, and what is to be said of it: lines by kind
    (``beyond_limits``, ``warnings``, ``notes``).
    """
    found = load_campaign(campaign, sets)
    remarks = _checked(found).remarks
    execute.check_effect(found, cases(found), work.ENGINE)
    return found, remarks | {"warnings": [*remarks.get("warnings", ()), *map(str, undemonstrable(found))]}


def refuse_undemonstrable(campaign: Campaign) -> None:
    """Raise InputError where runs of a campaign, all of them good, would leave a requirement undecided."""
    refuse_all(list(undemonstrable(campaign)))


def plan(campaign: str | Path, sets: Sequence[str] = (), folder: str | Path | None = None) -> Estimate:
    """Return the cases of a campaign, what they will take, and what of it `folder` (``results/NAME``) holds already."""
    found = load_campaign(campaign, sets)
    duration = {case: max(times.values()) - min(times.values()) for case, times in _checked(found).events.items()}
    made = estimate(found, place_of(found, folder), duration)
    return made._replace(warnings=[str(one) for one in undemonstrable(found)])


def place_of(campaign: Campaign, folder: str | Path | None) -> Path:
    """Return where results go: `folder`, or else ``results/NAME``."""
    return Path("results", campaign.name) if folder is None else Path(folder)


def _checked(campaign: Campaign) -> execute.Checked:
    """Return events and remarks of the cases; InputError where the campaign does not fit its flights."""
    _check_sections(campaign)
    return execute.check_flight(campaign, cases(campaign), work.ENGINE, jobs=1)


def run(
    campaign: str | Path | Campaign,
    sets: Sequence[str] = (),
    folder: str | Path | None = None,
    jobs: int = -1,
    fresh: bool = False,
    fail_fast: bool = False,
    report: bool = True,
    progress: Progress | None = None,
    on_answers: Callable[..., None] | None = None,
    shards: Sequence[Path] = (),
    copy_to: str = "",
) -> Results:
    """Carry out a campaign and return its results.

    Parameters
    ----------
    campaign : file, name of a campaign that comes with the tool, or a loaded one
    sets : assignments such as ``monte_carlo.runs=500``
    folder : where results go; ``results/NAME`` if absent
    jobs : worker processes, -1 for all cores
    fresh : begin again instead of resuming what the folder holds
    fail_fast : stop at the first failed run
    report : build the report too
    progress, on_answers, shards : see `campaign.execute.run`
    copy_to : place that fsspec knows, such as ``s3://bucket/demo``, where results are copied when they are there

    Raises
    ------
    InputError
        A mistake in the campaign, or a folder that cannot be used.
    campaign.execute.Halted
        Stopped early; the same call resumes.
    """
    if isinstance(campaign, Campaign):
        if sets:
            raise InputError("a loaded campaign takes no assignments; give the file, or change the campaign")
        found = campaign
    else:
        found = load_campaign(campaign, sets)
    place = place_of(found, folder)
    _check_sections(found)
    if copy_to:
        remote.refuse_foreign_place(copy_to)
    mode: execute.Mode = "fresh" if fresh else "resume"
    execute.run(found, place, jobs, mode, fail_fast, progress, on_answers, shards=shards)
    if report:
        from lvnav_trade.report import SECTIONS, build

        with staged(progress, "report", len(found.report.sections or SECTIONS) + 1) as step:
            build(place, step=step)
    if copy_to:
        remote.copy_to(place, copy_to)
    return load(place)


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


def load(folder: str | Path) -> Results:
    """Return the results in a folder, or at a place that fsspec knows (``s3://bucket/demo``), from which they are
    fetched; InputError where there are none.
    """
    return Results(remote.fetched(str(folder)) if remote.is_remote(folder) else Path(folder))


def build_report(folder: Path, figures: Sequence[str] = (), brief: bool = False) -> Path:
    """Build report.html and CSV tables from a folder of results, figures in formats too (png, svg); return the page.

    brief: a page for ten sheets of paper too, which is returned.
    """
    from lvnav_trade.report import build

    return build(folder, figures=figures, brief=brief)


class Studied(NamedTuple):
    """What a study left: its page; how many published rows no input decides and how many of these hold, by campaign and
    altogether; failed runs as lines.
    """

    page: Path
    campaigns: dict[str, tuple[int, int]]
    published: int
    hold: int
    failures: list[str]


def study(
    folder: str | Path,
    keep: str | Path,
    runs: int | None = None,
    results: str | Path | None = None,
    jobs: int = -1,
    fresh: bool = False,
    only_page: bool = False,
    progress: Callable[[], Progress] | None = None,
    on_campaign: Callable[[str, Results], None] | None = None,
) -> Studied:
    """Run every campaign of a folder in order and keep one page: published numbers beside ours, figures, remarks.

    Parameters
    ----------
    folder : folder of campaigns, with a `study.yaml` that says what the page does; or the name of one of the tool's
    keep : where report.md, figures/, references.csv and agreement.csv go
    runs : runs per case in place of the campaigns' own
    results : where the campaigns' results go; ``results/FOLDER`` if absent
    fresh : begin again instead of resuming; only_page : run nothing, take the results that are there; campaigns without
        results are listed as not flown
    progress : makes the progress of one campaign; on_campaign(name, results) is called when one is done

    Raises
    ------
    InputError
        A mistake in a campaign or in study.yaml: nothing has been computed.
    """
    from lvnav_trade.campaign.derived import behind
    from lvnav_trade.campaign.reading.study import load_study
    from lvnav_trade.metrics.held import evidence, held
    from lvnav_trade.metrics.published import references
    from lvnav_trade.report.study import Answered, build

    owned(keep, "study")  # refused before anything is computed
    found, questions = load_study(folder, runs)
    place = Path(results) if results is not None else Path("results") / (found.name or Path(folder).name)
    answered: list[Answered] = []
    failures: list[str] = []
    counts: dict[str, tuple[int, int]] = {}
    unflown = [one.campaign for one in questions if only_page and not (place / one.campaign.name).is_dir()]
    if len(unflown) == len(questions):
        unflown = []  # the first of them is reported
    for part, campaign in questions:
        mine = place / campaign.name
        if campaign in unflown:
            continue
        if not only_page:
            run(campaign, (), mine, jobs, fresh, report=False, progress=progress() if progress else None)
        found_there = load(mine)
        failures += found_there.failures
        if on_campaign is not None:
            on_campaign(campaign.name, found_there)
        answered.append(Answered(part, found_there.tables, campaign.model_dump(mode="json"), behind(part, campaign)))
        rows = references(found_there.tables, answered[-1].stated)
        rows = rows[evidence(rows)]
        counts[campaign.name] = (len(rows), int(held(rows).sum()))
    stated, hold = (sum(one[k] for one in counts.values()) for k in (0, 1))
    return Studied(build(found, answered, Path(keep), unflown), counts, stated, hold, failures)


def compare(
    base: str | Path,
    candidate: str | Path,
    effects: Sequence[str] = (),
    confidence: float | None = None,
    mapping: Mapping[str, str] | None = None,
    jobs: int = -1,
) -> Comparison:
    """Compare a candidate with a base, run by run on the same draws: worse, not worse or undecided, metric by metric.

    Parameters
    ----------
    base, candidate : folders of results, or campaign files, which are run first
    effects : smallest changes of interest, such as ``velocity_error_3d=5%``, ``position_error_3d@stage1_cutoff=0.5 m``,
        ``velocity_error_3d:q95=5%``, ``NAME OF A REQUIREMENT=1%``; ``METRIC=none`` leaves one out
    confidence : 0.95 unless the base's campaign says otherwise
    mapping : the candidate's name of a case or level, by the base's

    Raises
    ------
    InputError
        The two do not compare, with the reason.
    """
    from lvnav_trade.metrics.comparison.comparison import compare as hold
    from lvnav_trade.metrics.comparison.comparison import parse_effects

    wanted = parse_effects(effects)
    folders = [
        Path(place) if Path(place).is_dir() else run(place, jobs=jobs, report=False).folder
        for place in (base, candidate)
    ]
    return hold(folders[0], folders[1], wanted, confidence, mapping)


def estimate_q(
    campaign: str | Path | Campaign,
    file: str | Path,
    sets: Sequence[str] = (),
    case: str | None = None,
    runs: int = 100,
    step: float | None = None,
) -> tuple[ProcessNoise, tuple[Path, Path, Path]]:
    """Estimate process noise from perturbed runs of a case (the first if none is named), and write the filter's card
    with it, beside it the error per step as CSV and PNG. Return the estimate and the files.
    """
    from lvnav_trade.campaign.derived import process_noise
    from lvnav_trade.campaign.syntax.cards import write_card
    from lvnav_trade.plots.published import steps
    from lvnav_trade.plots.raster import written
    from lvnav_trade.report.escape import csv_text

    found = process_noise(*case_of(campaign, sets, case), runs, step)
    card = Path(file)
    files = (card, card.with_suffix(".csv"), card.with_suffix(".png"))
    write_card(card, found.card)
    with writing(card, "its tables cannot be written there"):
        files[1].write_text(csv_text(found.steps), encoding="utf-8")
        files[2].write_bytes(written(steps(found.steps, [phase[:3] for phase in found.phases]), "png"))
    return found, files


def schedule_gains(
    campaign: str | Path | Campaign,
    file: str | Path,
    sets: Sequence[str] = (),
    case: str | None = None,
    by: Literal["event", "time"] = "event",
    tolerance: float = 0.02,
) -> GainSchedule:
    """Write the gains that the filter of a case (the first if none is named) has on its nominal flight as a card for
    `filter.gains`, and return it.
    """
    from lvnav_trade.campaign.derived import gain_schedule
    from lvnav_trade.campaign.syntax.cards import write_card

    found = gain_schedule(*case_of(campaign, sets, case), by, tolerance)
    write_card(Path(file), found)
    return found


def export_trajectory(
    source: str | Path, file: str | Path, sets: Sequence[str] = (), case: str | None = None, rate: float = 10.0
) -> Written:
    """Write a flight as a file of a user's own and the card that names it: that of a trajectory card, or of a case (the
    first if none is named) of a campaign. Return the files, and by how much the export differs when it is flown.

    rate : rows per second; force and rate that change faster than rows 0.1 s apart show are not resolved
    """
    from lvnav_trade.campaign.reading.exporting import is_card, write_flight
    from lvnav_trade.campaign.reading.flights import read_card

    if is_card(str(source), Path.cwd()):
        if sets or case:
            raise InputError(f"{source}: is a trajectory card; assignments and cases are those of a campaign")
        return write_flight(read_card(str(source), Path.cwd()), Path(file), rate)
    return write_flight(case_of(source, sets, case)[1].scenario.trajectory, Path(file), rate)


def case_of(campaign: str | Path | Campaign, sets: Sequence[str], case: str | None) -> tuple[Campaign, Case]:
    """Return a campaign and the case that is named; its first where none is."""
    loaded = campaign if isinstance(campaign, Campaign) else load_campaign(campaign, sets)
    every = cases(loaded)
    return loaded, find(every, case) if case else every[0]


def selfcheck(
    campaign: str | Path, sets: Sequence[str] = (), jobs: int = -1, progress: Progress | None = None
) -> list[Checked]:
    """Check the configuration of every distinct case: error definitions, Jacobians, propagation over gaps, innovations
    and draws. The statistics of a campaign fail by chance with 1 %; the same campaign always gives the same figures.

    Raises
    ------
    InputError
        A mistake in the campaign: nothing has been checked.
    """
    from lvnav_trade.campaign.running.selfcheck import selfcheck as checks

    return checks(check(campaign, sets), jobs, progress)


def write_kml(
    source: str | Path, file: str | Path, ellipses: bool = False, every: float = 60.0, magnify: float = 1.0
) -> Path:
    """Write the flight of a trajectory card, or all flights of a folder of results, as KML; return the file.

    ellipses : draw 3-sigma position errors too, `every` seconds and at the events; results only
    magnify : how many times as large as they are
    """
    import pandas as pd

    from lvnav_trade.campaign.reading.flights import preview, read_card
    from lvnav_trade.report import kml

    if not every > 0.0 or not magnify > 0.0:
        raise InputError("the interval of the ellipses and their magnification should be above zero")
    if Path(source).is_dir():
        tables = read(source)
        drawn = kml.flights(tables, ellipses, every)
        return kml.write_kml(Path(file), str(tables.manifest.get("campaign", Path(source).name)), drawn, magnify)
    if ellipses:
        raise InputError(f"{source}: a trajectory has no errors; give a folder of results to draw ellipses")
    seen = preview(read_card(str(source), Path.cwd()))
    flight = kml.Flight(seen.name, pd.DataFrame(seen.reference), pd.DataFrame(seen.events))
    return kml.write_kml(Path(file), seen.name, [flight], magnify)
