"""A study: the campaigns of a folder that answer one publication, what its page says, and which figures it shows."""

from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple

from pydantic import Field, ValidationError, field_validator

from lvnav_trade.campaign.definition.metric_names import ERROR_UNITS
from lvnav_trade.campaign.definition.published import Case, Published, Stated
from lvnav_trade.campaign.definition.schema import Campaign, MonteCarlo
from lvnav_trade.campaign.reading.checks import of_study
from lvnav_trade.campaign.reading.explain import explain
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.cards import campaign_file
from lvnav_trade.errors import InputError, quoted, refuse_all
from lvnav_trade.units import Card, Duration, parse

FILE = "study.yaml"
Shown = Literal["requirements", "logic", "coverage", "paired", "error_bound", "integrity", "tested_errors"]


class Figure(Card):
    """A figure of a campaign that the study shows."""

    plot: Literal[
        "errors", "relative", "locus", "spread", "bound", "envelope", "budget", "consistency", "autocorrelation",
        "trajectory", "satellites", "sky", "timeline", "delays", "latency", "orbit", "impact", "logic",
        "missions", "motion", "ignition", "singular", "movement", "sweep", "turning", "worth", "interpretations",
        "apart", "allan", "decisions", "single", "clocks", "antennas",
    ]  # fmt: skip
    caption: str = ""
    case: Case = Field(default_factory=dict, description="level of each axis: the one case that is drawn")
    cases: tuple[Case, ...] = Field(
        (),
        description="of errors, relative, worth: the cases, all if absent; of apart: pairs of cases; of single: the "
        "aided case and the unaided one; of clocks: those whose receivers solve for themselves",
    )
    run: int = Field(0, ge=0, description="of single and clocks: the run that is drawn, the same in each case")
    quantity: str = Field("position", description="of errors, envelope, budget and motion")
    axis: str = Field("3d", description="of errors, relative: the axis; of locus: the axis that is varied")
    during: str | None = Field(None, description="of errors, relative, locus: the phase")
    metric: str = Field("position_error_3d", description="of locus")
    at: str | None = Field(None, description="of locus: event; injection if no phase is given")
    statistic: str = Field("rms", description="of locus, as in references")
    statement: str = Field("", description="of bound: id of the statement, drawn over the axis that it is along")
    unit: str = Field("m", description="of locus")
    varied: str = Field(
        "", description="of locus: the quantity that the axis varies, for its label; its name if absent"
    )
    flown: str = Field("", description="of locus: the level that the study flies; that of the base if absent")
    published: float | None = Field(None, description="of locus: the published value, in that unit")
    band: tuple[float, float] | None = Field(
        None, description="of locus: of ours / published, [0.5, 2] if absent; of sweep: percents that are shaded"
    )
    axes: dict[Literal["attitude", "velocity", "position"], str] = Field(
        default_factory=dict, description="of apart: the axis of each quantity, 3d if absent"
    )
    channels: str = Field("", description="of autocorrelation: words that a channel's name holds")


class Ensemble(Card):
    """Process noise that the study estimates anew."""

    runs: int = Field(100, ge=10)
    steps: tuple[Duration, ...] = Field(description="lengths of a step")


class Part(Card):
    """A campaign of the study."""

    campaign: str = Field(description="its file in the folder, without ending")
    question: str = Field("", description="what it asks; the campaign's own description if absent")
    figures: tuple[Figure, ...] = ()
    text: str = Field("", description="what should be said of what came out")
    tables: tuple[Shown, ...] = Field((), description="tables of it that the study shows")
    paired: str = Field("", description="axis whose levels are compared run by run, on the same draws")
    flown: tuple[Published, ...] = Field(
        (), description="published numbers of single flights, shown among ours; items are 'MISSION, WHAT'"
    )
    noise: Ensemble | None = Field(None, description="process noise of an ensemble of the first case, as estimate-q")
    kml: Case | None = Field(
        None, description="level of each axis: the case whose flight is kept as KML, with its 3-sigma position errors"
    )


class Elsewhere(Stated):
    """A statement that a number answers which no campaign has, such as one of the benchmark; remark: its origin."""

    value: float = Field(description="the number that was found")
    at_least: float | None = None
    at_most: float | None = None

    def _faults(self) -> Iterator[str]:
        if self.at_least is None and self.at_most is None:
            yield "there is no bound; give at_least or at_most"
        if not self.remark:
            yield "remark: should say where the number is from"


class Study(Card):
    """What a study's page says beside the numbers."""

    name: str = ""
    title: str
    description: str = Field(description="the introduction: what is reproduced, from where")
    assumptions: tuple[str, ...] = Field((), description="what the publication leaves open, and how it is filled")
    not_set_up: tuple[Stated, ...] = Field(
        (), description="statements of the publication that no campaign answers; remark: what is missing"
    )
    elsewhere: tuple[Elsewhere, ...] = Field(
        (), description="statements that a number from elsewhere answers, such as a measured time"
    )
    important: tuple[str, ...] = Field(
        (),
        description="beginnings of items, the most important first: of those that do not hold, three are named first",
    )
    units: dict[str, str] = Field(
        {}, description="unit by quantity, such as attitude: deg, of figures and tables; the tool's own where absent"
    )
    campaigns: tuple[Part, ...] = Field((), description="in the order in which they stand; all of the folder if absent")

    @field_validator("campaigns")
    @classmethod
    def _once(cls, parts: tuple[Part, ...]) -> tuple[Part, ...]:
        names = [part.campaign for part in parts]
        if len(set(names)) < len(names):
            raise ValueError("a campaign stands twice")
        return parts


class Question(NamedTuple):
    """A campaign of a study with its place on the page."""

    part: Part
    campaign: Campaign


def load_study(folder: str | Path, runs: int | None = None) -> tuple[Study, tuple[Question, ...]]:
    """Return a study and its campaigns, every one loaded and checked, with `runs` per case where that is given.

    The folder is a path, or one of the tool's (``conae``); InputError where there is none, or for every mistake in it.
    """
    place = _folder(str(folder))
    found = {file.stem: file for file in sorted(place.glob("*.yaml")) if file.name != FILE}
    if not found:
        raise InputError(f"{folder}: no campaigns here")
    study = _read(place, tuple(found))
    loaded = [Question(part, load(found[part.campaign])) for part in study.campaigns]
    refuse_all(
        [
            tree.mistake_at(tree.read_mapping(place / FILE), f"campaigns.{index}.{path}", message)
            for index, (part, campaign) in enumerate(loaded)
            for path, message in of_study(part, campaign)
        ]
    )
    return study, tuple(one._replace(campaign=_with_runs(one.campaign, runs)) for one in loaded)


def _folder(name: str) -> Path:
    for place in (Path(name), Path("campaigns") / name, campaign_file(f"{name}/{FILE}").parent):
        if place.is_dir():
            return place
    raise InputError(f"{name}: no such folder of campaigns")


def _read(place: Path, names: tuple[str, ...]) -> Study:
    """Return what stands in the folder's study.yaml; without one its campaigns in the order of their names."""
    file, every = place / FILE, tuple(Part(campaign=name) for name in names)
    if not file.is_file():
        return Study(name=place.name, title=place.resolve().name, description="", campaigns=every)
    root = tree.read_mapping(file)
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
