"""Which motors burn when: a stage with its boosters cut into pieces of straight thrust, and what is dropped between."""

from __future__ import annotations

import math
from typing import NamedTuple

from lvnav_trade.world.ascent.dynamics import NOTHING, Engine, Unthrottled
from lvnav_trade.world.ascent.vehicle import STANDARD_GRAVITY, Boosters, Motor, Stage, VehicleCard

_Burning = tuple[Motor, int, float]  # motor, how many, time of ignition


class Cut(NamedTuple):
    """A point of a stage's burn, `after` s from its ignition: mass (kg) dropped there, and the event's name."""

    after: float
    drop: float = 0.0
    event: str = ""


def exhaust_speed(motor: Motor) -> float:
    """Return the effective exhaust speed in vacuum, m/s."""
    return STANDARD_GRAVITY * motor.specific_impulse


def cuts(vehicle: VehicleCard, number: int) -> list[Cut]:
    """Return the points of stage `number`'s first burn at which thrust jumps or bends, or mass is dropped, in order."""
    stage, fairing = vehicle.stages[number - 1], vehicle.fairing
    found = [Cut(after) for after in _bends(stage)]
    if fairing is not None and fairing.stage == number:
        found.append(Cut(fairing.after_ignition, fairing.mass, "fairing_separation"))
    for group in vehicle.boosters if number == 1 else ():
        found += [Cut(group.ignition + after) for after in _bends(group)]
        if group.ignition > 0.0:
            found.append(Cut(group.ignition, event=f"{group.name}_ignition"))
        found.append(Cut(group.ignition + group.full_burn, event=f"{group.name}_cutoff"))
        found.append(Cut(group.gone, group.number * group.dry, f"{group.name}_separation"))
    return sorted(found, key=lambda cut: cut.after)


def engine(vehicle: VehicleCard, number: int, ignition: float, begin: float, end: float) -> Engine:
    """Return what pushes between begin and end, s since lift-off, with stage `number` lit at `ignition`.

    Between two neighbouring `cuts` every thrust is straight. An end at infinity is for a stage without bends.
    """
    stage = vehicle.stages[number - 1]
    middle = 0.5 * (begin + end)
    burning: list[_Burning] = [
        (group, group.number, group.ignition)
        for group in vehicle.boosters
        if number == 1 and group.ignition < middle < group.ignition + group.full_burn
    ]
    if stage.profile is not None:
        return Engine(0.0, 0.0, 0.0, math.inf, _together([(stage, 1, ignition), *burning], begin, end))
    limit = math.inf if stage.thrust is None or vehicle.max_load is None else vehicle.max_load
    beside = _together(burning, begin, end) if burning else NOTHING
    return Engine(stage.full_thrust, stage.full_thrust / exhaust_speed(stage), stage.exit_area, limit, beside)


def throttled(vehicle: VehicleCard, stage: Stage) -> bool:
    """Whether a stage may be throttled, so that its burn is not known before it is flown."""
    return stage.thrust is not None and vehicle.max_load is not None


def impulse_speed(vehicle: VehicleCard, payload: float) -> float:
    """Return the speed in m/s that the vehicle gains in empty space with a payload in kg, all propellant burnt.

    Boosters burn together with as much of the first stage's propellant as flows meanwhile; the fairing stays until
    the end of the burn in which it is released.
    """
    mass, gain = payload, 0.0
    for number in range(len(vehicle.stages), 0, -1):
        stage = vehicle.stages[number - 1]
        if vehicle.fairing is not None and vehicle.fairing.stage == number:
            mass += vehicle.fairing.mass
        alone = stage.propellant
        if number == 1 and vehicle.boosters:
            alone -= stage.propellant * max(group.gone for group in vehicle.boosters) / stage.full_burn
        gain += exhaust_speed(stage) * math.log1p(alone / (mass + stage.dry))
        if number == 1 and vehicle.boosters:
            gain += _joint_gain(vehicle.boosters, stage, stage.propellant - alone, mass + stage.dry + alone)
        mass += stage.dry + stage.propellant
    return gain


def _joint_gain(groups: tuple[Boosters, ...], stage: Stage, beside: float, mass: float) -> float:
    """Return the speed gained while the boosters burn beside a part (kg) of the stage; mass (kg) is what remains."""
    parts = [(group.number * group.propellant, exhaust_speed(group)) for group in groups]
    parts.append((beside, exhaust_speed(stage)))
    total = sum(propellant for propellant, _ in parts)
    mean = sum(propellant * speed for propellant, speed in parts) / total
    return mean * math.log1p(total / (mass + sum(group.number * group.dry for group in groups)))


def _bends(motor: Motor) -> list[float]:
    """Return the points of a motor's thrust profile, s after its ignition: guidance may let it burn beyond the last."""
    return [] if motor.profile is None else [part * motor.full_burn for part in motor.profile.part[1:]]


def _thrust_at(motor: Motor, after: float) -> float:
    """Return the vacuum thrust in N of a motor `after` s from its ignition; beyond its burn time that of the end."""
    if motor.profile is None:
        return motor.full_thrust
    part, level = motor.profile.part, motor.profile.thrust
    mean = sum(0.5 * (level[k] + level[k + 1]) * (part[k + 1] - part[k]) for k in range(len(part) - 1))
    x = min(max(after / motor.full_burn, 0.0), 1.0)
    k = next(k for k in range(len(part) - 1) if x <= part[k + 1])
    return motor.full_thrust * (level[k] + (level[k + 1] - level[k]) * (x - part[k]) / (part[k + 1] - part[k])) / mean


def _together(burning: list[_Burning], begin: float, end: float) -> Unthrottled:
    """Return the sum of motors over a stretch where each is straight."""
    thrust = slope = flow = flow_slope = area = 0.0
    for motor, number, ignition in burning:
        first, last = (_thrust_at(motor, t - ignition) for t in (begin, end))
        rise = (last - first) / (end - begin)
        speed = exhaust_speed(motor)
        thrust, slope = thrust + number * first, slope + number * rise
        flow, flow_slope = flow + number * first / speed, flow_slope + number * rise / speed
        area += number * motor.exit_area
    return Unthrottled(begin, thrust, slope, flow, flow_slope, area)
