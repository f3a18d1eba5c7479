"""Injection accuracy of guided ascents: achieved orbit against target, depletion, propellant, cut-off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from scipy import special

from lvnav_trade.quantities.records import INJECTION, OUTCOMES, Floats, InjectionLaw
from lvnav_trade.results.mechanics.injection_law import (
    APSIDES,
    apsis_errors,
    is_curved,
    scaled_law,
    share_depleted,
    why_no_law,
)
from lvnav_trade.results.metric import (
    BOTH,
    LENGTH,
    MEAN,
    ONE_SIDED,
    TWO_SIDED,
    Metric,
    MetricValue,
    dimension_message,
    scale_of,
)
from lvnav_trade.results.statistics.case_results import Distribution, Gaussian, Injections, Redraw, RunErrors

if TYPE_CHECKING:
    from lvnav_trade.results.statistics.case_results import CaseResults
    from lvnav_trade.results.tables.read import Tables

UNGUIDED = "no ascent is guided: give trajectory.guidance"
_AT_CUTOFF = "a number of the injection"
_PROPELLANT = INJECTION.index("propellant_left")
_GRID = 2**15  # number of equally probable values that represent a distribution


@dataclass(frozen=True)
class _InjectionMetric(Metric):
    """A metric of the injection of each run."""

    named_by: ClassVar[str] = BOTH
    event_only_reason: ClassVar[str] = _AT_CUTOFF
    has_single_value: ClassVar[bool] = True

    @property
    def quantities_of_law(self) -> tuple[str, ...]:
        """Quantities of `records.INJECTION` on which it depends."""
        return ("propellant_left",)

    def missing_in(self, campaign: Any) -> str:
        """Return the reason if a campaign has no guided ascent; empty if it may have one."""
        return "" if _may_be_guided(campaign) else UNGUIDED

    def distribution(self, case: CaseResults, requirement: Mapping[str, Any]) -> Distribution | str:
        """Return its distribution by linear covariance, or the reason why there is none."""
        law = case.injection_law()
        if law is None:
            return UNGUIDED
        reason = why_no_law(law, self.quantities_of_law)
        return reason or self.injection_distribution(law)

    def injection_distribution(self, law: InjectionLaw) -> Distribution:
        """Return its distribution for an injection that linear covariance describes."""
        raise NotImplementedError

    def sampled_distribution(self, size: Floats, unit: str, label_unit: str, label_factor: float) -> Distribution:
        """Return the distribution of equally probable magnitudes (n,).

        Parameters
        ----------
        size : (n,) array
            Magnitudes, SI, in any order.
        unit, label_unit : str
            SI unit and display unit.
        label_factor : float
            Factor from SI to the display unit.
        """
        empty_gaussian = Gaussian(np.empty(0), np.empty((0, 0)), {})
        return Distribution(empty_gaussian, unit, label_unit, label_factor, "injection", sample=np.sort(size))


@dataclass(frozen=True)
class InjectionError(_InjectionMetric):
    """Achieved orbit less target; for several quantities the norm of the difference.

    quantities : Quantities of the orbit, as in `records.ORBIT`.
    label_unit : Display unit.
    label_factor : Factor from SI to the display unit.
    """

    quantities: tuple[str, ...] = ()
    label_unit: str = "m"
    label_factor: float = 1.0

    @property
    def quantities_of_law(self) -> tuple[str, ...]:
        """Quantities of the orbit."""
        return self.quantities

    @property
    def bound_type(self) -> str:
        """Kind of bound: the norm of a vector, or a signed number."""
        return LENGTH if len(self.quantities) > 1 else TWO_SIDED

    def errors(self, case: CaseResults, requirement: Mapping[str, Any]) -> RunErrors | None:
        """Return the magnitude of every run; infinite if a run does not reach its cut-off."""
        size = self._run_sizes(case)
        if size is None:
            return None
        return RunErrors(size, self.unit, self.label_unit, self.label_factor)

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the root mean square over the runs."""
        from lvnav_trade.results.statistics.case_tables import CaseTables

        scale = scale_of(unit, self.unit)
        results = CaseTables(tables, case)
        size = self._run_sizes(results)
        law = results.injection_law()
        if scale is None:
            return MetricValue(remark=dimension_message(unit))
        if size is None and law is None:
            return MetricValue(remark=UNGUIDED)
        true = np.nan
        reason = ""
        if law is not None:
            reason = why_no_law(law, self.quantities_of_law)
            if not reason:
                true = self._root_mean_square(law) / scale
        if size is None:
            return MetricValue(true=true, remark=reason)
        squares = (size / scale) ** 2
        return MetricValue(true=true, monte_carlo=float(np.sqrt(np.mean(squares))), runs=squares)

    def injection_distribution(self, law: InjectionLaw) -> Distribution:
        """Return its Gaussian with the contribution of each source.

        Near a circular orbit, perigee and apogee are distributed as draws through the exact relation.
        """
        if self._is_sampled(law):

            def sample(sources: Sequence[str], factor: float) -> Floats:
                """Return sorted magnitudes with the sigmas of sources multiplied by a factor."""
                sample_law = scaled_law(law, sources, factor)
                return np.sort(np.abs(apsis_errors(sample_law, self.quantities[0])))

            distribution = self.sampled_distribution(sample((), 1.0), self.unit, self.label_unit, self.label_factor)
            return distribution._replace(redraw=Redraw(law.sources, sample))
        k = np.array([INJECTION.index(name) for name in self.quantities])
        source_covariances = law.covariance[:, k][:, :, k]
        gaussian = Gaussian(
            mean=law.mean[k],
            covariance=source_covariances.sum(axis=0),
            sources=dict(zip(law.sources, source_covariances, strict=True)),
        )
        return Distribution(gaussian, self.unit, self.label_unit, self.label_factor, "injection")

    def _is_sampled(self, law: InjectionLaw) -> bool:
        return self.quantities[0] in APSIDES and is_curved(law, self.quantities[0])

    def _root_mean_square(self, law: InjectionLaw) -> float:
        if self._is_sampled(law):
            return float(np.sqrt(np.mean(apsis_errors(law, self.quantities[0]) ** 2)))
        gaussian = self.injection_distribution(law).law
        return float(np.sqrt(np.trace(gaussian.covariance) + gaussian.mean @ gaussian.mean))

    def _run_sizes(self, case: CaseResults) -> Floats | None:
        """Return the magnitude (n_run,) of every run, infinite without injection; None if it is not stored."""
        injections: list[Injections] = []
        for quantity in self.quantities:
            runs = case.injections(quantity)
            if runs is None:
                return None
            injections.append(runs)
        size = np.sqrt(np.sum([runs.error**2 for runs in injections], axis=0))
        return np.where(injections[0].is_injected & np.isfinite(size), size, np.inf)


