"""Targeting: the steering of an ascent for its target orbit, or the missing velocity of the vehicle."""

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import OptimizeResult, brentq, minimize_scalar, root

from lvnav_trade.kernels.earth import GM, OMEGA, SEMI_MAJOR
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_velocity, elements_from_state
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.equations_of_motion import unthrottled_thrust
from lvnav_trade.trajectory.ascent.legs import (
    SimulatedAscent,
    TargetingUnknowns,
    fly_ascent,
    lift_off_mass,
    mass_above,
)
from lvnav_trade.trajectory.ascent.motors import engine, impulse_speed
from lvnav_trade.trajectory.ascent.vehicle_cards import STANDARD_GRAVITY, VehicleAscent

_CLIMB_AT_SEPARATION = math.radians(30.0)  # where the search for the kick starts
_SEA_LEVEL_PRESSURE = 101325.0  # Pa
_LOST = 1e6  # residual of an aim that is not finite
_SMALL = 1e-6  # norm of the scaled residuals that counts as solved: 10 mm, 1e-5 m/s, 1e-9 rad
_RESIDUAL = np.array([1e4, 10.0, 1e-2, 1e-3])  # m, m/s, rad, rad: residuals of one are about alike
_LONGEST = 3.0  # times a whole burn; longer burns are not integrated
_PATIENCE = 5  # unsuccessful kicks before a vehicle counts as too weak
# Payloads that are tried instead of a payload that is too heavy, over that payload
_PAYLOAD_FRACTIONS = (
    0.7,
    0.5,
    0.35,
    0.25,
    0.18,
    0.12,
    0.08,
    0.05,
    0.0,
)
_UNKNOWN = np.array([1e-3, 0.1, 0.1, 1.0])  # rad, tan, tan, s: so are steps of one


def solve(card: VehicleAscent) -> TargetingUnknowns:
    """Return the aim with which the vehicle reaches the card's orbit; InputError if it cannot.

    For a given kick there are four unknowns (azimuth, or yaw if that is prescribed; two of the tangent law; burn) and
    four conditions at the cut-off in orbit (radius, speed, flight-path angle, inclination). The kick is that of the
    card, or the kick with the shortest burn.
    """
    require_possible(card)
    if impulse_speed(card.vehicle, card.vehicle.payload) < _least_speed(card):
        _refuse_too_heavy(card)
    kick = _best_kick(card) if card.kick_angle is None else card.kick_angle
    solution = _reach(card, kick, _first_guess(card))
    aim = _aim(card, solution.x, kick)
    if np.linalg.norm(solution.fun) > _SMALL:
        _refuse_too_heavy(card)
    _require_converged(card, aim, solution)
    if card.parking is not None:
        aim = _raise_orbit(card, aim)
    _require_propellant(card, aim)
    return aim


def require_possible(card: VehicleAscent) -> None:
    """Raise InputError if a vehicle does not lift off, or the site cannot reach the inclination."""
    weight = lift_off_mass(card) * STANDARD_GRAVITY
    push = engine(card.vehicle, 1, 0.0, 0.0, 1.0)
    booster_thrust, _ = unthrottled_thrust(
        push.unthrottled_motors.reference_time, _SEA_LEVEL_PRESSURE, push.unthrottled_motors
    )
    thrust = push.thrust - _SEA_LEVEL_PRESSURE * push.exit_area + booster_thrust
    if thrust <= weight:
        raise InputError(
            f"{card.name}: the first stage does not lift off: {thrust / 1e3:.0f} kN of thrust at sea level, "
            f"{(weight - thrust) / 1e3:.0f} kN less than the weight"
        )
    # A site at latitude phi can reach the inclination i if |cos i| < cos phi.
    if abs(math.cos(card.target.inclination)) >= math.cos(card.site.latitude):
        inclination, latitude = math.degrees(card.target.inclination), math.degrees(card.site.latitude)
        highest_latitude = math.acos(min(1.0, abs(math.cos(card.target.inclination))))
        missing_angle = math.degrees(abs(card.site.latitude) - highest_latitude)
        raise InputError(
            f"{card.name}: an inclination of {inclination:.2f} deg cannot be reached from a latitude of {latitude:.2f} "
            f"deg without a turn of the plane: it misses by {missing_angle:.2f} deg"
        )


