"""Share of runs whose error is within three of the filter's sigmas, or below a limit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from lvnav_trade.results.metric import MEAN, NAVIGATION_UNITS, Metric, MetricValue, event_of

if TYPE_CHECKING:
    from lvnav_trade.results.tables.read import Tables


@dataclass(frozen=True)
class Coverage(Metric):
    """Share of runs whose error is within three sigmas on all three axes at an event, or below a limit.

    quantity : Quantity of the error.
    """

    quantity: str = ""

    average: ClassVar[str] = MEAN

    @property
    def limit_unit(self) -> str:
        """SI unit of the error."""
        return NAVIGATION_UNITS[self.quantity]

    def faults(self, statement: Any) -> Iterator[str]:
        """Yield input errors: the metric needs an event."""
        if statement.at is None or statement.statistic != "rms":
            yield f"{self.name} is of an event; give at, and no statistic"

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the share: formal, by linear covariance and by the runs; for a limit by the runs only."""
        from lvnav_trade.results.evaluation.coverage import coverage_probability, probability_below_limit

        event = event_of(statement)
        limit = statement.get("below")
        if limit is None:
            formal, true, runs = coverage_probability(tables, case, event, self.quantity)
        else:
            formal, true, runs = probability_below_limit(tables, case, event, self.quantity, str(limit))
        return MetricValue(
            formal=formal,
            true=true,
            monte_carlo=float(runs.mean()) if len(runs) else np.nan,
            remark="" if len(runs) else "no runs at that event",
            runs=runs,
            is_root=False,
            is_share=True,
        )

    def label(self, statement: Mapping[str, Any]) -> str:
        """Return the metric, its limit, and the event."""
        limit = f" below {statement['below']}" if statement.get("below") else ""
        return f"{self.name}{limit} at {event_of(statement)}"


METRICS = tuple(
    Coverage(f"{quantity}_coverage", "-", f"fraction of runs with {quantity} within three formal sigmas", quantity)
    for quantity in NAVIGATION_UNITS
)
