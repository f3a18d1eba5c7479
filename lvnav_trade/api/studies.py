"""Studies from Python: the campaigns of a folder, compared with published numbers in one report."""

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
from lvnav_trade.campaign.syntax.card_lookup import tool_folder
from lvnav_trade.campaign.syntax.tree import hint
from lvnav_trade.quantities.errors import InputError, refuse_all
from lvnav_trade.results.tables.contents import owned_folder

if TYPE_CHECKING:
    from lvnav_trade.campaign.definition.schema import Campaign
    from lvnav_trade.campaign.reading.study_card import StudyCard, StudySection
    from lvnav_trade.report.script import StudyResult, StudyScript

SCRIPT = "study.py"
"""File name of the script in the folder of a study; its variable STUDY is a `StudyScript`."""


class StudyWatch(NamedTuple):
    """Callbacks of a running study."""

    progress: Callable[[], Progress] | None = None  # returns the receiver of the progress of the next campaign
    on_campaign: Callable[[str, Results], None] | None = None  # called with the name and results after each campaign


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
    """Run the campaigns of a study in order and write one report: published numbers, results, figures, remarks.

    Parameters
    ----------
    folder : str, Path or StudyScript
        Folder of campaigns with a `study.yaml`, name of a study that comes with the tool, or script with additions.
    keep : str or Path
        Folder of the report: report.md, figures/, references.csv and agreement.csv.
    runs : int, optional
        Runs per case; by default the number of each campaign.
    results : str or Path, optional
        Folder for the results of the campaigns; ``results/FOLDER`` if absent.
    jobs : int
        Worker processes, -1 for all cores.
    fresh : bool
        Begin again instead of resuming.
    only_page : bool
        Write the report from existing results; campaigns without results are listed as not run.
    watch : StudyWatch, optional
        Callbacks for the progress and for each finished campaign.

    Returns
    -------
    Study
        The report, the number of published values that the results reproduce, failed runs.

    Raises
    ------
    InputError
        A campaign, study.yaml or an input of the script has an error: nothing has been computed. Or the folder is not
        one of the tool's and contains a script, which this function does not run.
    """
    from lvnav_trade.report.study import build

    owned_folder(keep, "study")  # refused before anything is computed
    script, description, questions = _load_study(folder, runs)
    place = _results_folder(results, description, script)
    not_run: list[Campaign] = []
    task = None
    if only_page:
        not_run = _without_results([question.campaign for question in questions], place)
    else:
        task = Task(jobs, fresh, report=False)
    to_run = [question for question in questions if question.campaign not in not_run]
    study_results, failures = _run_sections(to_run, place, task, watch or StudyWatch(), script)
    report = build(description, study_results, Path(keep), not_run, script)
    return _study_outcome(report, study_results, failures, script)


def recount(folder: str | Path | StudyScript, keep: str | Path) -> Path:
    """Count the reproduced published values of a kept report again, with the present study.yaml and stored numbers.

    Use it after a change of the items or marks of published values. The campaigns are not run again.

    Parameters
    ----------
    folder : str, Path or StudyScript
        The study, as for `study`.
    keep : str or Path
        Folder of the kept report; references.csv, the answer in report.md and its figure are rewritten.

    Returns
    -------
    Path
        The report.

    Raises
    ------
    InputError
        The study has an input error, the folder has no report, or the study no longer defines a stored row.
    """
    from lvnav_trade.report.recount import recount as rewrite

    script, description, questions = _load_study(folder, None)
    return rewrite(description, [question.campaign for question in questions], keep, script)


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
    """Run some campaigns of a study and update them in its kept report; the other campaigns stay unchanged.

    Parameters
    ----------
    folder : str, Path or StudyScript
        As for `study`.
    keep : str or Path
        Folder of the kept report.
    campaigns : sequence of str
        Names of the campaigns. A campaign that is new in the report is inserted in the order of study.yaml.
    runs, results, jobs, fresh, watch
        As for `study`.

    Returns
    -------
    Study
        The report, the number of published values of these campaigns that are reproduced, failed runs.

    Raises
    ------
    InputError
        As for `study`. Also: there is no such campaign or no kept report, or the study no longer defines a stored row
        of another campaign.
    """
    from lvnav_trade.report.recount import renew as rewrite

    script, description, questions = _load_study(folder, runs)
    names = [question.campaign.name for question in questions]
    for name in campaigns:
        if name not in names:
            raise InputError(f"{script.folder}: no campaign {name!r}{hint(name, names)}; there are {', '.join(names)}")
    place = _results_folder(results, description, script)
    to_run = [question for question in questions if question.campaign.name in campaigns]
    task = Task(jobs, fresh, report=False)
    study_results, failures = _run_sections(to_run, place, task, watch or StudyWatch(), script)
    report = rewrite(description, [question.campaign for question in questions], keep, script, study_results)
    return _study_outcome(report, study_results, failures, script)