def _first_guess(card: VehicleAscent) -> Floats:
    """Return the initial values: azimuth (or yaw), tangents at both ends of the law, burn of the stage cut off."""
    azimuth = math.asin(math.cos(card.target.inclination) / math.cos(card.site.latitude))
    if card.target.direction == "descending":
        azimuth = math.pi - azimuth
    azimuth -= card.azimuth or 0.0
    stage = card.vehicle.stages[card.insertion_stage - 1]
    burn = 0.95 * stage.propellant * STANDARD_GRAVITY * stage.specific_impulse / stage.full_thrust
    burns_twice = card.parking is not None and card.insertion_stage == len(card.vehicle.stages)
    if burns_twice:
        burn = 0.8 * burn
    return np.array([azimuth, 0.5, -0.1, burn])


def _aim(card: VehicleAscent, x: Floats, kick: float) -> TargetingUnknowns:
    """Return the aim of the unknowns x: azimuth (or yaw, if the azimuth is prescribed), both tangents, burn."""
    first, tangent, tangent_end, burn = x.tolist()
    aim = TargetingUnknowns(first, kick, tangent, tangent_end, burn)
    if card.azimuth is None:
        return aim
    return aim._replace(azimuth=card.azimuth, yaw=first)


class InjectionPoint(NamedTuple):
    """Point at which an orbit is entered: radius (m), speed (m/s), flight-path angle (rad)."""

    radius: float
    speed: float
    climb: float = 0.0


def _residuals(y: Floats, entry: InjectionPoint, inclination: float) -> Floats:
    """Return the residuals (4,) of a state y (7,): radius (m), speed (m/s), flight-path angle, inclination (rad)."""
    r, v = y[:3], y[3:6]
    reached_inclination = float(elements_from_state(r, v).inclination)
    return np.array(
        [
            float(np.linalg.norm(r)) - entry.radius,
            float(np.linalg.norm(v)) - entry.speed,
            _climb(r, v) - entry.climb,
            reached_inclination - inclination,
        ]
    )


def _climb(r_i: Floats, v: Floats) -> float:
    """Return the flight-path angle (rad) of a velocity above the horizontal at a position."""
    lengths = np.linalg.norm(r_i) * np.linalg.norm(v)
    sine = float(r_i @ v) / float(lengths)
    return math.asin(max(-1.0, min(1.0, sine)))


def _orbital_speed(radius: float, perigee_radius: float, apogee_radius: float) -> float:
    """Return the speed (m/s) by the vis-viva equation, v^2 = GM (2 / r - 1 / a)."""
    major_axis = perigee_radius + apogee_radius
    return math.sqrt(GM * (2.0 / radius - 2.0 / major_axis))


def _apse(perigee: float, apogee: float, at_apogee: bool = False) -> InjectionPoint:
    """Return the perigee or apogee of an orbit given by its altitudes (m)."""
    low, high = SEMI_MAJOR + perigee, SEMI_MAJOR + apogee
    radius = high if at_apogee else low
    return InjectionPoint(radius, _orbital_speed(radius, low, high))


def injection_point(card: VehicleAscent) -> InjectionPoint:
    """Return the point of the target orbit at its card's true anomaly, or the perigee of the parking orbit."""
    orbit = card.target
    if card.parking is not None or orbit.anomaly == 0.0:
        return _apse((card.parking or orbit).perigee, orbit.apogee)
    low, high = SEMI_MAJOR + orbit.perigee, SEMI_MAJOR + orbit.apogee
    e = (high - low) / (high + low)
    # Horizontal and radial velocity at a true anomaly f are as 1 + e cos f to e sin f.
    horizontal = 1.0 + e * math.cos(orbit.anomaly)
    radial = e * math.sin(orbit.anomaly)
    radius = low * (1.0 + e) / horizontal
    return InjectionPoint(
        radius=radius,
        speed=_orbital_speed(radius, low, high),
        climb=math.atan2(radial, horizontal),
    )


