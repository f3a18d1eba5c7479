"""Velocity error along and across the track: along the true velocity, and along the normal of the orbit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.metric import (
    BOTH,
    MISSING,
    NO_LAW,
    TWO_SIDED,
    Metric,
    MetricValue,
    SingleValue,
    dimension_message,
    event_of,
    scale_of,
)
from lvnav_trade.results.statistics.case_results import Distribution, Gaussian, RunErrors, error_magnitudes

if TYPE_CHECKING:
    from lvnav_trade.results.statistics.case_results import CaseResults
    from lvnav_trade.results.tables.read import Tables


@dataclass(frozen=True)
class TrackError(Metric):
    """Velocity error along one direction of the flight at an event, independent of the reporting frame.

    The directions are those of the NTW frame (Vallado, Fundamentals of Astrodynamics, section 3.3.3): T along the true
    inertial velocity v, W along r x v, with r the true position. The error of a run is a linear function of its errors
    in the reporting frame. By linear covariance it is therefore exactly Gaussian, with mean u'm and variance u'Pu.

    is_along : Whether the direction u is T; otherwise W.
    """

    is_along: bool = True

    named_by: ClassVar[str] = BOTH
    event_only_reason: ClassVar[str] = "resolved along the true velocity"

    @property
    def is_signed(self) -> bool:
        """Whether it has a sign: positive if the true velocity is larger along the direction."""
        return True

    @property
    def bound_type(self) -> str:
        """Kind of bound: an error along one direction is bounded on both sides."""
        return TWO_SIDED

    @property
    def has_history(self) -> bool:
        """Whether it is available between events: the directions are stored at events only."""
        return False

    def faults(self, statement: Any) -> Iterator[str]:
        """Yield input errors: the metric needs an event."""
        if statement.at is None:
            yield f"{self.name} is of an event; give at"

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the root mean square, or the signed mean."""
        from lvnav_trade.results.statistics.case_tables import CaseTables

        results = CaseTables(tables, case)
        event = event_of(statement)
        scale = scale_of(unit, self.unit)
        law = self._gaussian(results, event)
        if scale is None:
            return MetricValue(remark=dimension_message(unit))
        if law is None:
            return MetricValue(remark=MISSING)
        signed_errors = self._signed_errors(results, event)
        errors = np.where(results.has_failed(event), np.inf, signed_errors) / scale
        mean = float(law.mean[0]) / scale
        variance = float(law.covariance[0, 0]) / scale**2
        if statement.get("statistic") == "mean":
            return MetricValue(
                true=mean,
                monte_carlo=float(errors.mean()) if len(errors) else np.nan,
                runs=errors,
                is_root=False,
            )

        u = self._direction(results, event)
        formal = results.formal(event, "velocity")
        filter_sigma = np.nan
        if u is not None and formal is not None:
            filter_sigma = float(np.sqrt(u @ formal @ u)) / scale
        return MetricValue(
            formal=filter_sigma,
            true=float(np.sqrt(variance + mean**2)),
            monte_carlo=float(np.sqrt(np.mean(errors**2))) if len(errors) else np.nan,
            runs=errors**2,
        )

    def single(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> SingleValue:
        """Return the value of the runs (of linear covariance without runs), or a sigma."""
        statistic = statement.get("statistic")
        if statistic not in ("formal", "lincov"):
            return super().single(tables, case, statement, unit)
        number = self.value(tables, case, {**statement, "statistic": "rms"}, unit)
        if statistic == "formal":
            return SingleValue(float(number.formal), number.remark)
        mean = self.value(tables, case, {**statement, "statistic": "mean"}, unit).true
        return SingleValue(float(np.sqrt(number.true**2 - mean**2)), number.remark)

    def errors(self, case: CaseResults, requirement: Mapping[str, Any]) -> RunErrors | None:
        """Return the magnitude of the error of every run; None if the true state at the event is not stored."""
        event = event_of(requirement)
        if self._direction(case, event) is None:
            return None
        size = error_magnitudes(self._signed_errors(case, event), case.has_failed(event))
        return RunErrors(size, self.unit, self.unit, 1.0)

    def distribution(self, case: CaseResults, requirement: Mapping[str, Any]) -> Distribution | str:
        """Return the Gaussian of the error, with the contribution of each source."""
        event = event_of(requirement)
        gaussian = self._gaussian(case, event)
        if gaussian is None:
            return NO_LAW
        return Distribution(gaussian, self.unit, self.unit, 1.0, event)

    def _direction(self, case: CaseResults, event: str) -> Floats | None:
        """Return the direction u (3,) in the reporting axes; None if the true state is not stored."""
        state = case.state(event)
        if state is None or len(case.axes("velocity")) != len(state.v_i):
            return None
        if self.is_along:
            direction_i = state.v_i
        else:
            direction_i = np.cross(state.r_i, state.v_i)
        return np.asarray(state.turn.T @ (direction_i / np.linalg.norm(direction_i)))

    def _signed_errors(self, case: CaseResults, event: str) -> Floats:
        """Return the signed errors (n_run,), failed runs included."""
        u = self._direction(case, event)
        if u is None:
            return np.empty(0)
        return np.asarray(case.errors(event, "velocity") @ u)

    def _gaussian(self, case: CaseResults, event: str) -> Gaussian | None:
        """Return the Gaussian with mean u'm and variance u'Pu; None if it is not available."""
        u = self._direction(case, event)
        law = case.gaussian(event, "velocity", "3d")
        if u is None or law is None:
            return None
        return Gaussian(
            mean=np.array([u @ law.mean]),
            covariance=np.array([[u @ law.covariance @ u]]),
            sources={name: np.array([[u @ covariance @ u]]) for name, covariance in law.sources.items()},
        )


METRICS = (
    TrackError("velocity_along_track_error", "m/s", "velocity error along the true inertial velocity"),
    TrackError("velocity_across_track_error", "m/s", "velocity error along the normal of the orbit", is_along=False),
)
