"""A metric: a number of a case by its name, with unit, meaning, needs, and its value by runs and by linear covariance.

A family of metrics is a subclass; its module in `families` names the members. See `registry` for how they are found.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from lvnav_trade import units
from lvnav_trade.records import Floats

if TYPE_CHECKING:
    from lvnav_trade.metrics.basics.case import CaseResults, Distribution, Errors
    from lvnav_trade.store.read import Tables

# Blocks of a campaign that can name a metric
REQUIREMENTS, BOTH, STATEMENTS = "requirements", "requirements, statements", "statements"
# How numbers of several cases become one number
ROOT_MEAN_SQUARE, MEAN, MEDIAN = "root mean square", "mean", "median"
NUMBERS = ("formal", "true", "monte_carlo")
SI = "-"  # unit that stands for the SI unit of a metric, whichever it is
NO_LAW = "linear covariance does not hold this error there"
# SI unit of the navigation errors
NAVIGATION_UNITS = {"attitude": "rad", "velocity": "m/s", "position": "m"}
# What a bound on a number is: on the length of a vector, on a signed error either way, on a number without a sign
LENGTH, TWO_SIDED, ONE_SIDED = "norm", "two-sided", "one-sided"
MISSING, NOT_IN_FLIGHT = "not among our results", "not in our flight"


class MetricValue(NamedTuple):
    """The value of a metric in a case, three times; NaN where there is none.

    formal : By the filter's own sigma.
    true : By the true error of linear covariance, sigma and mean together; also what is the same in every run.
    monte_carlo : By the runs.
    remark : What should be said of it.
    runs : (n_run,). What the number of the runs is the mean of, in the order of the runs; empty where not stored.
    is_root : Whether `runs` are squares, and the number is the root of their mean.
    is_share : Whether `runs` are one or zero.
    levels : (n_case,). Mean of each of several cases that are taken together.
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
    """The number that is compared with a published one.

    value : In the unit that was asked for; NaN where there is none.
    remark : What should be said of it.
    runs : (n_run,), growing. The number of each run by itself; empty where not known.
    """

    value: float
    remark: str = ""
    runs: Floats = np.empty(0)


@dataclass(frozen=True)
class Metric:
    """A metric. A family overrides what applies to it; one without runs of its own needs `value` alone.

    name : Name in campaigns.
    unit : SI unit; "-" or "%" of a number that has none.
    meaning : One phrase for the list of metrics.

    named_by : Blocks of a campaign that can name it.
    average : How the numbers of several cases become one.
    is_signed : Whether it has a sign, so that a mean over the runs says something.
    has_least : Whether a statement can ask for its smallest value in a phase.
    is_of_signals : Whether elevation and altitude choose the signals that count.
    has_epoch : Whether a statement chooses the kind of its elements and their epochs.
    is_of_modes : Whether a statement names a mode of the filter's logic.
    limit_unit : SI unit of the limit `below` in a statement; empty where it takes none.
    limit_by_sigma : Whether the limit may be a multiple of the sigma of another case.
    at_events_only : Why a requirement on it is at an event and of no phase; empty where a phase will do.
    once_a_run : Whether a run has one value of it, so that nothing can be said of the time around its event.
    has_history : Whether it is known between events, so that a requirement can have a window.
    bounded_as : What a bound on it is: `LENGTH`, `TWO_SIDED` or `ONE_SIDED`.
    """

    name: str
    unit: str
    meaning: str

    named_by: ClassVar[str] = STATEMENTS
    average: ClassVar[str] = ROOT_MEAN_SQUARE
    has_least: ClassVar[bool] = False
    is_of_signals: ClassVar[bool] = False
    is_of_modes: ClassVar[bool] = False
    limit_by_sigma: ClassVar[bool] = False
    at_events_only: ClassVar[str] = ""
    once_a_run: ClassVar[bool] = False

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
    def bounded_as(self) -> str:
        """What a bound on it is: `LENGTH`, `TWO_SIDED` or `ONE_SIDED`."""
        return ONE_SIDED

    @property
    def limit_unit(self) -> str:
        """SI unit of a limit; empty without one."""
        return ""

    # --- what it needs -------------------------------------------------------------------------------------------

    def faults(self, stated: Any) -> Iterator[str]:
        """Yield what a statement (`published.Measured`) lacks, or names in vain, for this metric."""
        return iter(())

    def missing_in(self, campaign: Any) -> str:
        """Say what a campaign must ask for so that a requirement can name the metric; empty where nothing is missing.

        campaign: `schema.Campaign`, whose type is above this package.
        """
        return ""

    # --- its value -----------------------------------------------------------------------------------------------

    def value(self, tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the value of a case in a unit (`SI`: its SI unit), three times, at the place that is stated."""
        raise NotImplementedError

    def single(self, tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> SingleValue:
        """Return the number of the statistic that is stated: by the runs, or else by linear covariance."""
        found = self.value(tables, case, stated, unit)
        number = found.true if np.isnan(found.monte_carlo) else found.monte_carlo
        return SingleValue(number, found.remark, np.sort(np.sqrt(found.runs) if found.is_root else found.runs))

    def errors(self, case: CaseResults, requirement: Mapping[str, Any]) -> Errors | None:
        """Return what a requirement bounds in each run, infinite in a failed one; None where the case lacks it."""
        return None

    def law(self, case: CaseResults, requirement: Mapping[str, Any]) -> Distribution | str:
        """Return the distribution of what a requirement bounds by linear covariance, or why there is none."""
        return NO_LAW

    # --- how it is written ---------------------------------------------------------------------------------------

    def label(self, stated: Mapping[str, Any]) -> str:
        """Return the metric, the statistic where it is not the root mean square, and where it holds."""
        words = {"rms": "", "worst": "worst ", "least": "least ", "formal": "filter's own sigma of ", "mean": "mean "}
        first, during = words.get(stated.get("statistic", "rms"), "linear covariance of "), stated.get("during")
        return f"{first}{self.name}{f', {during}' if during else f' at {event_of(stated)}'}"

    def is_mean(self, stated: Mapping[str, Any]) -> bool:
        """Whether what is stated is a mean over the runs, and no root of one."""
        return self.average == MEAN or stated.get("statistic") == "mean"


def event_of(stated: Mapping[str, Any]) -> str:
    """Return the event that a statement or requirement without a phase is about."""
    return str(stated.get("at") or "injection")


def where(stated: Mapping[str, Any]) -> str:
    """Return where in the flight a statement or requirement holds: its phase, or its event."""
    return str(stated.get("during") or event_of(stated))


def scale_of(unit: str, si: str) -> float | None:
    """Return how many SI units one unit is; None where it is one of another kind."""
    if unit == SI:
        return 1.0
    try:
        return units.parse(f"1 {unit}", si)
    except ValueError:
        return None


def no_fit(unit: str) -> str:
    """Say that a unit is one of another kind."""
    return f"unit {unit} does not fit"