def _reach(card: VehicleAscent, kick: float, guess: Floats, max_evaluations: int = 200) -> OptimizeResult:
    """Solve for azimuth, law and burn of an insertion; x of the result is in the units of `_aim`."""
    entry = injection_point(card)
    longest = _LONGEST * card.vehicle.stages[card.insertion_stage - 1].full_burn

    def miss(z: Floats) -> Floats:
        if not np.all(np.isfinite(z)):  # the iteration diverged
            return np.full(z.size, _LOST)
        aim = _aim(card, guess + z * _UNKNOWN, kick)
        excess = max(0.0, aim.burn - longest)  # a diverging iteration may have a burn of days
        flight = fly_ascent(card, aim._replace(burn=aim.burn - excess), final_coast=False)
        residuals = _residuals(flight.legs[-1].y[-1], entry, card.target.inclination) / _RESIDUAL
        return np.asarray(residuals + excess)

    result = root(miss, np.zeros(4), method="hybr", options={"xtol": 1e-12, "maxfev": max_evaluations})
    result.x = guess + result.x * _UNKNOWN
    return result


def _state_at(flight: SimulatedAscent, t: float) -> Floats:
    """Return the state y (7,) at the end of the leg that ends at time t."""
    return next(leg.y[-1] for leg in flight.legs if leg.t[-1] >= t)


def _best_kick(card: VehicleAscent) -> float:
    """Return the kick angle in rad that reaches the orbit with the shortest last burn."""
    guess = _first_guess(card)
    start = _moderate_kick(card, guess)
    failures = 0

    def burn(kick: float) -> float:
        nonlocal guess, failures
        result = _reach(card, kick, guess)
        if np.linalg.norm(result.fun) > _SMALL:
            failures += 1
            if failures == _PATIENCE:
                _refuse_too_heavy(card)
            return 1e6 * (1.0 + float(np.linalg.norm(result.fun)))
        guess = result.x
        failures = _PATIENCE  # after a success the vehicle is not too weak
        return float(result.x[3])

    bounds = (0.7 * start, 1.3 * start)
    best = minimize_scalar(burn, bounds=bounds, method="bounded", options={"xatol": 0.01 * start})
    return float(best.x)


def _moderate_kick(card: VehicleAscent, guess: Floats) -> float:
    """Return the kick angle (rad) for which the first stage separates at a moderate climb angle."""

    def excess_climb(kick: float) -> float:
        aim = _aim(card, np.array([*guess[:3], 0.0]), kick)
        flight = fly_ascent(card, aim, final_coast=False)
        y = _state_at(flight, flight.events["stage1_separation"])
        r_i, v_i = y[:3], y[3:6]
        return _climb(r_i, earth_velocity(r_i, v_i)) - _CLIMB_AT_SEPARATION

    angles = np.radians([0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0])
    climbs = [excess_climb(float(angle)) for angle in angles]
    for k in range(len(angles) - 1):
        if climbs[k] > 0.0 >= climbs[k + 1]:
            return float(brentq(excess_climb, angles[k], angles[k + 1], xtol=1e-4))
    return float(angles[np.argmin(np.abs(climbs))])


