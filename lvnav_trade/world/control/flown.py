"""An ascent flown under wind and attitude control: a trajectory that turns and drifts as that launch does."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from lvnav_trade.envelope import EnvelopeCard
from lvnav_trade.frames import matrices
from lvnav_trade.kernels.earth import gravity_along
from lvnav_trade.reads import remembered
from lvnav_trade.records import Floats, Motion
from lvnav_trade.world.ascent.launch import achieved, build_ascent
from lvnav_trade.world.ascent.vehicle import STANDARD_GRAVITY, VehicleAscent
from lvnav_trade.world.control import loop
from lvnav_trade.world.control.ascent import Ascent, ascend
from lvnav_trade.world.control.missions import Launch, Missions, fly_missions, prepare_launch
from lvnav_trade.world.control_cards import SteeredCard, WindCard
from lvnav_trade.world.truth import Commands, Phase, Trajectory, attitude_spline, motion, product, rotation_quaternions
from lvnav_trade.world.truth import position_spline as quintic

_SEED = 0  # a launch is drawn from its number alone
_CLOSE = 1e-7  # m; to which the path is found that gravity bends
_LOAD_STEP = 0.05  # s between the times at which the largest load is looked for
_STILL = WindCard.model_construct(
    name="still air",
    source="",
    height=(0.0, 1.0),
    speed=(0.0, 0.0),
    direction=0.0,
    gust=(0.0, 0.0),
    gust_length=(1.0, 1.0),
)


class _Deviations:
    """How a launch differs from the nominal flight: rotation (rad) and load (m/s^2) about and along body axes over t.

    Pitching up is about y, and pushes the nose along -z; yawing right is about z, and pushes it along y.
    """

    def __init__(self, flown: Missions) -> None:
        rows, last = flown.history[0], flown.history[0, -1]
        end = flown.t[-1] + (flown.t[-1] - flown.t[-2])  # the last tick is flown to its end
        self.t, angle, rate = np.append(flown.t, end), rows[:, :, loop.ANGLE], rows[:, :, loop.RATE]
        angle = np.vstack([angle, angle[-1] + (end - flown.t[-1]) * rate[-1]])
        self._angle = CubicHermiteSpline(self.t, angle, np.vstack([rate, last[:, loop.RATE]]))
        self._load = np.vstack([rows[:, :, loop.FORCE], last[:, loop.FORCE]])

    def rotation(self, t: Floats) -> Floats:
        """Return rotation vectors (n, 3) from the nominal attitude, body axes."""
        angle = self._angle(t)
        return np.stack([np.zeros(t.size), angle[:, 0], angle[:, 1]], axis=1)

    def load(self, t: Floats, start: float, end: float) -> Floats:
        """Return specific forces (n, 3) in body axes at times of a phase, whose ticks alone they are between."""
        inside = (self.t > start - 1e-9) & (self.t < end - 1e-9)
        pitch, yaw = (np.interp(t, self.t[inside], self._load[inside, axis]) for axis in range(2))
        return np.stack([np.zeros(t.size), yaw, -pitch], axis=1)


@remembered(2)
def _solved(key: str, card: VehicleAscent) -> Ascent:
    return ascend(card)


def flown_ascent(card: VehicleAscent) -> Trajectory:
    """Return the true flight of a vehicle card, under wind and control where it says so."""
    if card.control is None:
        return build_ascent(card)
    ascent = _solved(card.model_dump_json(exclude={"control", "named_times", "oscillation"}), card)
    return fly_launch(ascent, launch_along(ascent, card.control), card.control)


def launch_along(ascent: Ascent, card: SteeredCard) -> Launch:
    """Return the launch of an ascent that a card steers."""
    wind = card.wind or _STILL
    return prepare_launch(ascent, card.rotation, card.controller, wind, card.imu, card.envelope or EnvelopeCard())


def fly_launch(ascent: Ascent, launch: Launch, card: SteeredCard) -> Trajectory:
    """Return the trajectory of one launch: events are those of the ascent, motors burn as on it.

    The body points as the controlled loop has it, thrust and drag of the ascent act along its axes, and nozzle and air
    push it from the side. Roll is that of the ascent. Knots lie a tick apart.
    """
    nominal = ascent.trajectory
    flown = fly_missions(launch, card.feedback, 1, _SEED, every=1, first_run=card.realisation)
    rows = flown.history[0]
    phases = tuple(_phases(nominal, _Deviations(flown)))
    built = Trajectory(
        phases,
        nominal.events,
        nominal.theta0,
        nominal.epoch,
        commands=Commands(flown.t, np.cumsum(rows[:, :, loop.STEPPED], axis=0), rows[:, :, loop.ASKED]),
    )
    return replace(built, facts=nominal.facts | _facts(built))


def _phases(nominal: Trajectory, deviations: _Deviations) -> Iterator[Phase]:
    shift, drift = np.zeros(3), np.zeros(3)
    for phase in nominal.phases:
        if phase.end <= 0.0:  # on the pad
            yield phase
            continue
        t = _knots(phase, deviations.t)
        at = motion(Trajectory((phase,), {}, nominal.theta0, nominal.epoch), t)
        q = product(at.q_b_i, rotation_quaternions(deviations.rotation(t)))
        turned = np.einsum("kij,kj->ki", matrices(q), at.f_b + deviations.load(t, phase.start, phase.end))
        other = turned - np.einsum("kij,kj->ki", matrices(at.q_b_i), at.f_b)
        away, speed, pull = _path(t, at, other, shift, drift)
        shift, drift = away[-1], speed[-1]
        v, a = (at.v_i + speed)[[0, -1]], (phase.position(t[[0, -1]], 2) + pull[[0, -1]])
        yield phase._replace(position=quintic(t, at.r_i + away, v, a), attitude=attitude_spline(t, q))


def _knots(phase: Phase, ticks: Floats) -> Floats:
    """Return the ends of a phase, and the ticks between them that are no nearer to an end than half a tick."""
    half = 0.5 * (ticks[1] - ticks[0])
    inside = ticks[(ticks > phase.start + half) & (ticks < phase.end - half)]
    return np.concatenate([[phase.start], inside, [phase.end]])


def _path(t: Floats, at: Motion, other: Floats, shift: Floats, drift: Floats) -> tuple[Floats, Floats, Floats]:
    """Return distance, speed and acceleration (n, 3), frame i, away from the nominal path, which begin with `shift` and
    `drift`: two integrals of the other specific force (n, 3) and of the other gravity at the place itself.
    """
    away = shift + np.outer(t - t[0], drift)
    nominal = gravity_along(at.r_i)
    while True:
        pull = other + gravity_along(at.r_i + away) - nominal
        once = CubicSpline(t, pull).antiderivative()
        speed = drift + once(t)
        found = shift + np.outer(t - t[0], drift) + once.antiderivative()(t)
        if np.max(np.abs(found - away)) < _CLOSE:
            return found, speed, pull
        away = found


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
