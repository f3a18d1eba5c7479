"""Names of the metrics that a campaign can use, and the evidence for sensor models."""

from __future__ import annotations

from typing import Any, NamedTuple

from lvnav_trade.campaign.syntax.tree import hint
from lvnav_trade.quantities.errors import quoted
from lvnav_trade.quantities.state_layout import split_metric
from lvnav_trade.results import registry
from lvnav_trade.results.metric import REQUIREMENTS, STATEMENTS, Metric
from lvnav_trade.results.metrics import state_errors
from lvnav_trade.sensors.family import FAMILY, SENSOR_STATES, card_kind
from lvnav_trade.sensors.sensor import Evidence

# SI unit of every quantity whose errors are stored
ERROR_UNITS = state_errors.UNITS | {name: state.unit for name, state in SENSOR_STATES.items()}


class ListedMetric(NamedTuple):
    """A metric in the list of metrics.

    metric : Name; ``_x`` in it represents any axis of a sensor.
    unit : SI unit.
    meaning : Meaning, in one phrase.
    named_by : Blocks of a campaign that can name it.
    """

    metric: str
    unit: str
    meaning: str
    named_by: str


def find_metric(name: str) -> Metric | None:
    """Return the metric with a name; None if there is none."""
    metric = registry.find(name)
    if metric is None and (unit := ERROR_UNITS.get(split_metric(name)[0])) is not None:
        return state_errors.error_named(name, unit)
    return metric


def metric_of(name: str) -> Metric:
    """Return the metric with a name; ValueError if there is none."""
    metric = find_metric(name)
    if metric is None:
        raise ValueError(f"{quoted(name)} is not a metric")
    return metric


def unit_of(name: str) -> str:
    """Return the SI unit of a metric; ``%`` or ``-`` for a metric without unit."""
    return metric_of(name).unit


def known_metric(name: str) -> str:
    """Return a name if it is a metric of published numbers; otherwise ValueError, which suggests a similar name."""
    metric = find_metric(name)
    if metric is None or metric.named_by == REQUIREMENTS:
        candidates = registry.names(_is_suggested)
        suggestion = hint(name, (*candidates, "position_error_3d", "velocity_error_3d", "attitude_error_3d"))
        raise ValueError(f"{quoted(name)} is not a metric{suggestion}")
    return name


def _is_suggested(metric: Metric) -> bool:
    """Whether a metric is suggested for an unknown name; of the many state errors only three are."""
    return metric.named_by != REQUIREMENTS and not isinstance(metric, state_errors.StateError)


def required_metrics() -> tuple[str, ...]:
    """Return the names of the metrics that a requirement can name."""
    return registry.names(lambda metric: metric.named_by != STATEMENTS)


def known_metrics() -> list[ListedMetric]:
    """Return all metrics that a campaign can name: first those of the registry, then the errors of sensor states."""
    sensors = [state_errors.state_metric(name, state.unit) for name, state in SENSOR_STATES.items()]
    metrics = [*registry.registry().values(), *sensors]
    return [ListedMetric(metric.name, metric.unit, metric.meaning, metric.named_by) for metric in metrics]


def sensor_entries() -> list[dict[str, Any]]:
    """Return the entries of the sensors, in the form of `report/templates/models.toml`.

    Sensors with the same evidence are one entry, with a set of settings for each sensor.
    """
    settings_by_evidence: dict[Evidence, list[dict[str, str]]] = {}
    for member in FAMILY:
        settings = {"sensors.*.kind": card_kind(member.card), "filter.measurements": member.card.measurement}
        settings_by_evidence.setdefault(member.evidence, []).append(settings)
    return [
        {
            "name": evidence.name,
            "used": settings,
            "checks": [check._asdict() for check in evidence.checks],
            "omits": evidence.omits,
        }
        for evidence, settings in settings_by_evidence.items()
    ]
