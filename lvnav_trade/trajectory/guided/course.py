"""Commanded attitude of an ascent on every tick, stored before lift-off for the attitude controller."""

import re
from typing import NamedTuple

import numpy as np

from lvnav_trade.quantities import frames
from lvnav_trade.quantities.conditions import resolve
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.shared_cards import EnvelopeCard, is_changing
from lvnav_trade.trajectory.ascent.dispersion import dispersed_ascent
from lvnav_trade.trajectory.ascent.launch import build_ascent
from lvnav_trade.trajectory.ascent.legs import AscentLeg
from lvnav_trade.trajectory.ascent.steering_law import smoothsteps
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent
from lvnav_trade.trajectory.control_cards import ControllerCard
from lvnav_trade.trajectory.guided.autopilot import BURN, CHANGE, COAST, CommandedAttitude
from lvnav_trade.trajectory.guided.guidance_plan import GuidancePlan, plan_solved_ascent
from lvnav_trade.trajectory.truth import Trajectory, motion

PITCH, YAW = 0, 1
_BURN = re.compile(r"stage \d+ burn")
_CHANGE = re.compile(r"stage\d+_(ignition|cutoff|separation)")


class SolvedAscent(NamedTuple):
    """A solved ascent.

    card : Vehicle and target.
    trajectory : True flight.
    plan : Guidance data.
    legs : Legs with mass and thrust.
    """

    card: VehicleAscent
    trajectory: Trajectory
    plan: GuidancePlan
    legs: list[AscentLeg]


def ascend(card: VehicleAscent) -> SolvedAscent:
    """Return the solved ascent of a vehicle card; InputError if the orbit is out of reach."""
    vehicle, aim, flight = dispersed_ascent(card)
    trajectory = build_ascent(card)
    plan = plan_solved_ascent(card, aim, flight)
    return SolvedAscent(
        card=vehicle,
        trajectory=trajectory,
        plan=plan,
        legs=flight.legs,
    )


def stage_event_times(trajectory: Trajectory) -> Floats:
    """Return the times (k,) in s of lift-off and of every ignition, cut-off and separation of a stage, in order."""
    times = []
    for name, t in trajectory.events.items():
        if name == "liftoff" or _CHANGE.match(name):
            times.append(t)
    return np.array(times)


def ascent_course(
    ascent: SolvedAscent, controller: ControllerCard, envelope: EnvelopeCard, rate: float
) -> CommandedAttitude:
    """Return the commanded attitude along an ascent.

    Parameters
    ----------
    ascent : SolvedAscent
        The nominal ascent.
    controller : ControllerCard
        Card with the turn manoeuvres.
    envelope : EnvelopeCard
        Envelope, which determines the intervals around changes of thrust.
    rate : float
        Rate of the ticks (Hz), from lift-off to the end.

    Raises
    ------
    InputError
        A turn starts at an unknown event.
    """
    trajectory = ascent.trajectory
    n_tick = int(np.floor(trajectory.end * rate + 1e-6))
    t = np.minimum(np.arange(n_tick + 1) / rate, trajectory.end)
    nominal = motion(trajectory, t)
    C_b_i = frames.matrices(nominal.q_b_i)
    turn, turn_rate = _turn_manoeuvres(controller, trajectory, t)
    phase = np.where(_is_burning(ascent.legs, t), BURN, COAST)
    phase[is_changing(envelope, t, stage_event_times(trajectory))] = CHANGE
    return CommandedAttitude(
        t=t,
        ahead=np.ascontiguousarray(C_b_i[:, :, 0]),
        up=np.ascontiguousarray(-C_b_i[:, :, 2]),
        right=np.ascontiguousarray(C_b_i[:, :, 1]),
        rate=np.ascontiguousarray(nominal.w_ib_b[:, 1:]),
        turn=turn,
        turn_rate=turn_rate,
        velocity=np.ascontiguousarray(nominal.v_i),
        phase=phase.astype(np.int64),
    )


def _is_burning(legs: list[AscentLeg], t: Floats) -> Floats:
    """Return whether a motor burns at times t (n,)."""
    starts = [leg.t[0] for leg in legs]
    are_burns = [_BURN.match(leg.name) is not None for leg in legs]
    n_begun = np.searchsorted(starts, t, side="right")
    index = np.maximum(n_begun - 1, 0)
    is_burn = np.array(are_burns)
    return is_burn[index]


def _turn_manoeuvres(controller: ControllerCard, trajectory: Trajectory, t: Floats) -> tuple[Floats, Floats]:
    """Return angle (rad) and rate (rad/s) of the turn manoeuvres at times t (n,), (n, 2) each."""
    angle = np.zeros((t.size, 2))
    rate = np.zeros((t.size, 2))
    for turn in controller.turns:
        axis = PITCH if turn.axis == "pitch" else YAW
        start = resolve(turn.start, trajectory.events)
        x = np.clip((t - start) / turn.duration, 0.0, 1.0)
        angle[:, axis] += turn.angle * smoothsteps(x)
        # The derivative of the quintic 10 x^3 - 15 x^4 + 6 x^5 is 30 (x (1 - x))^2.
        mean_rate = turn.angle / turn.duration
        root = x * (1.0 - x)
        rate[:, axis] += mean_rate * 30.0 * root**2
    return angle, rate
