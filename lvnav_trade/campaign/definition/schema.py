"""Schema of a campaign: base scenario, axes to vary, runs, seed, stored data, requirements."""

import math
import re
from typing import Annotated, Any, Literal

from pydantic import Field, PrivateAttr, ValidationInfo, field_serializer, field_validator

from lvnav_trade.campaign.definition.document import Document, MarginPolicy, Window
from lvnav_trade.campaign.definition.metric_names import metric_of, required_metrics, unit_of
from lvnav_trade.campaign.definition.published_cards import ENDS, FLIGHT, PublishedNumber, statement_event
from lvnav_trade.campaign.definition.run_counts import MonteCarlo as MonteCarlo
from lvnav_trade.campaign.definition.searches import Indices, Solve, Tune
from lvnav_trade.campaign.syntax.tree import SourceTree, hint
from lvnav_trade.quantities import input_limits, units
from lvnav_trade.quantities.errors import InputError, quoted
from lvnav_trade.scenario.scenario import Scenario


class Axis(units.Card):
    """An axis of the trade space: the path of a field of the base scenario, and its cards or values."""

    path: str = Field(description="field of the base scenario, dotted: imu, filter.gate, faults.0.keep")
    cards: tuple[str, ...] | None = Field(None, description="cards, one per level")
    values: tuple[Any, ...] | None = Field(None, description="values, one per level")
    labels: tuple[str, ...] | None = Field(None, description="names of the levels; from the cards or values if absent")
    linspace: tuple[Any, Any, int] | None = Field(None, description="or [first, last, count], equally spaced")
    logspace: tuple[Any, Any, int] | None = Field(None, description="or [first, last, count], with equal ratios")
    range: tuple[Any, Any, Any] | None = Field(None, description="or [first, last, step]")
    between: tuple[Any, Any] | None = Field(None, description="or [smallest, largest], for a sampled design")
    log: bool = Field(False, description="samples are uniform in the logarithm")
    crossed: bool = Field(
        False,
        description="in a design one_at_a_time: combine each level of this axis with every case of the other axes",
    )
    when: dict[str, str | tuple[str, ...]] = Field(
        {}, description="varied only if another axis has this level, or one of these; otherwise the value of the base"
    )

    @property
    def steps(self) -> list[str]:
        """The steps of the path, without `base`."""
        return self.path.removeprefix("base.").split(".")

    def _faults(self) -> list[str]:
        levels = self.cards or self.values or ()
        labels = self.labels or ()
        ways = (self.cards, self.values, self.linspace, self.logspace, self.range, self.between)
        rules = {
            "an axis has either cards or values": sum(way is not None for way in ways) != 1,
            "log is of an axis with between": self.log and self.between is None,
            "an axis needs at least one card or value": not levels,
            f"{len(labels)} labels for {len(levels)} levels": self.labels is not None and len(labels) != len(levels),
        }
        return [fault for fault, is_broken in rules.items() if is_broken]