@dataclass(frozen=True)
class Depletion(_InjectionMetric):
    """1 for a run whose last stage is empty before its cut-off, 0 for a run that reaches it.

    A run that ends otherwise has no injection, and counts as infinite in a requirement.
    """

    average: ClassVar[str] = MEAN

    @property
    def bound_type(self) -> str:
        """Kind of bound: a number without sign."""
        return ONE_SIDED

    def errors(self, case: CaseResults, requirement: Mapping[str, Any]) -> RunErrors | None:
        """Return zero or one for every run, so that the limit of a requirement is one half."""
        runs = _run_ends(case)
        if runs is None:
            return None
        is_depleted = runs.outcome == OUTCOMES[1]
        size = np.where(runs.is_injected, 0.0, np.where(is_depleted, 1.0, np.inf))
        return RunErrors(size, self.unit, "%", 100.0)

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the share of runs that deplete, and its expectation by linear covariance."""
        from lvnav_trade.results.statistics.case_tables import CaseTables

        results = CaseTables(tables, case)
        runs = _run_ends(results)
        law = results.injection_law()
        if runs is None and law is None:
            return MetricValue(remark=UNGUIDED)
        true = np.nan
        reason = ""
        if law is not None:
            reason = why_no_law(law, self.quantities_of_law)
            if not reason:
                true = share_depleted(law)
        if runs is None:
            return MetricValue(true=true, remark=reason, is_root=False, is_share=True)
        is_depleted = (runs.outcome == OUTCOMES[1]).astype(float)
        return MetricValue(
            true=true,
            monte_carlo=float(is_depleted.mean()),
            runs=is_depleted,
            is_root=False,
            is_share=True,
        )

    def injection_distribution(self, law: InjectionLaw) -> Distribution:
        """Return zeros and ones in the proportion of empty stages by linear covariance."""
        size = np.zeros(_GRID)
        n_depleted = round(share_depleted(law) * _GRID)
        size[:n_depleted] = 1.0
        return self.sampled_distribution(size, self.unit, "%", 100.0)


@dataclass(frozen=True)
class ExtraPropellant(_InjectionMetric):
    """Propellant burnt in addition to the reference flight.

    Zero for a flight that burns less; infinite if the stage is empty before the cut-off.
    """

    average: ClassVar[str] = MEAN

    @property
    def bound_type(self) -> str:
        """Kind of bound: a number without sign."""
        return ONE_SIDED

    def errors(self, case: CaseResults, requirement: Mapping[str, Any]) -> RunErrors | None:
        """Return the additional propellant (kg) of every run."""
        runs = _run_ends(case)
        law = case.injection_law()
        if runs is None or law is None or law.reason:
            return None
        extra = np.maximum(0.0, law.reference[_PROPELLANT] - runs.remaining_propellant)
        size = np.where(runs.is_injected & np.isfinite(extra), extra, np.inf)
        return RunErrors(size, self.unit, "kg", 1.0)

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the mean over the runs, and that of linear covariance."""
        from lvnav_trade.results.statistics.case_tables import CaseTables

        scale = scale_of(unit, self.unit)
        results = CaseTables(tables, case)
        law = results.injection_law()
        run_errors = self.errors(results, statement)
        if scale is None:
            return MetricValue(remark=dimension_message(unit))
        if law is None:
            return MetricValue(remark=UNGUIDED)
        reason = why_no_law(law, self.quantities_of_law)
        if reason:
            true = np.nan
        else:
            true = float(np.mean(self._law_sizes(law))) / scale
        if run_errors is None:
            return MetricValue(true=true, remark=reason, is_root=False)
        extra = run_errors.magnitude / scale
        return MetricValue(true=true, monte_carlo=float(extra.mean()), runs=extra, is_root=False)

    def injection_distribution(self, law: InjectionLaw) -> Distribution:
        """Return the Gaussian of the additional propellant, censored at zero."""
        return self.sampled_distribution(self._law_sizes(law), self.unit, "kg", 1.0)

    def _law_sizes(self, law: InjectionLaw) -> Floats:
        """Return equally probable values (n,) of the additional propellant (kg) by linear covariance."""
        probability = (np.arange(_GRID) + 0.5) / _GRID
        sigma = np.sqrt(law.covariance[:, _PROPELLANT, _PROPELLANT].sum())
        deviation = sigma * special.ndtri(probability)
        return np.maximum(0.0, law.reference[_PROPELLANT] - law.mean[_PROPELLANT] + deviation)