def _raise_orbit(card: VehicleAscent, aim: TargetingUnknowns) -> TargetingUnknowns:
    """Return the aim that cuts off at the parking perigee and a second time at the target's apogee.

    The given aim reaches the parking orbit for a spherical Earth after cut-off. Oblateness moves the apogee by some
    kilometres, so that both burns are solved together: six unknowns (all but the second tangent, which is level) and
    six conditions (radius and level flight at the first cut-off, the four of `_residuals` at the second).
    """
    assert card.parking is not None
    start = _second_burn(card, aim)
    first = start.azimuth if card.azimuth is None else start.yaw
    begin = np.array([first, start.tangent, start.tangent_end, start.burn])
    low = InjectionPoint(SEMI_MAJOR + card.parking.perigee, 0.0)
    high = _apse(card.target.perigee, card.target.apogee, at_apogee=True)

    def complete_aim(z: Floats) -> TargetingUnknowns:
        first_burn = _aim(card, begin + z[:4] * _UNKNOWN, aim.kick)
        return first_burn._replace(coast=start.coast + 10.0 * z[4], burn_2=start.burn_2 + z[5])

    def miss(z: Floats) -> Floats:
        if not np.all(np.isfinite(z)):
            return np.full(z.size, _LOST)
        flight = fly_ascent(card, complete_aim(z), final_coast=False)
        first_cutoff = _state_at(flight, flight.events[f"stage{card.insertion_stage}_cutoff"])
        first_residuals = _residuals(first_cutoff, low, 0.0) / _RESIDUAL
        last_residuals = _residuals(flight.legs[-1].y[-1], high, card.target.inclination) / _RESIDUAL
        return np.append(last_residuals, first_residuals[[0, 2]])

    result = root(miss, np.zeros(6), method="hybr", options={"xtol": 1e-12, "maxfev": 100})
    solution = complete_aim(result.x)
    _require_converged(card, solution, result)
    return solution


def _second_burn(card: VehicleAscent, aim: TargetingUnknowns) -> TargetingUnknowns:
    """Return the aim with coast and second burn of a Hohmann transfer, as initial values."""
    assert card.parking is not None
    stage = card.vehicle.stages[-1]
    mass = mass_above(card, card.insertion_stage)
    if card.insertion_stage == len(card.vehicle.stages):
        flight = fly_ascent(card, aim, final_coast=False)
        mass = float(flight.legs[-1].y[-1, 6])
    apogee = card.target.apogee
    target_speed = _apse(card.target.perigee, apogee, at_apogee=True).speed
    transfer_speed = _apse(card.parking.perigee, apogee, at_apogee=True).speed
    # Rocket equation: burn = (m exhaust / thrust) (1 - exp(-dv / exhaust))
    exhaust = stage.exhaust_speed
    speed_gain = target_speed - transfer_speed
    burn = mass * exhaust / stage.full_thrust * -math.expm1(-speed_gain / exhaust)
    a = SEMI_MAJOR + 0.5 * (card.parking.perigee + apogee)
    half_period = math.pi * math.sqrt(a**3 / GM)
    return aim._replace(coast=half_period - 0.5 * burn, burn_2=burn)


def _require_converged(card: VehicleAscent, aim: TargetingUnknowns, result: OptimizeResult) -> None:
    """Raise InputError, with the miss of the nearest solution, if the targeting has not converged."""
    if np.linalg.norm(result.fun) <= _SMALL:
        return
    residuals = np.asarray(result.fun) * _RESIDUAL[: len(result.fun)]
    raise InputError(
        f"{card.name}: no steering reaches the orbit: the nearest misses it by {abs(residuals[0]) / 1e3:.1f} km, "
        f"{abs(residuals[1]):.1f} m/s and {math.degrees(abs(residuals[2])):.2f} deg of flight-path angle "
        f"(kick {math.degrees(aim.kick):.2f} deg)"
    )


def propellant_left(card: VehicleAscent, aim: TargetingUnknowns, number: int) -> float:
    """Return the remaining usable propellant (kg) of a stage cut off in orbit; negative for a shortfall."""
    return flight_propellant_left(card, fly_ascent(card, aim, final_coast=False), number)


def flight_propellant_left(card: VehicleAscent, flight: SimulatedAscent, number: int) -> float:
    """Return the remaining usable propellant (kg), as `propellant_left`, of an ascent that is already simulated."""
    y = flight.legs[-1].y[-1]
    if number < len(card.vehicle.stages):
        y = _state_at(flight, flight.events[f"stage{number}_cutoff"])
    stage = card.vehicle.stages[number - 1]
    return float(y[6] - stage.dry - mass_above(card, number))


