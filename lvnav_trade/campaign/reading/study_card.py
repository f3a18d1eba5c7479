"""Studies: the campaigns of a folder that answer one question together, with the texts and figures of their report.

A study is described by data, in `study.yaml`. Anything beyond that is a script in the same folder (`report.script`),
which the user runs.
"""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

from pydantic import Field, ValidationError, field_validator

from lvnav_trade.campaign.definition.metric_names import ERROR_UNITS
from lvnav_trade.campaign.definition.published_cards import Case
from lvnav_trade.campaign.definition.schema import Campaign, MonteCarlo
from lvnav_trade.campaign.reading.checks import section_errors
from lvnav_trade.campaign.reading.explain import explain
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.card_lookup import tool_folder
from lvnav_trade.campaign.syntax.tree import SourceTree
from lvnav_trade.quantities.errors import InputError, Mistake, quoted, refuse_all
from lvnav_trade.quantities.units import Card, parse

FILE = "study.yaml"
TableName = Literal["requirements", "logic", "coverage", "paired", "error_bound", "integrity", "tested_errors"]


FIGURES = (
    "errors", "relative", "locus", "spread", "envelope", "budget", "consistency", "autocorrelation", "trajectory",
    "satellites", "sky", "timeline", "delays", "latency", "orbit", "injection", "impact", "logic", "motion", "singular",
    "movement", "sweep", "turning", "allan", "decisions",
)  # fmt: skip
"""Figures that every study can show; a script may add others."""


class CampaignFigure(Card):
    """A figure of a campaign that the study shows."""

    plot: str = Field(description="name of the figure, or of one that the study's script draws")
    caption: str = ""  # text under the figure
    case: Case = Field(default_factory=dict, description="level of each axis: the one case that is drawn")
    cases: tuple[Case, ...] = Field((), description="the cases that are drawn, all if absent")
    quantity: str = Field("position", description="for errors, envelope, budget and motion: the quantity")
    axis: str = Field("3d", description="for errors, relative: the axis; for locus: the axis that is varied")
    during: str | None = Field(None, description="for errors, relative, locus: the phase")
    metric: str = Field("position_error_3d", description="for locus: the metric")
    at: str | None = Field(None, description="for locus: the event; injection if no phase is given")
    statistic: str = Field("rms", description="for locus: the statistic, as in references")
    unit: str = Field("m", description="for locus: the metric")
    varied: str = Field("", description="for locus: label of the quantity that the axis varies; its name if absent")
    study_level: str = Field("", description="for locus: the level that the study uses; that of the base if absent")
    published: float | None = Field(None, description="for locus: the published value, in that unit")
    band: tuple[float, float] | None = Field(
        None,
        description="for locus: band of ours / published, [0.5, 2] if absent; for sweep: percentages that are shaded",
    )
    channels: str = Field("", description="for autocorrelation: words in the name of the channels")
    settings: dict[str, Any] = Field({}, description="for a figure of the study's script: its settings")


class StudyCampaign(Card):
    """A campaign of the study."""

    campaign: str = Field(description="name of its file in the folder, without extension")
    question: str = Field("", description="question of the campaign; its description if absent")
    figures: tuple[CampaignFigure, ...] = ()  # of this campaign, in order
    text: str = Field("", description="comment on the results")
    tables: tuple[TableName, ...] = Field((), description="tables of the campaign that the study shows")
    paired: str = Field("", description="axis whose levels are compared run by run, on the same draws")
    kml: Case | None = Field(
        None,
        description="level of each axis of the case whose trajectory is saved as KML, with its 3-sigma position errors",
    )


class Cell(Card):
    """A cell of a published table: the item of the row that answers it."""

    item: str = Field(description="as its reference, order or statement has it")
    campaign: str = Field("", description="the campaign that answers it; any that has the item if absent")
    case: Case = Field(default_factory=dict, description="level of each axis, where several cases have the item")


