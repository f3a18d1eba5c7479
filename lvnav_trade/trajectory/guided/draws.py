"""Vehicle and wind of one run: draws, times the dispersions of the vehicle card."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.random import normals, seed_words, source_word
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.dispersion import disperse_vehicle
from lvnav_trade.trajectory.ascent.dispersion_card import SOURCES, DispersionsCard
from lvnav_trade.trajectory.ascent.vehicle_cards import Boosters, Stage, VehicleAscent
from lvnav_trade.trajectory.guided.guided_dynamics import Wind

NO_RUN = -1  # number of a run without random draws
WIND_STEP, WIND_TOP = 500.0, 30e3
"""Metres between heights of the wind, and above which there is none: the air there is a hundredth of that at sea level.
"""
_LEAST = 0.5  # factor on a vehicle's number below which no draw takes it
Sigmas = Mapping[str, Floats]
"""Draws in sigmas by the name of the source, each (n,) as of `numbers`; a source that is missing is not dispersed."""


class Deviations(NamedTuple):
    """Deviations of a run, apart from the numbers of the vehicle.

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
    """Return the number of independent draws of each source."""
    n_stage = len(card.vehicle.stages)
    n_motor = n_stage + len(card.vehicle.boosters)
    n_height = round(WIND_TOP / WIND_STEP) + 1
    return {
        "thrust": n_motor,
        "specific_impulse": n_motor,
        "propellant": n_motor,
        "dry_mass": n_motor,
        "drag": 1,
        "density": 1,
        "tail_off": 1,
        "separation_impulse": n_stage - 1,
        "ignition_delay": n_stage - 1,
        "wind": 2 * n_height,
        "thrust_misalignment": 2 * n_stage,
    }


def draw(card: VehicleAscent, seed: int, run: int) -> dict[str, Floats]:
    """Return the draws of a run, in sigmas by the name of the source.

    They are the sum of random draws (`dispersion.drawn_sources`) and fixed deviations (`dispersion.sigmas`).

    Parameters
    ----------
    card : VehicleAscent
        Card with the dispersions; the result is empty without them.
    seed : int
        Seed of the draws.
    run : int
        Number of the run. A negative run has the fixed deviations alone.
    """
    dispersion, spreads = card.dispersion, card.vehicle.dispersions
    if dispersion is None or spreads is None:
        return {}
    sigmas: dict[str, Floats] = {}
    for name in SOURCES:
        n_draw = numbers(card)[name]
        if run >= 0 and name in dispersion.drawn_sources and getattr(spreads, name) > 0.0:
            sigmas[name] = _standard_normals(name, n_draw, seed, run)
        if name in dispersion.sigmas:
            random_sigmas = sigmas.get(name, np.zeros(n_draw))
            sigmas[name] = random_sigmas + dispersion.sigmas[name]
    return sigmas


def _standard_normals(name: str, n_draw: int, seed: int, run: int) -> Floats:
    """Return the standard normals (n_draw,) of a source in a run, which depend on name, seed and run alone."""
    k0, k1 = seed_words(seed)
    word = source_word(f"vehicle {name}")
    values = []
    for k in range(n_draw):
        first, _, _, _ = normals(k0, k1, word, np.uint64(run), np.uint64(0), np.uint64(k))
        values.append(first)
    return np.array(values)


def run_vehicle(card: VehicleAscent, sigmas: Sigmas) -> VehicleAscent:
    """Return the card of the vehicle of a run: fixed factors of the dispersion, then draws."""
    if card.dispersion is not None and card.dispersion.is_common:
        card = disperse_vehicle(card, card.dispersion)
    spreads, vehicle = card.vehicle.dispersions, card.vehicle
    if spreads is None or not sigmas:
        return card
    n_stage = len(vehicle.stages)
    upper_delays = sigmas.get("ignition_delay", np.zeros(n_stage - 1)) * spreads.ignition_delay
    delays = np.concatenate([[0.0], upper_delays])  # the first stage lights at lift-off
    stages = []
    for k, stage in enumerate(vehicle.stages):
        motor = _disperse_motor(stage, spreads, sigmas, k)
        ignition_delay = max(0.0, stage.ignition_delay + float(delays[k]))
        stages.append(motor.model_copy(update={"ignition_delay": ignition_delay}))
    boosters = []
    for k, group in enumerate(vehicle.boosters):
        boosters.append(_disperse_motor(group, spreads, sigmas, n_stage + k))
    # Drag is proportional to the product of coefficient and density.
    coefficient_factor = _factor(spreads, sigmas, "drag", 0)
    density_factor = _factor(spreads, sigmas, "density", 0)
    drag_factor = coefficient_factor * density_factor
    update = {
        "stages": tuple(stages),
        "boosters": tuple(boosters),
        "drag_coefficient": tuple(coefficient * drag_factor for coefficient in vehicle.drag_coefficient),
    }
    return card.model_copy(update={"vehicle": vehicle.model_copy(update=update)})


