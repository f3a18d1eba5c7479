"""What others published: numbers that ours are held against, orders of cases, statements, innovations."""

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationInfo, field_validator

from lvnav_trade import expression
from lvnav_trade.campaign.definition.metric_names import (
    CONVERGENCE,
    COUNTED,
    COVERAGE,
    ERROR_UNITS,
    LIMITED,
    NEES,
    known_metric,
    unit_of,
)
from lvnav_trade.errors import quoted
from lvnav_trade.layout import LEVELS, MISSION, MODE_METRICS, RATES
from lvnav_trade.records import MODES, REASONS
from lvnav_trade.units import Angle, Card, Length, parse

_SIGMA = re.compile(r"\d+(\.\d*)? (sigma|rms)$")  # limit of a convergence time in place of a size
# Words of a phase that are no events: from lift-off on; the first and the last time of the flight
FLIGHT, ENDS = "flight", ("start", "end")
_INSTANT = re.compile(r"\s*(?P<event>[A-Za-z_]\w*)\s*(?:[+-]\s*(?P<offset>\S.*))?$")

Case = dict[str, str]
if TYPE_CHECKING:
    Mode = str
    Reason = str
else:
    Mode = Literal[MODES]
    Reason = Literal[REASONS]


def _instant(text: str) -> str:
    match = _INSTANT.match(text)
    if match is None:
        raise ValueError(f"{text!r} is no instant; write EVENT, or 'EVENT + 20 s'")
    if match["offset"] is not None:
        parse(match["offset"].strip(), "s")
    return text


def event_of(instant: str) -> str:
    """Return the event that an instant such as ``stage1_cutoff + 20 s`` counts from."""
    match = _INSTANT.match(instant)
    return match["event"] if match is not None else instant


def _phase(phase: str | None) -> str | None:
    ends = phase.split(" to ") if phase is not None and phase != FLIGHT else ()
    if len(ends) not in (0, 2):
        raise ValueError(f"{phase!r} is no phase; write 'EVENT to EVENT' or {FLIGHT}")
    for end in ends:
        _instant(end)
    return phase


def place(event: str | None, info: ValidationInfo, statement: str) -> str | None:
    """Return the event that a statement is about: injection where it names neither an event nor a phase.

    ValueError where it names both; `statement` is what it is called there.
    """
    during = info.data.get("during")
    if event is not None and during is not None:
        raise ValueError(f"{statement} holds at an event or during a phase, not both")
    return event if event is not None or during is not None else "injection"


def _place(event: str | None, info: ValidationInfo) -> str | None:
    found = place(event, info, "a number")
    return found if found is None else _instant(found)


class Stated(Card):
    """What every statement has: where it is from, what it is about, and what is said of it."""

    id: str = Field("", max_length=60, description="name of the row in the CSV; from its place if absent")
    source: str
    item: str = ""
    remark: str = ""
    own: str = Field(
        "",
        max_length=200,
        description="what of it is not published: the statement, or its bound, and why; a study counts it apart",
    )


class Pooled(Card):
    """What may be of several cases taken together."""

    pool: tuple[str, ...] = Field(
        (), description="axes whose levels are taken together: all their runs count as runs of one case"
    )

    @field_validator("pool", mode="before")
    @classmethod
    def _several(cls, axes: Any) -> Any:
        return (axes,) if isinstance(axes, str) else axes