class PrintedTable(Card):
    """A table of the publication, in its own layout: each cell is shown with our number and their ratio."""

    title: str = Field(description="of the table, as the page has it")
    head: str = Field("", description="heading of the first column, which has the names of the rows")
    columns: tuple[str, ...] = Field(min_length=1, description="headings of the published columns")
    rows: dict[str, tuple[Cell | None, ...]] = Field(
        min_length=1, description="by the names of the rows: an item for each column, none where nothing is printed"
    )

    @field_validator("rows", mode="before")
    @classmethod
    def _items(cls, rows: Any) -> Any:
        """Accept the text of an item as a cell."""
        if not isinstance(rows, dict):
            return rows
        cells_by_row = {}
        for label, cells in rows.items():
            if isinstance(cells, list | tuple):
                cells = [{"item": cell} if isinstance(cell, str) else cell for cell in cells]
            cells_by_row[label] = cells
        return cells_by_row

    def _faults(self) -> Iterator[str]:
        for label, cells in self.rows.items():
            if len(cells) != len(self.columns):
                yield f"rows.{label}: {len(cells)} cells for {len(self.columns)} columns"


class StudyCard(Card):
    """Texts and layout of the report of a study."""

    name: str = ""  # of the study
    title: str  # of the report
    description: str = Field(description="introduction: the results that are reproduced, and their source")
    assumptions: tuple[str, ...] = Field(
        (), description="assumptions in place of data that the publication does not state"
    )
    important: tuple[str, ...] = Field(
        (),
        description="first words of the important items, the most important first; three of those that do not hold "
        "are named first",
    )
    units: dict[str, str] = Field(
        {}, description="unit of each quantity in figures and tables, such as attitude: deg; the default unit if absent"
    )
    campaigns: tuple[StudyCampaign, ...] = Field(
        (), description="campaigns in the order of the report; all of the folder if absent"
    )
    printed: tuple[PrintedTable, ...] = Field((), description="published tables that the answer shows in their layout")

    @field_validator("campaigns")
    @classmethod
    def _refuse_repeated(cls, campaigns: tuple[StudyCampaign, ...]) -> tuple[StudyCampaign, ...]:
        names = [section.campaign for section in campaigns]
        if len(set(names)) < len(names):
            raise ValueError("a campaign is listed twice")
        return campaigns


class StudySection(NamedTuple):
    """A campaign of a study with its section of the report.

    study_campaign : Section of study.yaml for this campaign.
    campaign : The campaign.
    source_tree : Places of the settings in study.yaml.
    path : Path of the section in study.yaml.
    """

    study_campaign: StudyCampaign
    campaign: Campaign
    source_tree: SourceTree = SourceTree()
    path: str = ""

    def mistake(self, path: str, message: str) -> Mistake:
        """Return an input error at a path below the section."""
        return self.source_tree.mistake(f"{self.path}.{path}", message)


def load_study(
    folder: str | Path, runs: int | None = None, figures: Iterable[str] = ()
) -> tuple[StudyCard, tuple[StudySection, ...]]:
    """Read a study, and load and check its campaigns.

    Parameters
    ----------
    folder : str or Path
        Folder of the study, or the name of a study that comes with the tool.
    runs : int, optional
        Runs per case; by default the number of each campaign.
    figures : iterable of str
        Names of figures that a script draws.

    Returns
    -------
    StudyCard, tuple of StudySection
        The study and its campaigns, in the order of the report.

    Raises
    ------
    InputError
        The folder does not exist, or a file in it has input errors.
    """
    place = study_folder(folder)
    files = {file.stem: file for file in sorted(place.glob("*.yaml")) if file.name != FILE}
    if not files:
        raise InputError(f"{folder}: no campaigns here")
    study_file = place / FILE
    source_tree = SourceTree(tree.read_mapping(study_file)) if study_file.is_file() else SourceTree()
    study = _read(place, tuple(files), source_tree.root)
    sections = []
    for index, study_campaign in enumerate(study.campaigns):
        campaign = load(files[study_campaign.campaign])
        section = StudySection(study_campaign, campaign, source_tree, f"campaigns.{index}")
        sections.append(section)
    figure_names = (*FIGURES, *figures)
    errors = []
    for section in sections:
        for path, message in _figure_errors(section.study_campaign, figure_names):
            errors.append(section.mistake(path, message))
        for path, message in section_errors(section.study_campaign, section.campaign):
            errors.append(section.mistake(path, message))
    refuse_all(errors)
    sections_with_runs = []
    for section in sections:
        campaign = _with_runs(section.campaign, runs)
        sections_with_runs.append(section._replace(campaign=campaign))
    return study, tuple(sections_with_runs)


