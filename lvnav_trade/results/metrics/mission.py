"""Mission errors: mean orbit, impact point, and the delta-v that corrects the orbit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.metric import (
    BOTH,
    LENGTH,
    MISSING,
    NO_LAW,
    TWO_SIDED,
    Metric,
    MetricValue,
    dimension_message,
    event_of,
    scale_of,
)
from lvnav_trade.results.statistics.case_results import Distribution, Gaussian, RunErrors, parse_number

if TYPE_CHECKING:
    from lvnav_trade.results.mechanics.mission_errors import ElementEpochs
    from lvnav_trade.results.statistics.case_results import CaseResults
    from lvnav_trade.results.tables.read import Tables


# Metrics that are norms of vectors
_LENGTHS = ("eccentricity_vector_error", "correction_delta_v", "impact_error")
# Metrics that are not elements of the orbit
_WITHOUT_ELEMENTS = ("correction_delta_v", "impact_error", "impact_error_down", "impact_error_cross")


@dataclass(frozen=True)
class MissionError(Metric):
    """Error of a mission quantity, a function of the errors of velocity and position together.

    label_unit : Display unit.
    label_factor : Factor from SI to the display unit.
    """

    label_unit: str = "m"
    label_factor: float = 1.0

    named_by: ClassVar[str] = BOTH
    event_only_reason: ClassVar[str] = "a number of the orbit"

    @property
    def has_epoch(self) -> bool:
        """Whether it has an epoch: errors of elements have; a correction and an impact point have not."""
        return self.name not in _WITHOUT_ELEMENTS

    @property
    def bound_type(self) -> str:
        """Kind of bound: the norm of a vector and the magnitude of a correction, or a signed number."""
        return LENGTH if self.name in _LENGTHS else TWO_SIDED

    def value(self, tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the root mean square over the runs at an event."""
        from lvnav_trade.results.statistics.case_tables import CaseTables

        scale = scale_of(unit, self.unit)
        if scale is None:
            return MetricValue(remark=dimension_message(unit))
        size = sizes_at(CaseTables(tables, case), event_of(statement), self.name, epochs_of(statement))
        if size is None or not len(size):
            return MetricValue(remark=MISSING)
        root_mean_square = float(np.sqrt(np.mean(size**2)))
        return MetricValue(monte_carlo=root_mean_square / scale, runs=(size / scale) ** 2)

    def label(self, statement: Mapping[str, Any]) -> str:
        """Return the metric and its event, with type and epochs of the elements unless they are the defaults."""
        epochs = epochs_of(statement)
        element_type = "" if epochs.is_mean else ", osculating"
        epoch_text = f" + {epochs.estimated_epoch:g} s" if epochs.estimated_epoch else ""
        if epochs.true_epoch != epochs.estimated_epoch:
            true_epoch_text = f", true elements at + {epochs.true_epoch:g} s"
        else:
            true_epoch_text = ""
        return f"{super().label(statement)}{epoch_text}{element_type}{true_epoch_text}"

    def errors(self, case: CaseResults, requirement: Mapping[str, Any]) -> RunErrors | None:
        """Return the magnitude of the error of every run at an event."""
        size = sizes_at(case, event_of(requirement), self.name)
        if size is None:
            return None
        return RunErrors(size, self.unit, self.label_unit, self.label_factor)

    def distribution(self, case: CaseResults, requirement: Mapping[str, Any]) -> Distribution | str:
        """Return the Gaussian to first order, or the distribution of draws through the exact relation if that is
        invalid.
        """
        event = event_of(requirement)
        moments_or_reason = mean_and_covariance_at(case, event, self.name)
        draws = None
        if isinstance(moments_or_reason, tuple):
            mean, covariance = moments_or_reason
            gaussian = Gaussian(mean, covariance, {})
        else:
            draws = magnitude_sample_at(case, event, self.name)
            if draws is None:
                return moments_or_reason or NO_LAW
            gaussian = Gaussian(np.empty(0), np.empty((0, 0)), {})
        return Distribution(gaussian, self.unit, self.label_unit, self.label_factor, event, sample=draws)