class Measured(Pooled):
    """A metric at an event or during a phase."""

    metric: Annotated[str, AfterValidator(known_metric)] = Field(
        description="such as velocity_error_3d, gyro_bias_error_x, perigee_error; satellites_tracked, troposphere_left"
    )
    during: Annotated[str | None, AfterValidator(_phase)] = Field(
        None, description="phase in place of an event: 'liftoff to injection', 'stage1_cutoff to stage1_cutoff + 30 s'"
    )
    at: Annotated[str | None, AfterValidator(_place)] = Field(
        None, validate_default=True, description="event; injection if no phase is given"
    )
    statistic: Literal["rms", "mean", "worst", "least", "formal", "lincov"] = Field(
        "rms",
        description="rms over runs (and time); mean: of the error of an axis, with its sign; worst: median over runs "
        "of each run's largest during the phase; least: the same of the smallest, of what is counted; formal: the "
        "filter's own sigma; lincov: sigma of the true error",
    )

    elevation: tuple[Angle, Angle] | None = Field(None, description="of signals: of the satellites, from and to")
    altitude: tuple[Length, Length] | None = Field(None, description="of signals: of the vehicle, from and to")
    below: str | None = Field(
        None,
        description="limit in three dimensions of a convergence time, an availability, a coverage; '3 rms', '3 sigma': "
        "so many times the root mean square by linear covariance of the case `sigma_of`, or its sigma, without the "
        "mean",
    )
    sigma_of: Case | None = Field(None, description="levels of the case whose sigmas are the limit")
    mode: Mode | None = Field(
        None, description=f"of what a filter's logic does: the mode ({', '.join(MODES)}) that is entered or lasts"
    )
    reason: Reason = Field(
        "", description="of changes into a mode: those of this reason alone, as the table of the logic has it"
    )
    number: int = Field(1, ge=1, description="of changes into a mode during the phase: the first, the second, ...")

    @property
    def events(self) -> tuple[str, ...]:
        """The events that it names."""
        instants = [] if self.during == FLIGHT else (self.during or self.at or "injection").split(" to ")
        return tuple(event for event in map(event_of, instants) if event not in ENDS)

    def _faults(self) -> Iterator[str]:
        if self.statistic in ("worst", "least") and self.during is None:
            yield f"statistic {self.statistic} is of a phase; give during in place of at"
        if self.statistic == "least" and self.metric not in COUNTED:
            yield f"statistic least is of what is counted ({', '.join(COUNTED)})"
        signed = "_error" in self.metric and not self.metric.endswith("_3d") and self.metric not in MISSION
        if self.statistic == "mean" and not signed:
            yield "statistic mean is of the error of one axis, which has a sign"
        if (self.elevation or self.altitude) and self.metric not in COUNTED[1:-2]:
            yield f"elevation and altitude choose signals ({', '.join(COUNTED[1:-2])})"
        if any(pair is not None and pair[0] >= pair[1] for pair in (self.elevation, self.altitude)):
            yield "elevation and altitude go from the smaller to the larger"
        if self.metric in NEES and (self.during is None or self.statistic != "rms"):
            yield f"{self.metric} is a mean over a phase; give during, and no statistic"
        if self.metric in LIMITED and (self.during is None or self.statistic != "rms" or self.below is None):
            yield f"{self.metric} is of a phase and a limit; give during and below, and no statistic"
        if self.metric in LEVELS and self.statistic != "rms":
            yield f"{self.metric} is the same in every run; give no statistic"
        if self.metric in RATES and (self.during is None or self.statistic != "rms"):
            yield f"{self.metric} is of a phase; give during, and no statistic"
        if self.metric in COVERAGE and (self.at is None or self.statistic != "rms"):
            yield f"{self.metric} is of an event; give at, and no statistic"
        yield from self._limits()
        yield from self._modes()

    def _modes(self) -> Iterator[str]:
        of_modes = self.metric in MODE_METRICS
        if of_modes and (self.during is None or self.mode is None or self.statistic != "rms"):
            yield f"{self.metric} is of a mode in a phase; give during and mode, and no statistic"
        if not of_modes and (self.mode or self.reason or self.number > 1):
            yield f"mode, reason and number are of what a filter's logic does ({', '.join(MODE_METRICS)})"
        if self.metric == "mode_duration" and (self.reason or self.number > 1):
            yield "reason and number choose changes; mode_duration is of all of the phase"

    def _limits(self) -> Iterator[str]:
        by_sigma = self.below is not None and self.metric in CONVERGENCE and bool(_SIGMA.match(self.below))
        if self.below is not None and self.metric not in (*LIMITED, *COVERAGE):
            yield f"below is the limit of a metric that has one ({', '.join((*LIMITED, *COVERAGE))})"
        elif self.below is not None and not by_sigma:
            parse(self.below, ERROR_UNITS[self.metric.partition("_")[0]])
        if by_sigma != (self.sigma_of is not None):
            yield "a limit in sigma or rms has the case that they are of, sigma_of, and no other limit has it"


class Published(Measured, Stated):
    """A published number that ours is held against."""

    case: Case = Field({}, description="level of each axis, by its label")
    against: Case | None = Field(
        None, description="the number is by how many % the metric of `case` is smaller than that of this one"
    )
    than: Annotated[str, AfterValidator(known_metric)] | None = Field(
        None, description="the number is by how many % the metric is smaller than this one, of the same case"
    )
    value: float
    unit: str
    band: tuple[float, float] = Field((0.5, 2.0), description="of ours / published")
    single: bool = Field(
        False, description="of a single run: the page shows where it lies among our runs, each by itself"
    )
    repeats: str = Field(
        "",
        max_length=200,
        description="the input that decides the number: a study lists it apart and does not count it",
    )
    fitted: bool = Field(
        False, description="settings were searched for by this number: a study counts it apart from those withheld"
    )

    @field_validator("value")
    @classmethod
    def _divides(cls, value: float) -> float:
        if value == 0.0:
            raise ValueError("0 has no ratio; publish the bound that ours must keep, with the band [0, 1]")
        return value

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        part = self.than is not None or self.against is not None
        least = -abs(self.band[1]) if part else 0.0  # a difference in percent may lie on the other side of zero
        if not least <= self.band[0] <= self.band[1] or self.band[1] == 0:
            yield "the band should be two growing ratios, such as [0.5, 2]"
        if part and self.unit != "%":
            name = "than" if self.against is None else "against"
            yield f"{name} makes the number a part of another; its unit is %, not {self.unit!r}"
        if self.than is not None and self.against is not None:
            yield "than is of the same case, against of another; choose one"
        wanted = "%" if part else unit_of(self.metric)
        if wanted not in ("%", "-"):
            parse(f"1 {self.unit}", wanted)
        elif self.unit != wanted:
            yield f"unit: {quoted(self.unit)} does not fit {self.metric}; expected {wanted!r}"
        if self.than is not None and unit_of(self.than) != unit_of(self.metric):
            yield f"than: {self.than} is in {unit_of(self.than)}, {self.metric} in {unit_of(self.metric)}"


