"""Injection accuracy of guided ascents: the achieved orbit against the target, depletion, propellant, cut-off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from lvnav_trade.metrics.basics.case import Distribution, Errors, Injections
from lvnav_trade.metrics.metric import (
    BOTH,
    LENGTH,
    MEAN,
    ONE_SIDED,
    TWO_SIDED,
    Metric,
    MetricValue,
    no_fit,
    scale_of,
)
from lvnav_trade.records import OUTCOMES, Floats

if TYPE_CHECKING:
    from lvnav_trade.metrics.basics.case import CaseResults
    from lvnav_trade.store.read import Tables

UNGUIDED = "no run is guided: give trajectory.guidance, and Monte Carlo"
_BY_RUNS = "linear covariance does not hold the injection of a guided ascent"
_AT_CUTOFF = "a number of the injection"


@dataclass(frozen=True)
class _OfInjection(Metric):
    """A number of the injection of each run."""

    named_by: ClassVar[str] = BOTH
    at_events_only: ClassVar[str] = _AT_CUTOFF
    once_a_run: ClassVar[bool] = True

    def law(self, case: CaseResults, requirement: Mapping[str, Any]) -> Distribution | str:
        """Return why linear covariance has no distribution."""
        return _BY_RUNS

    def missing_in(self, campaign: Any) -> str:
        """Say that it is known by runs of a guided ascent alone."""
        if campaign.monte_carlo is None:
            return "it is known by runs alone: give monte_carlo"
        return "" if _may_be_guided(campaign) else "no ascent is guided: give trajectory.guidance"


@dataclass(frozen=True)
class InjectionError(_OfInjection):
    """What the achieved orbit has more than the target; of several numbers the length of the difference.

    quantities : Numbers of the orbit, as in `records.ORBIT`.
    label_unit : Unit for people.
    label_factor : Factor from SI to it.
    """

    quantities: tuple[str, ...] = ()
    label_unit: str = "m"
    label_factor: float = 1.0

    @property
    def bounded_as(self) -> str:
        """The error of a vector is a length; of another number it has a sign."""
        return LENGTH if len(self.quantities) > 1 else TWO_SIDED

    def errors(self, case: CaseResults, requirement: Mapping[str, Any]) -> Errors | None:
        """Return the size of every run; infinite where it does not reach its cut-off."""
        size = self._sizes(case)
        return None if size is None else Errors(size, self.unit, self.label_unit, self.label_factor)

    def value(self, tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the root mean square over the runs."""
        from lvnav_trade.metrics.basics.case_tables import CaseTables

        scale, size = scale_of(unit, self.unit), self._sizes(CaseTables(tables, case))
        if scale is None or size is None:
            return MetricValue(remark=no_fit(unit) if scale is None else UNGUIDED)
        return MetricValue(monte_carlo=float(np.sqrt(np.mean(size**2))) / scale, runs=(size / scale) ** 2)

    def _sizes(self, case: CaseResults) -> Floats | None:
        found = [case.injections(quantity) for quantity in self.quantities]
        known = [one for one in found if one is not None]
        if len(known) < len(found):
            return None
        size = np.sqrt(np.sum([one.error**2 for one in known], axis=0))
        return np.where(known[0].injected & np.isfinite(size), size, np.inf)


@dataclass(frozen=True)
class Depletion(_OfInjection):
    """One for a run whose last stage is empty before its cut-off, else zero; a run that ends otherwise is no injection
    and counts as infinite in a requirement.
    """

    average: ClassVar[str] = MEAN

    @property
    def bounded_as(self) -> str:
        """It has no sign."""
        return ONE_SIDED

    def errors(self, case: CaseResults, requirement: Mapping[str, Any]) -> Errors | None:
        """Return zero or one of every run: a requirement asks for less than one half."""
        found = _any(case)
        if found is None:
            return None
        size = np.where(found.injected, 0.0, np.where(found.outcome == OUTCOMES[1], 1.0, np.inf))
        return Errors(size, self.unit, "-", 1.0)

    def value(self, tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the share of the runs that deplete."""
        from lvnav_trade.metrics.basics.case_tables import CaseTables

        found = _any(CaseTables(tables, case))
        if found is None:
            return MetricValue(remark=UNGUIDED)
        empty = (found.outcome == OUTCOMES[1]).astype(float)
        return MetricValue(monte_carlo=float(empty.mean()), runs=empty, is_root=False, is_share=True)


@dataclass(frozen=True)
class AtCutoff(Metric):
    """The mean over the runs that reach their cut-off of a number there: time or propellant left."""

    field: str = "t"

    average: ClassVar[str] = MEAN

    def value(self, tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the mean over the runs."""
        from lvnav_trade.metrics.basics.case_tables import CaseTables

        scale, found = scale_of(unit, self.unit), _any(CaseTables(tables, case))
        if scale is None or found is None or not found.injected.any():
            return MetricValue(remark=no_fit(unit) if scale is None else UNGUIDED)
        values = getattr(found, self.field)[found.injected] / scale
        return MetricValue(monte_carlo=float(values.mean()), runs=values, is_root=False)


def _may_be_guided(campaign: Any) -> bool:
    """Whether the base is guided, or an axis may change that."""
    guided = getattr(campaign.base.trajectory, "guidance", "nominal") != "nominal"
    paths = [axis.path.removeprefix("base.").split(".") for axis in campaign.axes]
    return guided or any(path in (["trajectory"], ["trajectory", "guidance"]) for path in paths)


def _any(case: CaseResults) -> Injections | None:
    return case.injections("semi_major_axis")


def _error(name: str, unit: str, label: str, factor: float, meaning: str, *quantities: str) -> InjectionError:
    meaning = f"achieved orbit of a guided ascent less its target: {meaning}"
    return InjectionError(f"injection_{name}_error", unit, meaning, quantities or (name,), label, factor)


_DEG = 180.0 / np.pi
METRICS: tuple[Metric, ...] = (
    _error("semi_major_axis", "m", "km", 1e-3, "semi-major axis, osculating"),
    _error("perigee", "m", "km", 1e-3, "height of perigee, osculating"),
    _error("apogee", "m", "km", 1e-3, "height of apogee, osculating"),
    _error(
        "eccentricity_vector",
        "dimensionless",
        "-",
        1.0,
        "eccentricity vector, length of the difference",
        "eccentricity_along_node",
        "eccentricity_ahead_of_node",
    ),
    _error("inclination", "rad", "deg", _DEG, "inclination"),
    _error("node", "rad", "deg", _DEG, "right ascension of the ascending node"),
    Depletion("depletion", "dimensionless", "share of guided ascents whose last stage is empty before its cut-off"),
    AtCutoff("cutoff_time", "s", "time of the last cut-off of guided ascents, since lift-off", "t"),
    AtCutoff("propellant_left", "kg", "propellant left in the last stage of guided ascents", "left"),
)