def epochs_of(statement: Mapping[str, Any]) -> ElementEpochs:
    """Return type and epochs of the elements in a statement; by default mean elements at its event."""
    from lvnav_trade.results.mechanics.mission_errors import ElementEpochs

    estimated_epoch = parse_number(statement.get("epoch") or 0.0, "s")
    reference = statement.get("reference_epoch")
    return ElementEpochs(
        is_mean=statement.get("elements", "mean") == "mean",
        estimated_epoch=estimated_epoch,
        true_epoch=estimated_epoch if reference is None else parse_number(reference, "s"),
    )


def sizes_at(case: CaseResults, event: str, metric: str, epochs: ElementEpochs | None = None) -> Floats | None:
    """Return |error| (n_run,) of a mission metric at an event in every run, SI.

    Infinite if the run failed or the quantity is undefined. None if the state at the event is not stored.

    epochs : type and epochs of the orbital elements; None for mean elements at the event
    """
    from lvnav_trade.results.mechanics.mission_errors import ElementEpochs, metric_errors, orbit_errors_at
    from lvnav_trade.results.mechanics.stored_states import inertial_errors

    state = case.state(event)
    if state is None:
        return None
    velocity = case.errors(event, "velocity")
    position = case.errors(event, "position")
    error, has_failed = inertial_errors(state, velocity, position, case.has_failed(event))
    size = np.full(len(error), np.inf)
    if not has_failed.all():
        good_error = error[~has_failed]
        if epochs is None or epochs == ElementEpochs():
            metric_error = metric_errors(state, good_error, metric)
        else:
            metric_error = orbit_errors_at(state, good_error, epochs)[metric]
        size[~has_failed] = np.linalg.norm(metric_error, axis=1)
    return np.where(np.isfinite(size), size, np.inf)


def magnitude_sample_at(case: CaseResults, event: str, metric: str) -> Floats | None:
    """Return `mission_errors.magnitude_sample` at an event; None if the state there is not stored."""
    from lvnav_trade.results.mechanics.mission_errors import magnitude_sample

    state = case.state(event)
    if state is None:
        return None
    return magnitude_sample(state, case.joint(event), metric)


def mean_and_covariance_at(case: CaseResults, event: str, metric: str) -> tuple[Floats, Floats] | str | None:
    """Return `mission_errors.mean_and_covariance` at an event; None if the state there is not stored."""
    from lvnav_trade.results.mechanics.mission_errors import mean_and_covariance

    state = case.state(event)
    if state is None:
        return None
    return mean_and_covariance(state, case.joint(event), metric)


def _error(name: str, unit: str, label: str, factor: float, meaning: str) -> MissionError:
    return MissionError(name, unit, f"error of the mission: {meaning}", label, factor)


_DEG = 180.0 / np.pi
METRICS: tuple[MissionError, ...] = (
    _error("semi_major_axis_error", "m", "km", 1e-3, "semi-major axis, averaged over a revolution"),
    _error("eccentricity_error", "dimensionless", "-", 1.0, "eccentricity, averaged"),
    _error("eccentricity_vector_error", "dimensionless", "-", 1.0, "eccentricity vector, length of the difference"),
    _error("perigee_error", "m", "km", 1e-3, "height of perigee, averaged"),
    _error("apogee_error", "m", "km", 1e-3, "height of apogee, averaged"),
    _error("inclination_error", "rad", "deg", _DEG, "inclination, averaged"),
    _error("node_error", "rad", "deg", _DEG, "right ascension of the ascending node, averaged"),
    _error("correction_delta_v", "m/s", "m/s", 1.0, "least sum of impulses that corrects the orbit"),
    _error("impact_error", "m", "km", 1e-3, "instantaneous point of impact, distance"),
    _error("impact_error_down", "m", "km", 1e-3, "point of impact along the velocity over the ground"),
    _error("impact_error_cross", "m", "km", 1e-3, "point of impact across it"),
)
MISSION = {metric.name: metric for metric in METRICS}
