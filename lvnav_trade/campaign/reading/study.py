"""A study: campaigns of a folder that answer one question together, what its page says, and which figures it shows.

A study is data. What it needs beyond that is a script in the same folder (`report.script`), which its user runs.
"""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

from pydantic import Field, ValidationError, field_validator

from lvnav_trade.campaign.definition.metric_names import ERROR_UNITS
from lvnav_trade.campaign.definition.published import Case
from lvnav_trade.campaign.definition.schema import Campaign, MonteCarlo
from lvnav_trade.campaign.reading.checks import of_study
from lvnav_trade.campaign.reading.explain import explain
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.cards import shipped
from lvnav_trade.campaign.syntax.tree import Written
from lvnav_trade.errors import InputError, Mistake, quoted, refuse_all
from lvnav_trade.units import Card, parse

FILE = "study.yaml"
Shown = Literal["requirements", "logic", "coverage", "paired", "error_bound", "integrity", "tested_errors"]


FIGURES = (
    "errors", "relative", "locus", "spread", "envelope", "budget", "consistency", "autocorrelation", "trajectory",
    "satellites", "sky", "timeline", "delays", "latency", "orbit", "impact", "logic", "motion", "singular", "movement",
    "sweep", "turning", "allan", "decisions",
)  # fmt: skip
"""Figures that every study can show; a script adds others."""


class Figure(Card):
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
    flown: str = Field("", description="for locus: the level that the study uses; that of the base if absent")
    published: float | None = Field(None, description="for locus: the published value, in that unit")
    band: tuple[float, float] | None = Field(
        None,
        description="for locus: band of ours / published, [0.5, 2] if absent; for sweep: percentages that are shaded",
    )
    channels: str = Field("", description="for autocorrelation: words in the name of the channels")
    settings: dict[str, Any] = Field({}, description="for a figure of the study's script: its settings")


class Part(Card):
    """A campaign of the study."""

    campaign: str = Field(description="name of its file in the folder, without extension")
    question: str = Field("", description="question of the campaign; its description if absent")
    figures: tuple[Figure, ...] = ()  # of this campaign, in order
    text: str = Field("", description="comment on the results")
    tables: tuple[Shown, ...] = Field((), description="tables of the campaign that the study shows")
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
    """A table of the publication, in its own layout: each cell is shown with ours and their ratio beside it."""

    title: str = Field(description="of the table, as the page has it")
    head: str = Field("", description="heading of the first column, which has the names of the rows")
    columns: tuple[str, ...] = Field(min_length=1, description="headings of the published columns")
    rows: dict[str, tuple[Cell | None, ...]] = Field(
        min_length=1, description="by the names of the rows: an item for each column, none where nothing is printed"
    )

    @field_validator("rows", mode="before")
    @classmethod
    def _items(cls, rows: Any) -> Any:
        """Let a cell be its item alone."""
        if not isinstance(rows, dict):
            return rows
        return {
            label: [{"item": cell} if isinstance(cell, str) else cell for cell in cells]
            if isinstance(cells, list | tuple)
            else cells
            for label, cells in rows.items()
        }

    def _faults(self) -> Iterator[str]:
        for label, cells in self.rows.items():
            if len(cells) != len(self.columns):
                yield f"rows.{label}: {len(cells)} cells for {len(self.columns)} columns"


class Study(Card):
    """What a study's page says next to the numbers."""

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
    campaigns: tuple[Part, ...] = Field(
        (), description="campaigns in the order of the report; all of the folder if absent"
    )
    printed: tuple[PrintedTable, ...] = Field((), description="published tables that the answer shows in their layout")

    @field_validator("campaigns")
    @classmethod
    def _once(cls, parts: tuple[Part, ...]) -> tuple[Part, ...]:
        names = [part.campaign for part in parts]
        if len(set(names)) < len(names):
            raise ValueError("a campaign is listed twice")
        return parts


class Question(NamedTuple):
    """A campaign of a study with its place on the page.

    part : What study.yaml says of it.
    campaign : The campaign.
    written : Where study.yaml says it.
    path : Of the part in study.yaml.
    """

    part: Part
    campaign: Campaign
    written: Written = Written()
    path: str = ""

    def mistake(self, path: str, message: str) -> Mistake:
        """Return a mistake at a path below the part."""
        return self.written.mistake(f"{self.path}.{path}", message)


