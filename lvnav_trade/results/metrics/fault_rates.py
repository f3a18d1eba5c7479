"""Shares of runs by outcome of a filter's fault tests in a phase."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from lvnav_trade.results.metric import MEAN, Metric, MetricValue

if TYPE_CHECKING:
    from lvnav_trade.results.tables.read import Tables


@dataclass(frozen=True)
class FaultRate(Metric):
    """Share of runs with an outcome of the fault tests; linear covariance decides once, for the mean."""

    average: ClassVar[str] = MEAN

    def faults(self, statement: Any) -> Iterator[str]:
        """Yield input errors: the metric needs a phase."""
        if statement.during is None or statement.statistic != "rms":
            yield f"{self.name} is of a phase; give during, and no statistic"

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the share of runs with the outcome, and the decision by linear covariance."""
        from lvnav_trade.results.evaluation.integrity import rate
        from lvnav_trade.results.statistics.select import phase, pick

        if pick(tables.runs, case=case).empty:
            return MetricValue(remark="no runs")
        start_end = phase(tables, case, str(statement["during"]))
        outcomes, nominal = rate(tables, case, self.name, start_end)
        return MetricValue(
            true=nominal,
            monte_carlo=float(outcomes.mean()),
            runs=outcomes,
            is_root=False,
            is_share=True,
        )


METRICS = (
    FaultRate("false_alarm_rate", "-", "fraction of runs without a fault in which a fault is reported"),
    FaultRate("detection_rate", "-", "fraction of runs in which a fault is detected"),
    FaultRate("isolation_rate", "-", "fraction of runs in which the faulty channel is isolated"),
    FaultRate("wrong_isolation_rate", "-", "fraction of runs in which another channel is isolated"),
)
