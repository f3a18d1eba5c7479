"""Normalised estimation error squared of three axes, per degree of freedom."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from lvnav_trade.results.metric import MEAN, NAVIGATION_UNITS, Metric, MetricValue

if TYPE_CHECKING:
    from lvnav_trade.results.tables.read import Tables


@dataclass(frozen=True)
class Nees(Metric):
    """e' P^-1 e / 3, averaged over the events of a phase; P is the formal covariance of the nominal flight.

    quantity : Quantity of the error e (3,).
    """

    quantity: str = ""

    average: ClassVar[str] = MEAN

    def faults(self, statement: Any) -> Iterator[str]:
        """Yield input errors: the metric needs a phase."""
        if statement.during is None or statement.statistic != "rms":
            yield f"{self.name} is a mean over a phase; give during, and no statistic"

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the NEES per axis: one by definition (formal), by linear covariance, and as the mean over the runs."""
        from lvnav_trade.results.statistics.case_results import SAME_TIME
        from lvnav_trade.results.statistics.case_tables import CaseTables
        from lvnav_trade.results.statistics.select import phase

        results = CaseTables(tables, case)
        first, last = phase(tables, case, str(statement["during"]))
        expected_nees = []
        squares = []
        for event, t in results.events().items():
            if not first - SAME_TIME <= t <= last + SAME_TIME:
                continue
            formal = results.formal(event, self.quantity)
            true = results.gaussian(event, self.quantity, "3d")
            if formal is None or true is None or not np.all(np.linalg.eigvalsh(formal) > 0.0):
                continue
            weight = np.linalg.inv(formal) / len(formal)
            # E[e' W e] = trace(W E[e e'])
            second_moment = true.covariance + np.outer(true.mean, true.mean)
            expected_nees.append(float(np.trace(weight @ second_moment)))
            errors = results.errors(event, self.quantity)
            event_squares = np.einsum("ri,ij,rj->r", errors, weight, errors)
            squares.append(np.where(results.has_failed(event), np.inf, event_squares))
        if not expected_nees:
            return MetricValue(remark="no event with a covariance in this phase")
        run_means = np.mean(squares, axis=0)
        return MetricValue(
            formal=1.0,
            true=float(np.mean(expected_nees)),
            monte_carlo=float(np.mean(run_means)) if len(run_means) else np.nan,
            remark=f"at {len(expected_nees)} events",
            runs=run_means,
            is_root=False,
        )


METRICS = tuple(
    Nees(f"{quantity}_nees", "-", f"normalised error squared of {quantity}, per degree of freedom", quantity)
    for quantity in NAVIGATION_UNITS
)