def _require_propellant(card: VehicleAscent, aim: TargetingUnknowns) -> None:
    """Raise InputError, with the missing delta-v, if an aim burns more propellant than available."""
    for number, stage in enumerate(card.vehicle.stages[card.insertion_stage - 1 :], start=card.insertion_stage):
        remaining = propellant_left(card, aim, number)
        if remaining >= 0.0:
            continue
        empty = stage.dry + mass_above(card, number)
        if empty + remaining <= 0.5 * empty:  # the final mass is unphysical, and no measure of the missing velocity
            _refuse_too_heavy(card)
        missing_speed = stage.exhaust_speed * math.log(empty / (empty + remaining))
        raise InputError(
            f"{card.name}: vehicle {card.vehicle.name!r} lacks {missing_speed:.0f} m/s of delta-v for the target "
            f"orbit: stage {stage.name!r} would need {-remaining:.0f} kg more propellant with the payload of "
            f"{card.vehicle.payload:.0f} kg"
        )


def _refuse_too_heavy(card: VehicleAscent) -> None:
    """Raise InputError, with the missing delta-v, if the payload is too heavy for the orbit.

    The largest payload that reaches the orbit is bracketed with the kick for a moderate climb. The shortfall is the
    difference of the ideal velocity gains with the two payloads. If even the vehicle without payload fails, a lower
    bound is computed from the energy of the orbit, without losses.
    """
    vehicle, payload = card.vehicle, card.vehicle.payload
    gain = impulse_speed(vehicle, payload)
    message_start = f"{card.name}: vehicle {vehicle.name!r} lacks "
    bracket = _bracket_payload(card)
    if bracket is None:
        missing_speed = _least_speed(card) - gain
        if missing_speed > 0.0:
            raise InputError(
                f"{message_start}at least {missing_speed:.0f} m/s of delta-v for the target orbit, losses not counted; "
                "no payload, however light, gets there"
            )
        return
    feasible_payload, infeasible_payload = bracket
    for _ in range(5):
        middle = 0.5 * (feasible_payload + infeasible_payload)
        if _reaches_orbit(card, middle):
            feasible_payload = middle
        else:
            infeasible_payload = middle
    missing_speed = impulse_speed(vehicle, feasible_payload) - gain
    raise InputError(
        f"{message_start}about {missing_speed:.0f} m/s of delta-v for the target orbit: it carries about "
        f"{feasible_payload:.0f} kg there, the payload is {payload:.0f} kg"
    )


def _bracket_payload(card: VehicleAscent) -> tuple[float, float] | None:
    """Return the largest payload (kg) of those tried that reaches the orbit, and the next larger; None for none."""
    larger = card.vehicle.payload
    for fraction in _PAYLOAD_FRACTIONS:
        payload = fraction * card.vehicle.payload
        if _reaches_orbit(card, payload):
            return payload, larger
        larger = payload
    return None


def _reaches_orbit(card: VehicleAscent, payload: float) -> bool:
    """Return whether the (first) orbit is reached with a payload (kg), within the propellant."""
    vehicle = card.vehicle.model_copy(update={"payload": payload})
    loaded_card = card.model_copy(update={"vehicle": vehicle})
    if impulse_speed(loaded_card.vehicle, payload) < _least_speed(loaded_card):
        return False
    guess = _first_guess(loaded_card)
    kick = loaded_card.kick_angle or _moderate_kick(loaded_card, guess)
    solution = _reach(loaded_card, kick, guess, 80)
    if not float(np.linalg.norm(solution.fun)) <= _SMALL:  # nor may it be NaN
        return False
    aim = _aim(loaded_card, solution.x, kick)
    return propellant_left(loaded_card, aim, loaded_card.insertion_stage) >= 0.0


def _least_speed(card: VehicleAscent) -> float:
    """Return the velocity gain (m/s) from the ground for the energy of the orbit, with the help of Earth rotation."""
    perigee = (card.parking or card.target).perigee
    a = SEMI_MAJOR + 0.5 * (perigee + card.target.apogee)
    surface_speed = math.sqrt(2.0 * GM / SEMI_MAJOR - GM / a)
    return surface_speed - OMEGA * SEMI_MAJOR * math.cos(card.target.inclination)
