"""Allan deviation of a case's IMUs: a simulated stream at rest, compared with the curve of the card."""

import math
from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.imu import allan
from lvnav_trade.imu.array import list_triads
from lvnav_trade.imu.error_model import AccelCard, GyroCard, ImuCard
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.random import seed_words
from lvnav_trade.kernels.transition import CONSTANT
from lvnav_trade.quantities.per_axis import rms
from lvnav_trade.quantities.records import Floats
from lvnav_trade.simulation.imu_sensing import sense
from lvnav_trade.simulation.preparation.imu_arrays import noise_sigmas
from lvnav_trade.simulation.preparation.imu_inputs import ImuTruth
from lvnav_trade.simulation.preparation.prepare import PreparedCase

_MIN_INTERVALS = 10  # intervals of the longest averaging time in the stream
_TIMES_PER_DECADE = 6

# Arrays of a run that the IMU kernels use, by the names that they read.
_Work = namedtuple("_Work", "run nav true_par true_tables increments remainder")


class Curve(NamedTuple):
    """Allan deviation of a sensor.

    sensor : Name of the sensor.
    unit : SI unit of the deviation.
    tau : (n,) s. Averaging times.
    stream : (n,). Of the simulated stream, root mean square over the axes.
    card : (n,). By the card, all processes.
    white : (n,). By the card, white noise and quantisation.
    instability : (n,). By the card, bias instability.
    walk : (n,). By the card, random walk.
    """

    sensor: str
    unit: str
    tau: Floats
    stream: Floats
    card: Floats
    white: Floats
    instability: Floats
    walk: Floats


@jit
def _collect(out: Any, work: Any, unit: Any, count: Any, key: Any) -> None:
    """Set the means of the IMU's output.

    Parameters
    ----------
    out
        (n, 6) rad/s and m/s^2. Set here.
    work
        Arrays of the run, `_Work`.
    unit
        ImuTruth of the IMU at rest.
    count
        Ticks of each mean.
    key
        (2,). Key words of the seed.
    """
    for k in range(out.shape[0]):
        sense(work, None, unit, None, k * count, count, key)
        for i in range(6):
            total = 0.0
            for tick in range(count):
                total += work.increments[tick, i]
            out[k, i] = total / (count * unit.dt)


def _imu_at_rest(prepared_case: PreparedCase, triad: int, card: ImuCard, n_tick: int) -> ImuTruth:
    """Return one IMU of the case at rest, with the error blocks of its triad and without warm-up and motion.

    Parameters
    ----------
    prepared_case
        Prepared case.
    triad
        Number of the triad.
    card
        Card of its IMU.
    n_tick
        Number of ticks.
    """
    unit = prepared_case.unit
    no_motion = np.zeros((n_tick, 3))
    blocks = unit.sensors // 2 == triad
    names = ("sigma", "decay", "walk", "sources", "drivers")
    parameters = {name: getattr(unit, name)[: blocks.size][blocks] for name in names}
    no_profiles = {name: getattr(unit, name)[:0] for name in ImuTruth._fields if name.startswith("profile")}
    return unit._replace(
        **parameters,
        **no_profiles,
        sensors=unit.sensors[blocks] % 2,
        dtheta=no_motion,
        dvel=no_motion,
        gravity=-1,
        is_drifting=True,
        white=noise_sigmas(card, unit.dt),
        biases_only=bool(np.all(parameters["drivers"] == CONSTANT)),
    )


