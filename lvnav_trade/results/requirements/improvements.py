"""Verdicts by linear covariance on requirements, and the improvement of an error source that would meet them."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import optimize

from lvnav_trade.results.evaluate import statement_metric
from lvnav_trade.results.evaluation.covariances import why_not_applicable
from lvnav_trade.results.requirements.requirements import verdicts
from lvnav_trade.results.statistics.case_results import CaseResults, Distribution, parse_number
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.statistics.probability import norm_probability, norm_quantile
from lvnav_trade.results.statistics.select import cache_result
from lvnav_trade.results.tables.read import Tables

ABOVE_ONLY = "the worst of a phase: linear covariance bounds its probability from above only"
EXPECTED = [
    "requirement",
    "case",
    "verdict",
    "probability",
    "expected_probability",
    "estimate",
    "limit",
    "unit",
    "reason",
]
IMPROVEMENTS = ["requirement", "case", "verdict", "source", "factor_ratio", "share_ratio", "remark"]
# Smallest factor on a sigma that is advised: a sensor twenty times better is not realistic
LEAST = 0.05


class RequirementCase(NamedTuple):
    """A requirement in one case, by linear covariance.

    distribution : Distribution of its metric.
    bound : Bound on the metric, SI.
    probability : Required probability of keeping the bound.
    """

    distribution: Distribution
    bound: float
    probability: float

    @property
    def unit(self) -> str:
        """Display unit."""
        return self.distribution.label_unit

    @property
    def factor(self) -> float:
        """Factor from SI to the display unit."""
        return self.distribution.label_factor

    @property
    def has_sources(self) -> bool:
        """Whether the effect of the error sources on the metric is known."""
        return bool(self.distribution.law.sources) or self.distribution.redraw is not None

    def quantile(self, probability: float) -> float:
        """Return the quantile (SI) of the magnitude of the metric at a probability."""
        if self.distribution.sample is not None:
            return float(np.quantile(self.distribution.sample, probability))
        return norm_quantile(self.distribution.law.mean, self.distribution.law.covariance, probability)

    def success_probability(self, sources: tuple[str, ...] = (), factor: float = 1.0) -> float:
        """Return the probability of keeping the bound, with the sigmas of sources scaled by a factor and gains frozen.

        Parameters
        ----------
        sources : tuple of str
            Names of the error sources to scale.
        factor : float
            Factor of their sigmas.

        Notes
        -----
        The covariance is linear in the variances of the sources: P + (factor^2 - 1) sum_s P_s.
        """
        sample = self.distribution.sample
        redraw = self.distribution.redraw
        if sample is not None:
            if redraw is not None and sources:
                sample = redraw.sample(sources, factor)
            n_within = np.searchsorted(sample, self.bound)
            return float(n_within / sample.size)
        law = self.distribution.law
        covariances = [law.sources[name] for name in sources]
        source_covariance = np.sum(covariances, axis=0)
        covariance = law.covariance + (factor**2 - 1.0) * source_covariance
        return norm_probability(law.mean, covariance, self.bound)

    def share(self, sources: tuple[str, ...]) -> float:
        """Return the share of error sources in the mean square.

        For a metric that is not Gaussian it is the part of the mean square that disappears without these sources.
        """
        sample = self.distribution.sample
        redraw = self.distribution.redraw
        if sample is not None and redraw is not None:
            without_sources = redraw.sample(sources, 0.0)
            remaining_share = np.mean(without_sources**2) / np.mean(sample**2)
            return 1.0 - float(remaining_share)
        law = self.distribution.law
        source_variance = sum(float(np.trace(law.sources[name])) for name in sources)
        mean_square = float(np.trace(law.covariance) + law.mean @ law.mean)
        return source_variance / mean_square

    def shares(self) -> dict[str, float]:
        """Return the share of each error source in the mean square."""
        redraw = self.distribution.redraw
        if redraw is None:
            names = tuple(self.distribution.law.sources)
        else:
            names = redraw.sources
        return {name: self.share((name,)) for name in names}


def evaluate_stored_requirement(tables: Tables, requirement: Mapping[str, Any], case: str) -> RequirementCase | str:
    """Evaluate a requirement in a case by linear covariance.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    requirement : mapping
        The requirement, as in the campaign.
    case : str
        Digest of the case.

    Returns
    -------
    RequirementCase or str
        Distribution, bound (SI) and required probability, or the reason why linear covariance does not give them.
    """
    return evaluate_requirement(CaseTables(tables, case), requirement)


def evaluate_requirement(case: CaseResults, requirement: Mapping[str, Any]) -> RequirementCase | str:
    """Evaluate a requirement in a case, as `evaluate_stored_requirement`; the results of the case need not be stored.

    Parameters
    ----------
    case : CaseResults
        Results of the case.
    requirement : mapping
        The requirement, as in the campaign.
    """
    law = statement_metric(requirement).distribution(case, requirement)
    if isinstance(law, str):
        return law
    return RequirementCase(law, parse_number(requirement["below"], law.unit), float(requirement["probability"]))


@cache_result
def lincov_verdicts(tables: Tables) -> pd.DataFrame:
    """Return the verdict by linear covariance on every requirement in every case.

    expected_probability: probability that the error, Gaussian with mean and covariance of linear covariance, is below
    the bound (exact, see `norm_probability`). verdict: "met" or "violated" by this probability; "not applicable", with
    the reason, for example if a gate rejects too many good measurements. estimate: P-quantile of the error with the
    required probability P, in `unit`.

    For a phase, the probability is that at its worst time. It is an upper limit of the probability for the whole phase,
    and can therefore show a violation only.
    """
    rows = [
        _expected_row(tables, requirement, case, requirement_case)
        for requirement, case, requirement_case in _requirement_cases(tables)
    ]
    return pd.DataFrame(rows, columns=EXPECTED)


def _expected_row(
    tables: Tables, requirement: Mapping[str, Any], case: str, requirement_case: RequirementCase | str
) -> dict[str, Any]:
    row = {
        "requirement": requirement["name"],
        "case": tables.labels[case],
        "probability": float(requirement["probability"]),
    }
    if isinstance(requirement_case, str):
        return row | {"verdict": "not applicable", "reason": requirement_case}
    probability = requirement_case.success_probability()
    verdict = "met" if probability >= requirement_case.probability else "violated"
    distribution = requirement_case.distribution
    reason = why_not_applicable(tables, case)
    is_applicable = not reason
    if distribution.is_upper_limit:
        reason = reason or (f"already at {distribution.event_or_time}" if verdict == "violated" else ABOVE_ONLY)
        is_applicable &= verdict == "violated"
    return row | {
        "verdict": verdict if is_applicable else "not applicable",
        "reason": reason,
        "expected_probability": probability,
        "estimate": requirement_case.quantile(requirement_case.probability) * requirement_case.factor,
        "limit": requirement_case.bound * requirement_case.factor,
        "unit": requirement_case.unit,
    }


def improvements(tables: Tables) -> pd.DataFrame:
    """Return the improvement of error sources that would meet each violated or undecided requirement.

    source: the single error source that needs the smallest improvement, or else the smallest number of the largest
    sources together. factor_ratio: required factor on its sigma; share_ratio: its present share of the mean square.
    remark: says that no improvement is needed, or that none is sufficient.

    The factor is found by bisection of the probability that the Gaussian error is below the bound, with frozen gains. A
    filter re-tuned to the better source may perform better or, if it neglects other errors, worse.
    """
    run_verdicts = verdicts(tables).set_index(["requirement", "case"]).verdict
    rows = []
    for requirement, case, requirement_case in _requirement_cases(tables):
        if isinstance(requirement_case, str) or not requirement_case.has_sources:
            continue
        name = requirement["name"]
        label = tables.labels[case]
        verdict = str(run_verdicts[name, label])
        if verdict in ("violated", "undecided") and not why_not_applicable(tables, case):
            improvement = _improvement(requirement_case)
            row = {
                "requirement": name,
                "case": label,
                "verdict": verdict,
                "source": improvement.source,
                "factor_ratio": improvement.factor,
                "share_ratio": improvement.share,
                "remark": improvement.remark,
            }
            rows.append(row)
    return pd.DataFrame(rows, columns=IMPROVEMENTS)


@cache_result
def _requirement_cases(tables: Tables) -> list[tuple[dict[str, Any], str, RequirementCase | str]]:
    """Return every requirement with every case (digest): by linear covariance, or the reason why not."""
    pairs = []
    for requirement in tables.campaign.get("requirements") or ():
        for case in tables.labels:
            pairs.append((requirement, case, evaluate_stored_requirement(tables, requirement, case)))
    return pairs


class _Improvement(NamedTuple):
    """Improvement of error sources that meets a requirement."""

    source: str  # names of the sources; empty if none is sufficient or needed
    factor: float  # required factor on their sigmas
    share: float  # their share of the mean square
    remark: str


def _required_factor(requirement_case: RequirementCase, names: tuple[str, ...]) -> float:
    """Return the largest factor on the sigmas of sources that meets the requirement; NaN if even `LEAST` does not."""

    def excess(factor: float) -> float:
        return requirement_case.success_probability(names, factor) - requirement_case.probability

    if not excess(LEAST) >= 0.0:
        return float("nan")
    return float(optimize.bisect(excess, LEAST, 1.0, xtol=1e-4))


def _improvement(requirement_case: RequirementCase) -> _Improvement:
    distribution = requirement_case.distribution
    if requirement_case.success_probability() >= requirement_case.probability:
        remark = ABOVE_ONLY if distribution.is_upper_limit else "linear covariance expects it to be met as it is"
        return _Improvement("", np.nan, np.nan, remark)
    improvement = _smallest_improvement(requirement_case)
    if not distribution.is_upper_limit:
        return improvement
    remark = f"to keep it at {distribution.event_or_time}; the whole phase may take more"
    return improvement._replace(remark="; ".join(filter(None, [improvement.remark, remark])))


def _smallest_improvement(requirement_case: RequirementCase) -> _Improvement:
    """Return the improvement for a violated requirement: of a single source, or of the fewest of the largest."""
    shares = requirement_case.shares()
    sorted_sources = sorted(shares, key=lambda name: -shares[name])
    sufficient = []  # single sources with their factors
    for name in sorted_sources:
        factor = _required_factor(requirement_case, (name,))
        if not np.isnan(factor):
            sufficient.append((factor, name))
    if sufficient:
        factor, name = max(sufficient)
        return _Improvement(name, factor, shares[name], "")
    for n in range(1, len(sorted_sources) + 1):
        names = tuple(sorted_sources[:n])
        factor = _required_factor(requirement_case, names)
        if not np.isnan(factor):
            return _Improvement(", ".join(names), factor, requirement_case.share(names), "together")
    remark = f"not even all error sources together, each times {LEAST:g}, would do"
    return _Improvement("", float("nan"), float("nan"), remark)
