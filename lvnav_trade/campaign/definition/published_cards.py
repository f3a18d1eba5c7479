"""Published numbers that the results are compared with."""

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationInfo, field_validator

from lvnav_trade.campaign.definition.metric_names import known_metric, metric_of, unit_of
from lvnav_trade.quantities.errors import quoted
from lvnav_trade.quantities.records import MODES, REASONS
from lvnav_trade.quantities.units import Angle, Card, Length, Pause, parse
from lvnav_trade.results import registry

_SIGMA = re.compile(r"[0-9]+(\.[0-9]*)? (sigma|rms)$")  # limit of a convergence time in place of a size
# Words of a phase that are not events: the flight from lift-off on; the first and the last time of the flight
FLIGHT, ENDS = "flight", ("start", "end")
_INSTANT = re.compile(r"\s*(?P<event>[A-Za-z_]\w*)\s*(?:[+-]\s*(?P<offset>\S.*))?$")

Case = dict[str, str]
if TYPE_CHECKING:
    Mode = str
    Reason = str
else:
    Mode = Literal[MODES]
    Reason = Literal[REASONS]


def _check_instant(text: str) -> str:
    match = _INSTANT.match(text)
    if match is None:
        raise ValueError(f"{text!r} is no instant; write EVENT, or 'EVENT + 20 s'")
    if match["offset"] is not None:
        parse(match["offset"].strip(), "s")
    return text


def event_of(instant: str) -> str:
    """Return the event of an instant such as ``stage1_cutoff + 20 s``."""
    match = _INSTANT.match(instant)
    return match["event"] if match is not None else instant


def _check_phase(phase: str | None) -> str | None:
    ends = phase.split(" to ") if phase is not None and phase != FLIGHT else ()
    if len(ends) not in (0, 2):
        raise ValueError(f"{phase!r} is no phase; write 'EVENT to EVENT' or {FLIGHT}")
    for end in ends:
        _check_instant(end)
    return phase


def statement_event(event: str | None, info: ValidationInfo, statement: str) -> str | None:
    """Return the event to which a statement applies: injection if it names neither an event nor a phase.

    Parameters
    ----------
    event : str or None
        Event that the statement names.
    info : ValidationInfo
        Fields validated so far, with the phase `during`.
    statement : str
        Subject of the error message.

    Raises
    ------
    ValueError
        The statement names both an event and a phase.
    """
    phase = info.data.get("during")
    if event is not None and phase is not None:
        raise ValueError(f"{statement} holds at an event or during a phase, not both")
    return event if event is not None or phase is not None else "injection"


def _check_event(event: str | None, info: ValidationInfo) -> str | None:
    instant = statement_event(event, info, "a number")
    return instant if instant is None else _check_instant(instant)


def require_unit(unit: str, metric: str, which: str = "") -> None:
    """Raise a ValueError if a unit does not fit a metric.

    Parameters
    ----------
    unit : str
        Unit of a published number.
    metric : str
        Name of the metric.
    which : str
        Text that specifies the metric further in the message.
    """
    si = unit_of(metric)
    if si not in ("%", "-"):
        parse(f"1 {unit}", si)
    elif unit != si:
        raise ValueError(f"{quoted(unit)} does not fit {metric}{which}; expected {si!r}")


class PublishedStatement(Card):
    """Fields of every published statement: source, subject, remark, and reasons not to count it as evidence."""

    id: str = Field(
        "", max_length=60, description="name of the row in the CSV; if absent, derived from the position in the file"
    )
    source: str
    item: str = ""
    remark: str = ""
    own: str = Field(
        "",
        max_length=200,
        description="part that is not published (the statement or its bound), and why; a study does not count it",
    )
    repeats: str = Field(
        "",
        max_length=200,
        description="input that fixes the result; a study lists it separately and does not count it",
    )
    again: str = Field(
        "", max_length=200, description="first row that compares the same published number, which counts once"
    )
    verification: str = Field(
        "", max_length=200, description="reason why it cannot fail: it checks the tool, and a study does not count it"
    )


