"""Metrics of the received signals: satellites, atmospheric delays, reacquisition. They are equal in every run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from lvnav_trade.results.metric import (
    MEDIAN,
    MISSING,
    NOT_IN_FLIGHT,
    Metric,
    MetricValue,
    dimension_message,
    event_of,
    scale_of,
)

if TYPE_CHECKING:
    from lvnav_trade.results.tables.read import Tables

REACQUIRED = "reacquisition_time"


@dataclass(frozen=True)
class SignalNumber(Metric):
    """A number of the signals at an event or in a phase: root mean square, largest or smallest."""

    has_least: ClassVar[bool] = True

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the statistic of the signals as the true value, since all runs have the same signals."""
        from lvnav_trade.results.evaluation.satellite_tracking import signal_values
        from lvnav_trade.results.statistics.per_run import select_times
        from lvnav_trade.results.statistics.select import pick

        scale = 1.0 if self.unit == "-" else scale_of(unit, self.unit)
        if scale is None:
            return MetricValue(remark=dimension_message(unit))
        rows = signal_values(tables, case, self.name, statement.get("elevation"), statement.get("altitude"))
        values = np.empty(0)
        if len(rows):
            rows = select_times(tables, case, rows, statement)
            if len(rows):
                values = rows.value.dropna().to_numpy(dtype=float)
        if not len(values):
            has_signals = len(pick(tables.satellites, case=case)) > 0
            return MetricValue(remark=NOT_IN_FLIGHT if has_signals else MISSING)
        statistic = str(statement.get("statistic", "rms"))
        return MetricValue(true=self.reduce(rows, values, statistic) / scale)

    def reduce(self, rows: Any, value: Any, statistic: str) -> float:
        """Return the requested statistic, SI.

        Parameters
        ----------
        rows : pandas.DataFrame
            Rows of `satellite_tracking.signal_values`.
        value : (n,) array
            Their values.
        statistic : str
            worst, least or rms.
        """
        if statistic == "worst":
            return float(value.max())
        if statistic == "least":
            return float(value.min())
        return float(np.sqrt(np.mean(value**2)))


@dataclass(frozen=True)
class Delay(SignalNumber):
    """A delay of the signals, or its change between epochs; elevation and altitude select signals."""

    selects_signals: ClassVar[bool] = True


@dataclass(frozen=True)
class Count(SignalNumber):
    """Number of tracked satellites."""

    average: ClassVar[str] = MEDIAN


@dataclass(frozen=True)
class Height(SignalNumber):
    """Altitude at which a number is largest."""

    average: ClassVar[str] = MEDIAN

    def reduce(self, rows: Any, value: Any, statistic: str) -> float:
        """Return the altitude (m) at which the value is largest."""
        return float(rows.height[rows.value.idxmax()])


@dataclass(frozen=True)
class DelayHeight(Height):
    """Altitude at which the change of a delay is largest; elevation and altitude select signals."""

    selects_signals: ClassVar[bool] = True


@dataclass(frozen=True)
class ReacquisitionTime(Metric):
    """Time from an event until lost satellites are tracked again; the median over the satellites."""

    average: ClassVar[str] = MEDIAN
    has_least: ClassVar[bool] = True

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the median over the satellites."""
        from lvnav_trade.results.evaluation.satellite_tracking import reacquisition_times

        scale = scale_of(unit, self.unit)
        if scale is None:
            return MetricValue(remark=dimension_message(unit))
        times = reacquisition_times(tables, case, event_of(statement))
        if not len(times):
            return MetricValue(remark=NOT_IN_FLIGHT)
        return MetricValue(true=float(np.median(times)) / scale)


METRICS: tuple[Metric, ...] = (
    Count("satellites_tracked", "-", "satellites that are tracked"),
    Delay("troposphere", "m", "tropospheric delay of the signals"),
    Delay("troposphere_left", "m", "tropospheric delay after the filter's correction"),
    Delay("ionosphere", "m", "ionospheric delay of the signals"),
    Delay("ionosphere_left", "m", "ionospheric delay after the filter's correction"),
    Delay("troposphere_change", "m", "change of the tropospheric delay from an epoch to the next"),
    Delay("troposphere_left_change", "m", "change of the corrected tropospheric delay from an epoch to the next"),
    Delay("ionosphere_change", "m", "change of the ionospheric delay from an epoch to the next"),
    Delay("ionosphere_left_change", "m", "change of the corrected ionospheric delay from an epoch to the next"),
    DelayHeight("troposphere_change_height", "m", "altitude at which the change of the tropospheric delay is largest"),
    Height("air_crossing_height", "m", "altitude at which climb rate times density of the air is largest"),
    ReacquisitionTime(REACQUIRED, "s", "time until lost satellites are tracked again"),
)
