"""The metrics that a campaign can name: those of the registry, and errors of the states of sensors."""

from typing import NamedTuple

from lvnav_trade.campaign.syntax.tree import hint
from lvnav_trade.errors import quoted
from lvnav_trade.layout import split_metric
from lvnav_trade.metrics import registry
from lvnav_trade.metrics.families import errors
from lvnav_trade.metrics.metric import REQUIREMENTS, STATEMENTS, Metric
from lvnav_trade.observables.sensors import SENSOR_STATES

# SI unit of every quantity of which results hold an error
ERROR_UNITS = errors.UNITS | {name: state.unit for name, state in SENSOR_STATES.items()}


class Known(NamedTuple):
    """A metric in the list of metrics.

    metric : Name; ``_x`` stands for any axis of a sensor.
    unit : SI unit.
    meaning : One phrase.
    named_by : Blocks of a campaign that can name it.
    """

    metric: str
    unit: str
    meaning: str
    named_by: str


def find_metric(name: str) -> Metric | None:
    """Return the metric of a name; None where there is none."""
    found = registry.find(name)
    if found is None and (unit := ERROR_UNITS.get(split_metric(name)[0])) is not None:
        return errors.error_named(name, unit)
    return found


def metric_of(name: str) -> Metric:
    """Return the metric of a name that a campaign may state; ValueError where there is none."""
    found = find_metric(name)
    if found is None:
        raise ValueError(f"{quoted(name)} is not a metric")
    return found


def unit_of(name: str) -> str:
    """Return the SI unit of a metric, ``%`` or ``-`` of those that have none."""
    return metric_of(name).unit


def known_metric(name: str) -> str:
    """Return the name of a metric of statements; ValueError with what may be meant where it is none."""
    found = find_metric(name)
    if found is None or found.named_by == REQUIREMENTS:
        others = registry.names(lambda one: one.named_by != REQUIREMENTS and not isinstance(one, errors.StateError))
        near = hint(name, (*others, "position_error_3d", "velocity_error_3d", "attitude_error_3d"))
        raise ValueError(f"{quoted(name)} is not a metric{near}")
    return name


def required_metrics() -> tuple[str, ...]:
    """Return the names of the metrics that a requirement can name."""
    return registry.names(lambda one: one.named_by != STATEMENTS)


def known_metrics() -> list[Known]:
    """Return every metric that can be named: those of requirements first, then those of statements alone."""
    sensors = [errors.state_metric(name, state.unit) for name, state in SENSOR_STATES.items()]
    found = [*registry.registry().values(), *sensors]
    return [Known(one.name, one.unit, one.meaning, one.named_by) for one in found]
