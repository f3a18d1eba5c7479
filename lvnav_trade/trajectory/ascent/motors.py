"""Motors of a vehicle card: propulsion between the points at which thrust bends, and the ideal velocity gain."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.trajectory.ascent.equations_of_motion import NOTHING, Propulsion, UnthrottledMotors
from lvnav_trade.trajectory.ascent.vehicle_cards import Boosters, Motor, Stage, VehicleCard

_Burning = tuple[Motor, int, float]  # motor, number of motors, time of ignition


class BurnPoint(NamedTuple):
    """A point in the burn of a stage.

    time_from_ignition : s. Time from the ignition of the stage.
    dropped_mass : kg. Mass that is dropped at this point.
    event : Name of the event; empty for none.
    """

    time_from_ignition: float
    dropped_mass: float = 0.0
    event: str = ""


def cuts(vehicle: VehicleCard, number: int) -> list[BurnPoint]:
    """Return, in order, the points of the first burn of a stage at which thrust jumps or bends, or mass is dropped."""
    stage = vehicle.stages[number - 1]
    fairing = vehicle.fairing
    points = [BurnPoint(bend_time) for bend_time in _bends(stage)]
    if fairing is not None and fairing.stage == number:
        points.append(BurnPoint(fairing.after_ignition, fairing.mass, "fairing_separation"))
    boosters = vehicle.boosters if number == 1 else ()
    for group in boosters:
        ignition = group.ignition
        burn_end = ignition + group.full_burn
        dropped_mass = group.number * group.dry
        points += [BurnPoint(ignition + bend_time) for bend_time in _bends(group)]
        if ignition > 0.0:
            points.append(BurnPoint(ignition, event=f"{group.name}_ignition"))
        points.append(BurnPoint(burn_end, event=f"{group.name}_cutoff"))
        points.append(BurnPoint(group.separation_time, dropped_mass, f"{group.name}_separation"))
    return sorted(points, key=lambda cut: cut.time_from_ignition)


def engine(vehicle: VehicleCard, number: int, ignition: float, begin: float, end: float) -> Propulsion:
    """Return the propulsion over an interval between two successive `cuts`, in which every thrust is linear in time.

    number : number of the burning stage, from 1
    ignition : s since lift-off. Ignition of the stage.
    begin, end : s since lift-off. The end is infinite for a stage without bends.
    """
    stage = vehicle.stages[number - 1]
    middle = 0.5 * (begin + end)
    burning_motors: list[_Burning] = []
    for group in vehicle.boosters if number == 1 else ():
        burn_end = group.ignition + group.full_burn
        if group.ignition < middle < burn_end:
            burning_motors.append((group, group.number, group.ignition))
    if stage.profile is not None:
        motors = _total_thrust([(stage, 1, ignition), *burning_motors], begin, end)
        return Propulsion(
            thrust=0.0,
            mass_flow=0.0,
            exit_area=0.0,
            max_load=math.inf,
            unthrottled_motors=motors,
        )
    limit = math.inf if stage.thrust is None or vehicle.max_load is None else vehicle.max_load
    return Propulsion(
        thrust=stage.full_thrust,
        mass_flow=stage.full_thrust / stage.exhaust_speed,
        exit_area=stage.exit_area,
        max_load=limit,
        unthrottled_motors=_total_thrust(burning_motors, begin, end) if burning_motors else NOTHING,
    )


def impulse_speed(vehicle: VehicleCard, payload: float) -> float:
    """Return the ideal velocity gain (m/s) of the vehicle with a payload (kg), with all propellant burnt.

    Boosters burn together with the propellant that the first stage consumes in that time. The fairing is counted to the
    end of the burn in which it is released.
    """
    mass, gain = payload, 0.0
    for number in range(len(vehicle.stages), 0, -1):
        stage = vehicle.stages[number - 1]
        if vehicle.fairing is not None and vehicle.fairing.stage == number:
            mass += vehicle.fairing.mass
        boosters = vehicle.boosters if number == 1 else ()
        booster_time = max((group.separation_time for group in boosters), default=0.0)
        joint_propellant = stage.propellant * booster_time / stage.full_burn
        solo_propellant = stage.propellant - joint_propellant
        empty_mass = mass + stage.dry
        gain += stage.exhaust_speed * math.log1p(solo_propellant / empty_mass)
        if boosters:
            stage_propellant = stage.propellant - solo_propellant
            final_mass = empty_mass + solo_propellant
            gain += _joint_gain(boosters, stage, stage_propellant, final_mass)
        mass += stage.dry + stage.propellant
    return gain


def _joint_gain(groups: tuple[Boosters, ...], stage: Stage, stage_propellant: float, mass: float) -> float:
    """Return the velocity gain (m/s) while boosters and stage burn together.

    stage_propellant : kg. Propellant of the stage burnt in that time.
    mass : kg. Mass at the end.
    """
    burnt = [(group.number * group.propellant, group.exhaust_speed) for group in groups]
    burnt.append((stage_propellant, stage.exhaust_speed))
    total = sum(propellant for propellant, _ in burnt)
    impulse = sum(propellant * speed for propellant, speed in burnt)
    mean_exhaust = impulse / total
    dry = sum(group.number * group.dry for group in groups)
    final_mass = mass + dry
    return mean_exhaust * math.log1p(total / final_mass)


def _bends(motor: Motor) -> list[float]:
    """Return the points of a motor's thrust profile, s after ignition; with guidance it may burn beyond the last."""
    if motor.profile is None:
        return []
    return [share * motor.full_burn for share in motor.profile.part[1:]]


def _thrust_at(motor: Motor, time_from_ignition: float) -> float:
    """Return the vacuum thrust (N) of a motor `time_from_ignition` s from ignition; constant after its burn time.

    The profile is linear between its points, and is scaled to the mean thrust of the motor.
    """
    if motor.profile is None:
        return motor.full_thrust
    share = motor.profile.part
    level = motor.profile.thrust
    intervals = range(len(share) - 1)
    mean = sum(0.5 * (level[k] + level[k + 1]) * (share[k + 1] - share[k]) for k in intervals)
    x = min(max(time_from_ignition / motor.full_burn, 0.0), 1.0)
    k = next(k for k in intervals if x <= share[k + 1])
    rise = level[k + 1] - level[k]
    width = share[k + 1] - share[k]
    distance = x - share[k]
    level_x = level[k] + rise * distance / width
    return motor.full_thrust * level_x / mean


def _total_thrust(burning: list[_Burning], begin: float, end: float) -> UnthrottledMotors:
    """Return the total of motors over an interval in which the thrust of each is linear.

    burning : motors, each with its number and its ignition (s since lift-off)
    begin, end : s since lift-off
    """
    total = np.zeros(5)
    for motor, number, ignition in burning:
        first = _thrust_at(motor, begin - ignition)
        last = _thrust_at(motor, end - ignition)
        thrust = number * first
        motor_slope = (last - first) / (end - begin)
        slope = number * motor_slope
        exhaust = motor.exhaust_speed
        total += [
            thrust,
            slope,
            thrust / exhaust,
            slope / exhaust,
            number * motor.exit_area,
        ]
    return UnthrottledMotors(begin, *total.tolist())