@dataclass(frozen=True)
class AtCutoff(Metric):
    """Mean of cut-off time or residual propellant over the runs that reach their cut-off.

    field : Field of `Injections`: t, or remaining_propellant.
    """

    field: str = "t"

    average: ClassVar[str] = MEAN

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the mean over the runs, and that of linear covariance."""
        from lvnav_trade.results.statistics.case_tables import CaseTables

        scale = scale_of(unit, self.unit)
        results = CaseTables(tables, case)
        runs = _run_ends(results)
        law = results.injection_law()
        if scale is None:
            return MetricValue(remark=dimension_message(unit))
        if runs is None and law is None:
            return MetricValue(remark=UNGUIDED)
        true = np.nan
        reason = ""
        if law is not None:
            reason = why_no_law(law, (self.name,))
            if not reason:
                true = float(law.mean[INJECTION.index(self.name)]) / scale
        if runs is None or not runs.is_injected.any():
            return MetricValue(true=true, remark=reason, is_root=False)
        values = getattr(runs, self.field)[runs.is_injected] / scale
        return MetricValue(true=true, monte_carlo=float(values.mean()), runs=values, is_root=False)


def _may_be_guided(campaign: Any) -> bool:
    """Whether the base is guided, or an axis may change that."""
    if getattr(campaign.base.trajectory, "guidance", "nominal") != "nominal":
        return True
    paths = [axis.path.removeprefix("base.") for axis in campaign.axes]
    return "trajectory" in paths or "trajectory.guidance" in paths


def _run_ends(case: CaseResults) -> Injections | None:
    """Return how and when the runs end, which is stored with every orbital quantity; None if it is not stored."""
    return case.injections("semi_major_axis")


def _error(name: str, unit: str, label: str, factor: float, meaning: str, *quantities: str) -> InjectionError:
    meaning = f"achieved minus target orbit of a guided ascent: {meaning}"
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
    Depletion("depletion", "dimensionless", "fraction of guided ascents whose last stage is empty before cut-off"),
    ExtraPropellant("extra_propellant", "kg", "propellant burnt by guided ascents beyond the reference flight"),
    AtCutoff("cutoff_time", "s", "time of the last cut-off of guided ascents, since lift-off", "t"),
    AtCutoff("propellant_left", "kg", "propellant left in the last stage of guided ascents", "remaining_propellant"),
)
