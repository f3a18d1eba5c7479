"""Off-nominal missions: an ascent of a dispersed vehicle with the steering of the nominal vehicle."""

import math

import numpy as np

from lvnav_trade.quantities.errors import InputError, Mistake
from lvnav_trade.trajectory.ascent.dispersion_card import Dispersion
from lvnav_trade.trajectory.ascent.legs import SimulatedAscent, TargetingUnknowns, fly_ascent, law_span
from lvnav_trade.trajectory.ascent.targeting import flight_propellant_left, require_possible, solve
from lvnav_trade.trajectory.ascent.vehicle_cards import Boosters, Stage, VehicleAscent

_EMPTY = 1e-6  # kg; less propellant counts as none
_GROUND = 1e3  # m below the start, because the Earth is not a sphere
_DEPLETION = 20  # largest number of corrections of the depletion time


def dispersed_ascent(card: VehicleAscent) -> tuple[VehicleAscent, TargetingUnknowns, SimulatedAscent]:
    """Return vehicle, aim and ascent of a card, dispersed if the card says so.

    With guidance the result is nominal, because vehicles differ between runs. InputError if the nominal vehicle does
    not reach the orbit, or the dispersed vehicle cannot fly.
    """
    aim = solve(card)
    if card.dispersion is None or card.guidance != "nominal":
        return card, aim, fly_ascent(card, aim)
    return fly_dispersed(card, aim, card.dispersion)


def fly_dispersed(
    card: VehicleAscent, aim: TargetingUnknowns, dispersion: Dispersion
) -> tuple[VehicleAscent, TargetingUnknowns, SimulatedAscent]:
    """Return the dispersed vehicle, its aim and its ascent.

    A stage cut off in orbit burns as long as the nominal stage, or until it is empty.

    Parameters
    ----------
    card : VehicleAscent
        Card of the nominal vehicle.
    aim : TargetingUnknowns
        Solution of the targeting for the nominal vehicle.
    dispersion : Dispersion
        Factors on thrust, specific impulse and masses, and error of the pitch programme.

    Raises
    ------
    InputError
        The dispersed vehicle is impossible, is empty too early, or falls to the ground.
    """
    vehicle = disperse_vehicle(card, dispersion)
    require_possible(vehicle)
    span = law_span(card, aim)
    aim = raise_pitch(aim, dispersion.pitch_program)
    last = len(card.vehicle.stages)
    burns_twice = card.parking is not None
    # With a parking orbit the last stage inserts by its second burn; an earlier stage inserts into the parking orbit.
    if not burns_twice or card.insertion_stage < last:
        aim = _limit_burn(vehicle, aim, span, card.insertion_stage, "burn")
    if burns_twice:
        aim = _limit_burn(vehicle, aim, span, last, "burn_2")
    flight = fly_ascent(vehicle, aim, span=span)
    _require_aloft(flight)
    return vehicle, aim, flight


def _require_aloft(flight: SimulatedAscent) -> None:
    """Raise InputError if the vehicle falls more than a kilometre below its start."""
    start_r = flight.legs[0].y[0, :3]
    start_radius = float(np.linalg.norm(start_r))
    for leg in flight.legs:
        radius = np.linalg.norm(leg.y[:, :3], axis=1)
        is_low = radius < start_radius - _GROUND
        if np.any(is_low):
            time = leg.t[np.argmax(is_low)]
            message = f"the dispersed vehicle falls to the ground {time:.0f} s after lift-off"
            raise InputError(records=[Mistake(message, "trajectory.dispersion")])


def disperse_vehicle(card: VehicleAscent, dispersion: Dispersion) -> VehicleAscent:
    """Return a vehicle card with dispersed thrust, specific impulse and masses; InputError for faults."""
    vehicle, fairing = card.vehicle, card.vehicle.fairing
    if fairing is not None:
        fairing = fairing.model_copy(update={"mass": fairing.mass * dispersion.mass})
    update = {
        "stages": tuple(_disperse_motor(stage, dispersion) for stage in vehicle.stages),
        "boosters": tuple(_disperse_motor(group, dispersion) for group in vehicle.boosters),
        "payload": vehicle.payload * dispersion.mass,
        "fairing": fairing,
    }
    dispersed_vehicle = vehicle.model_copy(update=update)
    for fault in dispersed_vehicle._faults():
        raise InputError(records=[Mistake(f"the dispersed vehicle cannot be flown: {fault}", "trajectory.dispersion")])
    return card.model_copy(update={"vehicle": dispersed_vehicle})


def _disperse_motor(motor: Stage | Boosters, dispersion: Dispersion) -> Stage | Boosters:
    update = {
        "specific_impulse": motor.specific_impulse * dispersion.specific_impulse,
        "dry": motor.dry * dispersion.mass,
    }
    if motor.thrust is not None:
        update["thrust"] = motor.thrust * dispersion.thrust
    if motor.burn_time is not None:
        update["burn_time"] = motor.burn_time * (dispersion.specific_impulse / dispersion.thrust)
    return motor.model_copy(update=update)


def raise_pitch(aim: TargetingUnknowns, angle: float) -> TargetingUnknowns:
    """Return an aim with the pitch programme raised by an angle (rad): less kick, and a law of more elevation."""
    if angle == 0.0:
        return aim
    return aim._replace(
        kick=aim.kick - angle,
        tangent=math.tan(math.atan(aim.tangent) + angle),
        tangent_end=math.tan(math.atan(aim.tangent_end) + angle),
    )


def _limit_burn(card: VehicleAscent, aim: TargetingUnknowns, span: float, number: int, burn: str) -> TargetingUnknowns:
    """Return the aim with the burn of a stage limited by its propellant.

    Parameters
    ----------
    card : VehicleAscent
        Card of the dispersed vehicle.
    aim : TargetingUnknowns
        Aim with the nominal burn.
    span : float
        Time scale of the steering law (s), from `law_span` of the nominal vehicle.
    number : int
        Number of the stage, from 1.
    burn : {"burn", "burn_2"}
        Field of the aim with the duration of the burn.

    Raises
    ------
    InputError
        The stage is empty before its ignition.
    """
    stage = card.vehicle.stages[number - 1]
    flow = stage.full_thrust / stage.exhaust_speed
    for _ in range(_DEPLETION):
        flight = fly_ascent(card, aim, final_coast=False, span=span)
        remaining = flight_propellant_left(card, flight, number)
        if remaining >= -_EMPTY:
            return aim
        limited_time = getattr(aim, burn) + remaining / flow
        if limited_time <= 0.0:
            break
        aim = aim._replace(**{burn: limited_time})
    message = f"stage {stage.name!r} of the dispersed vehicle is empty before it lights"
    raise InputError(records=[Mistake(message, "trajectory.dispersion")])
