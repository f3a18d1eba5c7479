"""The script of a study: statements from its folder, figures and tables of its own, and its command line."""

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from lvnav_studies.checks import faults, faults_in_flight
from lvnav_studies.claims import Claims, OfStudy, Statement
from lvnav_studies.figures import bound
from lvnav_studies.rows import claim_rows
from lvnav_studies.verdicts import further_rows, verdicts
from lvnav_trade import api
from lvnav_trade.api.input import Campaign, InputError, InputFile, Mistake, read_input
from lvnav_trade.api.measures import COLUMNS, Metric, Tables, add_metrics
from lvnav_trade.api.pages import (
    Block,
    FigureEntry,
    StudyFigure,
    StudyResult,
    StudyScript,
    StudySection,
    published_rows,
    recount,
    renew,
)

STATEMENTS, STUDY = "statements", "study"
"""Folder of the statements, and the name of the file of those that belong to no campaign."""


class Publication(StudyScript):
    """A study that answers a publication.

    Attributes
    ----------
    claims : mapping of str to InputFile of Claims
        What is claimed of each campaign, from the files ``statements/CAMPAIGN.yaml``.
    of_study : OfStudy
        Statements that belong to no campaign, from ``statements/study.yaml``.
    """

    def __init__(
        self,
        folder: str | Path,
        figures: Mapping[str, StudyFigure] | None = None,
        metrics: Sequence[Metric] = (),
        blocks: Callable[[StudyResult, Claims], list[Block]] | None = None,
    ) -> None:
        """Read the statements of a folder.

        Parameters
        ----------
        folder : str or Path
            Folder of the study.
        figures : mapping of str to StudyFigure, optional
            Further figures by name; ``bound`` is there.
        metrics : sequence of Metric
            Metrics that statements name and the package does not have.
        blocks : callable, optional
            Makes further tables and figures of a campaign.
        """
        drawn = StudyFigure(self._draw_bound, "The value of a statement along its axis, and its bounds.", self._unbound)
        super().__init__(folder, {"bound": drawn, **(figures or {})})
        add_metrics(metrics)
        self._make = blocks
        place = self.folder / STATEMENTS
        files = sorted(place.glob("*.yaml"))
        self.claims: dict[str, InputFile[Claims]] = {
            file.stem: read_input(file, Claims) for file in files if file.stem != STUDY
        }
        whole = place / f"{STUDY}.yaml"
        self.of_study = read_input(whole, OfStudy).content if whole.is_file() else OfStudy()

    def of(self, campaign: str) -> Claims:
        """Return what is claimed of a campaign; nothing where it has no file."""
        found = self.claims.get(campaign)
        return Claims() if found is None else found.content

    def mistakes(self, questions: Sequence[StudySection]) -> Iterator[Mistake]:
        """Yield what is claimed of cases that are not there, and files of no campaign."""
        yield from super().mistakes(questions)
        campaigns = {one.campaign.name: one.campaign for one in questions}
        for name, file in self.claims.items():
            if name not in campaigns:
                known = ", ".join(campaigns)
                yield file.mistake("", f"no campaign of the study has the name {name!r} (known: {known})")
            else:
                yield from (file.mistake(path, text) for path, text in faults(file.content, campaigns[name]))

    def mistakes_in_flight(self, campaign: Campaign, events: Mapping[str, Mapping[str, float]]) -> Iterator[Mistake]:
        """Yield the events that are named and that no flight has."""
        file = self.claims.get(campaign.name)
        if file is not None:
            found = dict.fromkeys(faults_in_flight(file.content, events))
            yield from (file.mistake(path, text) for path, text in found)

    def references(self, campaign: str) -> Sequence[Mapping[str, Any]]:
        """Return published numbers of metrics that the script adds."""
        found: list[Mapping[str, Any]] = self.of(campaign).model_dump(mode="json")["references"]
        return found

    def stated(self, campaign: str) -> Mapping[str, Sequence[Mapping[str, Any]]]:
        """Return what the files of statements say of a campaign, by list; of no campaign where the name is empty."""
        if campaign:
            whole: dict[str, list[dict[str, Any]]] = self.of(campaign).model_dump(mode="json", exclude={"flown"})
            return whole
        apart = (*self.of_study.not_set_up, *self.of_study.elsewhere)
        return {"statements": [one.model_dump(mode="json") for one in apart]}

    def rows(self, campaign: str, tables: Tables) -> list[dict[str, Any]]:
        """Return the rows of orders, statements on innovations, and expressions."""
        return claim_rows(tables, {"name": campaign, **self.of(campaign).model_dump(mode="json")})

    def table(self, results: api.Results | Tables) -> pd.DataFrame:
        """Return the table of published numbers of one campaign from its results, as the report has it."""
        tables = results.tables if isinstance(results, api.Results) else results
        name = str(tables.campaign["name"])
        return pd.DataFrame(published_rows(name, tables, tables.campaign, self), columns=COLUMNS)

    def further_rows(self, unflown: Sequence[Campaign]) -> list[dict[str, Any]]:
        """Return the rows of statements that no campaign answers, or that has not been run."""
        return further_rows(self.of_study, {one.name: self.of(one.name).statements for one in unflown})

    def is_statement(self, rows: pd.DataFrame) -> pd.Series:
        """Whether each row is of an expression, or of a statement that no campaign answers."""
        names = {
            one.id or f"{campaign} {STATEMENTS} {number}"
            for campaign, file in self.claims.items()
            for number, one in enumerate(file.content.statements, 1)
        }
        return rows.id.isin(names) | (rows["case"] == "")

    def verdicts(self, rows: pd.DataFrame) -> list[Block]:
        """Return how many statements hold, and a table of the rows of each verdict."""
        return verdicts(rows)

    def blocks(self, answered: StudyResult) -> list[Block]:
        """Return what the script makes of a campaign."""
        return [] if self._make is None else self._make(answered, self.of(answered.campaign.name))

    def _statement(self, campaign: str, figure: FigureEntry) -> Statement | None:
        wanted = figure.settings.get("statement")
        return next((one for one in self.of(campaign).statements if one.id == wanted), None)

    def _draw_bound(self, one: StudyResult, figure: FigureEntry) -> Any:
        found = self._statement(one.campaign.name, figure)
        return None if found is None else bound(one.tables, found.model_dump(mode="json"))

    def _unbound(self, figure: FigureEntry, question: StudySection) -> Iterator[tuple[str, str]]:
        found = self._statement(question.campaign.name, figure)
        if found is None or not found.along:
            named = figure.settings.get("statement")
            yield "settings.statement", f"no statement {named!r} that is along an axis"