def load_study(
    folder: str | Path, runs: int | None = None, figures: Iterable[str] = ()
) -> tuple[Study, tuple[Question, ...]]:
    """Return a study and its campaigns, every one loaded and checked, with `runs` per case where that is given.

    folder : A path, or the name of a study that comes with the tool.
    figures : Names of figures that a script draws.

    InputError where there is no such folder, or for every mistake in it.
    """
    place = study_folder(folder)
    found = {file.stem: file for file in sorted(place.glob("*.yaml")) if file.name != FILE}
    if not found:
        raise InputError(f"{folder}: no campaigns here")
    written = Written(tree.read_mapping(place / FILE)) if (place / FILE).is_file() else Written()
    study = _read(place, tuple(found), written.root)
    questions = [
        Question(part, load(found[part.campaign]), written, f"campaigns.{index}")
        for index, part in enumerate(study.campaigns)
    ]
    known = (*FIGURES, *figures)
    refuse_all(
        [
            one.mistake(path, message)
            for one in questions
            for path, message in (*_unknown_figures(one.part, known), *of_study(one.part, one.campaign))
        ]
    )
    return study, tuple(one._replace(campaign=_with_runs(one.campaign, runs)) for one in questions)


def _unknown_figures(part: Part, known: Sequence[str]) -> Iterator[tuple[str, str]]:
    for index, figure in enumerate(part.figures):
        if figure.plot not in known:
            message = f"{quoted(figure.plot)} is not one of {', '.join(known)}{tree.hint(figure.plot, known)}"
            yield f"figures.{index}.plot", message
        elif figure.plot in FIGURES and figure.settings:
            yield f"figures.{index}.settings", f"no effect: the study's script does not draw {figure.plot}"


def study_folder(name: str | Path) -> Path:
    """Return the folder of a study: a path, or the name of one that comes with the tool; InputError without it."""
    for place in (Path(name), Path("campaigns") / name, shipped("campaigns") / name):
        if place.is_dir():
            return place
    raise InputError(f"{name}: no such folder of campaigns")


def _read(place: Path, names: tuple[str, ...], root: tree.Node | None) -> Study:
    """Return what stands in the folder's study.yaml; without one its campaigns in the order of their names."""
    every = tuple(Part(campaign=name) for name in names)
    if root is None:
        return Study(name=place.name, title=place.resolve().name, description="", campaigns=every)
    try:
        study = Study.model_validate(tree.plain(root))
    except ValidationError as error:
        raise InputError(records=explain(error, root, Study, "")) from None
    refuse_all([tree.mistake_at(root, f"units.{quantity}", text) for quantity, text in _unknown_units(study)])
    for index, part in enumerate(study.campaigns):
        if part.campaign not in names:
            message = f"no campaign {part.campaign!r} in this folder{tree.hint(part.campaign, names)}"
            raise InputError(records=[tree.mistake_at(root, f"campaigns.{index}.campaign", message)])
    return study.model_copy(update={"name": place.resolve().name, "campaigns": study.campaigns or every})


def _unknown_units(study: Study) -> Iterator[tuple[str, str]]:
    for quantity, unit in study.units.items():
        if quantity not in ERROR_UNITS:
            yield quantity, f"no error is of {quoted(quantity)}{tree.hint(quantity, ERROR_UNITS)}"
            continue
        try:
            parse(f"1 {unit}", ERROR_UNITS[quantity])
        except ValueError as error:
            yield quantity, str(error)


def _with_runs(campaign: Campaign, runs: int | None) -> Campaign:
    """Return the campaign with so many runs per case; one of linear covariance alone as it is."""
    if runs is None or campaign.monte_carlo is None:
        return campaign
    try:
        asked = MonteCarlo(runs=runs, block=campaign.monte_carlo.block, stop=None)
    except ValidationError as error:
        raise InputError(f"--runs {runs}: {error.errors()[0]['msg'].removeprefix('Value error, ')}") from None
    return campaign.model_copy(update={"monte_carlo": asked})
