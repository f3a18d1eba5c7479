"""Claims of a study on its campaigns: orders of cases, statements on innovations, expressions of metrics."""

from collections.abc import Iterator
from typing import Literal

from pydantic import Field, ValidationInfo, field_validator

from lvnav_trade.api.input import (
    STATEMENTS,
    Card,
    Levels,
    MeasuredMetric,
    Pooled,
    PublishedNumber,
    PublishedStatement,
    Share,
    expression,
    metric_of,
    quoted,
    require_unit,
)
from lvnav_trade.api.measures import Nees


class Ordering(MeasuredMetric, PublishedStatement):
    """A published order of cases by a metric, the smallest first; it holds where each is below the next."""

    cases: tuple[Levels, ...] = Field(min_length=2, description="level of each axis, by its label; smallest first")
    factor: float = Field(1.0, gt=0, description="largest ratio of a case to the next")

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if self.statistic == "mean":
            yield "an ordering compares sizes, and a mean has a sign; give another statistic"


class Innovations(Pooled, PublishedStatement):
    """A published statement on innovations: white, or correlated, as one flight can tell."""

    case: Levels = Field({}, description="level of each axis, by its label")
    channels: str = Field("", description="words that a channel's name holds: position, velocity, range, range rate")
    white: bool = True
    largest: Share = Field(
        0.15,
        gt=0,
        lt=1,
        description="autocorrelation at lags 1 to 10 above which a channel is called correlated; of 600 white "
        "innovations of one flight it is below 0.12 in 97 % of flights, of 300 below 0.17",
    )


class Term(MeasuredMetric):
    """A number of a case that an expression of a statement names."""

    case: Levels = Field({}, description="level of each axis, by its label; the axes left out take each level in turn")
    minus: Levels | None = Field(
        None, description="levels of another case, whose errors are subtracted run by run and axis by axis; at an event"
    )
    over: str = Field("", description="axis over whose levels the median is taken; of reacquisition times all together")

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if self.minus is not None and (self.at is None or self.statistic != "rms" or "_error" not in self.metric):
            yield "minus needs an error at an event, without a statistic"
        if self.pool and (self.over or self.minus is not None):
            yield "pool takes the runs of all levels together, over their median and minus a difference; choose one"
        if self.statistic == "lincov":
            yield "statistic lincov is a column of every statement; leave it out"
        if self.statistic == "formal" and "_error" not in self.metric:
            yield f"statistic formal is of an error, not of {self.metric}"


class Statement(PublishedStatement):
    """A statement with a number: an expression of metrics of cases has bounds that it must keep.

    It is evaluated with formal sigmas, with the true errors of linear covariance, and with the runs, paired.
    """

    value: str = Field(description="expression of the terms: 'a / b', 'max(a, b) / min(a, b)', '100 * (a / b - 1)'")
    terms: dict[str, Term] = Field(min_length=1, description="by the names in the expression")
    unit: str = Field("-", description="of the terms and of the value; -: a ratio, all terms in SI units")
    case: Levels = Field({}, description="levels of axes that hold for every term")
    at_least: float | None = None  # lower bound of the value; none: no lower bound
    at_most: float | None = None  # upper bound of the value; none: no upper bound
    probability: Share | None = Field(
        None, gt=0.5, lt=1, description="of a NEES: it is at most its upper bound at this probability (chi-square)"
    )
    of_runs: Share | None = Field(
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

    @field_validator("unit")
    @classmethod
    def _check_unit(cls, unit: str, info: ValidationInfo) -> str:
        if unit != "-":
            for name, term in info.data.get("terms", {}).items():
                require_unit(unit, term.metric, f" of the term {name}")
        return unit

    @field_validator("value")
    @classmethod
    def _check_expression(cls, value: str) -> str:
        expression.names(value)
        return value

    def case_of(self, name: str) -> Levels:
        """Return the levels of a term, including those of the whole statement."""
        return self.case | self.terms[name].case

    def _faults(self) -> Iterator[str]:
        unshared_names = sorted(set(expression.names(self.value)) ^ set(self.terms))
        if unshared_names:
            yield f"value: {quoted(self.value)} and the terms do not have the same names ({', '.join(unshared_names)})"
        other_bounds = (self.at_least, self.at_most, self.probability)
        has_bound = any(bound is not None for bound in other_bounds)
        if self.of_runs is None and not has_bound:
            yield "there is no bound; give at_least, at_most, of_runs, or the probability of a NEES"
        if self.of_runs is not None and has_bound:
            yield "of_runs sets both bounds; leave out at_least, at_most and probability"
        if self.of_runs is not None and "monte_carlo" not in self.tested_by:
            yield "of_runs needs monte_carlo among tested_by"
        if self.at_least is not None and self.at_most is not None and self.at_least > self.at_most:
            yield f"at_least {self.at_least:g} is above at_most {self.at_most:g}"
        if self.probability is not None:
            metrics = [metric_of(term.metric) for term in self.terms.values()]
            is_single_nees = len(metrics) == 1 and isinstance(metrics[0], Nees)
            if self.at_most is not None or not is_single_nees:
                yield "probability is the bound of a single NEES, in place of at_most"


class ExternalNumber(PublishedStatement):
    """Statement that is tested by a number from outside the campaigns, such as a benchmark; remark: its origin."""

    value: float = Field(description="the number that was found")
    at_least: float | None = None
    at_most: float | None = None

    def _faults(self) -> Iterator[str]:
        if self.at_least is None and self.at_most is None:
            yield "there is no bound; give at_least or at_most"
        if not self.remark:
            yield "remark: should say where the number is from"


class Claims(Card):
    """Claims of a study on one campaign."""

    references: tuple[PublishedNumber, ...] = Field(
        (), max_length=STATEMENTS, description="published numbers of metrics that the study's script adds"
    )
    orderings: tuple[Ordering, ...] = Field(
        (), max_length=STATEMENTS, description="published orders of cases that must hold"
    )
    innovations: tuple[Innovations, ...] = Field(
        (), max_length=STATEMENTS, description="published statements on the innovations"
    )
    statements: tuple[Statement, ...] = Field(
        (), max_length=STATEMENTS, description="published statements, each a bound on an expression of metrics"
    )
    missions: tuple[PublishedNumber, ...] = Field(
        (), description="published numbers of single flights, shown among ours; items are 'MISSION, WHAT'"
    )


class StudyStatements(Card):
    """Statements that belong to no campaign."""

    not_set_up: tuple[PublishedStatement, ...] = Field(
        (), description="statements of the publication that no campaign answers; remark: what is missing"
    )
    elsewhere: tuple[ExternalNumber, ...] = Field(
        (), description="statements that a number from elsewhere answers, such as a measured time"
    )
