"""Missions of a turning launcher: runs on keyed draws, the same for every way of feeding the controller."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.envelope import EnvelopeCard, changing, steady_ratio
from lvnav_trade.kernels.random import seed_words
from lvnav_trade.per_axis import rms
from lvnav_trade.records import Floats, Ints
from lvnav_trade.world.control import loop
from lvnav_trade.world.control.ascent import Ascent, Body, body_along, changes
from lvnav_trade.world.control_cards import ControllerCard, FeedbackCard, RotationCard, WindCard, rate_noise
from lvnav_trade.world.sensors.imu import ImuCard

_RATES = {"true": loop.TRUE, "raw": loop.RAW, "filtered": loop.FILTERED}


class Launch(NamedTuple):
    """What is common to all missions of a vehicle: its path with wind, and cards."""

    body: Body
    phase: Ints
    rotation: RotationCard
    controller: ControllerCard
    wind: WindCard
    imu: ImuCard
    envelope: EnvelopeCard


class Missions(NamedTuple):
    """Runs of one way of feeding the controller; axes are pitch and yaw.

    t (n_record,) s; history (n_run, n_record, 2, N_RECORD) by the columns of `loop`; movement (n_run, 2) total
    of the nozzles' movement, rad; sums (n_run, 2, N_PHASE, N_SUM).
    """

    t: Floats
    history: Floats
    movement: Floats
    sums: Floats


def prepare_launch(
    ascent: Ascent,
    rotation: RotationCard,
    controller: ControllerCard,
    wind: WindCard,
    imu: ImuCard,
    envelope: EnvelopeCard | None = None,
) -> Launch:
    """Return a launch on the ticks of the inertial unit; InputError where the cards do not fit the vehicle."""
    envelope = envelope or EnvelopeCard()
    body = body_along(ascent, rotation, controller, wind, imu.rate)
    phase = np.where(body.motor > 0, loop.BURN, loop.COAST)
    phase[changing(envelope, body.t, changes(ascent.trajectory))] = loop.CHANGE
    return Launch(body, phase.astype(np.int64), rotation, controller, wind, imu, envelope)


def with_rate_gain(launch: Launch, factor: float) -> Launch:
    """Return the launch with the rate gain of every stage times a factor."""
    gains = tuple(one.model_copy(update={"rate": one.rate * factor}) for one in launch.controller.gains)
    return launch._replace(controller=launch.controller.model_copy(update={"gains": gains}))


def fly_missions(
    launch: Launch, feedback: FeedbackCard, runs: int, seed: int = 1, every: int = 200, first_run: int = 0
) -> Missions:
    """Return runs of a launch; draws depend on seed and run alone, so two ways of feeding meet the same ones.

    `every` is the number of ticks from record to record.
    """
    n_tick = launch.body.t.size - 1
    history = np.zeros((runs, (n_tick - 1) // every + 1, 2, loop.N_RECORD))
    sums = np.zeros((runs, 2, loop.N_PHASE, loop.N_SUM))
    movement = np.empty((runs, 2))
    k0, k1 = seed_words(seed)
    envelope = loop.CommandedEnvelope(*(getattr(launch.envelope, name) for name in loop.CommandedEnvelope._fields))
    settings = loop.Settings(
        _plant(launch.rotation), _law(launch), _feed(launch, feedback), envelope, launch.wind.spread
    )
    for n in range(runs):
        draws = loop.Draws(k0, k1, np.uint64(first_run + n))
        movement[n] = loop.fly_run(launch.body, launch.phase, settings, draws, every, history[n], sums[n])
    return Missions(launch.body.t[:n_tick:every], history, movement, sums)


def _plant(card: RotationCard) -> loop.Plant:
    nozzle, thrusters = card.nozzle, card.thrusters
    return loop.Plant(
        nozzle.time_constant,
        nozzle.rate_limit,
        nozzle.deflection_limit,
        nozzle.misalignment,
        thrusters.dead_band,
        thrusters.lead,
        thrusters.release,
    )


def _law(launch: Launch) -> loop.Law:
    card, rate = launch.controller, launch.imu.rate
    gains = np.array([[one.attitude, one.rate, one.integral] for one in card.gains])
    guide = card.guidance
    if guide is None:
        return loop.Law(gains, card.command_time, 0, 1, 1.0, 0.0, 0.0, 0.0)
    ticks = max(1, round(guide.period * rate))
    return loop.Law(
        gains,
        card.command_time,
        guide.from_stage,
        ticks,
        guide.time,
        guide.limit,
        guide.velocity_sigma,
        guide.command_sigma,
    )


def _feed(launch: Launch, card: FeedbackCard) -> loop.Feed:
    """Return the settings of sensing; the steady filter of the gyro's random walk weighs the attitude reference."""
    noise = rate_noise(launch.imu, card.noise)
    ticks = max(1, round(launch.imu.rate / card.reference_rate))
    driving = ticks * (noise / launch.imu.rate) ** 2
    gain = steady_ratio(driving, card.reference_sigma**2) if card.reference_sigma > 0.0 else 1.0
    bias = 0.0 if card.noise == "none" else rms(launch.imu.gyro.bias_repeatability)
    navigated = card.attitude == "navigation"
    start = math.sqrt(gain) * card.reference_sigma if navigated else 0.0
    return loop.Feed(_RATES[card.rate], navigated, noise, bias, card.reference_sigma, ticks, gain, start)