def main(study: StudyScript, arguments: Sequence[str] | None = None) -> int:
    """Run a study from the command line: every campaign, then its report.

    Parameters
    ----------
    study : StudyScript
        The study.
    arguments : sequence of str, optional
        Words of the command line; those of the process if absent.

    Returns
    -------
    int
        Exit code: 0, 2 for a mistake in a file, 4 where runs failed.
    """
    parser = argparse.ArgumentParser(description=f"Run every campaign of {study.folder.name} and write one report.")
    parser.add_argument("--keep", required=True, metavar="FOLDER", help="folder of the study's report")
    parser.add_argument("--runs", type=int, help="runs per case, instead of the campaigns' numbers")
    parser.add_argument("--out", metavar="FOLDER", help="folder of the results (results/NAME if absent)")
    parser.add_argument("--fresh", action="store_true", help="start again instead of resuming")
    parser.add_argument("--only-page", action="store_true", help="make the report from existing results")
    parser.add_argument("--recount", action="store_true", help="recount the kept report; no results are needed")
    parser.add_argument(
        "--campaigns", nargs="+", metavar="NAME", help="run only these, and update them in the kept report"
    )
    parser.add_argument("--jobs", type=int, default=-1, help="worker processes, -1 for all cores")
    asked = parser.parse_args(arguments)
    if asked.campaigns and (asked.recount or asked.only_page):
        parser.error("--campaigns runs campaigns; leave out --recount and --only-page")
    try:
        if asked.recount:
            print(f"kept: {recount(study, asked.keep)}")
            return api.MET
        watch = api.StudyWatch(on_campaign=_show)
        if asked.campaigns:
            found = renew(study, asked.keep, asked.campaigns, asked.runs, asked.out, asked.jobs, asked.fresh, watch)
        else:
            found = api.study(study, asked.keep, asked.runs, asked.out, asked.jobs, asked.fresh, asked.only_page, watch)
    except InputError as error:
        print(error, file=sys.stderr)
        return api.USAGE
    for line in found.failures:
        print(f"failed: {line}")
    for name, (stated, hold) in found.campaigns.items():
        print(f"{name}: {hold} of {stated} as published")
    print(f"kept: {found.page}")
    return api.FAILED if found.failures else api.MET


def _show(name: str, results: Any) -> None:
    print(f"{name}: {len(results.tables.cases)} cases, {len(results.failures)} failed runs", flush=True)
