"""What the script of a study may add to its report, beyond what study.yaml can ask for."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.study import Figure, Part, Question
from lvnav_trade.errors import Mistake
from lvnav_trade.metrics.published import reference_rows
from lvnav_trade.plots.figure import Figure as Drawing
from lvnav_trade.report.blocks import Block
from lvnav_trade.store.read import Tables


class Answered(NamedTuple):
    """A campaign of a study with its results.

    part : What study.yaml says of it.
    campaign : The campaign, as it was run.
    tables : Its results, in the units of the study.
    """

    part: Part
    campaign: Campaign
    tables: Tables


class StudyFigure(NamedTuple):
    """A figure that a script draws.

    draw : Draws it of a campaign's results, as an entry `figures` of study.yaml asks; None where there is nothing.
    caption : Its caption where the entry has none.
    faults : Yields what is wrong with an entry, as path below it and message, before anything is computed.
    """

    draw: Callable[[Answered, Figure], Drawing | None]
    caption: str = ""
    faults: Callable[[Figure, Question], Iterator[tuple[str, str]]] = lambda figure, question: iter(())


class StudyScript:
    """What a script adds to the report of a study; this one adds nothing, and scripts override what they need.

    Attributes
    ----------
    folder : Path
        Folder of the study.
    figures : mapping of str to StudyFigure
        Figures by the name that study.yaml calls them by.
    """

    def __init__(self, folder: str | Path, figures: Mapping[str, StudyFigure] | None = None) -> None:
        self.folder = Path(folder)
        self.figures = dict(figures or {})

    def mistakes(self, questions: Sequence[Question]) -> Iterator[Mistake]:
        """Yield what is wrong with the script's own input, before anything is computed."""
        for one in questions:
            for place, figure in enumerate(one.part.figures):
                if figure.plot in self.figures:
                    for path, message in self.figures[figure.plot].faults(figure, one):
                        yield one.mistake(f"figures.{place}.{path}", message)

    def mistakes_in_flight(self, campaign: Campaign, events: Mapping[str, Mapping[str, float]]) -> Iterator[Mistake]:
        """Yield what does not fit the flights of a campaign, before it is run; events: times (s) by case and name."""
        return iter(())

    def references(self, campaign: str) -> Sequence[Mapping[str, Any]]:
        """Return further published numbers of a campaign (its name), as entries of its `references`."""
        return ()

    def stated(self, campaign: str) -> Mapping[str, Sequence[Mapping[str, Any]]]:
        """Return the entries that rows of a campaign (its name) are made of, by list; those of no campaign for ""."""
        return {"references": self.references(campaign)} if campaign else {}

    def rows(self, campaign: str, tables: Tables) -> list[dict[str, Any]]:
        """Return further rows (values by column) of the table of published numbers from a campaign (its name)."""
        return []

    def further_rows(self, unflown: Sequence[Campaign]) -> list[dict[str, Any]]:
        """Return rows of no campaign, and of campaigns without results; their case is empty."""
        return []

    def is_statement(self, rows: pd.DataFrame) -> pd.Series:
        """Whether each row belongs to the statements that `verdicts` shows, and to no table of its campaign."""
        return pd.Series(False, index=rows.index)

    def verdicts(self, rows: pd.DataFrame) -> list[Block]:
        """Return what the answer says of the rows that are statements."""
        return []

    def blocks(self, answered: Answered) -> list[Block]:
        """Return further tables and figures of a campaign, below its table of published numbers."""
        return []


def published_rows(
    campaign: str, tables: Tables, stated: Mapping[str, Any], script: StudyScript
) -> list[dict[str, Any]]:
    """Return the rows of the table of published numbers from a campaign: its references, then what the script adds.

    campaign : Its name.
    stated : The campaign as it was written, of which `references` count.
    """
    every = [*stated.get("references", ()), *script.references(campaign)]
    return [*reference_rows(tables, {"name": campaign, "references": every}), *script.rows(campaign, tables)]
