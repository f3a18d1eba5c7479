"""Time after which an error stays below a limit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from lvnav_trade.results.metric import MEDIAN, NAVIGATION_UNITS, Metric, MetricValue, scale_of

if TYPE_CHECKING:
    from lvnav_trade.results.tables.read import Tables


@dataclass(frozen=True)
class ConvergenceTime(Metric):
    """Time from the start of a phase after which the 3-D error of a run stays below a limit; the median over the runs.

    It is evaluated at the events of the phase. A run that never converges, or that fails, counts with the length of the
    phase.

    quantity : Quantity of the error.
    """

    quantity: str = ""

    average: ClassVar[str] = MEDIAN
    limit_by_sigma: ClassVar[bool] = True

    @property
    def limit_unit(self) -> str:
        """SI unit of the error."""
        return NAVIGATION_UNITS[self.quantity]

    def faults(self, statement: Any) -> Iterator[str]:
        """Yield input errors: the metric needs a phase and a limit."""
        if statement.during is None or statement.statistic != "rms" or statement.below is None:
            yield f"{self.name} is of a phase and a limit; give during and below, and no statistic"

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the median over the runs; for a limit by another case's sigma, also the time by linear covariance."""
        from lvnav_trade.results.evaluation.convergence import convergence
        from lvnav_trade.results.statistics.select import cases_of

        reference = ""  # case whose sigma is the limit; empty for a fixed limit
        result = None
        if statement.get("sigma_of") is None:
            result = convergence(tables, case, statement, reference)
        else:
            references = cases_of(tables, {**tables.levels[case], **statement["sigma_of"]})
            if references:
                reference = references[0]
                result = convergence(tables, case, statement, reference)
        if result is None:
            return MetricValue(remark="no runs, or no events in this phase")
        scale = scale_of(unit, self.unit) or np.nan
        median = float(np.median(result.times))
        limit_remark = ", half the runs are below the limit throughout" if median == 0.0 else ""
        return MetricValue(
            true=result.lincov_time / scale if reference else np.nan,
            monte_carlo=median / scale,
            remark=f"median, at {result.n_event} events{limit_remark}",
        )


METRICS = tuple(
    ConvergenceTime(
        f"{quantity}_convergence_time", "s", f"time until the error of {quantity} stays below a limit", quantity
    )
    for quantity in NAVIGATION_UNITS
)
