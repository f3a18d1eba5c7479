"""A vehicle under attitude control made ready for its runs, and runs of its nominal mission on keyed draws."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.kernels.random import seed_words
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.per_axis import rms
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.shared_cards import EnvelopeCard, steady_ratio
from lvnav_trade.trajectory.control_cards import (
    ControllerCard,
    FeedbackCard,
    RotationCard,
    Stack,
    SteeredCard,
    WindCard,
    rate_noise,
)
from lvnav_trade.trajectory.guided import autopilot, loop
from lvnav_trade.trajectory.guided.course import SolvedAscent, course_along
from lvnav_trade.trajectory.guided.draws import deviations
from lvnav_trade.trajectory.guided.guided_dynamics import PERFECT, Wind
from lvnav_trade.trajectory.guided.pilots import TurningPilot
from lvnav_trade.trajectory.guided.turning import AttitudeControl, Gusts, RotationalModel

_RATES = {"true": autopilot.TRUE, "raw": autopilot.RAW, "filtered": autopilot.FILTERED}
_AIR_STEP = 50.0  # m between the heights of wind and gusts
_ONCE = 1 << 40  # ticks from record to record of a run that keeps none
STILL = WindCard.model_construct(
    name="still air",
    source="",
    height=(0.0, 1.0),
    speed=(0.0, 0.0),
    direction=0.0,
    spread=0.0,
    gust=(0.0, 0.0),
    gust_length=(1.0, 1.0),
)


class Launch(NamedTuple):
    """What is common to all missions of a vehicle: its ascent, the attitude that is commanded on it, and cards."""

    ascent: SolvedAscent
    course: autopilot.CommandedAttitude
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
    ascent: SolvedAscent,
    rotation: RotationCard,
    controller: ControllerCard,
    wind: WindCard,
    imu: ImuCard,
    envelope: EnvelopeCard | None = None,
) -> Launch:
    """Return a launch on the ticks of the inertial unit.

    InputError where a card has not as many stacks or gains as the vehicle has stages, or a turn starts at no event.
    """
    envelope, n_stage = envelope or EnvelopeCard(), len(ascent.card.vehicle.stages)
    for owner, name, held in ((rotation, "stacks", rotation.stacks), (controller, "gains", controller.gains)):
        if len(held) != n_stage:
            raise InputError(f"{owner.name}: {len(held)} {name}, {ascent.card.vehicle.name} has {n_stage} stages")
    course = course_along(ascent, controller, envelope, imu.rate)
    return Launch(ascent, course, rotation, controller, wind, imu, envelope)


def launch_along(ascent: SolvedAscent, card: SteeredCard) -> Launch:
    """Return the launch of an ascent that a card steers."""
    wind = card.wind or STILL
    return prepare_launch(ascent, card.rotation, card.controller, wind, card.imu, card.envelope)


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
    n_tick = launch.course.t.size - 1
    history = np.zeros((runs, (n_tick - 1) // every + 1, 2, autopilot.N_RECORD))
    sums = np.zeros((runs, 2, autopilot.N_PHASE, autopilot.N_SUM))
    movement = np.empty((runs, 2))
    for n in range(runs):
        draws = autopilot.DrawKeys(*seed_words(seed), np.uint64(first_run + n))
        control = fly_mission(launch, feedback, draws, every).turning.control
        history[n], sums[n], movement[n] = control.history, control.sums, loop.movement(control)
    return Missions(launch.course.t[:n_tick:every], history, movement, sums)


def fly_mission(
    launch: Launch, feedback: FeedbackCard, draws: autopilot.DrawKeys, every: int, path: bool = False
) -> TurningPilot:
    """Return the pilot of one run, who has flown it; path: whether its state at every record is kept."""
    ascent = launch.ascent
    turning = turning_of(launch, feedback, draws, every, path)
    differs = deviations(ascent.plan.card, {})
    differs = differs._replace(wind=wind_of_launch(launch, draws, differs.wind))
    pilot = TurningPilot(ascent.plan, ascent.card, differs, PERFECT, turning)
    pilot.fly_nominal()
    return pilot


def turning_of(
    launch: Launch,
    feedback: FeedbackCard,
    draws: autopilot.DrawKeys,
    every: int = _ONCE,
    path: bool = False,
    by_run: bool = False,
    density: float = 1.0,
) -> AttitudeControl:
    """Return what one run of a launch is flown with.

    Parameters
    ----------
    launch : Launch
    feedback : What feeds the controller.
    draws : What the draws of the run depend on.
    every : Ticks from record to record.
    path : Whether the true state at every tick is recorded.
    by_run : Whether the navigation of the controller is that of the run, and not one of its own.
    density : Factor on the density of the air.
    """
    control = control_of(launch, feedback, draws, every)
    feed, n_tick, rotation = control.settings.feed, launch.course.t.size - 1, launch.rotation
    if by_run and feed.attitude == autopilot.MODELLED:
        feed = feed._replace(attitude=autopilot.OF_THE_RUN)
        control = control._replace(settings=control.settings._replace(feed=feed))
    stacks = np.array([_numbers(one) for one in rotation.stacks])
    craft = RotationalModel(stacks, density, rotation.thrusters.force * rotation.thrusters.arm)
    return AttitudeControl(control, craft, _gusts(launch.wind), np.zeros((n_tick if path else 0, 7)))


def _numbers(stack: Stack) -> tuple[float, float, float, float]:
    """Return a row of `RotationalModel.stacks`."""
    length = stack.length
    return (stack.gyration * length) ** 2, stack.nozzle_arm * length, stack.normal_force, stack.pressure_arm * length


def control_of(
    launch: Launch, feedback: FeedbackCard, draws: autopilot.DrawKeys, every: int = _ONCE
) -> autopilot.ControlledAttitude:
    """Return the controlled attitude of one run at lift-off."""
    n_record = (launch.course.t.size - 2) // every + 1
    envelope = autopilot.CommandedEnvelope(
        *(getattr(launch.envelope, name) for name in autopilot.CommandedEnvelope._fields)
    )
    control = autopilot.ControlledAttitude(
        launch.course,
        autopilot.AutopilotSettings(_plant(launch.rotation), _law(launch), _feed(launch, feedback), envelope),
        draws,
        np.zeros((2, loop.N_MEMORY)),
        np.zeros(autopilot.N_COUNT, dtype=np.int64),
        every,
        np.zeros((n_record, 2, autopilot.N_RECORD)),
        np.zeros((2, autopilot.N_PHASE, autopilot.N_SUM)),
    )
    loop.begin(control)
    return control


def _heights(card: WindCard) -> Floats:
    return np.arange(0.0, card.height[-1] + _AIR_STEP, _AIR_STEP)


def _gusts(card: WindCard) -> Gusts:
    """Return the gusts of a card on even heights; there are none above its highest one."""
    height = _heights(card)
    sigma = np.interp(height, card.height, card.gust, right=0.0)
    return Gusts(_AIR_STEP, np.append(sigma, 0.0), np.interp(np.append(height, np.inf), card.height, card.gust_length))


def wind_of_launch(launch: Launch, draws: autopilot.DrawKeys, other: Wind) -> Wind:
    """Return the steady wind of a run: that of its card, which is drawn along and across its direction, and another."""
    card, (along, across) = launch.wind, loop.profile_draws(draws)
    top = max(card.height[-1], other.step * (len(other.speed) - 1))
    height = np.arange(0.0, top + _AIR_STEP, _AIR_STEP)
    profile = np.interp(height, card.height, card.speed, right=0.0)
    ahead, abeam = 1.0 + card.spread * along, card.spread * across
    east = -math.sin(card.direction) * ahead - math.cos(card.direction) * abeam
    north = -math.cos(card.direction) * ahead + math.sin(card.direction) * abeam
    speed = np.outer(profile, [east, north])
    if len(other.speed) > 1:
        at = other.step * np.arange(len(other.speed))
        speed += np.stack([np.interp(height, at, one, right=0.0) for one in other.speed.T], axis=1)
    return Wind(_AIR_STEP, speed)


def _plant(card: RotationCard) -> autopilot.Plant:
    nozzle, thrusters = card.nozzle, card.thrusters
    return autopilot.Plant(
        nozzle.time_constant,
        nozzle.rate_limit,
        nozzle.deflection_limit,
        nozzle.misalignment,
        thrusters.dead_band,
        thrusters.lead,
        thrusters.release,
    )


def _law(launch: Launch) -> autopilot.ControlLaw:
    card, rate = launch.controller, launch.imu.rate
    gains = np.array([[one.attitude, one.rate, one.integral] for one in card.gains])
    guide = card.guidance
    if guide is None:
        return autopilot.ControlLaw(gains, card.command_time, 0, 1, 1.0, 0.0, 0.0, 0.0)
    ticks = max(1, round(guide.period * rate))
    return autopilot.ControlLaw(
        gains,
        card.command_time,
        guide.from_stage,
        ticks,
        guide.time,
        guide.limit,
        guide.velocity_sigma,
        guide.command_sigma,
    )


def _feed(launch: Launch, card: FeedbackCard) -> autopilot.ControllerInputs:
    """Return the settings of sensing; the steady filter of the gyro's random walk weighs the attitude reference."""
    noise = rate_noise(launch.imu, card.noise)
    ticks = max(1, round(launch.imu.rate / card.reference_rate))
    driving = ticks * (noise / launch.imu.rate) ** 2
    gain = steady_ratio(driving, card.reference_sigma**2) if card.reference_sigma > 0.0 else 1.0
    bias = 0.0 if card.noise == "none" else rms(launch.imu.gyro.bias_repeatability)
    modelled = card.attitude == "navigation"
    start = math.sqrt(gain) * card.reference_sigma if modelled else 0.0
    attitude = autopilot.MODELLED if modelled else autopilot.IDEAL
    return autopilot.ControllerInputs(
        _RATES[card.rate], attitude, noise, bias, card.reference_sigma, ticks, gain, start
    )