def _figure_errors(section: StudyCampaign, names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield path and message of unknown figures, and of settings for figures that no script draws."""
    for index, figure in enumerate(section.figures):
        if figure.plot not in names:
            suggestion = tree.hint(figure.plot, names)
            message = f"{quoted(figure.plot)} is not one of {', '.join(names)}{suggestion}"
            yield f"figures.{index}.plot", message
        elif figure.plot in FIGURES and figure.settings:
            yield f"figures.{index}.settings", f"no effect: the study's script does not draw {figure.plot}"


def study_folder(name: str | Path) -> Path:
    """Return the folder of a study, given as a path or as the name of a study of the tool; InputError if missing."""
    for place in (Path(name), Path("campaigns") / name, tool_folder("campaigns") / name):
        if place.is_dir():
            return place
    raise InputError(f"{name}: no such folder of campaigns")


def _read(place: Path, names: tuple[str, ...], root: tree.Node | None) -> StudyCard:
    """Return the content of study.yaml; without that file all campaigns of the folder in the order of their names."""
    default_campaigns = tuple(StudyCampaign(campaign=name) for name in names)
    if root is None:
        return StudyCard(name=place.name, title=place.resolve().name, description="", campaigns=default_campaigns)
    try:
        study = StudyCard.model_validate(tree.plain_data(root))
    except ValidationError as error:
        raise InputError(records=explain(error, root, StudyCard, "")) from None
    unit_errors = []
    for quantity, message in _unknown_units(study):
        unit_errors.append(tree.mistake_at(root, f"units.{quantity}", message))
    refuse_all(unit_errors)
    for index, section in enumerate(study.campaigns):
        name = section.campaign
        if name not in names:
            suggestion = tree.hint(name, names)
            message = f"no campaign {name!r} in this folder{suggestion}"
            raise InputError(records=[tree.mistake_at(root, f"campaigns.{index}.campaign", message)])
    update = {"name": place.resolve().name, "campaigns": study.campaigns or default_campaigns}
    return study.model_copy(update=update)


def _unknown_units(study: StudyCard) -> Iterator[tuple[str, str]]:
    """Yield quantity and message for each display unit that is not possible."""
    for quantity, unit in study.units.items():
        if quantity not in ERROR_UNITS:
            suggestion = tree.hint(quantity, ERROR_UNITS)
            yield quantity, f"no error is of {quoted(quantity)}{suggestion}"
            continue
        try:
            parse(f"1 {unit}", ERROR_UNITS[quantity])
        except ValueError as error:
            yield quantity, str(error)


def _with_runs(campaign: Campaign, runs: int | None) -> Campaign:
    """Return the campaign with a number of runs per case; a campaign without Monte Carlo is returned unchanged."""
    if runs is None or campaign.monte_carlo is None:
        return campaign
    try:
        monte_carlo = MonteCarlo(runs=runs, block=campaign.monte_carlo.block, stop=None)
    except ValidationError as error:
        message = error.errors()[0]["msg"].removeprefix("Value error, ")
        raise InputError(f"--runs {runs}: {message}") from None
    return campaign.model_copy(update={"monte_carlo": monte_carlo})
