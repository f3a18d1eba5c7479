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
from lvnav_trade.trajectory.guided import autopilot, axis_state, loop
from lvnav_trade.trajectory.guided.course import SolvedAscent, ascent_course
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
    """Data common to all missions of a vehicle: its ascent, the attitude that is commanded on it, and cards."""

    ascent: SolvedAscent
    course: autopilot.CommandedAttitude
    rotation: RotationCard
    controller: ControllerCard
    wind: WindCard
    imu: ImuCard
    envelope: EnvelopeCard


class Missions(NamedTuple):
    """Runs with the same feedback of the controller; axes are pitch and yaw.

    t : (n_record,) s since lift-off.
    history : (n_run, n_record, 2, N_RECORD). Records by the columns of `autopilot`.
    movement : (n_run, 2) rad. Total movement of the nozzle.
    sums : (n_run, 2, N_PHASE, N_SUM). Sums over the ticks of each phase.
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
    """Return a launch on the ticks of the IMU.

    Parameters
    ----------
    ascent : SolvedAscent
        The nominal ascent.
    rotation, controller, wind : RotationCard, ControllerCard, WindCard
        Cards of the body, the controller and the wind.
    imu : ImuCard
        IMU whose gyro feeds the controller; its rate is that of the ticks.
    envelope : EnvelopeCard, optional
        Envelope of the filter for the rate; by default that of an empty card.

    Raises
    ------
    InputError
        A card does not have one entry for each stage, or a turn starts at no event.
    """
    envelope = envelope or EnvelopeCard()
    vehicle = ascent.card.vehicle
    n_stage = len(vehicle.stages)
    tables = ((rotation, "stacks", rotation.stacks), (controller, "gains", controller.gains))
    for owner, name, entries in tables:
        if len(entries) != n_stage:
            raise InputError(f"{owner.name}: {len(entries)} {name}, {vehicle.name} has {n_stage} stages")
    course = ascent_course(ascent, controller, envelope, imu.rate)
    return Launch(
        ascent=ascent,
        course=course,
        rotation=rotation,
        controller=controller,
        wind=wind,
        imu=imu,
        envelope=envelope,
    )


def steered_launch(ascent: SolvedAscent, card: SteeredCard) -> Launch:
    """Return the launch of an ascent that a card steers."""
    return prepare_launch(
        ascent,
        card.rotation,
        card.controller,
        card.wind or STILL,
        card.imu,
        card.envelope,
    )


def scale_rate_gain(launch: Launch, factor: float) -> Launch:
    """Return the launch with the rate gain of every stage times a factor."""
    gains = tuple(stage.model_copy(update={"rate": stage.rate * factor}) for stage in launch.controller.gains)
    controller = launch.controller.model_copy(update={"gains": gains})
    return launch._replace(controller=controller)


def fly_missions(
    launch: Launch, feedback: FeedbackCard, runs: int, seed: int = 1, record_interval: int = 200, first_run: int = 0
) -> Missions:
    """Return runs of a launch.

    Draws depend on seed and run alone, so that runs with different feedback have the same draws.

    Parameters
    ----------
    launch : Launch
        Vehicle, controller and wind on the ticks of the IMU.
    feedback : FeedbackCard
        Rate and attitude that the controller receives.
    runs : int
        Number of runs.
    seed : int
        Seed of the draws.
    record_interval : int
        Number of ticks between records.
    first_run : int
        Number of the first run.
    """
    n_tick = launch.course.t.size - 1
    n_record = (n_tick - 1) // record_interval + 1
    history = np.zeros((runs, n_record, 2, autopilot.N_RECORD))
    sums = np.zeros((runs, 2, autopilot.N_PHASE, autopilot.N_SUM))
    movement = np.empty((runs, 2))
    for n in range(runs):
        draws = autopilot.DrawKeys(*seed_words(seed), np.uint64(first_run + n))
        pilot = fly_mission(launch, feedback, draws, record_interval)
        control = pilot.turning.control
        history[n] = control.history
        sums[n] = control.sums
        movement[n] = loop.movement(control)
    return Missions(
        t=launch.course.t[:n_tick:record_interval],
        history=history,
        movement=movement,
        sums=sums,
    )


def fly_mission(
    launch: Launch, feedback: FeedbackCard, draws: autopilot.DrawKeys, record_interval: int, path: bool = False
) -> TurningPilot:
    """Return the pilot after one simulated run.

    record_interval : number of ticks between records
    path : whether the state at every tick is recorded
    """
    ascent = launch.ascent
    turning = attitude_control(launch, feedback, draws, record_interval, path)
    nominal = deviations(ascent.plan.card, {})
    wind = launch_wind(launch, draws, nominal.wind)
    pilot = TurningPilot(ascent.plan, ascent.card, nominal._replace(wind=wind), PERFECT, turning)
    pilot.fly_nominal()
    return pilot


def attitude_control(
    launch: Launch,
    feedback: FeedbackCard,
    draws: autopilot.DrawKeys,
    record_interval: int = _ONCE,
    path: bool = False,
    uses_run_navigation: bool = False,
    density: float = 1.0,
) -> AttitudeControl:
    """Return attitude control, body and gusts of one run of a launch.

    Parameters
    ----------
    launch : Launch
    feedback : Rate, attitude and noise that feed the controller.
    draws : Keys of the draws of the run.
    record_interval : Ticks from record to record.
    path : Whether the true state at every tick is recorded.
    uses_run_navigation : Whether the controller uses the navigation of the run; otherwise it has separate navigation.
    density : Factor on the density of the air.
    """
    control = controlled_attitude(launch, feedback, draws, record_interval)
    feed, rotation = control.settings.feed, launch.rotation
    if uses_run_navigation and feed.attitude == autopilot.MODELLED:
        feed = feed._replace(attitude=autopilot.OF_THE_RUN)
        control = control._replace(settings=control.settings._replace(feed=feed))
    craft = RotationalModel(
        stacks=np.array([_stack_row(stack) for stack in rotation.stacks]),
        density=density,
        thruster=rotation.thrusters.force * rotation.thrusters.arm,
    )
    n_tick = launch.course.t.size - 1
    return AttitudeControl(
        control=control,
        craft=craft,
        gusts=_gusts(launch.wind),
        path=np.zeros((n_tick if path else 0, 7)),
    )


def _stack_row(stack: Stack) -> tuple[float, float, float, float]:
    """Return a row of `RotationalModel.stacks`."""
    length = stack.length
    return (
        (stack.gyration * length) ** 2,
        stack.nozzle_arm * length,
        stack.normal_force,
        stack.pressure_arm * length,
    )


def controlled_attitude(
    launch: Launch, feedback: FeedbackCard, draws: autopilot.DrawKeys, record_interval: int = _ONCE
) -> autopilot.ControlledAttitude:
    """Return the controlled attitude of one run at lift-off.

    record_interval : number of ticks between records
    """
    n_record = (launch.course.t.size - 2) // record_interval + 1
    envelope_fields = {name: getattr(launch.envelope, name) for name in autopilot.CommandedEnvelope._fields}
    settings = autopilot.AutopilotSettings(
        plant=_plant(launch.rotation),
        law=_law(launch),
        feed=_feed(launch, feedback),
        model=autopilot.CommandedEnvelope(**envelope_fields),
    )
    control = autopilot.ControlledAttitude(
        course=launch.course,
        settings=settings,
        draws=draws,
        memory=np.zeros((2, axis_state.N_MEMORY)),
        counts=np.zeros(autopilot.N_COUNT, dtype=np.int64),
        record_interval=record_interval,
        history=np.zeros((n_record, 2, autopilot.N_RECORD)),
        sums=np.zeros((2, autopilot.N_PHASE, autopilot.N_SUM)),
    )
    axis_state.begin(control)
    return control


def _heights(card: WindCard) -> Floats:
    return np.arange(0.0, card.height[-1] + _AIR_STEP, _AIR_STEP)


def _gusts(card: WindCard) -> Gusts:
    """Return the gusts of a card on even heights; there are none above the highest."""
    height = _heights(card)
    height_and_above = np.append(height, np.inf)
    sigma = np.interp(height, card.height, card.gust, right=0.0)
    sigma_and_above = np.append(sigma, 0.0)
    length = np.interp(height_and_above, card.height, card.gust_length)
    return Gusts(
        step=_AIR_STEP,
        sigma=sigma_and_above,
        length=length,
    )


def launch_wind(launch: Launch, draws: autopilot.DrawKeys, further_wind: Wind) -> Wind:
    """Return the steady wind of a run: that of its card, drawn along and across its direction, plus a further wind.

    Parameters
    ----------
    launch : Launch
        Launch with the wind card.
    draws : DrawKeys
        Keys of the random draws of the run.
    further_wind : Wind
        Wind that is added; zero above its heights.
    """
    card = launch.wind
    draw_along, draw_across = axis_state.profile_draws(draws)
    n_further = len(further_wind.speed)
    further_top = further_wind.step * (n_further - 1)
    top = max(card.height[-1], further_top)
    height = np.arange(0.0, top + _AIR_STEP, _AIR_STEP)
    profile = np.interp(height, card.height, card.speed, right=0.0)
    along = 1.0 + card.spread * draw_along
    across = card.spread * draw_across
    # The direction is that from which the wind blows, clockwise from north.
    sine = math.sin(card.direction)
    cosine = math.cos(card.direction)
    east = -sine * along - cosine * across
    north = -cosine * along + sine * across
    speed = np.outer(profile, [east, north])
    if n_further > 1:
        further_height = further_wind.step * np.arange(n_further)
        components = [np.interp(height, further_height, component, right=0.0) for component in further_wind.speed.T]
        speed += np.stack(components, axis=1)
    return Wind(_AIR_STEP, speed)


def _plant(card: RotationCard) -> autopilot.Plant:
    nozzle, thrusters = card.nozzle, card.thrusters
    return autopilot.Plant(
        time_constant=nozzle.time_constant,
        rate_limit=nozzle.rate_limit,
        limit=nozzle.deflection_limit,
        misalignment=nozzle.misalignment,
        dead_band=thrusters.dead_band,
        lead=thrusters.lead,
        release=thrusters.release,
    )


def _law(launch: Launch) -> autopilot.ControlLaw:
    card = launch.controller
    gains = np.array([[stage.attitude, stage.rate, stage.integral] for stage in card.gains])
    guidance = card.guidance
    if guidance is None:
        return autopilot.ControlLaw(
            gains=gains,
            command_time=card.command_time,
            guided_from=0,
            guidance_ticks=1,
            guidance_time=1.0,
            guidance_limit=0.0,
            velocity_sigma=0.0,
            command_sigma=0.0,
        )
    return autopilot.ControlLaw(
        gains=gains,
        command_time=card.command_time,
        guided_from=guidance.from_stage,
        guidance_ticks=max(1, round(guidance.period * launch.imu.rate)),
        guidance_time=guidance.time,
        guidance_limit=guidance.limit,
        velocity_sigma=guidance.velocity_sigma,
        command_sigma=guidance.command_sigma,
    )


def _feed(launch: Launch, card: FeedbackCard) -> autopilot.ControllerInputs:
    """Return the settings of sensing; the steady filter of the gyro's random walk weights the attitude reference."""
    imu = launch.imu
    noise = rate_noise(imu, card.noise)
    ticks = max(1, round(imu.rate / card.reference_rate))
    angle_variance = ticks * (noise / imu.rate) ** 2  # random walk of the angle between two references
    gain = steady_ratio(angle_variance, card.reference_sigma**2) if card.reference_sigma > 0.0 else 1.0
    is_modelled = card.attitude == "navigation"
    return autopilot.ControllerInputs(
        rate=_RATES[card.rate],
        attitude=autopilot.MODELLED if is_modelled else autopilot.IDEAL,
        gyro=noise,
        bias=0.0 if card.noise == "none" else rms(imu.gyro.bias_repeatability),
        reference=card.reference_sigma,
        reference_ticks=ticks,
        reference_gain=gain,
        start=math.sqrt(gain) * card.reference_sigma if is_modelled else 0.0,
    )