def _factor(spreads: DispersionsCard, sigmas: Sigmas, name: str, k: int) -> float:
    """Return the factor by which a draw of a source multiplies a number of the vehicle, at least `_LEAST`.

    spreads : sigma of each source, as a fraction of the number
    sigmas : draws; the factor is 1 for a source without draws
    name, k : source, and index of its draw
    """
    if name not in sigmas:
        return 1.0
    deviation = float(sigmas[name][k]) * float(getattr(spreads, name))
    return max(_LEAST, 1.0 + deviation)


def air_density_factor(card: VehicleAscent, sigmas: Sigmas) -> float:
    """Return the factor on the density of the air of a run."""
    spreads = card.vehicle.dispersions
    return 1.0 if spreads is None else _factor(spreads, sigmas, "density", 0)


def _disperse_motor(motor: Stage | Boosters, spreads: DispersionsCard, sigmas: Sigmas, k: int) -> Stage | Boosters:
    """Return a motor with its draws.

    k : index of the motor: stages first, then groups of boosters
    """
    thrust = _factor(spreads, sigmas, "thrust", k)
    impulse = _factor(spreads, sigmas, "specific_impulse", k)
    propellant = _factor(spreads, sigmas, "propellant", k)
    dry_mass = _factor(spreads, sigmas, "dry_mass", k)
    update = {
        "specific_impulse": motor.specific_impulse * impulse,
        "propellant": motor.propellant * propellant,
        "dry": motor.dry * dry_mass,
    }
    if motor.thrust is not None:
        update["thrust"] = motor.thrust * thrust
    if motor.burn_time is not None:
        # thrust x burn time = propellant x specific impulse
        update["burn_time"] = motor.burn_time * (propellant * impulse / thrust)
    return motor.model_copy(update=update)


def deviations(card: VehicleAscent, sigmas: Sigmas) -> Deviations:
    """Return the deviations of a run, apart from those of the vehicle's numbers, by its draws."""
    spreads, n_stage = card.vehicle.dispersions, len(card.vehicle.stages)
    n_draw = numbers(card)
    size = {}
    for name in ("thrust_misalignment", "separation_impulse", "tail_off"):
        size[name] = sigmas.get(name, np.zeros(n_draw[name])) * float(getattr(spreads, name, 0.0))
    return Deviations(
        wind=run_wind(sigmas.get("wind"), spreads),
        misalignment=size["thrust_misalignment"].reshape(n_stage, 2),
        separation=np.concatenate([size["separation_impulse"], [0.0]]),
        tail_off=float(size["tail_off"][0]),
    )


def run_wind(sigmas: Floats | None, spreads: DispersionsCard | None) -> Wind:
    """Return the wind of a run: a Gauss-Markov process over height for each component, stationary from the ground on.

    sigmas : (2 n_height,). Draws of both components, height by height from the ground; None: no wind.
    """
    if sigmas is None or spreads is None:
        return Wind(WIND_STEP, np.zeros((1, 2)))
    white = sigmas.reshape(-1, 2)
    n_height = len(sigmas) // 2
    speed = np.empty((n_height, 2))
    decay = np.exp(-WIND_STEP / spreads.wind_length)
    noise_sigma = np.sqrt(1.0 - decay * decay)
    speed[0] = white[0]
    for k in range(1, len(speed)):
        noise = noise_sigma * white[k]
        speed[k] = decay * speed[k - 1] + noise
    return Wind(WIND_STEP, speed * spreads.wind)
