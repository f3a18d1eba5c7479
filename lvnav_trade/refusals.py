"""Meaningless combinations of policies and measurements: one table, each with its reason in physics."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np


class Refusal(NamedTuple):
    """A refused combination: path of the field that it is about, reason, and whether a scenario has it."""

    path: str
    reason: str
    applies: Callable[[Any], bool]


def _delay(scenario: Any) -> Any:
    return scenario.filter.delay_compensation


def _receiver(scenario: Any) -> bool:
    return bool(scenario.filter.tight or scenario.filter.loose)


def _units(scenario: Any) -> tuple[Any, ...]:
    """Return the inertial units of a scenario."""
    return tuple(getattr(scenario.imu, "units", (scenario.imu,)))


def _quantised(unit: Any) -> bool:
    return max(unit.gyro.quantisation, unit.accel.quantisation) > 0.0


def _rank(unit: Any) -> int:
    """Return how many dimensions the axes of a unit span."""
    return int(np.linalg.matrix_rank(getattr(unit, "directions", np.eye(3)), tol=1e-6))


def _differences(scenario: Any) -> list[Any]:
    """Return the sensors that measure by what two units differ."""
    return [card for card in scenario.sensors.values() if getattr(card, "measurement", "").endswith("_difference")]


def _late(scenario: Any, card: Any) -> bool:
    """Return whether the filter takes a sensor for late: by its own latency, or what the filter card states."""
    model = getattr(scenario.filter.sensor_models, card.measurement)
    return bool((card if isinstance(model, str) else model).latency > 0.0)


def _late_sensors(scenario: Any) -> bool:
    """Return whether the filter compensates the latency of a sensor."""
    return any(
        card is not None and card.measurement in scenario.filter.measurements and _late(scenario, card)
        for card in scenario.sensors.values()
    )


REFUSALS = (
    Refusal(
        "filter.delay_compensation",
        "it has no effect: the filter uses neither the receiver nor a sensor with latency",
        lambda s: _delay(s) is not None and not _receiver(s) and not _late_sensors(s),
    ),
    Refusal(
        "filter.delay_compensation.kind",
        "a solution's position is extrapolated by its velocity, and the filter does not take both of them; buffered "
        "compares whatever is late with the stored state",
        lambda s: (
            _delay(s) is not None
            and _delay(s).kind == "extrapolated"
            and not {"position", "velocity"} <= set(s.filter.measurements)
        ),
    ),
    Refusal(
        "filter.init",
        "a start from GNSS takes position and velocity of the receiver's solution: both are to be measured",
        lambda s: s.filter.init == "from_gnss" and not {"position", "velocity"} <= set(s.filter.measurements),
    ),
    Refusal(
        "filter.logic",
        "a mode logic checks what the receiver measures, and the filter takes nothing of it",
        lambda s: s.filter.logic is not None and not _receiver(s),
    ),
    Refusal(
        "filter.measurements",
        "zero_rotation says that the attitude on the pad stays, not which it is: standing_attitude is an extra state",
        lambda s: (
            "zero_rotation" in s.filter.measurements
            and "standing_attitude" not in (*s.filter.extra_states, *s.filter.consider)
        ),
    ),
    Refusal(
        "trajectory.pad_hold",
        "the flight begins with its lift-off, and a sensor of the scenario measures on the pad only",
        lambda s: (
            s.trajectory.pad_hold <= 0.0
            and s.trajectory.kind != "table"  # its rows may begin at rest
            and any(card is not None and card.on_pad for card in s.sensors.values())
        ),
    ),
    Refusal(
        "filter.gains",
        "the filter has no measurement that a gain could be for",
        lambda s: s.filter.gains is not None and not s.filter.aided,
    ),
    Refusal(
        "imu",
        "quantisation correlates a sample with the next one, which samples as measurements (imu) take for independent",
        lambda s: s.filter.models_vehicle and any(_quantised(unit) for unit in _units(s)),
    ),
    Refusal(
        "faults",
        "a fault is of an inertial unit that the scenario does not have",
        lambda s: any(getattr(fault, "unit", 1) > len(_units(s)) for fault in s.faults),
    ),
    Refusal(
        "sensors",
        "a difference is of two inertial units that each sense along three axes or more, and one of them is not there",
        lambda s: any(
            number > len(_units(s)) or _rank(_units(s)[number - 1]) < 3
            for card in _differences(s)
            for number in card.units
        ),
    ),
    Refusal(
        "sensors",
        "two sensors measure the same difference: the filter has one relative bias for each of its kind",
        lambda s: len({card.measurement for card in _differences(s)}) < len(_differences(s)),
    ),
    Refusal(
        "imu.weights",
        "noise of a difference is correlated with that of fused increments, unless both weight all units by "
        "random_walk throughout: no selection, no exclusion",
        lambda s: (
            bool(_differences(s))
            and (s.imu.weights != "random_walk" or s.imu.selection != "mean" or s.imu.parity is not None)
        ),
    ),
    Refusal(
        "imu",
        "quantisation correlates a difference of increments with the next one, which updates take for independent",
        lambda s: bool(_differences(s)) and any(_quantised(unit) for unit in _units(s)),
    ),
    Refusal(
        "sensors",
        "what a vehicle at rest is known to do, and what two units differ by, reaches the filter at once: no latency",
        lambda s: any(
            card is not None and card.at_once and (card.latency > 0.0 or _late(s, card)) for card in s.sensors.values()
        ),
    ),
    Refusal(
        "control",
        "the attitude sensor of a vehicle under control measures throughout and at once: no condition, no latency",
        lambda s: (
            s.control is not None
            and any(
                card is not None and card.measurement == "attitude" and (card.stated or card.latency)
                for card in s.sensors.values()
            )
        ),
    ),
)


def refused(scenario: Any) -> Refusal | None:
    """Return the first refusal that applies to a scenario, None if it can be simulated."""
    return next((refusal for refusal in REFUSALS if refusal.applies(scenario)), None)