class Ordering(Measured, Stated):
    """A published order of cases by a metric, the smallest first; it holds where each is below the next."""

    cases: tuple[Case, ...] = Field(min_length=2, description="level of each axis, by its label; smallest first")
    factor: float = Field(1.0, gt=0, description="largest ratio of a case to the next")

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if self.statistic == "mean":
            yield "an order is of sizes, and a mean has a sign"


class Innovations(Pooled, Stated):
    """A published statement on innovations: white, or correlated, as one flight can tell."""

    case: Case = Field({}, description="level of each axis, by its label")
    channels: str = Field("", description="words that a channel's name holds: position, velocity, range, range rate")
    white: bool = True
    largest: float = Field(
        0.15,
        gt=0,
        lt=1,
        description="autocorrelation at lags 1 to 10 above which a channel is called correlated; of 600 white "
        "innovations of one flight it is below 0.12 in 97 % of flights, of 300 below 0.17",
    )


class Term(Measured):
    """A number of a case that an expression of a statement names."""

    case: Case = Field({}, description="level of each axis, by its label; the axes left out take each level in turn")
    minus: Case | None = Field(
        None, description="levels of another case, whose errors are subtracted run by run and axis by axis; at an event"
    )
    over: str = Field("", description="axis over whose levels the median is taken; of reacquisition times all together")

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if self.minus is not None and (self.at is None or self.statistic != "rms" or "_error" not in self.metric):
            yield "minus is of an error at an event, without a statistic"
        if self.pool and (self.over or self.minus is not None):
            yield "pool takes the runs of all levels together, over their median and minus a difference; choose one"
        if self.statistic == "lincov":
            yield "statistic lincov is a column of every statement; leave it out"
        if self.statistic == "formal" and "_error" not in self.metric:
            yield f"statistic formal is of an error, not of {self.metric}"


class Statement(Stated):
    """A statement with a number: an expression of metrics of cases has bounds that it must keep.

    It is evaluated with formal sigmas, with the true errors of linear covariance, and with the runs, paired.
    """

    value: str = Field(description="expression of the terms: 'a / b', 'max(a, b) / min(a, b)', '100 * (a / b - 1)'")
    terms: dict[str, Term] = Field(min_length=1, description="by the names in the expression")
    unit: str = Field("-", description="of the terms and of the value; -: a ratio, all terms in SI units")
    case: Case = Field({}, description="levels of axes that hold for every term")
    at_least: float | None = None
    at_most: float | None = None
    probability: float | None = Field(
        None, gt=0.5, lt=1, description="of a NEES: it is at most its upper bound at this probability (chi-square)"
    )
    of_runs: float | None = Field(
        None,
        gt=0.5,
        lt=1,
        description="of a ratio of root mean squares over the runs to what is expected of them: it lies between the "
        "bounds that so many runs at one time keep with this probability (chi-square, both sides)",
    )
    tested_by: tuple[Literal["formal", "true", "monte_carlo"], ...] = Field(
        ("formal", "true", "monte_carlo"), min_length=1, description="numbers that must all keep the bounds"
    )
    along: str = Field("", description="axis over which the page shows the value, and where it would hold")

    def case_of(self, name: str) -> Case:
        """Return the levels that a term is of, those of the whole statement among them."""
        return self.case | self.terms[name].case

    def _faults(self) -> Iterator[str]:
        named = expression.names(self.value)
        if set(named) != set(self.terms):
            odd = sorted(set(named) ^ set(self.terms))
            yield f"value: {quoted(self.value)} and the terms do not have the same names ({', '.join(odd)})"
        if (self.at_least, self.at_most, self.probability, self.of_runs) == (None, None, None, None):
            yield "there is no bound; give at_least, at_most, of_runs, or the probability of a NEES"
        if self.of_runs is not None and (self.at_least, self.at_most, self.probability) != (None, None, None):
            yield "of_runs sets both bounds; leave out at_least, at_most and probability"
        if self.of_runs is not None and "monte_carlo" not in self.tested_by:
            yield "of_runs is a bound of runs; monte_carlo is not among tested_by"
        if self.at_least is not None and self.at_most is not None and self.at_least > self.at_most:
            yield f"at_least {self.at_least:g} is above at_most {self.at_most:g}"
        nees = [term.metric in NEES for term in self.terms.values()]
        if self.probability is not None and (self.at_most is not None or len(nees) != 1 or not all(nees)):
            yield "probability is the bound of a single NEES, in place of at_most"
        for name, term in self.terms.items():
            si = unit_of(term.metric)
            if self.unit != "-" and si not in ("-", "%"):
                parse(f"1 {self.unit}", si)
            elif self.unit not in ("-", si):
                yield f"unit: {quoted(self.unit)} does not fit {term.metric} of the term {name}; expected {si!r}"
