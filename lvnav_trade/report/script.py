"""Interface for scripts of studies, which add to the report what study.yaml cannot describe."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.study_card import CampaignFigure, StudyCampaign, StudySection
from lvnav_trade.quantities.errors import Mistake
from lvnav_trade.report.blocks import Block
from lvnav_trade.report.figures.figure import Figure as Drawing
from lvnav_trade.results.evaluation.published import reference_rows
from lvnav_trade.results.tables.read import Tables


class StudyResult(NamedTuple):
    """A campaign of a study with its results.

    study_campaign : Section of study.yaml for the campaign.
    campaign : The campaign, as it was run.
    tables : Its results, in the units of the study.
    """

    study_campaign: StudyCampaign
    campaign: Campaign
    tables: Tables


class StudyFigure(NamedTuple):
    """A figure that a script draws.

    draw : Draws the figure from the results of a campaign, for an entry of `figures` in study.yaml; returns None if
        there is nothing to draw.
    caption : Caption if the entry has none.
    faults : Yields the input errors of an entry, path below the entry and message, before anything is computed.
    """

    draw: Callable[[StudyResult, CampaignFigure], Drawing | None]
    caption: str = ""
    faults: Callable[[CampaignFigure, StudySection], Iterator[tuple[str, str]]] = lambda figure, question: iter(())


class StudyScript:
    """Additions of a script to the report of a study. This base class adds nothing; scripts override its methods.

    Attributes
    ----------
    folder : Path
        Folder of the study.
    figures : mapping of str to StudyFigure
        Figures by their name in study.yaml.
    """

    def __init__(self, folder: str | Path, figures: Mapping[str, StudyFigure] | None = None) -> None:
        self.folder = Path(folder)
        self.figures = dict(figures or {})

    def mistakes(self, questions: Sequence[StudySection]) -> Iterator[Mistake]:
        """Yield the errors of the script's own input, before anything is computed."""
        for question in questions:
            for place, figure in enumerate(question.study_campaign.figures):
                if figure.plot in self.figures:
                    for path, message in self.figures[figure.plot].faults(figure, question):
                        yield question.mistake(f"figures.{place}.{path}", message)

    def mistakes_in_flight(self, campaign: Campaign, events: Mapping[str, Mapping[str, float]]) -> Iterator[Mistake]:
        """Yield the input errors with respect to the trajectories of a campaign, before it is run.

        events : times (s) of the events by digest of the case and by name
        """
        return iter(())

    def references(self, campaign: str) -> Sequence[Mapping[str, Any]]:
        """Return further published numbers of a campaign (given by name), as entries of its `references`."""
        return ()

    def entries(self, campaign: str) -> Mapping[str, Sequence[Mapping[str, Any]]]:
        """Return the entries of the rows of a campaign (given by name), by list; for "" entries without a campaign."""
        return {"references": self.references(campaign)} if campaign else {}

    def rows(self, campaign: str, tables: Tables) -> list[dict[str, Any]]:
        """Return further rows (values by column) for the published numbers of a campaign (given by name)."""
        return []

    def further_rows(self, not_run: Sequence[Campaign]) -> list[dict[str, Any]]:
        """Return rows without a campaign, and rows of campaigns without results (`not_run`); their case is empty."""
        return []

    def is_statement(self, rows: pd.DataFrame) -> pd.Series:
        """Whether each row is a statement, shown by `verdicts` and not in the table of its campaign."""
        return pd.Series(False, index=rows.index)

    def verdicts(self, rows: pd.DataFrame) -> list[Block]:
        """Return the blocks of the answer on the rows that are statements."""
        return []

    def blocks(self, result: StudyResult) -> list[Block]:
        """Return further tables and figures of a campaign, below its table of published numbers."""
        return []


def published_rows(
    campaign: str, tables: Tables, settings: Mapping[str, Any], script: StudyScript
) -> list[dict[str, Any]]:
    """Return the rows of published numbers of a campaign: its references, and those of the script.

    Parameters
    ----------
    campaign : str
        Name of the campaign.
    tables : Tables
        Its results.
    settings : mapping
        The campaign as written, with `references`.
    script : StudyScript
        Script of the study.
    """
    references = [*settings.get("references", ()), *script.references(campaign)]
    return [*reference_rows(tables, {"name": campaign, "references": references}), *script.rows(campaign, tables)]