class Requirement(units.Card):
    """A bound that a fraction of the flights must keep, and the confidence with which the runs must demonstrate it."""

    name: str  # of the requirement, unique in the campaign
    id: str | None = Field(None, description="identifier in the project's specification, such as GNC-NAV-012")
    parent: str | None = Field(None, description="identifier of the requirement from which this one is derived")
    source: str | None = Field(None, description="document and paragraph that state it")
    rationale: str | None = Field(None, description="why the bound has this value, and how it is interpreted")
    verification: Literal["test", "analysis", "review of design", "inspection"] | None = Field(
        None, description="verification method after ECSS-E-ST-10-02; a campaign is an analysis"
    )
    metric: str = Field(description="such as velocity_error_3d, attitude_error_roll, perigee_error, impact_error")
    during: str | None = Field(
        None,
        description="phase whose worst error counts, in place of an event: 'liftoff to injection'; flight, start, end",
    )
    at: str | None = Field(
        None, validate_default=True, description="event of the trajectory; injection if no phase is given"
    )
    probability: units.Share = Field(gt=0, lt=1, description="fraction of flights that must stay within the bound")
    below: float = Field(json_schema_extra={"type": "string"}, description="bound with its unit, such as 0.3 m/s")
    confidence: units.Share = Field(0.9, gt=0, lt=1)  # at which the runs must show it
    window: Window | None = Field(
        None,
        description="time around the event in which the error is evaluated too; 5 s before to 20 s after if absent",
    )

    @field_validator("metric")
    @classmethod
    def _check_metric(cls, name: str) -> str:
        if name not in required_metrics():
            raise ValueError(f"{quoted(name)} is not a metric{hint(name, required_metrics())}")
        return name

    @field_validator("during")
    @classmethod
    def _check_phase(cls, phase: str | None, info: ValidationInfo) -> str | None:
        metric = metric_of(info.data["metric"]) if "metric" in info.data else None
        if phase is not None and metric is not None and metric.event_only_reason:
            raise ValueError(f"{metric.name} is {metric.event_only_reason} at an event; give at in place of during")
        if phase is not None and phase != FLIGHT and len(phase.split(" to ")) != 2:
            raise ValueError(f"{quoted(phase)} is no phase; write 'EVENT to EVENT' or {FLIGHT}")
        return phase

    @field_validator("at")
    @classmethod
    def _check_event(cls, event: str | None, info: ValidationInfo) -> str | None:
        return statement_event(event, info, "a requirement")

    @property
    def events(self) -> tuple[str, ...]:
        """The events named by the requirement: its event, or the two ends of its phase."""
        if self.during is None:
            return (self.at or "injection",)
        return tuple(end for end in self.during.split(" to ") if self.during != FLIGHT and end not in ENDS)

    @field_validator("below", mode="before")
    @classmethod
    def _parse_bound(cls, value: Any, info: ValidationInfo) -> float:
        if "metric" not in info.data:
            return 0.0  # the input error of the metric is reported already; its unit is unknown here
        unit = unit_of(info.data["metric"])
        if not isinstance(value, str):
            raise ValueError(f"{quoted(value)} has no unit; write it with a unit, such as '0.3 {unit}'")
        bound = units.parse(value, unit)
        if bound <= 0:
            raise ValueError(f"{quoted(value)} is no bound; it should be above zero")
        return bound

    @field_validator("window")
    @classmethod
    def _check_window(cls, window: Window | None, info: ValidationInfo) -> Window | None:
        if window is not None and info.data.get("during") is not None:
            raise ValueError("a window needs an event: give at in place of during")
        if window is not None and "metric" in info.data and not metric_of(info.data["metric"]).has_history:
            raise ValueError(f"no effect: {info.data['metric']} is known at events only; leave the window out")
        return window

    @field_serializer("below", when_used="json")
    def _bound_text(self, value: float) -> str:
        return f"{value!r} {unit_of(self.metric)}"


class ProtectionCard(units.Card):
    """Protection levels by solution separation; the risks apply to each epoch of the flight."""

    integrity_risk: units.Share = Field(
        1e-7,
        gt=0.0,
        lt=0.5,
        description="probability of an error beyond its level without an alarm, on any axis of position or velocity",
    )
    false_alarm: units.Share = Field(
        1e-5,
        gt=0.0,
        lt=0.5,
        description="probability of an alarm without a fault, by any satellite on any axis of position or velocity",
    )
    satellite_fault: units.Share = Field(
        1e-4,
        ge=0.0,
        le=1.0,
        description="probability that a satellite has failed; 1: any one of them has certainly failed",
    )
    alarms: bool = Field(
        False,
        description="simulate the sub-filters in every run and log separations beyond their limit; this costs one "
        "more filter per satellite",
    )