class Pooled(Card):
    """A statement that may apply to several cases taken together."""

    pool: tuple[str, ...] = Field(
        (), description="axes whose levels are pooled: all their runs count as runs of one case"
    )

    @field_validator("pool", mode="before")
    @classmethod
    def _axis_tuple(cls, axes: Any) -> Any:
        return (axes,) if isinstance(axes, str) else axes


class MeasuredMetric(Pooled):
    """A metric at an event or during a phase."""

    metric: Annotated[str, AfterValidator(known_metric)] = Field(
        description="such as velocity_error_3d, gyro_bias_error_x, perigee_error; satellites_tracked, troposphere_left"
    )
    during: Annotated[str | None, AfterValidator(_check_phase)] = Field(
        None, description="phase in place of an event: 'liftoff to injection', 'stage1_cutoff to stage1_cutoff + 30 s'"
    )
    at: Annotated[str | None, AfterValidator(_check_event)] = Field(
        None, validate_default=True, description="event; injection if no phase is given"
    )
    statistic: Literal["rms", "mean", "worst", "least", "formal", "lincov"] = Field(
        "rms",
        description="rms over runs (and time); mean: of the error of an axis, with its sign; worst: median over runs "
        "of each run's largest during the phase; least: the same of the smallest, of what is counted; formal: the "
        "filter's own sigma; lincov: sigma of the true error",
    )

    elevation: tuple[Angle, Angle] | None = Field(None, description="for signals: range of elevation of the satellites")
    altitude: tuple[Length, Length] | None = Field(None, description="for signals: range of altitude of the vehicle")
    elements: Literal["mean", "osculating"] = Field(
        "mean", description="for errors of an orbit: averaged over a revolution to first order in J2, or osculating"
    )
    epoch: Pause = Field(0.0, description="for errors of an orbit: time after the event of the estimated elements")
    reference_epoch: Pause | None = Field(
        None, description="for errors of an orbit: time after the event of the true elements; none: that of `epoch`"
    )
    below: str | None = Field(
        None,
        description="limit in three dimensions of a convergence time, an availability, a coverage; '3 rms', '3 sigma': "
        "so many times the root mean square by linear covariance of the case `sigma_of`, or its sigma, without the "
        "mean",
    )
    sigma_of: Case | None = Field(None, description="levels of the case whose sigmas set the limit")
    mode: Mode | None = Field(
        None, description=f"for the mode logic: the mode ({', '.join(MODES)}) that is entered or active"
    )
    reason: Reason = Field(
        "", description="for changes into a mode: only those with this reason, as in the logic table"
    )
    number: int = Field(1, ge=1, description="for changes into a mode: number of the change in the phase, from 1")

    @property
    def events(self) -> tuple[str, ...]:
        """The events named by the statement."""
        if self.during == FLIGHT:
            return ()
        instants = (self.during or self.at or "injection").split(" to ")
        events = map(event_of, instants)
        return tuple(event for event in events if event not in ENDS)

    def _faults(self) -> Iterator[str]:
        metric = metric_of(self.metric)
        if self.statistic in ("worst", "least") and self.during is None:
            yield f"statistic {self.statistic} needs a phase; give during in place of at"
        if self.statistic == "least" and not metric.has_least:
            counted_metrics = ", ".join(registry.names(lambda metric: metric.has_least))
            yield f"statistic least needs a metric that is counted ({counted_metrics})"
        if self.statistic == "mean" and not metric.is_signed:
            yield "statistic: mean needs a signed metric, such as the error of one axis"
        if (self.elevation or self.altitude) and not metric.selects_signals:
            signal_metrics = ", ".join(registry.names(lambda metric: metric.selects_signals))
            yield f"elevation and altitude select signals: they need a metric of signals ({signal_metrics})"
        for limits in (self.elevation, self.altitude):
            if limits is not None and limits[0] >= limits[1]:
                yield "elevation and altitude: give the smaller limit first"
                break
        has_orbit_setting = self.elements != "mean" or self.epoch or self.reference_epoch is not None
        if has_orbit_setting and not metric.has_epoch:
            orbit_metrics = ", ".join(registry.names(lambda metric: metric.has_epoch))
            yield f"elements, epoch and reference_epoch need the error of an element of the orbit ({orbit_metrics})"
        if self.reference_epoch is not None and self.reference_epoch == self.epoch:
            yield "reference_epoch is the epoch of the estimated elements already; leave it out"
        yield from metric.faults(self)
        yield from self._limits()
        if not metric.names_mode and (self.mode or self.reason or self.number > 1):
            mode_metrics = ", ".join(registry.names(lambda metric: metric.names_mode))
            yield f"mode, reason and number need a metric of the mode logic ({mode_metrics})"

    def _limits(self) -> Iterator[str]:
        metric = metric_of(self.metric)
        by_sigma = self.below is not None and metric.limit_by_sigma and bool(_SIGMA.match(self.below))
        if self.below is not None and not metric.limit_unit:
            limit_metrics = ", ".join(registry.names(lambda metric: bool(metric.limit_unit)))
            yield f"below needs a metric that has a limit ({limit_metrics})"
        elif self.below is not None and not by_sigma:
            parse(self.below, metric.limit_unit)
        if by_sigma != (self.sigma_of is not None):
            yield "sigma_of names the case of a limit in sigma or rms: give both, or neither and a limit with its unit"


