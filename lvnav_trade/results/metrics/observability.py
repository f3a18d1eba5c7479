"""Ranks of the observability matrix: numbers of states that the measurements determine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from lvnav_trade.results.metric import MISSING, Metric, MetricValue

if TYPE_CHECKING:
    from lvnav_trade.results.tables.read import Tables


@dataclass(frozen=True)
class Rank(Metric):
    """Smallest rank in any segment of a flight; equal in every run.

    is_information_rank : Whether the rank counts the singular values above the tolerance of the results, rather than
        above rounding errors only.
    """

    is_information_rank: bool = False

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the rank, and the threshold above which a singular value counts."""
        from lvnav_trade.results.evaluation.covariances import NUMERICAL, observability_ranks
        from lvnav_trade.results.statistics.select import pick

        ranks = pick(observability_ranks(tables), case=tables.labels[case])
        if ranks.empty:
            return MetricValue(remark=MISSING)
        row = ranks.iloc[0]
        if not self.is_information_rank:
            remark = f"{row.stretches} stretches, singular values above {NUMERICAL:g} of the largest"
            return MetricValue(true=float(row.least_rank), remark=remark)
        tolerance = float(pick(tables.observability, case=case).tolerance_ratio.iloc[0])
        threshold = f"{row.stretches} stretches, singular values above {tolerance:g}"
        return MetricValue(
            true=float(row.least_rank_with_information),
            remark=f"{threshold}; least informed: {row.weakest_direction}",
        )

    def label(self, statement: Mapping[str, Any]) -> str:
        """Return the label of the metric, which applies to a whole flight."""
        return f"{self.name}, least of all stretches"


METRICS = (
    Rank("observable_states", "-", "smallest number of observable states in any interval"),
    Rank(
        "informed_states",
        "-",
        "smallest number of states with information above the tolerance in any interval",
        is_information_rank=True,
    ),
)
