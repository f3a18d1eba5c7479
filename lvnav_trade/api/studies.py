"""Studies from Python: several campaigns of a folder, compared with published numbers in one report."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from lvnav_trade.api.campaigns import Task, carry_out, flight_events
from lvnav_trade.api.results import Results
from lvnav_trade.api.types import Study
from lvnav_trade.campaign.running.progress import Progress
from lvnav_trade.campaign.syntax.cards import shipped
from lvnav_trade.campaign.syntax.tree import hint
from lvnav_trade.errors import InputError, refuse_all
from lvnav_trade.store.contents import owned

if TYPE_CHECKING:
    from lvnav_trade.campaign.definition.schema import Campaign
    from lvnav_trade.campaign.reading.study import Question
    from lvnav_trade.report.script import Answered, StudyScript

SCRIPT = "study.py"
"""Script of a study, in its folder; its variable STUDY is a `StudyScript`."""


class StudyWatch(NamedTuple):
    """What watches a study: `progress` makes the progress of one campaign; `on_campaign` is called with the name and
    the results of one that is done.
    """

    progress: Callable[[], Progress] | None = None
    on_campaign: Callable[[str, Results], None] | None = None


def study(
    folder: str | Path | StudyScript,
    keep: str | Path,
    runs: int | None = None,
    results: str | Path | None = None,
    jobs: int = -1,
    fresh: bool = False,
    only_page: bool = False,
    watch: StudyWatch | None = None,
) -> Study:
    """Run every campaign of a folder in order and write one report: published numbers, ours, figures, remarks.

    Parameters
    ----------
    folder : str, Path or StudyScript
        Folder of campaigns with a `study.yaml` that describes the report; the name of one of the tool's; or a script,
        which names its folder and adds to the report.
    keep : str or Path
        Where report.md, figures/, references.csv and agreement.csv go.
    runs : int, optional
        Runs per case, in place of the campaigns' own.
    results : str or Path, optional
        Where the campaigns' results go; ``results/FOLDER`` if absent.
    jobs : int
        Worker processes, -1 for all cores.
    fresh : bool
        Begin again instead of resuming.
    only_page : bool
        Run nothing; campaigns without results are listed as not run.
    watch : StudyWatch, optional
        What watches.

    Returns
    -------
    Study
        The page, how many published rows hold, failed runs.

    Raises
    ------
    InputError
        A mistake in a campaign, in study.yaml or in what the script reads: nothing has been computed. Or a folder with
        a script of the user's own, which this function does not run.
    """
    from lvnav_trade.campaign.reading.study import load_study
    from lvnav_trade.report.printed import mistakes
    from lvnav_trade.report.script import StudyScript
    from lvnav_trade.report.study import build

    owned(keep, "study")  # refused before anything is computed
    script = folder if isinstance(folder, StudyScript) else script_of(folder)
    found, questions = load_study(script.folder, runs, script.figures)
    refuse_all([*script.mistakes(questions), *mistakes(found, questions, script)])
    place = Path(results) if results is not None else Path("results") / (found.name or script.folder.name)
    unflown = _unflown([one.campaign for one in questions], place) if only_page else []
    task = None if only_page else Task(jobs, fresh, report=False)
    asked = [one for one in questions if one.campaign not in unflown]
    answered, failures = _answers(asked, place, task, watch or StudyWatch(), script)
    counts = {one.campaign.name: _counted(one, script) for one in answered}
    stated, hold = (sum(one[k] for one in counts.values()) for k in (0, 1))
    return Study(build(found, answered, Path(keep), unflown, script), counts, stated, hold, failures)


def recount(folder: str | Path | StudyScript, keep: str | Path) -> Path:
    """Count a kept report of a study anew: items and marks of rows as its folder states them now, numbers as they are.

    Parameters
    ----------
    folder : str, Path or StudyScript
        As of `study`.
    keep : str or Path
        Where the report is kept; references.csv, the answer of report.md and its figure are written anew.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    InputError
        A mistake in the folder; no report there; or a row of which nothing is stated any more.
    """
    from lvnav_trade.campaign.reading.study import load_study
    from lvnav_trade.report.printed import mistakes
    from lvnav_trade.report.recount import recount as written
    from lvnav_trade.report.script import StudyScript

    script = folder if isinstance(folder, StudyScript) else script_of(folder)
    found, questions = load_study(script.folder, None, script.figures)
    refuse_all([*script.mistakes(questions), *mistakes(found, questions, script)])
    return written(found, [one.campaign for one in questions], keep, script)


def renew(
    folder: str | Path | StudyScript,
    keep: str | Path,
    campaigns: Sequence[str],
    runs: int | None = None,
    results: str | Path | None = None,
    jobs: int = -1,
    fresh: bool = False,
    watch: StudyWatch | None = None,
) -> Study:
    """Run some campaigns of a study, and write anew what its kept report has of them; what it has of others stays.

    Parameters
    ----------
    folder : str, Path or StudyScript
        As of `study`.
    keep : str or Path
        Where the report is kept.
    campaigns : sequence of str
        Names of the campaigns; one that the report does not have yet is put where study.yaml has it.
    runs, results, jobs, fresh, watch
        As of `study`.

    Returns
    -------
    Study
        The page, how many published rows of these campaigns hold, failed runs.

    Raises
    ------
    InputError
        As of `study`; no campaign of such a name; no report there; or a row of another campaign of which nothing is
        stated any more.
    """
    from lvnav_trade.campaign.reading.study import load_study
    from lvnav_trade.report.printed import mistakes
    from lvnav_trade.report.recount import renew as written
    from lvnav_trade.report.script import StudyScript

    script = folder if isinstance(folder, StudyScript) else script_of(folder)
    found, questions = load_study(script.folder, runs, script.figures)
    refuse_all([*script.mistakes(questions), *mistakes(found, questions, script)])
    known = [one.campaign.name for one in questions]
    for name in campaigns:
        if name not in known:
            raise InputError(f"{script.folder}: no campaign {name!r}{hint(name, known)}; there are {', '.join(known)}")
    place = Path(results) if results is not None else Path("results") / (found.name or script.folder.name)
    asked = [one for one in questions if one.campaign.name in campaigns]
    answered, failures = _answers(asked, place, Task(jobs, fresh, report=False), watch or StudyWatch(), script)
    counts = {one.campaign.name: _counted(one, script) for one in answered}
    stated, hold = (sum(one[k] for one in counts.values()) for k in (0, 1))
    page = written(found, [one.campaign for one in questions], keep, script, answered)
    return Study(page, counts, stated, hold, failures)


def script_of(folder: str | Path) -> StudyScript:
    """Return what the script of a study adds; of one that comes with the tool it is run, of any other it is not.

    Parameters
    ----------
    folder : str or Path
        Folder of a study, or the name of one of the tool's.

    Returns
    -------
    StudyScript
        One that adds nothing where the folder has no script.

    Raises
    ------
    InputError
        No such folder, or it has a script and is not one of the tool's.
    """
    from lvnav_trade.campaign.reading.study import study_folder
    from lvnav_trade.report.script import StudyScript

    place = study_folder(folder)
    file = place / SCRIPT
    if not file.is_file():
        return StudyScript(place)
    if not place.resolve().is_relative_to(shipped("campaigns").resolve()):
        raise InputError(
            f"{file}: a script of your own is not run by the name of its folder; run it: python {file} --keep FOLDER"
        )
    return load_script(file)


def load_script(file: str | Path) -> StudyScript:
    """Return the variable STUDY of a script, which is run as a module; it may import modules next to it.

    Parameters
    ----------
    file : str or Path
        The script.

    Returns
    -------
    StudyScript
        What it adds to the report.

    Raises
    ------
    InputError
        The script has no STUDY.
    """
    path = Path(file).resolve()
    spec = importlib.util.spec_from_file_location(f"{path.parent.name}_study", path)
    assert spec is not None  # of a file that ends in .py
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(path.parent))
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(path.parent))
    if not hasattr(module, "STUDY"):
        raise InputError(f"{file}: has no STUDY; it is the StudyScript of the folder")
    found: StudyScript = module.STUDY
    return found


def _unflown(campaigns: Sequence[Campaign], place: Path) -> list[Campaign]:
    """Return the campaigns without results; none where all are, so that the first of them is reported."""
    found = [campaign for campaign in campaigns if not (place / campaign.name).is_dir()]
    return found if len(found) < len(campaigns) else []


def _answers(
    questions: Sequence[Question], place: Path, task: Task | None, watch: StudyWatch, script: StudyScript
) -> tuple[list[Answered], list[str]]:
    """Return every campaign with its results, and the failures of all."""
    from lvnav_trade.report.script import Answered

    found = [_results_of(one.campaign, place / one.campaign.name, task, watch, script) for one in questions]
    answered = [Answered(one.part, one.campaign, mine.tables) for one, mine in zip(questions, found, strict=True)]
    return answered, [line for mine in found for line in mine.failures]


def _results_of(campaign: Campaign, place: Path, task: Task | None, watch: StudyWatch, script: StudyScript) -> Results:
    """Return the results of a campaign, which is run first unless there is no task."""
    if task is not None:
        refuse_all(list(script.mistakes_in_flight(campaign, flight_events(campaign))))
        carry_out(campaign, place, task._replace(progress=watch.progress() if watch.progress else None))
    found = Results(place)
    if watch.on_campaign is not None:
        watch.on_campaign(campaign.name, found)
    return found


def _counted(answered: Answered, script: StudyScript) -> tuple[int, int]:
    """Return how many published rows no input decides, and how many of them hold."""
    import pandas as pd

    from lvnav_trade.metrics.held import evidence, held
    from lvnav_trade.metrics.published import COLUMNS
    from lvnav_trade.report.script import published_rows

    name, stated = answered.campaign.name, answered.campaign.model_dump(mode="json")
    rows = pd.DataFrame(published_rows(name, answered.tables, stated, script), columns=COLUMNS)
    rows = rows[evidence(rows)]
    return len(rows), int(held(rows).sum())
