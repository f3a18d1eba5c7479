"""The vehicle and the day of one run: spreads of the vehicle card times draws, and the vehicle that they make."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.random import normals, seed_words, source_word
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.dispersion import dispersed
from lvnav_trade.trajectory.ascent.dispersion_card import SOURCES, DispersionsCard
from lvnav_trade.trajectory.ascent.vehicle_cards import Boosters, Stage, VehicleAscent
from lvnav_trade.trajectory.guided.guided_dynamics import Wind

NO_RUN = -1  # number that stands for a vehicle of which nothing is drawn
WIND_STEP, WIND_TOP = 500.0, 30e3
"""Metres between heights of the wind, and above which there is none: the air there is a hundredth of that at sea level.
"""
_LEAST = 0.5  # factor on a vehicle's number below which no draw takes it
Sigmas = Mapping[str, Floats]
"""Draws in sigmas by the name of the source, each (n,) as of `numbers`; a source that is missing is not dispersed."""


class Deviations(NamedTuple):
    """What differs in a run, apart from the numbers of the vehicle.

    wind : Wind over height.
    misalignment : (n_stage, 2) rad. Of the thrust of each stage, down and to the right.
    separation : (n_stage,) m/s. Speed along the thrust that the separation of each stage adds.
    tail_off : m/s. Speed along the thrust that is gained after the last cut-off.
    """

    wind: Wind
    misalignment: Floats
    separation: Floats
    tail_off: float


def numbers(card: VehicleAscent) -> dict[str, int]:
    """Return how many independent draws each source has."""
    n_stage = len(card.vehicle.stages)
    n_motor, n_height = n_stage + len(card.vehicle.boosters), round(WIND_TOP / WIND_STEP) + 1
    once = dict.fromkeys(("drag", "density", "tail_off"), 1)
    each = dict.fromkeys(("thrust", "specific_impulse", "propellant", "dry_mass"), n_motor)
    between = {"separation_impulse": n_stage - 1, "ignition_delay": n_stage - 1}
    return {**each, **once, **between, "wind": 2 * n_height, "thrust_misalignment": 2 * n_stage}


def draw(card: VehicleAscent, seed: int, run: int) -> dict[str, Floats]:
    """Return the draws (in sigmas) of a run: those of `dispersion.draw`, and the fixed ones of `dispersion.sigmas`.

    Of a negative run the fixed ones alone.
    """
    how, spreads = card.dispersion, card.vehicle.dispersions
    if how is None or spreads is None:
        return {}
    k0, k1 = seed_words(seed)
    found: dict[str, Floats] = {}
    for name in SOURCES:
        n = numbers(card)[name]
        if run >= 0 and name in how.drawn and getattr(spreads, name) > 0.0:
            word = source_word(f"vehicle {name}")
            found[name] = np.array(
                [normals(k0, k1, word, np.uint64(run), np.uint64(0), np.uint64(k))[0] for k in range(n)]
            )
        if name in how.sigmas:
            found[name] = found.get(name, np.zeros(n)) + how.sigmas[name]
    return found


def vehicle_of(card: VehicleAscent, sigmas: Sigmas) -> VehicleAscent:
    """Return the card of the vehicle that is flown: fixed factors of the dispersion, then draws."""
    if card.dispersion is not None and card.dispersion.is_common:
        card = dispersed(card, card.dispersion)
    spreads, vehicle = card.vehicle.dispersions, card.vehicle
    if spreads is None or not sigmas:
        return card
    n_stage = len(vehicle.stages)
    late = np.concatenate([[0.0], sigmas.get("ignition_delay", np.zeros(n_stage - 1)) * spreads.ignition_delay])
    stages = []
    for k, stage in enumerate(vehicle.stages):
        motor = _motor(stage, spreads, sigmas, k)
        stages.append(motor.model_copy(update={"ignition_delay": max(0.0, stage.ignition_delay + float(late[k]))}))
    groups = [_motor(group, spreads, sigmas, n_stage + k) for k, group in enumerate(vehicle.boosters)]
    air = _factor(spreads, sigmas, "drag", 0) * _factor(spreads, sigmas, "density", 0)
    update = {
        "stages": tuple(stages),
        "boosters": tuple(groups),
        "drag_coefficient": tuple(one * air for one in vehicle.drag_coefficient),
    }
    return card.model_copy(update={"vehicle": vehicle.model_copy(update=update)})


def _factor(spreads: DispersionsCard, sigmas: Sigmas, name: str, k: int) -> float:
    if name not in sigmas:
        return 1.0
    return max(_LEAST, 1.0 + float(sigmas[name][k]) * float(getattr(spreads, name)))


def density_of(card: VehicleAscent, sigmas: Sigmas) -> float:
    """Return the factor on the density of the air of a run."""
    spreads = card.vehicle.dispersions
    return 1.0 if spreads is None else _factor(spreads, sigmas, "density", 0)


def _motor(motor: Stage | Boosters, spreads: DispersionsCard, sigmas: Sigmas, k: int) -> Stage | Boosters:
    thrust, impulse, load, dry = (
        _factor(spreads, sigmas, name, k) for name in ("thrust", "specific_impulse", "propellant", "dry_mass")
    )
    update = {
        "specific_impulse": motor.specific_impulse * impulse,
        "propellant": motor.propellant * load,
        "dry": motor.dry * dry,
    }
    if motor.thrust is not None:
        update["thrust"] = motor.thrust * thrust
    if motor.burn_time is not None:
        update["burn_time"] = motor.burn_time * (load * impulse / thrust)
    return motor.model_copy(update=update)


def deviations(card: VehicleAscent, sigmas: Sigmas) -> Deviations:
    """Return what differs beside the vehicle, by the draws of a run."""
    spreads, n_stage = card.vehicle.dispersions, len(card.vehicle.stages)

    def of(name: str) -> Floats:
        return sigmas.get(name, np.zeros(numbers(card)[name])) * float(getattr(spreads, name, 0.0))

    return Deviations(
        wind_of(sigmas.get("wind"), spreads),
        of("thrust_misalignment").reshape(n_stage, 2),
        np.concatenate([of("separation_impulse"), [0.0]]),
        float(of("tail_off")[0]),
    )


def wind_of(sigmas: Floats | None, spreads: DispersionsCard | None) -> Wind:
    """Return the wind of draws (2 n_height,): a Gauss-Markov process over height, stationary from the ground on."""
    if sigmas is None or spreads is None:
        return Wind(WIND_STEP, np.zeros((1, 2)))
    white, speed = sigmas.reshape(-1, 2), np.empty((len(sigmas) // 2, 2))
    keep = np.exp(-WIND_STEP / spreads.wind_length)
    speed[0] = white[0]
    for k in range(1, len(speed)):
        speed[k] = keep * speed[k - 1] + np.sqrt(1.0 - keep * keep) * white[k]
    return Wind(WIND_STEP, speed * spreads.wind)
