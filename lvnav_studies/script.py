"""The script of a study: statements from its folder, figures and tables of its own, and its command line."""

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from lvnav_studies.checks import faults, faults_in_flight
from lvnav_studies.claims import Claims, Statement, StudyStatements
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
    """Study of a publication.

    Attributes
    ----------
    claims : mapping of str to InputFile of Claims
        Claims on each campaign by its name, from the files ``statements/CAMPAIGN.yaml``.
    study_statements : StudyStatements
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
            Further figures by name, in addition to ``bound``.
        metrics : sequence of Metric
            Metrics of the statements that the package does not have.
        blocks : callable, optional
            Makes further tables and figures of a campaign.
        """
        bound_figure = StudyFigure(
            self._draw_bound, "The value of a statement along its axis, and its bounds.", self._bound_faults
        )
        super().__init__(folder, {"bound": bound_figure, **(figures or {})})
        add_metrics(metrics)
        self._make_blocks = blocks
        statement_folder = self.folder / STATEMENTS
        self.claims: dict[str, InputFile[Claims]] = {}
        for file in sorted(statement_folder.glob("*.yaml")):
            if file.stem != STUDY:
                self.claims[file.stem] = read_input(file, Claims)
        study_file = statement_folder / f"{STUDY}.yaml"
        self.study_statements = StudyStatements()
        if study_file.is_file():
            self.study_statements = read_input(study_file, StudyStatements).content

    def campaign_claims(self, campaign: str) -> Claims:
        """Return the claims on a campaign; empty if it has no file."""
        file = self.claims.get(campaign)
        return Claims() if file is None else file.content

    def mistakes(self, questions: Sequence[StudySection]) -> Iterator[Mistake]:
        """Yield claims on cases that do not exist, and files without a campaign."""
        yield from super().mistakes(questions)
        campaigns = {section.campaign.name: section.campaign for section in questions}
        for name, file in self.claims.items():
            if name not in campaigns:
                names = ", ".join(campaigns)
                yield file.mistake("", f"no campaign of the study has the name {name!r} (known: {names})")
                continue
            for path, text in faults(file.content, campaigns[name]):
                yield file.mistake(path, text)

    def mistakes_in_flight(self, campaign: Campaign, events: Mapping[str, Mapping[str, float]]) -> Iterator[Mistake]:
        """Yield the named events that do not occur in the flight of a case."""
        file = self.claims.get(campaign.name)
        if file is not None:
            event_faults = dict.fromkeys(faults_in_flight(file.content, events))
            for path, text in event_faults:
                yield file.mistake(path, text)

    def references(self, campaign: str) -> Sequence[Mapping[str, Any]]:
        """Return published numbers of metrics that the script adds."""
        claims = self.campaign_claims(campaign).model_dump(mode="json")
        references: list[Mapping[str, Any]] = claims["references"]
        return references

    def entries(self, campaign: str) -> Mapping[str, Sequence[Mapping[str, Any]]]:
        """Return the claims on a campaign by list; for an empty name the statements that belong to no campaign."""
        if campaign:
            claims: dict[str, list[dict[str, Any]]] = self.campaign_claims(campaign).model_dump(
                mode="json", exclude={"missions"}
            )
            return claims
        statements = [*self.study_statements.not_set_up, *self.study_statements.elsewhere]
        return {"statements": [statement.model_dump(mode="json") for statement in statements]}

    def rows(self, campaign: str, tables: Tables) -> list[dict[str, Any]]:
        """Return the rows of orders, statements on innovations, and expressions."""
        claims = self.campaign_claims(campaign).model_dump(mode="json")
        return claim_rows(tables, {"name": campaign, **claims})

    def table(self, results: api.Results | Tables) -> pd.DataFrame:
        """Return the table of published numbers of one campaign from its results, as the report has it."""
        tables = results.tables if isinstance(results, api.Results) else results
        name = str(tables.campaign["name"])
        rows = published_rows(name, tables, tables.campaign, self)
        return pd.DataFrame(rows, columns=COLUMNS)

    def further_rows(self, not_run: Sequence[Campaign]) -> list[dict[str, Any]]:
        """Return the rows of statements without campaign, and of those of campaigns that have not been run."""
        statements = {campaign.name: self.campaign_claims(campaign.name).statements for campaign in not_run}
        return further_rows(self.study_statements, statements)

    def is_statement(self, rows: pd.DataFrame) -> pd.Series:
        """Whether each row is of an expression, or of a statement that no campaign answers."""
        ids = set()
        for campaign, file in self.claims.items():
            for number, statement in enumerate(file.content.statements, 1):
                ids.add(statement.id or f"{campaign} {STATEMENTS} {number}")
        return rows.id.isin(ids) | (rows["case"] == "")

    def verdicts(self, rows: pd.DataFrame) -> list[Block]:
        """Return how many statements hold, and a table of the rows of each verdict."""
        return verdicts(rows)

    def blocks(self, answered: StudyResult) -> list[Block]:
        """Return the further tables and figures of a campaign."""
        if self._make_blocks is None:
            return []
        return self._make_blocks(answered, self.campaign_claims(answered.campaign.name))

    def _statement(self, campaign: str, figure: FigureEntry) -> Statement | None:
        for statement in self.campaign_claims(campaign).statements:
            if statement.id == figure.settings.get("statement"):
                return statement
        return None

    def _draw_bound(self, result: StudyResult, figure: FigureEntry) -> Any:
        statement = self._statement(result.campaign.name, figure)
        if statement is None:
            return None
        return bound(result.tables, statement.model_dump(mode="json"))

    def _bound_faults(self, figure: FigureEntry, question: StudySection) -> Iterator[tuple[str, str]]:
        statement = self._statement(question.campaign.name, figure)
        if statement is None or not statement.along:
            name = figure.settings.get("statement")
            yield "settings.statement", f"no statement {name!r} that is along an axis"


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
    options = parser.parse_args(arguments)
    if options.campaigns and (options.recount or options.only_page):
        parser.error("--campaigns runs campaigns; leave out --recount and --only-page")
    try:
        if options.recount:
            print(f"kept: {recount(study, options.keep)}")
            return api.MET
        watch = api.StudyWatch(on_campaign=_show)
        if options.campaigns:
            outcome = renew(
                study, options.keep, options.campaigns, options.runs, options.out, options.jobs, options.fresh, watch
            )
        else:
            outcome = api.study(
                study, options.keep, options.runs, options.out, options.jobs, options.fresh, options.only_page, watch
            )
    except InputError as error:
        print(error, file=sys.stderr)
        return api.USAGE
    for line in outcome.failures:
        print(f"failed: {line}")
    for name, (n_stated, n_reproduced) in outcome.campaigns.items():
        print(f"{name}: {n_reproduced} of {n_stated} as published")
    print(f"kept: {outcome.page}")
    return api.FAILED if outcome.failures else api.MET


def _show(name: str, results: Any) -> None:
    n_case = len(results.tables.cases)
    n_failed = len(results.failures)
    print(f"{name}: {n_case} cases, {n_failed} failed runs", flush=True)
