"""Ascent under wind and attitude control, as a trajectory with the motion of that launch."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.interpolate import BSpline, CubicHermiteSpline

from lvnav_trade.kernels.random import seed_words
from lvnav_trade.quantities.reads import result_cache
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.launch import achieved_orbit, build_ascent
from lvnav_trade.trajectory.ascent.vehicle_cards import STANDARD_GRAVITY, VehicleAscent
from lvnav_trade.trajectory.attitude_algebra import product, rotation_quaternions
from lvnav_trade.trajectory.control_cards import SteeredCard
from lvnav_trade.trajectory.guided import autopilot
from lvnav_trade.trajectory.guided.course import SolvedAscent, ascend
from lvnav_trade.trajectory.guided.missions import Launch, fly_mission, steered_launch
from lvnav_trade.trajectory.guided.pilots import PathSegment, TurningPilot
from lvnav_trade.trajectory.truth import Commands, Phase, Trajectory, attitude_spline, motion, position_spline

_SEED = 0  # a launch is drawn from its number alone
_LOAD_STEP = 0.05  # s between the times at which the load is evaluated


@result_cache(2)
def _cached_ascent(key: str, card: VehicleAscent) -> SolvedAscent:
    return ascend(card)


def simulate_ascent(card: VehicleAscent) -> Trajectory:
    """Return the true flight of a vehicle card, under wind and control if the card has them.

    Under guidance it is the nominal flight, because every run has its own launch.
    """
    if card.control is None or card.guidance != "nominal":
        return build_ascent(card)
    content = card.model_dump_json(exclude={"control", "named_times", "oscillation"})
    ascent = _cached_ascent(content, card)
    launch = steered_launch(ascent, card.control)
    return fly_launch(ascent, launch, card.control)


def fly_launch(ascent: SolvedAscent, launch: Launch, card: SteeredCard) -> Trajectory:
    """Return the trajectory of one launch, with the burn times of the nominal ascent.

    The attitude is that of the controlled loop; roll is that of the ascent. Knots are one tick apart.

    Parameters
    ----------
    ascent : SolvedAscent
        The nominal ascent.
    launch : Launch
        Vehicle, controller and wind on the ticks of the IMU.
    card : SteeredCard
        Card with the feedback and the number of the realisation.
    """
    nominal = ascent.trajectory
    draws = autopilot.DrawKeys(*seed_words(_SEED), np.uint64(card.realisation))
    pilot = fly_mission(launch, card.feedback, draws, 1, path=True)
    control = pilot.turning.control
    history = control.history
    pad = tuple(phase for phase in nominal.phases if phase.end <= 0.0)
    commands = Commands(
        t=control.course.t[: len(history)],
        rate=np.cumsum(history[:, :, autopilot.STEPPED], axis=0),
        nozzle=history[:, :, autopilot.NOZZLE_COMMAND],
    )
    flight = Trajectory(
        phases=(*pad, *_phases(nominal, pilot)),
        events=pilot.events | {"max_q": nominal.events["max_q"]},
        theta0=nominal.theta0,
        epoch=nominal.epoch,
        commands=commands,
    )
    return replace(flight, facts=nominal.facts | _facts(flight))


def _phases(nominal: Trajectory, pilot: TurningPilot) -> Iterator[Phase]:
    """Yield the phases of a launch: its path, and the nominal attitude turned by the angles of both axes."""
    control, path = pilot.turning.control, pilot.turning.path
    ticks = control.course.t[: len(path)]
    angle = control.history[:, :, autopilot.ANGLE]
    rate = control.history[:, :, autopilot.RATE]
    angle_spline = CubicHermiteSpline(ticks, angle, rate)
    for segment in pilot.stretches:
        inside = _inner_ticks(segment, ticks)
        first_t, last_t = segment.t[:1], segment.t[1:]
        end_r = segment.y[:, :3]
        end_v = segment.y[:, 3:6]
        first_r, last_r = end_r[:1], end_r[1:]
        t = np.concatenate([first_t, ticks[inside], last_t])
        r = np.concatenate([first_r, path[inside, :3], last_r])
        yield Phase(
            name=segment.name,
            start=float(t[0]),
            end=float(t[-1]),
            position=position_spline(t, r, end_v, segment.a),
            attitude=_turned_attitude(nominal, t, angle_spline(t)),
        )


def _turned_attitude(nominal: Trajectory, t: Floats, angles: Floats) -> BSpline:
    """Return the attitude spline of a body that is turned from its nominal attitude.

    t : (n,) s since lift-off
    angles : (n, 2) rad. Pitch up and yaw to the right.
    """
    # rotation vectors: pitching up is about the y axis, yawing right about z
    no_roll = np.zeros((t.size, 1))
    turns = np.concatenate([no_roll, angles], axis=1)
    nominal_t = np.clip(t, 0.0, nominal.end)
    nominal_q = motion(nominal, nominal_t).q_b_i
    q_b_i = product(nominal_q, rotation_quaternions(turns))
    return attitude_spline(t, q_b_i)


def _inner_ticks(segment: PathSegment, ticks: Floats) -> Floats:
    """Return which ticks lie between the ends of a segment, no nearer to them than half a tick."""
    interval = ticks[1] - ticks[0]
    half = 0.5 * interval
    is_after_start = ticks > segment.t[0] + half
    is_before_end = ticks < segment.t[1] - half
    return is_after_start & is_before_end


def _facts(flight: Trajectory) -> dict[str, float | str]:
    """Return the facts of a launch: its orbit at the end of the last burn, and its largest load."""
    injection = motion(flight, [flight.events["injection"]])
    injection_state = np.concatenate([injection.r_i[0], injection.v_i[0]])
    n_load = int(flight.end / _LOAD_STEP) + 1
    t = np.linspace(0.0, flight.end, n_load)
    load = np.linalg.norm(motion(flight, t).f_b, axis=1)
    max_q_time = np.array([flight.events["max_q"]])
    max_q = flight.flight_profile.values_at(max_q_time)[2, 0]
    return {
        **achieved_orbit(injection_state),
        "max_load_g": float(np.max(load)) / STANDARD_GRAVITY,
        "max_dynamic_pressure_pa": float(max_q),
    }