def _load_study(
    folder: str | Path | StudyScript, runs: int | None
) -> tuple[StudyScript, StudyCard, Sequence[StudySection]]:
    """Return the script, the description and the campaigns of a study; InputError if one of them has an error."""
    from lvnav_trade.campaign.reading.study_card import load_study
    from lvnav_trade.report.printed import mistakes
    from lvnav_trade.report.script import StudyScript

    script = folder if isinstance(folder, StudyScript) else script_of(folder)
    description, questions = load_study(script.folder, runs, script.figures)
    refuse_all([*script.mistakes(questions), *mistakes(description, questions, script)])
    return script, description, questions


def _results_folder(results: str | Path | None, description: StudyCard, script: StudyScript) -> Path:
    """Return the folder for the results of the campaigns; ``results/NAME`` if None."""
    if results is not None:
        return Path(results)
    return Path("results") / (description.name or script.folder.name)


def _study_outcome(
    report: Path, study_results: Sequence[StudyResult], failures: list[str], script: StudyScript
) -> Study:
    """Return the report of a study with the numbers of published and of reproduced values."""
    counts = {result.campaign.name: _count_reproduced(result, script) for result in study_results}
    n_published = sum(published_count for published_count, _ in counts.values())
    n_reproduced = sum(reproduced_count for _, reproduced_count in counts.values())
    return Study(report, counts, n_published, n_reproduced, failures)


def script_of(folder: str | Path) -> StudyScript:
    """Return the script of a study; only scripts that come with the tool are executed.

    Parameters
    ----------
    folder : str or Path
        Folder of a study, or the name of a study that comes with the tool.

    Returns
    -------
    StudyScript
        The script; an empty script if the folder has none.

    Raises
    ------
    InputError
        The folder does not exist, or it has a script and is not one of the tool's.
    """
    from lvnav_trade.campaign.reading.study_card import study_folder
    from lvnav_trade.report.script import StudyScript

    place = study_folder(folder)
    file = place / SCRIPT
    if not file.is_file():
        return StudyScript(place)
    if not place.resolve().is_relative_to(tool_folder("campaigns").resolve()):
        raise InputError(
            f"{file}: a script of your own is not run by the name of its folder; run it: python {file} --keep FOLDER"
        )
    return load_script(file)


def load_script(file: str | Path) -> StudyScript:
    """Execute a script as a module and return its variable STUDY; the script may import modules of its folder.

    Parameters
    ----------
    file : str or Path
        The script.

    Returns
    -------
    StudyScript
        Additions of the script to the report.

    Raises
    ------
    InputError
        The script has no STUDY.
    """
    path = Path(file).resolve()
    spec = importlib.util.spec_from_file_location(f"{path.parent.name}_study", path)
    assert spec is not None  # every file that ends in .py has a spec
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(path.parent))
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(path.parent))
    if not hasattr(module, "STUDY"):
        raise InputError(f"{file}: has no STUDY; it is the StudyScript of the folder")
    script: StudyScript = module.STUDY
    return script


def _without_results(campaigns: Sequence[Campaign], place: Path) -> list[Campaign]:
    """Return the campaigns without results.

    If no campaign has results, the list is empty: reading the first campaign then raises the error for the user.
    """
    not_run = [campaign for campaign in campaigns if not (place / campaign.name).is_dir()]
    return not_run if len(not_run) < len(campaigns) else []


def _run_sections(
    questions: Sequence[StudySection], place: Path, task: Task | None, watch: StudyWatch, script: StudyScript
) -> tuple[list[StudyResult], list[str]]:
    """Return every campaign with its results, and the failed runs of all campaigns."""
    from lvnav_trade.report.script import StudyResult

    study_results: list[StudyResult] = []
    failures: list[str] = []
    for question in questions:
        campaign = question.campaign
        results = _campaign_results(campaign, place / campaign.name, task, watch, script)
        study_results.append(StudyResult(question.study_campaign, campaign, results.tables))
        failures += results.failures
    return study_results, failures


def _campaign_results(
    campaign: Campaign, place: Path, task: Task | None, watch: StudyWatch, script: StudyScript
) -> Results:
    """Return the results of a campaign; run it first if a task is given."""
    if task is not None:
        refuse_all(list(script.mistakes_in_flight(campaign, flight_events(campaign))))
        progress = watch.progress() if watch.progress else None
        carry_out(campaign, place, task._replace(progress=progress))
    results = Results(place)
    if watch.on_campaign is not None:
        watch.on_campaign(campaign.name, results)
    return results


def _count_reproduced(result: StudyResult, script: StudyScript) -> tuple[int, int]:
    """Return the number of published values that are evidence, and how many of them the results reproduce.

    A value that an input of the campaign determines is no evidence and is not counted.
    """
    import pandas as pd

    from lvnav_trade.report.script import published_rows
    from lvnav_trade.results.evaluation.published import COLUMNS, is_evidence, is_reproduced

    name = result.campaign.name
    settings = result.campaign.model_dump(mode="json")
    rows = pd.DataFrame(published_rows(name, result.tables, settings, script), columns=COLUMNS)
    rows = rows[is_evidence(rows)]
    return len(rows), int(is_reproduced(rows).sum())
