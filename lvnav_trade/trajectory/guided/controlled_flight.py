"""An ascent flown under wind and attitude control: a trajectory that turns and drifts as that launch does."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from lvnav_trade.kernels.random import seed_words
from lvnav_trade.quantities.reads import remembered
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.launch import achieved, build_ascent
from lvnav_trade.trajectory.ascent.vehicle_cards import STANDARD_GRAVITY, VehicleAscent
from lvnav_trade.trajectory.control_cards import SteeredCard
from lvnav_trade.trajectory.guided import autopilot
from lvnav_trade.trajectory.guided.course import SolvedAscent, ascend
from lvnav_trade.trajectory.guided.missions import Launch, fly_mission, launch_along
from lvnav_trade.trajectory.guided.pilots import PathSegment, TurningPilot
from lvnav_trade.trajectory.truth import (
    Commands,
    Phase,
    Trajectory,
    attitude_spline,
    motion,
    position_spline,
    product,
    rotation_quaternions,
)

_SEED = 0  # a launch is drawn from its number alone
_LOAD_STEP = 0.05  # s between the times at which the largest load is looked for


@remembered(2)
def _solved(key: str, card: VehicleAscent) -> SolvedAscent:
    return ascend(card)


def flown_ascent(card: VehicleAscent) -> Trajectory:
    """Return the true flight of a vehicle card, under wind and control where it says so.

    Under guidance that is the nominal flight: there, every run has a launch of its own.
    """
    if card.control is None or card.guidance != "nominal":
        return build_ascent(card)
    ascent = _solved(card.model_dump_json(exclude={"control", "named_times", "oscillation"}), card)
    return fly_launch(ascent, launch_along(ascent, card.control), card.control)


def fly_launch(ascent: SolvedAscent, launch: Launch, card: SteeredCard) -> Trajectory:
    """Return the trajectory of one launch, whose motors burn as long as on the nominal ascent.

    The body points as the controlled loop has it; roll is that of the ascent. Knots lie a tick apart.
    """
    nominal = ascent.trajectory
    draws = autopilot.DrawKeys(*seed_words(_SEED), np.uint64(card.realisation))
    pilot = fly_mission(launch, card.feedback, draws, 1, path=True)
    control = pilot.turning.control
    t, rows = control.course.t[: len(control.history)], control.history
    pad = tuple(phase for phase in nominal.phases if phase.end <= 0.0)
    built = Trajectory(
        (*pad, *_phases(nominal, pilot)),
        pilot.events | {"max_q": nominal.events["max_q"]},
        nominal.theta0,
        nominal.epoch,
        commands=Commands(t, np.cumsum(rows[:, :, autopilot.STEPPED], axis=0), rows[:, :, autopilot.ASKED]),
    )
    return replace(built, facts=nominal.facts | _facts(built))


def _phases(nominal: Trajectory, pilot: TurningPilot) -> Iterator[Phase]:
    control, path = pilot.turning.control, pilot.turning.path
    ticks = control.course.t[: len(path)]
    angle, rate = control.history[:, :, autopilot.ANGLE], control.history[:, :, autopilot.RATE]
    turned = CubicHermiteSpline(ticks, angle, rate)
    for stretch in pilot.stretches:
        inside = _inside(stretch, ticks)
        t = np.concatenate([stretch.t[:1], ticks[inside], stretch.t[1:]])
        r = np.concatenate([stretch.y[:1, :3], path[inside, :3], stretch.y[1:, :3]])
        at = np.clip(t, 0.0, nominal.end)
        by_nose = np.concatenate([np.zeros((t.size, 1)), turned(t)], axis=1)  # pitching up is about y, yawing right z
        q = product(motion(nominal, at).q_b_i, rotation_quaternions(by_nose))
        position = position_spline(t, r, stretch.y[:, 3:6], stretch.a)
        yield Phase(stretch.name, float(t[0]), float(t[-1]), position, attitude_spline(t, q))


def _inside(stretch: PathSegment, ticks: Floats) -> Floats:
    """Return which ticks lie between the ends of a stretch, no nearer to them than half a tick."""
    half = 0.5 * (ticks[1] - ticks[0])
    return (ticks > stretch.t[0] + half) & (ticks < stretch.t[1] - half)


def _facts(flight: Trajectory) -> dict[str, float | str]:
    """Return what the launch reached: its orbit at the end of the last burn, and its largest load."""
    top = motion(flight, [flight.events["injection"]])
    t = np.linspace(0.0, flight.end, int(flight.end / _LOAD_STEP) + 1)
    load = float(np.max(np.linalg.norm(motion(flight, t).f_b, axis=1)))
    return {
        **achieved(np.concatenate([top.r_i[0], top.v_i[0]])),
        "max_load_g": load / STANDARD_GRAVITY,
        "max_dynamic_pressure_pa": float(flight.course.sampled(np.array([flight.events["max_q"]]))[2, 0]),
    }
