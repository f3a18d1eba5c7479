"""Errors of the filter's states: attitude, velocity, position, and every other state that a filter can estimate."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from lvnav_trade.quantities.state_layout import AXES, BACKUP, EXTRAS, MOTION, PARAMETERS, split_metric
from lvnav_trade.results.metric import (
    BOTH,
    LENGTH,
    MISSING,
    NAVIGATION_UNITS,
    NO_LAW,
    NOT_IN_FLIGHT,
    TWO_SIDED,
    Metric,
    MetricValue,
    SingleValue,
    dimension_message,
    event_of,
    event_or_phase,
    scale_of,
)
from lvnav_trade.results.statistics.case_results import Distribution, RunErrors, parse_number

if TYPE_CHECKING:
    import pandas as pd

    from lvnav_trade.results.statistics.case_results import CaseResults
    from lvnav_trade.results.tables.read import Tables

NORM = "3d"
_FRAME_AXES = ("north", "east", "down", "x", "y", "z", "radial", "along", "cross")
# Axes of the quantities that a requirement can name
_AXES = {
    f"{prefix}{quantity}": axes
    for prefix in ("", BACKUP)
    for quantity, axes in (("position", _FRAME_AXES), ("velocity", _FRAME_AXES), ("attitude", ("roll", "pitch", "yaw")))
}
_WORDS = {
    "attitude": "attitude, small rotation from estimate to truth",
    "velocity": "velocity over the ground",
    "position": "position",
}
# States of a filter that statements can name; in the list, axis x represents every axis
_STATES = (
    {name: kind.unit for name, kind in PARAMETERS.items()}
    | {name: unit for name, (unit, *_) in EXTRAS.items()}
    | {name: unit for name, unit, *_ in MOTION}
    | {"clock_bias": "m", "clock_drift": "m/s"}
)
# SI unit of every quantity whose error is stored in results
UNITS = (
    NAVIGATION_UNITS
    | {f"{BACKUP}{name}": unit for name, unit in NAVIGATION_UNITS.items()}
    | {"solution_velocity": "m/s", "solution_position": "m", "receiver_clock_bias": "m", "receiver_clock_drift": "m/s"}
    | _STATES
    | {f"{prefix}{name}": unit for prefix in ("raw_", "corrected_") for name, unit, *_ in MOTION}
)
_NAME = re.compile(r"[a-z][a-z_]*_error(_[a-z0-9]+)?")
# Columns of the history with a sigma: with runs, and without
_SIGMAS = {"formal": ("filter_sigma_si", "lincov_formal_si"), "lincov": ("lincov_true_si", "lincov_true_si")}


@dataclass(frozen=True)
class StateError(Metric):
    """Error of a quantity along an axis, or the norm of its three components ("3d").

    quantity : Such as velocity, gyro_bias.
    axis : Axis of the reporting frame, the body or a sensor; 3d for the norm.
    """

    quantity: str = ""
    axis: str = NORM

    @classmethod
    def from_name(cls, name: str, unit: str, meaning: str = "") -> StateError:
        """Return the metric of a name such as ``gyro_bias_error_x``.

        Parameters
        ----------
        name : str
            Name of the metric.
        unit : str
            SI unit; "1" for a number without unit.
        meaning : str
            Meaning, in one phrase.
        """
        return cls(name, "dimensionless" if unit == "1" else unit, meaning, *split_metric(name))

    @property
    def is_signed(self) -> bool:
        """Whether it is an error along one axis."""
        return self.axis != NORM

    @property
    def bound_type(self) -> str:
        """Kind of bound: a norm, or an error along one axis, which is bounded on both sides."""
        return LENGTH if self.axis == NORM else TWO_SIDED

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the root mean square, or the signed mean, at an event or over the time of a phase."""
        if statement.get("statistic") == "worst":
            number = self.single(tables, case, statement, unit)
            if len(number.runs):
                return MetricValue(monte_carlo=number.value, remark=number.remark)
            return MetricValue(true=number.value, remark=number.remark)
        rows, scale, remark = self._history_rows(tables, case, statement, unit)
        if remark:
            return MetricValue(remark=remark)
        if statement.get("statistic") == "mean":
            return self._mean_value(tables, case, statement, rows, scale)
        return self._rms_value(tables, case, statement, rows, scale)

    def _mean_value(
        self,
        tables: Tables,
        case: str,
        statement: Mapping[str, Any],
        rows: pd.DataFrame,
        scale: float,
    ) -> MetricValue:
        """Return the signed mean over the time of history rows."""
        from lvnav_trade.results.statistics.per_run import signed_run_errors
        from lvnav_trade.results.statistics.select import time_mean

        t = rows.t_s.to_numpy()
        run_means = signed_run_errors(tables, case, statement, str(rows.unit.iloc[0])) / scale
        return MetricValue(
            true=time_mean(t, rows.lincov_mean_si.to_numpy(dtype=float)) / scale,
            monte_carlo=time_mean(t, rows.mean_si.to_numpy(dtype=float)) / scale,
            runs=run_means,
            is_root=False,
        )

    def _rms_value(
        self,
        tables: Tables,
        case: str,
        statement: Mapping[str, Any],
        rows: pd.DataFrame,
        scale: float,
    ) -> MetricValue:
        """Return the root mean square over the time of history rows."""
        from lvnav_trade.results.statistics.per_run import run_values
        from lvnav_trade.results.statistics.select import time_mean

        t = rows.t_s.to_numpy()

        def root_mean(square: pd.Series) -> float:
            """Return the root of the mean over time of squares."""
            return float(np.sqrt(time_mean(t, square.to_numpy(dtype=float)))) / scale

        if rows.run_count.iloc[0]:
            run_rms = rows.rms_si
        else:
            run_rms = np.nan * rows.rms_si
        run_roots = run_values(tables, case, statement, str(rows.unit.iloc[0]))
        return MetricValue(
            formal=root_mean(rows.lincov_formal_si**2),
            true=root_mean(rows.lincov_true_si**2 + rows.lincov_mean_si**2),
            monte_carlo=root_mean(run_rms**2),
            runs=(run_roots / scale) ** 2,
        )

    def single(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> SingleValue:
        """Return the number that is compared with a published number.

        It is the root mean square or mean of the runs (of linear covariance without runs), a sigma, or the median over
        the runs of the largest error of each run in a phase.
        """
        statistic = statement.get("statistic", "rms")
        if statistic == "worst":
            return self._median_maximum(tables, case, statement, unit)
        if statistic in _SIGMAS:
            return self._sigma(tables, case, statement, unit)
        number = super().single(tables, case, statement, unit)
        if statistic == "rms" and not number.remark and not self._has_runs(tables, case):
            return number._replace(remark="linear covariance")
        return number

    def _history_rows(
        self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str
    ) -> tuple[pd.DataFrame, float, str]:
        """Return the history at the event or phase of a statement, the SI value of the unit, and the reason if there is
        no history.
        """
        from lvnav_trade.results.statistics.per_run import select_times
        from lvnav_trade.results.statistics.select import history_of

        rows = history_of(tables, case, self.quantity, self.axis)
        if rows.empty:
            return rows, 1.0, MISSING
        scale = scale_of(unit, str(rows.unit.iloc[0]))
        if scale is None:
            return rows, 1.0, dimension_message(unit)
        rows = select_times(tables, case, rows, statement)
        return rows, scale, NOT_IN_FLIGHT if rows.empty else ""

    def _has_runs(self, tables: Tables, case: str) -> bool:
        from lvnav_trade.results.statistics.select import history_of

        return bool(history_of(tables, case, self.quantity, self.axis).run_count.iloc[0])

    def _median_maximum(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> SingleValue:
        """Return the median over the runs of the largest error of each run in a phase."""
        from lvnav_trade.results.statistics.per_run import per_run
        from lvnav_trade.results.statistics.select import history_of
        from lvnav_trade.results.tables.dictionary import error_column

        rows = history_of(tables, case, self.quantity, self.axis)
        if rows.empty:
            return SingleValue(np.nan, MISSING)
        si = str(rows.unit.iloc[0])
        scale = scale_of(unit, si)
        if scale is None:
            return SingleValue(np.nan, dimension_message(unit))
        column = error_column(self.quantity, self.axis, rows.unit.iloc[0])
        largest = per_run(tables, case, statement, column)
        if not len(largest):
            return SingleValue(np.nan, "no runs, or the phase does not begin and end at events")
        return SingleValue(float(np.median(largest)) / scale, "", np.sort(largest) / scale)

    def _sigma(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> SingleValue:
        from lvnav_trade.results.statistics.select import time_mean

        rows, scale, remark = self._history_rows(tables, case, statement, unit)
        statistic = str(statement["statistic"])
        if not remark and statistic == "lincov":
            reason = self._large_attitude_reason(tables, case, statement, unit)
            if reason:
                remark = f"not applicable: {reason}"
        if remark:
            return SingleValue(np.nan, remark)
        has_runs = bool(rows.run_count.iloc[0])
        column_with_runs, column_without_runs = _SIGMAS[statistic]
        sigma = rows[column_with_runs if has_runs else column_without_runs]
        variance = time_mean(rows.t_s.to_numpy(), (sigma**2).to_numpy())
        return SingleValue(float(np.sqrt(variance)) / scale, "" if has_runs else "linear covariance")

    def _large_attitude_reason(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> str:
        """Return the reason why linear covariance cannot be compared with a published attitude: an attitude error is
        large.
        """
        from lvnav_trade.results.evaluation.covariances import (
            LINEAR_ATTITUDE,
            initial_tilt_message,
            large_attitude_message,
        )

        published_attitude = 0.0  # attitude error in rad
        if self.quantity == "attitude":
            published_attitude = float(statement.get("value", 0.0)) * (scale_of(unit, "rad") or 0.0)
        if published_attitude > LINEAR_ATTITUDE:
            return large_attitude_message(published_attitude)
        return initial_tilt_message(tables, case)

    def errors(self, case: CaseResults, requirement: Mapping[str, Any]) -> RunErrors | None:
        """Return |error| of every run at an event, or its largest value in a phase."""
        output = case.output(self.quantity, self.axis)
        if output is None:
            return None
        if requirement.get("during"):
            phase = case.phase(str(requirement["during"]))
            size = case.largest(self.quantity, self.axis, *phase)
        else:
            size = case.sizes(event_of(requirement), self.quantity, self.axis)
        return RunErrors(size, output.unit, output.label_unit, output.label_factor)

    def distribution(self, case: CaseResults, requirement: Mapping[str, Any]) -> Distribution | str:
        """Return the Gaussian at an event, or at the time of a phase with the smallest probability to meet the limit.

        For a phase, the norm needs the covariance of three axes, which is stored at events; the error along one axis is
        evaluated at every time of the history.
        """
        from lvnav_trade.results.statistics.gaussian import worst_time_gaussian

        output = case.output(self.quantity, self.axis)
        if output is None:
            return NO_LAW
        place = event_or_phase(requirement)
        is_phase = bool(requirement.get("during"))
        if is_phase:
            limit = parse_number(requirement["below"], output.unit)
            worst_law = worst_time_gaussian(case, self.quantity, self.axis, place, limit)
            if worst_law is None:
                return NO_LAW
            gaussian, place = worst_law
        else:
            event_gaussian = case.gaussian(place, self.quantity, self.axis)
            if event_gaussian is None:
                return NO_LAW
            gaussian = event_gaussian
        return Distribution(
            gaussian,
            output.unit,
            output.label_unit,
            output.label_factor,
            place,
            is_upper_limit=is_phase,
        )


@dataclass(frozen=True)
class NavigationError(StateError):
    """Error of attitude, velocity or position, of the filter or of a strapdown without corrections."""

    named_by: ClassVar[str] = BOTH

    def missing_in(self, campaign: Any) -> str:
        """Return the reason if the reporting frame of a campaign lacks the axis; empty if it has it."""
        frame_axes = AXES[campaign.base.frame]
        is_attitude = self.quantity.removeprefix(BACKUP) == "attitude"  # its axes are those of the body
        if is_attitude or self.axis in (*frame_axes, NORM):
            return ""
        return f"frame {campaign.base.frame} has the axes {', '.join(frame_axes)}"


def error_named(name: str, unit: str = "") -> StateError | None:
    """Return the metric of an error by its name; None for other names.

    Parameters
    ----------
    name : str
        Name, such as velocity_error_3d.
    unit : str
        SI unit, for a quantity that is not in the list of known quantities.
    """
    if not unit:
        quantity, _ = split_metric(name)
        unit = UNITS.get(quantity, "")
    if not unit or not _NAME.fullmatch(name):
        return None
    return StateError.from_name(name, unit)


def state_metric(quantity: str, unit: str) -> StateError:
    """Return the error of a filter state as the list of metrics shows it, where x represents every axis."""
    meaning = f"estimate of {quantity.replace('_', ' ')}, where it is a state"
    return StateError.from_name(f"{quantity}_error_x", unit, meaning)


def _navigation_error(quantity: str, axis: str) -> NavigationError:
    """Return the error of attitude, velocity or position along an axis, or its norm."""
    plain_quantity = quantity.removeprefix(BACKUP)
    component = "length of the three-axis error" if axis == NORM else f"{axis} component of the error"
    source = " of the uncorrected backup strapdown" if quantity.startswith(BACKUP) else ""
    return NavigationError(
        name=f"{quantity}_error_{axis}",
        unit=NAVIGATION_UNITS[plain_quantity],
        meaning=f"{component} of {_WORDS[plain_quantity]}{source}",
        quantity=quantity,
        axis=axis,
    )


METRICS: tuple[Metric, ...] = (
    *(_navigation_error(quantity, NORM) for quantity in _AXES),
    *(_navigation_error(quantity, axis) for quantity, axes in _AXES.items() for axis in axes),
    *(state_metric(quantity, unit) for quantity, unit in _STATES.items()),
)
