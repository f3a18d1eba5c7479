"""Base class of metrics: named numbers of a case, evaluated by Monte Carlo runs and by linear covariance.

A family of metrics is a subclass; its module in the folder `metrics` lists the members. The `registry` finds them by
name.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from lvnav_trade.quantities import units
from lvnav_trade.quantities.records import Floats

if TYPE_CHECKING:
    from lvnav_trade.results.statistics.case_results import CaseResults, Distribution, RunErrors
    from lvnav_trade.results.tables.read import Tables

# Blocks of a campaign that can name a metric
REQUIREMENTS, BOTH, STATEMENTS = "requirements", "requirements, statements", "statements"
# How the numbers of several cases are averaged
ROOT_MEAN_SQUARE, MEAN, MEDIAN = "root mean square", "mean", "median"
NUMBERS = ("formal", "true", "monte_carlo")
SI = "-"  # unit that represents the SI unit of any metric
NO_LAW = "linear covariance does not hold this error there"
# SI unit of the navigation errors
NAVIGATION_UNITS = {"attitude": "rad", "velocity": "m/s", "position": "m"}
# Kinds of bounds: on the length of a vector, on a signed error in both directions, on a number without a sign
LENGTH, TWO_SIDED, ONE_SIDED = "norm", "two-sided", "one-sided"
MISSING, NOT_IN_FLIGHT = "not among our results", "not in our flight"
# Words for a statistic in a label
_STATISTICS = {
    "rms": "",
    "worst": "worst ",
    "least": "least ",
    "formal": "filter's own sigma of ",
    "mean": "mean ",
}


class MetricValue(NamedTuple):
    """Value of a metric in a case, computed in three ways; NaN where a value is not available.

    formal : By the formal sigma of the filter.
    true : By the true error of linear covariance, sigma and mean combined; also a number that is equal in all runs.
    monte_carlo : By the runs.
    remark : Remark for the reader of the report; empty for none.
    runs : (n_run,). Contributions of the runs, whose mean gives `monte_carlo`; empty if not stored.
    is_root : Whether `runs` are squares, so that `monte_carlo` is the root of their mean.
    is_share : Whether `runs` are one or zero, so that `monte_carlo` is a fraction.
    levels : (n_case,). Mean of each case if several cases are pooled.
    """

    formal: float = np.nan
    true: float = np.nan
    monte_carlo: float = np.nan
    remark: str = ""
    runs: Floats = np.empty(0)
    is_root: bool = True
    is_share: bool = False
    levels: Floats = np.empty(0)


class SingleValue(NamedTuple):
    """Number that is compared with a published number.

    value : In the requested unit; NaN if not available.
    remark : Remark for the reader of the report; empty for none.
    runs : (n_run,), ascending. Value of each single run; empty if not known.
    """

    value: float
    remark: str = ""
    runs: Floats = np.empty(0)


@dataclass(frozen=True)
class Metric:
    """A metric. A family overrides the members that apply to it: at least `value`, for requirements also
    `errors` and, where linear covariance describes it, `distribution`.

    name : Name in campaigns.
    unit : SI unit; "-" or "%" for a number without unit.
    meaning : Meaning, in one phrase for the list of metrics.

    named_by : Blocks of a campaign that can name it.
    average : How the numbers of several cases are averaged.
    is_signed : Whether it has a sign, so that its mean over the runs is meaningful.
    has_least : Whether a statement can ask for its smallest value in a phase.
    selects_signals : Whether elevation and altitude select the signals to evaluate.
    has_epoch : Whether a statement chooses the kind of its elements and their epochs.
    names_mode : Whether a statement names a mode of the filter's logic.
    limit_unit : SI unit of the limit `below` in a statement; empty if there is no limit.
    limit_by_sigma : Whether the limit may be a multiple of the sigma of another case.
    event_only_reason : Reason why a requirement must be at an event; empty if a phase is possible.
    has_single_value : Whether a run has a single value of it, so that there is no time history around an event.
    has_history : Whether it is known between events, so that a requirement can have a window.
    bound_type : Kind of a bound on it: `LENGTH`, `TWO_SIDED` or `ONE_SIDED`.
    """

    name: str
    unit: str
    meaning: str

    named_by: ClassVar[str] = STATEMENTS
    average: ClassVar[str] = ROOT_MEAN_SQUARE
    has_least: ClassVar[bool] = False
    selects_signals: ClassVar[bool] = False
    names_mode: ClassVar[bool] = False
    limit_by_sigma: ClassVar[bool] = False
    event_only_reason: ClassVar[str] = ""
    has_single_value: ClassVar[bool] = False

    @property
    def has_epoch(self) -> bool:
        """Whether it is of elements of the orbit, of which there are kinds and epochs."""
        return False

    @property
    def is_signed(self) -> bool:
        """Whether it has a sign; a length has none."""
        return False

    @property
    def has_history(self) -> bool:
        """Whether it is known between events."""
        return True

    @property
    def bound_type(self) -> str:
        """Kind of a bound on it: `LENGTH`, `TWO_SIDED` or `ONE_SIDED`."""
        return ONE_SIDED

    @property
    def limit_unit(self) -> str:
        """SI unit of a limit; empty if there is no limit."""
        return ""

    # --- needs ---------------------------------------------------------------------------------------------------

    def faults(self, statement: Any) -> Iterator[str]:
        """Yield an error message for each setting of a statement that is missing or has no effect for this metric.

        statement: `published_cards.MeasuredMetric`; its type is above this package.
        """
        return iter(())

    def missing_in(self, campaign: Any) -> str:
        """Return the setting that a campaign needs for a requirement on the metric; empty if nothing is missing.

        campaign: `schema.Campaign`, whose type is above this package.
        """
        return ""

    # --- value ---------------------------------------------------------------------------------------------------

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the value of the metric in a case.

        Parameters
        ----------
        tables : Tables
            Tables of the results.
        case : str
            Digest of the case.
        statement : mapping
            Statement: event or phase, statistic and further settings of the metric.
        unit : str
            Unit of the value; `SI` for the SI unit.

        Returns
        -------
        MetricValue
            Value by formal sigma, by linear covariance and by the runs.
        """
        raise NotImplementedError

    def single(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> SingleValue:
        """Return the value of the requested statistic by the runs, or by linear covariance if there are no runs.

        The arguments are those of `value`.
        """
        value = self.value(tables, case, statement, unit)
        number = value.true if np.isnan(value.monte_carlo) else value.monte_carlo
        runs = np.sqrt(value.runs) if value.is_root else value.runs
        return SingleValue(number, value.remark, np.sort(runs))

    def errors(self, case: CaseResults, requirement: Mapping[str, Any]) -> RunErrors | None:
        """Return the quantity bounded by a requirement in each run, infinite in a failed run; None if not available.

        Parameters
        ----------
        case : CaseResults
            Results of a case.
        requirement : mapping
            The requirement: metric, event or phase.
        """
        return None

    def distribution(self, case: CaseResults, requirement: Mapping[str, Any]) -> Distribution | str:
        """Return the distribution of the bounded quantity by linear covariance, or the reason why there is none.

        Parameters
        ----------
        case : CaseResults
            Results of a case.
        requirement : mapping
            The requirement: metric, event or phase.
        """
        return NO_LAW

    # --- text ----------------------------------------------------------------------------------------------------

    def label(self, statement: Mapping[str, Any]) -> str:
        """Return a label: the statistic unless it is the root mean square, the metric, and its event or phase."""
        statistic = _STATISTICS.get(statement.get("statistic", "rms"), "linear covariance of ")
        phase = statement.get("during")
        place = f", {phase}" if phase else f" at {event_of(statement)}"
        return f"{statistic}{self.name}{place}"

    def is_mean(self, statement: Mapping[str, Any]) -> bool:
        """Whether a statement refers to a mean over the runs and not to a root mean square."""
        return self.average == MEAN or statement.get("statistic") == "mean"


def event_of(statement: Mapping[str, Any]) -> str:
    """Return the event of a statement or requirement without a phase; injection by default."""
    return str(statement.get("at") or "injection")


def event_or_phase(statement: Mapping[str, Any]) -> str:
    """Return the phase or event of a statement or requirement."""
    return str(statement.get("during") or event_of(statement))


def scale_of(unit: str, si: str) -> float | None:
    """Return the factor from a unit to an SI unit; None if their dimensions differ.

    Parameters
    ----------
    unit : str
        Unit of the value; `SI` for the SI unit.
    si : str
        SI unit of the metric.
    """
    if unit == SI:
        return 1.0
    try:
        return units.parse(f"1 {unit}", si)
    except ValueError:
        return None


def dimension_message(unit: str) -> str:
    """Return the message for a unit of another dimension."""
    return f"unit {unit} does not fit"