class PublishedNumber(MeasuredMetric, PublishedStatement):
    """A published number with which the results are compared."""

    case: Case = Field({}, description="level of each axis, by its label")
    against: Case | None = Field(
        None, description="the number is the reduction (%) of the metric of `case` relative to this case"
    )
    than: Annotated[str, AfterValidator(known_metric)] | None = Field(
        None, description="the number is the reduction (%) of the metric relative to this metric of the same case"
    )
    value: float  # published number, in `unit`
    unit: str  # unit of `value`
    band: tuple[float, float] = Field((0.5, 2.0), description="bounds of the ratio of our number to the published one")
    digit: float = Field(
        0.0, ge=0.0, description="last printed digit of the number, in `unit`; the band is wider by half of it"
    )
    single: bool = Field(
        False, description="the number is of a single run; the report shows its percentile among our runs"
    )
    fitted: bool = Field(
        False,
        description="settings were fitted to this number; a study counts it separately from numbers that were withheld",
    )

    @field_validator("unit")
    @classmethod
    def _check_unit(cls, unit: str, info: ValidationInfo) -> str:
        is_reduction = info.data.get("than") is not None or info.data.get("against") is not None
        if "metric" in info.data and not is_reduction:
            require_unit(unit, info.data["metric"])
        return unit

    @field_validator("value")
    @classmethod
    def _check_value(cls, value: float) -> float:
        if value == 0.0:
            raise ValueError("0 has no ratio; publish the bound that ours must keep, with the band [0, 1]")
        return value

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        is_reduction = self.than is not None or self.against is not None
        lowest, highest = self.band
        smallest_ratio = -abs(highest) if is_reduction else 0.0  # a difference in percent may have the other sign
        if not smallest_ratio <= lowest <= highest or highest == 0:
            yield "the band should be two growing ratios, such as [0.5, 2]"
        if self.digit > abs(self.value):
            yield f"digit: {self.digit:g} is larger than the number {self.value:g}, whose last digit it is"
        if is_reduction and self.unit != "%":
            name = "than" if self.against is None else "against"
            yield f"{name} makes the number a part of another; its unit is %, not {self.unit!r}"
        if self.than is not None and self.against is not None:
            yield "`than` compares within the case, `against` with another case; choose one"
        if self.than is not None:
            than_unit = unit_of(self.than)
            metric_unit = unit_of(self.metric)
            if than_unit != metric_unit:
                yield f"than: {self.than} is in {than_unit}, {self.metric} in {metric_unit}"
