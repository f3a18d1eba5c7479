"""Protection levels, and the share of a phase in which a level stays below a limit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from lvnav_trade.quantities.state_layout import PROTECTED
from lvnav_trade.quantities.units import parse
from lvnav_trade.results.metric import BOTH, MEDIAN, Metric, MetricValue, dimension_message, event_of, scale_of
from lvnav_trade.results.statistics.case_results import Distribution, RunErrors

if TYPE_CHECKING:
    from lvnav_trade.results.statistics.case_results import CaseResults
    from lvnav_trade.results.tables.read import Tables

_NONE = "no protection levels there"


@dataclass(frozen=True)
class ProtectionLevel(Metric):
    """Bound on an error at the integrity risk of the campaign; equal in every run.

    quantity : Quantity of the error.
    """

    quantity: str = ""

    named_by: ClassVar[str] = BOTH

    def faults(self, statement: Any) -> Iterator[str]:
        """Yield input errors: a statistic over the runs is meaningless."""
        if statement.statistic != "rms":
            yield f"{self.name} is the same in every run; give no statistic"

    def missing_in(self, campaign: Any) -> str:
        """Return the reason if a campaign computes no protection levels; empty if it does."""
        if campaign.covariance.protection is None:
            return "the campaign asks for no protection levels (covariance.protection)"
        return ""

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the level at an event, or its largest value in a phase."""
        from lvnav_trade.results.statistics.case_tables import CaseTables

        scale = scale_of(unit, self.unit)
        if scale is None:
            return MetricValue(remark=dimension_message(unit))
        phase_text = str(statement.get("during") or "")
        level = CaseTables(tables, case).protection_level(self.quantity, event_of(statement), phase_text)
        return MetricValue(true=level / scale, remark="" if np.isfinite(level) else _NONE)

    def errors(self, case: CaseResults, requirement: Mapping[str, Any]) -> RunErrors | None:
        """Return the level as the error of every run: equal in all runs, infinite in a run that failed."""
        phase_text = str(requirement.get("during") or "")
        level = case.protection_level(self.quantity, event_of(requirement), phase_text)
        output = case.output(self.quantity, "3d")
        if not np.isfinite(level) or output is None:
            return None
        size = np.where(case.failed_runs(), np.inf, level)
        return RunErrors(size, self.unit, output.label_unit, output.label_factor)

    def distribution(self, case: CaseResults, requirement: Mapping[str, Any]) -> Distribution | str:
        """Return the reason: a level has no distribution."""
        return "a protection level is the same in every run"


@dataclass(frozen=True)
class Availability(Metric):
    """Share of the time of a phase in which a protection level does not exceed a limit.

    quantity : Quantity of the error.
    """

    quantity: str = ""

    average: ClassVar[str] = MEDIAN

    @property
    def limit_unit(self) -> str:
        """SI unit of the level."""
        return PROTECTED[self.quantity]

    def faults(self, statement: Any) -> Iterator[str]:
        """Yield input errors: the metric needs a phase and a limit."""
        if statement.during is None or statement.statistic != "rms" or statement.below is None:
            yield f"{self.name} is of a phase and a limit; give during and below, and no statistic"

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the share, which is equal in every run."""
        from lvnav_trade.results.evaluation.protection_levels import protection_series
        from lvnav_trade.results.statistics.select import phase, rows_between, time_mean

        rows = protection_series(tables, case, self.quantity)
        if len(rows):
            first, last = phase(tables, case, str(statement["during"]))
            rows = rows_between(rows, first, last)
        if rows.empty:
            return MetricValue(remark=_NONE)
        limit = parse(str(statement["below"]), self.limit_unit)
        is_available = (rows.level_si <= limit).to_numpy(dtype=float)
        return MetricValue(true=time_mean(rows.t_s.to_numpy(), is_available))


METRICS: tuple[Metric, ...] = (
    *(
        ProtectionLevel(
            f"{quantity}_protection_level", unit, f"protection level of {quantity}, the box of three axes", quantity
        )
        for quantity, unit in PROTECTED.items()
    ),
    *(
        Availability(
            f"{quantity}_availability",
            "-",
            f"share of time for which the protection level of {quantity} keeps a limit",
            quantity,
        )
        for quantity in PROTECTED
    ),
)
