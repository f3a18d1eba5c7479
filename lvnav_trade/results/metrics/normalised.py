"""Errors normalised by the filter's own sigmas, for requirements on the consistency of its covariance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.metric import (
    LENGTH,
    MISSING,
    NAVIGATION_UNITS,
    NO_LAW,
    REQUIREMENTS,
    Metric,
    MetricValue,
    event_of,
)
from lvnav_trade.results.statistics.case_results import Distribution, Gaussian, RunErrors

if TYPE_CHECKING:
    from lvnav_trade.results.statistics.case_results import CaseResults
    from lvnav_trade.results.tables.read import Tables

SIGMAS = "sigma"


@dataclass(frozen=True)
class NormalisedError(Metric):
    """The root of the NEES per axis, sqrt(e' P^-1 e / 3): 1 on average for a consistent filter.

    e (3,) is the error of a run. P (3, 3) is the formal covariance of the nominal run. Both are in the reporting axes.

    quantity : Quantity of the error: attitude, velocity or position.
    """

    quantity: str = ""

    named_by: ClassVar[str] = REQUIREMENTS
    event_only_reason: ClassVar[str] = "compared with the filter's covariance"

    @property
    def bound_type(self) -> str:
        """Kind of bound: a norm, in units of the filter's sigma."""
        return LENGTH

    @property
    def has_history(self) -> bool:
        """Whether it is available between events; the covariance between the axes of attitude is not."""
        return self.quantity != "attitude"

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the root mean square at an event; it is 1 by the formal covariance."""
        from lvnav_trade.results.statistics.case_tables import CaseTables

        results = CaseTables(tables, case)
        errors = self.errors(results, statement)
        distribution = self.distribution(results, statement)
        if errors is None or isinstance(distribution, str):
            return MetricValue(remark=MISSING)
        gaussian = distribution.law
        squares = errors.magnitude**2
        return MetricValue(
            formal=1.0,
            true=float(np.sqrt(np.trace(gaussian.covariance) + gaussian.mean @ gaussian.mean)),
            monte_carlo=float(np.sqrt(squares.mean())) if len(squares) else np.nan,
            runs=squares,
        )

    def errors(self, case: CaseResults, requirement: Mapping[str, Any]) -> RunErrors | None:
        """Return the normalised error of every run; None if error or P is not available, or P is singular."""
        event = event_of(requirement)
        P = case.formal(event, self.quantity)
        W = whitening(P)
        errors = case.errors(event, self.quantity)
        if W is None or errors.shape[1] != len(W):
            return None
        size = np.linalg.norm(errors @ W.T, axis=1)
        is_infinite = case.has_failed(event) | ~np.isfinite(size)
        size = np.where(is_infinite, np.inf, size)
        return RunErrors(size, SIGMAS, SIGMAS, 1.0)

    def distribution(self, case: CaseResults, requirement: Mapping[str, Any]) -> Distribution | str:
        """Return the Gaussian of the three components whose norm is the error."""
        event = event_of(requirement)
        W = whitening(case.formal(event, self.quantity))
        law = case.gaussian(event, self.quantity, "3d")
        if W is None or law is None:
            return NO_LAW
        gaussian = Gaussian(
            mean=W @ law.mean,
            covariance=W @ law.covariance @ W.T,
            sources={name: W @ covariance @ W.T for name, covariance in law.sources.items()},
        )
        return Distribution(gaussian, SIGMAS, SIGMAS, 1.0, event)


def whitening(formal_covariance: Floats | None) -> Floats | None:
    """Return the matrix that normalises an error.

    Parameters
    ----------
    formal_covariance : (3, 3) array or None
        Formal covariance P.

    Returns
    -------
    (3, 3) array or None
        W with W' W = P^-1 / 3; None if P is not available or singular.
    """
    if formal_covariance is None or not np.isfinite(formal_covariance).all():
        return None
    try:
        factor = np.linalg.cholesky(formal_covariance)
    except np.linalg.LinAlgError:
        return None
    return np.asarray(np.linalg.inv(factor) / np.sqrt(len(formal_covariance)))


METRICS = tuple(
    NormalisedError(
        f"normalised_{quantity}_error",
        SIGMAS,
        f"{quantity} error in the filter's own sigmas: root of its NEES per axis, 1 on average if consistent",
        quantity,
    )
    for quantity in NAVIGATION_UNITS
)