class Covariance(units.Card):
    """Results of linear covariance that are computed and stored."""

    budget: bool = Field(True, description="store the variance of every error source over the flight")
    at: str | None = Field(None, description="event of the diagnostics; if absent: injection, or the last event")
    adjoint: bool = Field(True, description="contribution of every source to the errors at the event, over time")
    sensitivity: bool = Field(
        False,
        description="errors at the event with each source 0.1 to 10 times as large and the filter re-tuned: four "
        "further linear covariances for each important source",
    )
    observability: bool = Field(True, description="observability of the states in each phase of flight")
    window: units.Duration | None = Field(
        None, gt=0, description="or in each window of this length, in place of phases"
    )
    nonlinearity: bool = Field(True, description="nonlinearity of each case at every event and gap")
    error_bound: bool = Field(
        False,
        description="check whether the noise that the filter assumes keeps its error bounded (q I <= Q, r I <= R)",
    )
    protection: ProtectionCard | None = Field(
        None, description="bounds on position and velocity: a further linear covariance for every satellite in use"
    )
    spot_check: int = Field(
        input_limits.SPOT_CHECK,
        description="runs of each case that check linear covariance; only half of them if these agree; 0: none",
    )

    @field_validator("spot_check")
    @classmethod
    def _check_spot_check(cls, runs: int) -> int:
        if runs and not input_limits.SPOT_CHECK <= runs <= input_limits.RUNS:
            raise ValueError(f"{quoted(runs)} runs; give 0 for no check, or at least {input_limits.SPOT_CHECK}")
        return runs


class Keep(units.Card):
    """Data stored of a simulated flight."""

    history: Annotated[units.Duration, Field(gt=0.0, le=input_limits.STREAM)] = Field(
        1.0, description="step of the stored histories, 1 ms or more; events are always kept"
    )
    allan: Annotated[units.Duration, Field(ge=100.0, le=input_limits.STREAM)] | None = Field(
        None, description="duration of IMU errors at rest, simulated for each case, whose Allan deviation is stored"
    )

    @field_validator("history")
    @classmethod
    def _check_history(cls, step: float) -> float:
        if step < input_limits.FINEST_HISTORY:
            raise ValueError(f"{step:g} s is too fine; give {1e3 * input_limits.FINEST_HISTORY:g} ms or more")
        return step


class Compare(units.Card):
    """Settings of the comparison of a candidate with these results."""

    confidence: units.Share = Field(0.95, ge=0.5, lt=1)
    effects: dict[str, str] = Field(
        {},
        description="smallest change of interest by METRIC, METRIC@EVENT, METRIC@EVENT:q95 or a requirement's name: "
        "'5 %', '0.1 m/s', or none to omit the comparison",
    )

    @field_validator("effects")
    @classmethod
    def _check_effects(cls, effects: dict[str, str]) -> dict[str, str]:
        from lvnav_trade.results.comparison.comparison import parse_effect

        for key, amount in effects.items():
            try:
                parse_effect(key, amount)
            except InputError as error:
                raise ValueError(str(error)) from None
        return effects


class Report(units.Card):
    """Content of the report."""

    sections: tuple[str, ...] | None = Field(None, description="sections in order; all if absent")


