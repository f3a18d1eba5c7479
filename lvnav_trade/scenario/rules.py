"""Rules between the fields of a scenario: contradictions, combinations that physics excludes, requirements of a case.

A breach has the path of the field to change, and a reason. `SETTINGS` and `REFUSALS` apply to every scenario:
validation raises the first breach. `CASES` apply to the cases of a campaign only, because an axis may correct the base
that it varies: the reader of campaigns checks every case and reports all breaches.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lvnav_trade.scenario.filter_models import filter_models, has_receiver_solution, sensors_measuring
from lvnav_trade.sensors.family import SENSOR_MEASUREMENTS

if TYPE_CHECKING:
    from lvnav_trade.scenario.scenario import Scenario


class RuleBreach(NamedTuple):
    """A rule that a scenario breaks.

    path : Path of the field to change.
    reason : Reason of the breach.
    """

    path: str
    reason: str


class Refusal(NamedTuple):
    """A refused combination of settings.

    path : Path of the field to change.
    reason : Reason of the refusal.
    applies : Function that returns whether a scenario has the combination.
    """

    path: str
    reason: str
    applies: Callable[[Any], bool]


# --- settings that contradict each other ------------------------------------------------------------------------------


def _control(scenario: Scenario) -> Iterator[RuleBreach]:
    """Yield the breaches of a vehicle under control."""
    control, card = scenario.control, scenario.trajectory
    if control is None:
        return
    if card.kind != "vehicle":
        yield RuleBreach("control", f"the ascent of a vehicle is steered, not a trajectory of kind {card.kind}")
        return
    if not sensors_measuring(scenario, "attitude"):
        yield RuleBreach("control", "a vehicle under control needs a sensor that measures attitude")
    if card.control is not None:
        yield RuleBreach(
            "control", "steers the ascent anew, which flies under trajectory.control already; state one of them"
        )
    for misfit in control.misfits(len(card.vehicle.stages)):
        path, _, reason = misfit.partition(": ")
        yield RuleBreach(path, reason)


def _repeated_fault(scenario: Scenario) -> Iterator[RuleBreach]:
    """Yield the first fault that is listed twice."""
    for number, fault in enumerate(scenario.faults):
        first = scenario.faults.index(fault)
        if first < number:
            yield RuleBreach(f"faults.{number}", f"is the same as faults.{first}; leave one of them out")
            return


def _missing_sensors(scenario: Scenario) -> Iterator[RuleBreach]:
    """Yield the measurements that no sensor provides; a sensor set to null removes its measurement without an error."""
    for name in scenario.filter.measurements:
        has_sensor = None in scenario.sensors.values() or sensors_measuring(scenario, name)
        if name in SENSOR_MEASUREMENTS and not has_sensor:
            yield RuleBreach("filter.measurements", f"no sensor of the scenario measures {name}")


SETTINGS: tuple[Callable[[Scenario], Iterator[RuleBreach]], ...] = (_control, _repeated_fault, _missing_sensors)


# --- combinations that physics excludes -------------------------------------------------------------------------------


def _delay(scenario: Any) -> Any:
    return scenario.filter.delay_compensation


def _receiver(scenario: Any) -> bool:
    return bool(scenario.filter.tight or scenario.filter.loose)


def _units(scenario: Any) -> tuple[Any, ...]:
    """Return the IMUs of a scenario."""
    return tuple(getattr(scenario.imu, "units", (scenario.imu,)))


def _is_quantised(unit: Any) -> bool:
    return max(unit.gyro.quantisation, unit.accel.quantisation) > 0.0


def _rank(unit: Any) -> int:
    """Return the number of dimensions that the sensing axes of an IMU span."""
    return int(np.linalg.matrix_rank(getattr(unit, "directions", np.eye(3)), tol=1e-6))


def _differences(scenario: Any) -> list[Any]:
    """Return the sensors that measure the difference of two IMUs."""
    return [card for card in scenario.sensors.values() if getattr(card, "measurement", "").endswith("_difference")]


def _has_modelled_latency(scenario: Any, card: Any) -> bool:
    """Return whether the filter models a latency of a sensor, by the sensor's card (`matched`) or the filter's card."""
    model = getattr(scenario.filter.sensor_models, card.measurement)
    if isinstance(model, str):  # matched
        model = card
    return bool(model.latency > 0.0)


def _has_latency_compensation(scenario: Any) -> bool:
    """Return whether the filter compensates the latency of a sensor."""
    for card in scenario.sensors.values():
        if (
            card is not None
            and card.measurement in scenario.filter.measurements
            and _has_modelled_latency(scenario, card)
        ):
            return True
    return False


REFUSALS = (
    Refusal(
        "filter.delay_compensation",
        "it has no effect: the filter uses neither the receiver nor a sensor with latency",
        lambda s: _delay(s) is not None and not _receiver(s) and not _has_latency_compensation(s),
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
            and any(card is not None and card.is_on_pad for card in s.sensors.values())
        ),
    ),
    Refusal(
        "filter.gains",
        "the filter has no measurement that a gain could be for",
        lambda s: s.filter.gains is not None and not s.filter.is_aided,
    ),
    Refusal(
        "imu",
        "quantisation correlates a sample with the next one, which samples as measurements (imu) take for independent",
        lambda s: s.filter.models_vehicle and any(_is_quantised(unit) for unit in _units(s)),
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
        lambda s: bool(_differences(s)) and any(_is_quantised(unit) for unit in _units(s)),
    ),
    Refusal(
        "sensors",
        "what a vehicle at rest is known to do, and what two units differ by, reaches the filter at once: no latency",
        lambda s: any(
            card is not None and card.has_no_latency and (card.latency > 0.0 or _has_modelled_latency(s, card))
            for card in s.sensors.values()
        ),
    ),
    Refusal(
        "control",
        "the attitude sensor of a vehicle under control measures throughout and at once: no condition, no latency",
        lambda s: (
            s.control is not None
            and any(
                card is not None and card.measurement == "attitude" and (card.condition_keys or card.latency)
                for card in s.sensors.values()
            )
        ),
    ),
)


def first_refusal(scenario: Any) -> Refusal | None:
    """Return the first refusal that applies to a scenario, None if it can be simulated."""
    return next((refusal for refusal in REFUSALS if refusal.applies(scenario)), None)


# --- requirements of a case -------------------------------------------------------------------------------------------

_RATES = {
    "imu.rate": "IMU rate",
    "filter.covariance_rate": "covariance rate",
    "filter.update_rate": "update rate",
    "receiver.rate": "receiver rate",
}


def _rates(scenario: Scenario) -> Iterator[RuleBreach]:
    """Yield the rates that do not divide the next faster rate."""
    pairs = [
        ("imu.rate", "imu.process_rate"),
        ("imu.rate", "filter.covariance_rate"),
        ("filter.covariance_rate", "filter.update_rate"),
    ]
    if scenario.filter.tight or scenario.filter.loose or has_receiver_solution(scenario):
        pairs.append(("receiver.rate", "filter.update_rate"))
    slower_rates = [(faster, path, attrgetter(path)(scenario)) for faster, path in pairs]
    for name, card in scenario.sensors.items():
        if card is not None and card.rate is not None:
            slower_rates.append(("filter.update_rate", f"sensors.{name}.rate", card.rate))
    for faster, path, slow_rate in slower_rates:
        fast_rate = attrgetter(faster)(scenario)
        ratio = fast_rate / slow_rate
        if ratio <= 1 - 1e-9 or abs(ratio - round(ratio)) >= 1e-9 * ratio:
            yield RuleBreach(path, f"{slow_rate:g} Hz does not divide the {_RATES[faster]} of {fast_rate:g} Hz")


def _strapdown(scenario: Scenario) -> Iterator[RuleBreach]:
    """Yield the breach of a strapdown step longer than a covariance step."""
    increments = round(scenario.imu.rate / scenario.filter.covariance_rate)
    if scenario.filter.strapdown.ratio > max(1, increments):
        reason = f"a step longer than a covariance step of {increments} increments; at most {increments} fit"
        yield RuleBreach("filter.strapdown.ratio", reason)


def _noiseless(scenario: Scenario) -> Iterator[RuleBreach]:
    """Yield the measurements that the filter models without noise, which makes its covariance singular."""
    card = scenario.filter
    is_matched = isinstance(card.receiver, str)
    if has_receiver_solution(scenario) and is_matched:
        return  # the receiver reports the covariance of its solutions, which is never zero
    _, receiver, _ = filter_models(scenario)
    truth = "receiver" if card.tight else "receiver.solution"
    for measurement in card.measurements:
        name = f"{measurement}_sigma"
        if getattr(receiver, name, 1.0) <= 0.0:
            reason = f"the filter cannot model {measurement.replace('_', ' ')} without noise; should be greater than 0"
            yield RuleBreach(f"{truth if is_matched else 'filter.receiver'}.{name}", reason)


CASES: tuple[Callable[[Scenario], Iterator[RuleBreach]], ...] = (_rates, _strapdown, _noiseless)


def breaches(scenario: Scenario) -> Iterator[RuleBreach]:
    """Yield the breaches of the rules for every scenario, and the first refused combination."""
    for rule in SETTINGS:
        yield from rule(scenario)
    refusal = first_refusal(scenario)
    if refusal is not None:
        yield RuleBreach(refusal.path, refusal.reason)


def case_breaches(scenario: Scenario) -> Iterator[RuleBreach]:
    """Yield the breaches of the rules for the cases of a campaign."""
    for rule in CASES:
        yield from rule(scenario)
