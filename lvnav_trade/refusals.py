"""Combinations of policies and measurements that make no sense: one table, each with its reason in physics."""

from collections.abc import Callable
from typing import Any, NamedTuple


class Refusal(NamedTuple):
    """A refused combination: path of the field that it is about, reason, and whether a scenario has it."""

    path: str
    reason: str
    applies: Callable[[Any], bool]


def _delay(scenario: Any) -> Any:
    return scenario.filter.delay_compensation


def _receiver(scenario: Any) -> bool:
    return bool(scenario.filter.tight or scenario.filter.loose)


REFUSALS = (
    Refusal(
        "filter.delay_compensation",
        "the filter takes nothing of the receiver that could be late",
        lambda s: _delay(s) is not None and not _receiver(s),
    ),
    Refusal(
        "filter.delay_compensation.kind",
        "a range has no velocity of its own to be extrapolated with; buffered compares it with the stored state",
        lambda s: _delay(s) is not None and _delay(s).kind == "extrapolated" and s.filter.tight,
    ),
    Refusal(
        "filter.delay_compensation.kind",
        "a solution is extrapolated position and velocity together; the filter takes one of them",
        lambda s: (
            _delay(s) is not None
            and _delay(s).kind == "extrapolated"
            and s.filter.loose
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
        lambda s: s.filter.models_vehicle and max(s.imu.gyro.quantisation, s.imu.accel.quantisation) > 0.0,
    ),
    Refusal(
        "control",
        "the attitude sensor of a vehicle under control measures throughout: no from, no until, no other condition",
        lambda s: (
            s.control is not None
            and any(card is not None and card.measurement == "attitude" and card.stated for card in s.sensors.values())
        ),
    ),
)


def refused(scenario: Any) -> Refusal | None:
    """Return the first refusal that applies to a scenario, None if it can be simulated."""
    return next((refusal for refusal in REFUSALS if refusal.applies(scenario)), None)
