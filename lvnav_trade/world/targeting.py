"""Solve the steering of an ascent for its target orbit, or say by how much the vehicle falls short."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, brentq, minimize_scalar, root

from lvnav_trade.errors import InputError
from lvnav_trade.frames import earth_velocity, elements_from_state
from lvnav_trade.kernels.earth import GM, SEMI_MAJOR
from lvnav_trade.world.ascent import Aim, fly_ascent, lift_off_mass
from lvnav_trade.world.vehicle import STANDARD_GRAVITY, VehicleAscent

Floats = NDArray[np.float64]

_CLIMB_AT_SEPARATION = math.radians(30.0)  # where the search for the kick starts
_SMALL = 1e-6  # norm of the scaled residuals that counts as solved: 10 mm, 1e-5 m/s, 1e-9 rad
_RESIDUAL = np.array([1e4, 10.0, 1e-2, 1e-3])  # m, m/s, rad, rad: residuals of one are about alike
_UNKNOWN = np.array([1e-3, 0.1, 0.1, 1.0])  # rad, tan, tan, s: so are steps of one


def solve(card: VehicleAscent) -> Aim:
    """Return the aim with which the vehicle reaches the card's orbit; InputError where it cannot.

    For a given kick four unknowns (azimuth, two of the tangent law, burn) meet four conditions at the last cut-off
    (radius, speed, level flight, inclination); the kick is the card's, or the one that needs the shortest burn.
    """
    _check(card)
    perigee = (card.parking or card.target).perigee
    kick = card.kick_angle
    if kick is None:
        kick = _best_kick(card, perigee, card.target.apogee)
    solution = _reach(card, kick, perigee, card.target.apogee, _first_guess(card))
    aim = _aim(solution.x, kick)
    _judge(card, aim, solution)
    if card.parking is not None:
        aim = _raise_orbit(card, aim)
    _judge_propellant(card, aim)
    return aim


def _check(card: VehicleAscent) -> None:
    """Refuse what no steering can mend."""
    first = card.vehicle.stages[0]
    weight = lift_off_mass(card) * STANDARD_GRAVITY
    thrust = first.thrust - 101325.0 * first.exit_area
    if thrust <= weight:
        raise InputError(
            f"{card.name}: the first stage does not lift off: {thrust / 1e3:.0f} kN of thrust at sea level, "
            f"{(weight - thrust) / 1e3:.0f} kN less than the weight"
        )
    if abs(math.cos(card.target.inclination)) >= math.cos(card.site.latitude):
        short = math.acos(min(1.0, abs(math.cos(card.target.inclination))))
        raise InputError(
            f"{card.name}: an inclination of {math.degrees(card.target.inclination):.2f} deg cannot be reached from a "
            f"latitude of {math.degrees(card.site.latitude):.2f} deg without a turn of the plane: it misses by "
            f"{math.degrees(abs(card.site.latitude) - short):.2f} deg"
        )


def _first_guess(card: VehicleAscent) -> Floats:
    """Return azimuth, tangent at the ends of the law, and last burn to start from."""
    azimuth = math.asin(math.cos(card.target.inclination) / math.cos(card.site.latitude))
    if card.target.direction == "descending":
        azimuth = math.pi - azimuth
    last = card.vehicle.stages[-1]
    burn = 0.95 * last.propellant * STANDARD_GRAVITY * last.specific_impulse / last.thrust
    return np.array([azimuth, 0.5, -0.1, burn if card.parking is None else 0.8 * burn])


def _aim(x: Floats, kick: float) -> Aim:
    return Aim(float(x[0]), kick, float(x[1]), float(x[2]), float(x[3]))


def _residuals(y: Floats, radius: float, speed: float, inclination: float) -> Floats:
    """Return what a state y (7,) has too much of radius, speed, flight-path angle and inclination, (4,)."""
    r, v = y[:3], y[3:6]
    length, pace = float(np.linalg.norm(r)), float(np.linalg.norm(v))
    climb = math.asin(max(-1.0, min(1.0, float(r @ v) / (length * pace))))
    return np.array([length - radius, pace - speed, climb, float(elements_from_state(r, v).inclination) - inclination])


def _insertion(card: VehicleAscent, aim: Aim, radius: float, speed: float) -> Floats:
    """Return the residuals (4,) at the last cut-off."""
    return _residuals(fly_ascent(card, aim, final_coast=False).legs[-1].y[-1], radius, speed, card.target.inclination)


def _apse(perigee: float, apogee: float, at_apogee: bool = False) -> tuple[float, float]:
    """Return radius (m) and speed (m/s) at perigee, or at apogee, of an orbit given by its altitudes."""
    low, high = SEMI_MAJOR + perigee, SEMI_MAJOR + apogee
    radius = high if at_apogee else low
    return radius, math.sqrt(GM * (2.0 / radius - 2.0 / (low + high)))


def _reach(card: VehicleAscent, kick: float, perigee: float, apogee: float, guess: Floats) -> OptimizeResult:
    """Solve for azimuth, law and burn of an insertion at perigee; x of the result is in the units of `_aim`."""
    radius, speed = _apse(perigee, apogee)

    def miss(z: Floats) -> Floats:
        return np.asarray(_insertion(card, _aim(guess + z * _UNKNOWN, kick), radius, speed) / _RESIDUAL)

    result = root(miss, np.zeros(4), method="hybr", options={"xtol": 1e-12, "maxfev": 200})
    result.x = guess + result.x * _UNKNOWN
    return result


def _best_kick(card: VehicleAscent, perigee: float, apogee: float) -> float:
    """Return the kick angle in rad that reaches the orbit with the shortest last burn."""
    guess = _first_guess(card)
    start = _kick_for_climb(card, guess)

    def burn(kick: float) -> float:
        nonlocal guess
        result = _reach(card, kick, perigee, apogee, guess)
        if np.linalg.norm(result.fun) > _SMALL:
            return 1e6 * (1.0 + float(np.linalg.norm(result.fun)))
        guess = result.x
        return float(result.x[3])

    best = minimize_scalar(burn, bounds=(0.7 * start, 1.3 * start), method="bounded", options={"xatol": 0.01 * start})
    return float(best.x)


def _kick_for_climb(card: VehicleAscent, guess: Floats) -> float:
    """Return the kick angle in rad after which the first stage is dropped at a middling climb angle."""

    def climb(kick: float) -> float:
        flight = fly_ascent(card, _aim(np.array([*guess[:3], 0.0]), kick), final_coast=False)
        t = flight.events["stage1_separation"]
        y = next(leg.y[-1] for leg in flight.legs if leg.t[-1] >= t)
        r, v = y[:3], earth_velocity(y[:3], y[3:6])
        sine = float(r @ v / (np.linalg.norm(r) * np.linalg.norm(v)))
        return math.asin(max(-1.0, min(1.0, sine))) - _CLIMB_AT_SEPARATION

    angles = np.radians([0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0])
    climbs = [climb(float(angle)) for angle in angles]
    for k in range(len(angles) - 1):
        if climbs[k] > 0.0 >= climbs[k + 1]:
            return float(brentq(climb, angles[k], angles[k + 1], xtol=1e-4))
    return float(angles[np.argmin(np.abs(climbs))])


def _raise_orbit(card: VehicleAscent, aim: Aim) -> Aim:
    """Return the aim that cuts off at the parking perigee and a second time at the target's apogee.

    The aim given reaches the parking orbit as if the Earth were a sphere from there on; its oblateness moves apogee by
    some kilometres, so both burns are solved together: six unknowns (all but the second tangent, which is level), six
    conditions (radius and level flight at the first cut-off, the four of `_insertion` at the second).
    """
    assert card.parking is not None
    start = _second_burn(card, aim)
    begin = np.array([start.azimuth, start.tangent, start.tangent_end, start.burn])
    low = SEMI_MAJOR + card.parking.perigee
    radius, speed = _apse(card.target.perigee, card.target.apogee, at_apogee=True)

    def full(z: Floats) -> Aim:
        first = _aim(begin + z[:4] * _UNKNOWN, aim.kick)
        return first._replace(coast=start.coast + 10.0 * z[4], burn_2=start.burn_2 + z[5])

    def miss(z: Floats) -> Floats:
        flight = fly_ascent(card, full(z), final_coast=False)
        cutoff = flight.events[f"stage{len(card.vehicle.stages)}_cutoff"]
        y = next(leg.y[-1] for leg in flight.legs if leg.t[-1] >= cutoff)
        return np.append(
            _residuals(flight.legs[-1].y[-1], radius, speed, card.target.inclination) / _RESIDUAL,
            _residuals(y, low, 0.0, 0.0)[[0, 2]] / _RESIDUAL[[0, 2]],
        )

    result = root(miss, np.zeros(6), method="hybr", options={"xtol": 1e-12, "maxfev": 100})
    _judge(card, full(result.x), result)
    return full(result.x)


def _second_burn(card: VehicleAscent, aim: Aim) -> Aim:
    """Return the aim with coast and second burn of a Hohmann transfer, to start from."""
    assert card.parking is not None
    stage = card.vehicle.stages[-1]
    exhaust = STANDARD_GRAVITY * stage.specific_impulse
    mass = float(fly_ascent(card, aim, final_coast=False).legs[-1].y[-1, 6])
    high = card.target.apogee
    gain = _apse(card.target.perigee, high, at_apogee=True)[1] - _apse(card.parking.perigee, high, at_apogee=True)[1]
    burn = mass * exhaust / stage.thrust * -math.expm1(-gain / exhaust)
    a = SEMI_MAJOR + 0.5 * (card.parking.perigee + high)
    return aim._replace(coast=math.pi * math.sqrt(a**3 / GM) - 0.5 * burn, burn_2=burn)


def _judge(card: VehicleAscent, aim: Aim, result: OptimizeResult) -> None:
    """Refuse an aim that misses the orbit."""
    if np.linalg.norm(result.fun) <= _SMALL:
        return
    missed = np.asarray(result.fun) * _RESIDUAL[: len(result.fun)]
    raise InputError(
        f"{card.name}: no steering reaches the orbit: the nearest misses it by {abs(missed[0]) / 1e3:.1f} km, "
        f"{abs(missed[1]):.1f} m/s and {math.degrees(abs(missed[2])):.2f} deg of flight-path angle "
        f"(kick {math.degrees(aim.kick):.2f} deg)"
    )


def propellant_left(card: VehicleAscent, aim: Aim) -> float:
    """Return the usable propellant of the last stage at injection, kg; negative where it was not enough."""
    mass = float(fly_ascent(card, aim, final_coast=False).legs[-1].y[-1, 6])
    return float(mass - card.vehicle.stages[-1].dry - card.vehicle.payload)


def _judge_propellant(card: VehicleAscent, aim: Aim) -> None:
    """Refuse an aim that burns more propellant than there is, with the missing delta-v."""
    left = propellant_left(card, aim)
    if left >= 0.0:
        return
    stage = card.vehicle.stages[-1]
    empty = stage.dry + card.vehicle.payload
    lacking = STANDARD_GRAVITY * stage.specific_impulse * math.log(empty / (empty + left))
    raise InputError(
        f"{card.name}: vehicle {card.vehicle.name!r} lacks {lacking:.0f} m/s of delta-v for the target orbit: stage "
        f"{stage.name!r} would need {-left:.0f} kg more propellant with the payload of {card.vehicle.payload:.0f} kg"
    )