def stream_at_rest(prepared_case: PreparedCase, triad: int, card: ImuCard, n_mean: int, seed: int) -> Floats:
    """Return the output of an IMU of a case at rest, as means over its process steps, (n_mean, 6) rad/s and m/s^2.

    Parameters
    ----------
    prepared_case
        Prepared case.
    triad
        Number of the triad.
    card
        Card of its IMU.
    n_mean
        Number of process steps.
    seed
        Seed of the draws.
    """
    unit = _imu_at_rest(prepared_case, triad, card, n_mean * prepared_case.unit.process_ticks)
    n_block = max(1, len(unit.sigma))
    work = _Work(
        run=np.zeros(1, dtype=np.uint64),
        nav=np.zeros(10),
        true_par=np.zeros((n_block, 3)),
        true_tables=np.zeros((2, processes.N_TABLE)),
        increments=np.zeros((unit.process_ticks, 6)),
        remainder=np.zeros(6),
    )
    words = seed_words(seed)
    processes.start(work.true_par, unit.sigma, unit.sources, *words, work.run[0])
    means = np.zeros((n_mean, 6))
    _collect(means, work, unit, unit.process_ticks, words)
    return means


def card_deviations(card: GyroCard | AccelCard, tau: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the Allan deviations by a card over tau (n,) s, root mean square of the axes.

    Returns
    -------
    white, instability, walk
        (n,) SI. White noise with quantisation, bias instability, random walk.

    Notes
    -----
    The quantisation remainder is uniform over a step and independent, which gives sqrt(3) times its sigma over tau.
    """
    white_noise = allan.white(rms(card.random_walk), tau)
    quantisation = 0.5 * card.quantisation / tau
    white = allan.combined_deviation(white_noise, quantisation)
    instability = np.zeros_like(tau)
    if card.flicker > 0.0 and card.instability_fit is not None:
        instability = np.full_like(tau, card.flicker * allan.FLOOR)
    elif card.flicker > 0.0:
        instability = allan.gauss_markov(card.instability, tau)
    walk = allan.random_walk(rms(card.rate_random_walk), tau)
    return white, instability, walk


def allan_curves(prepared_case: PreparedCase, seconds: float, seed: int) -> tuple[Curve, ...]:
    """Return the Allan deviations of gyros and accelerometers of every IMU of a case, from a simulated stream.

    Parameters
    ----------
    prepared_case
        Prepared case.
    seconds
        s. Length of the stream; no curve is returned if it is too short for one averaging time.
    seed
        Seed of the draws.
    """
    dt = prepared_case.unit.dt * prepared_case.unit.process_ticks
    n_mean = math.floor(seconds / dt)
    longest = n_mean // _MIN_INTERVALS
    if longest < 1:
        return ()
    count = max(2, math.ceil(_TIMES_PER_DECADE * math.log10(max(longest, 2))))
    factors = np.unique(np.rint(np.geomspace(1, longest, count)).astype(np.int64)).tolist()
    tau = dt * np.array(factors, dtype=float)
    curves = []
    for triad, card, name in _triad_cards(prepared_case):
        means = stream_at_rest(prepared_case, triad, card, n_mean, seed)
        for columns, label, sensor, unit in (
            (slice(0, 3), "gyro", card.gyro, "rad/s"),
            (slice(3, 6), "accelerometer", card.accel, "m/s^2"),
        ):
            axis_deviations = allan.overlapping(means[:, columns], dt, factors)
            white, instability, walk = card_deviations(sensor, tau)
            curve = Curve(
                sensor=f"{name}{label}",
                unit=unit,
                tau=tau,
                stream=np.sqrt(np.mean(axis_deviations**2, axis=1)),
                card=allan.combined_deviation(white, instability, walk),
                white=white,
                instability=instability,
                walk=walk,
            )
            curves.append(curve)
    return tuple(curves)


def _triad_cards(prepared_case: PreparedCase) -> list[tuple[int, ImuCard, str]]:
    """Return number, card and prefix of the name of every triad of IMU axes."""
    imu = prepared_case.scenario.imu
    if isinstance(imu, ImuCard):
        return [(0, imu, "")]
    cards: list[tuple[int, ImuCard, str]] = []
    for k, triad in enumerate(list_triads(imu)):
        card = imu.units[triad.unit]
        cards.append((k, card, f"unit {triad.unit + 1} "))
    return cards