class CorridorCard(units.Card):
    """A polygon of latitudes and longitudes; the estimated point of impact must stay inside with a probability."""

    polygon: tuple[tuple[units.Angle, units.Angle], ...] = Field(
        description="corners in order, each [latitude, longitude] with units; edges are straight in both angles"
    )
    probability: units.Share = Field(0.999, gt=0, lt=1, description="fraction of flights that must stay inside")
    confidence: units.Share = Field(0.9, gt=0, lt=1, description="confidence at which the runs must demonstrate it")

    @field_validator("polygon")
    @classmethod
    def _check_corners(cls, corners: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        if len(set(corners)) < 3:
            raise ValueError(f"a corridor needs at least 3 corners, not {len(set(corners))}")
        for latitude, _ in corners:
            if abs(latitude) > 0.5 * math.pi:
                raise ValueError(f"a latitude of {math.degrees(latitude):g} deg; each corner is [latitude, longitude]")
        return corners


class Campaign(units.Card):
    """A trade study. In a loaded campaign all cards are expanded and all defaults filled in."""

    name: str  # also of the folder of results
    description: str = ""  # question that it answers, for the report
    seed: int = Field(ge=0, lt=2**63)  # of all random draws
    base: Scenario  # the scenario that the axes vary
    axes: tuple[Axis, ...] = Field((), max_length=input_limits.AXES)  # fields that are varied
    # choice of the cases among all combinations of levels
    design: Literal["grid", "zip", "one_at_a_time", "latin_hypercube", "sobol", "box_behnken"] = "grid"
    samples: int | None = Field(
        None, description="number of points of a Latin hypercube or a Sobol sequence (a power of 2)"
    )
    store: Literal["metrics", "events", "history"] | None = Field(
        None,
        description="history: every table of every case; metrics: one row per case, full analysis of a few; events: as "
        "metrics, with the errors at every event; if absent: metrics beyond "
        f"{input_limits.CASES} cases, otherwise history",
    )
    exclude: tuple[dict[str, str | tuple[str, ...]], ...] = Field(
        (), description="combinations that are excluded: levels of some axes, or lists of levels"
    )
    constraints: tuple[str, ...] = Field(
        (), description="conditions on numeric axes, in SI: 'update_rate <= covariance_rate'"
    )
    monte_carlo: MonteCarlo | None = None  # number of runs and rule for stopping; none: linear covariance alone
    covariance: Covariance = Covariance()  # results of linear covariance
    keep: Keep = Keep()  # data that are stored
    requirements: tuple[Requirement, ...] = Field(
        (), max_length=input_limits.STATEMENTS
    )  # bounds that verdicts are given on
    references: tuple[PublishedNumber, ...] = Field(
        (), max_length=input_limits.STATEMENTS, description="published numbers that are compared with ours"
    )
    corridor: CorridorCard | None = Field(None, description="corridor in which the point of impact must stay")
    margin_policy: MarginPolicy | None = Field(None, description="margin policy that verdicts are compared with")
    document: Document = Document()  # title block of the document
    report: Report = Report()  # sections of the report
    compare: Compare = Compare()  # settings of the comparison of a candidate with these results
    solve: Solve | None = Field(
        None, description="search by lvnav-trade solve: largest sufficient value, or cheapest case"
    )
    indices: Indices | None = Field(None, description="global sensitivity, computed by lvnav-trade indices")
    tune: Tune | None = Field(None, description="tuning of a filter by lvnav-trade tune")
    _source_tree: SourceTree = PrivateAttr(default_factory=SourceTree)  # place where each value is written
    # definition of a design space
    _space_definition: "SpaceDefinition" = PrivateAttr(default_factory=lambda: SpaceDefinition())

    @property
    def source_tree(self) -> SourceTree:
        """File, line and column of every value, for input errors that are found after reading."""
        return self._source_tree

    @property
    def is_space(self) -> bool:
        """Whether the campaign explores a design space: it stores one row per design."""
        return self.store in ("metrics", "events")

    @property
    def written_axes(self) -> tuple[Axis, ...]:
        """The axes as written in the file: a sampled axis has its limits, not its samples."""
        return self._space_definition.axes or self.axes

    @property
    def probe(self) -> "Campaign":
        """The campaign whose cases are checked for input errors: the campaign itself, or for a design space a campaign
        of the base and of the two ends of each axis alone.
        """
        return self if self._space_definition.probe is None else self._space_definition.probe

    @field_validator("name")
    @classmethod
    def _check_name(cls, name: str) -> str:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}", name):
            raise ValueError(f"{quoted(name)} cannot name a folder; use letters, digits, '-', '_' and '.'")
        return name


class SpaceDefinition:
    """Definition of a design space. All instances compare as equal, because campaigns are compared by their cases.

    axes : Axes as written in the file; the axes of the campaign itself have one value per sample.
    probe : The campaign of the base and of the two ends of each axis alone.
    """

    def __init__(self, axes: tuple[Axis, ...] = (), probe: Campaign | None = None) -> None:
        self.axes, self.probe = axes, probe

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SpaceDefinition)

    __hash__ = None  # type: ignore[assignment]
