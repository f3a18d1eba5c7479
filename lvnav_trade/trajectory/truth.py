"""True trajectory as splines of position and attitude by phase; velocity, rate and specific force are derivatives.

Rolls of many turns and oscillations are closed formulas added to the splines.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import chain, pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, PPoly, make_interp_spline

from lvnav_trade.kernels.earth import OMEGA, gravity_along
from lvnav_trade.kernels.media.atmosphere import atmosphere
from lvnav_trade.quantities import frames
from lvnav_trade.quantities.conditions import FlightProfile
from lvnav_trade.quantities.records import Floats, Motion, Reference
from lvnav_trade.trajectory.disturbances import Oscillation, small_motion

_AT_ONCE = 4096
"""Number of times evaluated together. Intermediate arrays (3 KB a time) then stay in the processor's cache."""
PAD_STEP = 2.5  # s between knots on the pad; at the Earth's rate the spline error is below rounding
_SLIVER = 1e-9  # s; a shorter piece of a tick is rounding of the grid


class Phase(NamedTuple):
    """Part of a trajectory without a jump of specific force.

    name : Name of the phase.
    start, end : s since lift-off.
    position : Spline of position (m, frame i).
    attitude : Spline of the quaternion q_b_i, before normalisation.
    spin : Roll angle (rad) over time, a rotation about the body x axis after the splined attitude.
    oscillations : Coning and vibration, a rotation and displacement after the roll.
    """

    name: str
    start: float
    end: float
    position: BSpline
    attitude: BSpline
    spin: PPoly | None = None
    oscillations: tuple[Oscillation, ...] = ()


BEYOND, WARNING, NOTE = "beyond usual limits", "warning", "note"


class Remark(NamedTuple):
    """Remark on a trajectory for the user: kind (`BEYOND`, `WARNING` or `NOTE`) and text without a full stop."""

    kind: str
    text: str


class Commands(NamedTuple):
    """Commands of the attitude controller in pitch and yaw.

    A command that is reset to the actual attitude at an ignition counts as no change.

    t : (n,) s since lift-off. Ticks of the controller.
    rate : (n, 2) rad/s. Change of the commanded rate since lift-off.
    nozzle : (n, 2) rad. Commanded nozzle angle.
    """

    t: Floats
    rate: Floats
    nozzle: Floats

    def at(self, t: Floats) -> tuple[Floats, Floats]:
        """Return rate and nozzle angle, (k, 2) each, of the last tick before times t (k,) s; zero before the first."""
        k = np.searchsorted(self.t, t + _SLIVER, side="right")
        return np.vstack([np.zeros(2), self.rate])[k], np.vstack([np.zeros(2), self.nozzle])[k]


@dataclass(frozen=True)
class Trajectory:
    """The true trajectory.

    phases : Phases without gaps between them.
    events : Times (s since lift-off) of the events by name, in order of time.
    theta0 : rad. Earth angle at lift-off.
    epoch : ISO 8601 time of lift-off.
    facts : Figures for the report, by name.
    remarks : Remarks on the input file or the solution.
    commands : Commands of the attitude controller; None if it is not modelled.
    """

    phases: tuple[Phase, ...]
    events: dict[str, float]
    theta0: float
    epoch: str
    facts: dict[str, float | str] = field(default_factory=dict)
    remarks: tuple[Remark, ...] = ()
    commands: Commands | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "events", dict(sorted(self.events.items(), key=lambda event: event[1])))

    @property
    def start(self) -> float:
        """Start of the first phase, s since lift-off; negative on the pad."""
        return self.phases[0].start

    @property
    def end(self) -> float:
        """End of the last phase, s since lift-off."""
        return self.phases[-1].end

    @property
    def instants(self) -> dict[str, float]:
        """Times (s) that a fault may start at: the events, and ``start`` and ``end`` of the flight."""
        return {"start": self.start, "end": self.end, **self.events}

    def remarked(self, kind: str, texts: Iterable[str]) -> "Trajectory":
        """Return the trajectory with further remarks of a kind."""
        return replace(self, remarks=(*self.remarks, *(Remark(kind, text) for text in texts)))

    @cached_property
    def course(self) -> FlightProfile:
        """The flight as `Conditions` evaluate it: events, altitude, speed, dynamic pressure."""
        return FlightProfile(self.instants, self._reached)

    def _reached(self, t: Floats) -> Floats:
        """Return altitude (m), speed (m/s, relative to the Earth) and dynamic pressure (Pa) at t (n,) s, (3, n)."""
        at = motion(self, t)
        height = frames.geodetic_from_ecef(at.r_i)[2]  # the same in frame i: it turns about the ellipsoid's axis
        speed = np.linalg.norm(frames.earth_velocity(at.r_i, at.v_i), axis=1)
        density = np.array([atmosphere(h)[0] for h in height.tolist()])
        return np.stack([height, speed, 0.5 * density * speed**2])


def splined(
    name: str, t: Floats, r: Floats, v_ends: ArrayLike, a_ends: ArrayLike, attitude: BSpline, spin: PPoly | None = None
) -> Phase:
    """Return the phase through positions r (n, 3) m at t (n,) s; attitude and spin as in `Phase`.

    v_ends, a_ends : (2, 3) m/s, m/s^2, frame i. Velocity and acceleration at both ends.
    """
    return Phase(name, float(t[0]), float(t[-1]), position_spline(t, r, v_ends, a_ends), attitude, spin)


def pad_times(start: float, hold: float, step: float = PAD_STEP) -> Floats:
    """Return the knots (n,) s, at most `step` s apart, of `hold` seconds at rest on the pad that end at `start`."""
    return start + np.linspace(-hold, 0.0, max(8, int(np.ceil(hold / step))) + 1)


def pad_phase(
    r_e: Floats,
    theta0: float,
    start: float,
    hold: float,
    attitude: BSpline,
    spin: PPoly | None = None,
    v_end: Floats | None = None,
) -> tuple[Phase, ...]:
    """Return the phase at rest on the pad, in a tuple; an empty tuple without a hold.

    r_e : (3,) m, frame e. Position on the pad.
    theta0 : rad. Earth angle at lift-off.
    start, hold : s. End of the phase (since lift-off) and its length.
    attitude, spin : As in `Phase`.
    v_end : (3,) m/s, frame i. Velocity at the end, that of the next phase; None: that of the rotating Earth.
    """
    if hold <= 0.0:
        return ()
    t = pad_times(start, hold)
    r = frames.eci_from_ecef(r_e, frames.earth_angle(theta0, t))
    v = np.cross([0.0, 0.0, OMEGA], r[[0, -1]])
    a = np.cross([0.0, 0.0, OMEGA], v)
    v[1] = v[1] if v_end is None else v_end
    return (splined("pad", t, r, v, a, attitude, spin),)


def position_spline(t: Floats, r: Floats, v_ends: ArrayLike, a_ends: ArrayLike) -> BSpline:
    """Return the quintic spline through r (n, 3) at t (n,), with velocity and acceleration (2, 3) of both ends."""
    v, a = np.asarray(v_ends), np.asarray(a_ends)
    return make_interp_spline(t, r, k=5, bc_type=([(1, v[0]), (2, a[0])], [(1, v[1]), (2, a[1])]))


def join_samples(parts: Sequence[Floats]) -> Floats:
    """Return the samples of successive phases as one array, with the common sample of two phases only once."""
    return np.concatenate([*(part[:-1] for part in parts[:-1]), parts[-1]])


def attitude_spline(t: Floats, q: Floats) -> BSpline:
    """Return the quintic spline through quaternions q (n, 4) of continuous sign; `motion` normalises its values."""
    return make_interp_spline(t, q, k=5)


def motion(trajectory: Trajectory, t: ArrayLike) -> Motion:
    """Return the true motion at times t (n,), s since lift-off; at a jump of force the value just after it.

    ValueError if a time lies outside the trajectory, where the splines would extrapolate.
    """
    t = np.atleast_1d(np.asarray(t, dtype=float))
    if t.size and not (trajectory.start <= t.min() and t.max() <= trajectory.end):
        span = f"{trajectory.start:g} to {trajectory.end:g} s"
        raise ValueError(f"times {t.min():g} to {t.max():g} s, the trajectory has {span}")
    parts = Motion(t, *(np.empty((t.size, width)) for width in (3, 3, 4, 3, 3)))
    starts = np.array([phase.start for phase in trajectory.phases[1:]])
    index = np.searchsorted(starts, t, side="right")
    for k in np.unique(index):
        inside = np.flatnonzero(index == k)
        for here in (inside[piece] for piece in _stretches(inside.size)):
            for whole, part in zip(parts[1:], _in_phase(trajectory.phases[k], t[here])[1:], strict=True):
                whole[here] = part
    return parts


def _stretches(n: int) -> Iterator[slice]:
    """Return slices of at most `_AT_ONCE` that together cover n indices."""
    return (slice(first, min(first + _AT_ONCE, n)) for first in range(0, n, _AT_ONCE))


def _in_phase(phase: Phase, t: Floats) -> Motion:
    r, v = phase.position(t), phase.position(t, 1)
    if phase.oscillations:
        return _shaken(phase, t, r, v)
    q, w_ib_b = _turning(phase, t)
    f_b = np.einsum("kji,kj->ki", frames.matrices(q), phase.position(t, 2) - gravity_along(r))
    return Motion(t, r, v, q, f_b, w_ib_b)


def _turning(phase: Phase, t: Floats) -> tuple[Floats, Floats]:
    """Return quaternion (n, 4) and body rate (n, 3) at times t (n,) of the body without its oscillations."""
    raw = phase.attitude(t)
    length = np.linalg.norm(raw, axis=1, keepdims=True)
    q, slope = raw / length, phase.attitude(t, 1) / length
    # w = 2 vec(q* qdot). The part of qdot that changes the length is along q and has no vector part in the product.
    w, xyz, dw, dxyz = q[:, :1], q[:, 1:], slope[:, :1], slope[:, 1:]
    rate = 2.0 * (w * dxyz - dw * xyz - np.cross(xyz, dxyz))
    if phase.spin is None:
        return q, rate
    roll = rotation_quaternions(np.outer(phase.spin(t), [1.0, 0.0, 0.0]))
    rate = np.einsum("kji,kj->ki", frames.matrices(roll), rate)
    rate[:, 0] += phase.spin(t, 1)
    return product(q, roll), rate


def _turning_faster(phase: Phase, t: Floats, w_ib_b: Floats) -> Floats:
    """Return the angular acceleration (n, 3) rad/s^2: the derivative of the body rate w_ib_b (n, 3) of `_turning`."""
    raw, first, second = phase.attitude(t), phase.attitude(t, 1), phase.attitude(t, 2)
    square = np.sum(raw * raw, axis=1, keepdims=True)
    w, xyz = raw[:, :1], raw[:, 1:]
    # qdot* qdot is a scalar and drops out of the vector part; the last line corrects for the change of length.
    bend = 2.0 * (w * second[:, 1:] - second[:, :1] * xyz - np.cross(xyz, second[:, 1:])) / square
    rate = 2.0 * (w * first[:, 1:] - first[:, :1] * xyz - np.cross(xyz, first[:, 1:])) / square
    bend -= rate * (2.0 * np.sum(raw * first, axis=1, keepdims=True) / square)
    if phase.spin is None:
        return np.asarray(bend)
    roll = rotation_quaternions(np.outer(phase.spin(t), [1.0, 0.0, 0.0]))
    along = np.outer(phase.spin(t, 1), [1.0, 0.0, 0.0])
    bend = np.einsum("kji,kj->ki", frames.matrices(roll), bend) - np.cross(along, w_ib_b)
    bend[:, 0] += phase.spin(t, 2)
    return bend


def _shaken(phase: Phase, t: Floats, r: Floats, v: Floats) -> Motion:
    """Return the motion at times t (n,) of an oscillating body; its mean position is r, its mean velocity v, (n, 3).

    The displacement d, in the axes of the body without oscillations, adds the acceleration
    d'' + 2 w x d' + w' x d + w x (w x d). The rotation vector p turns the body by exp(p) at the rate J(p) p', with
    J = 1 - (1 - cos |p|) / |p|^2 [p x] + (|p| - sin |p|) / |p|^3 [p x]^2.
    """
    q, w = _turning(phase, t)
    dw = _turning_faster(phase, t, w)
    small = small_motion(phase.oscillations, t)
    C = frames.matrices(q)
    speed = small.shift_rate + np.cross(w, small.shift)
    push = small.shift_acceleration + np.cross(w, small.shift_rate + speed) + np.cross(dw, small.shift)
    r = r + np.einsum("kij,kj->ki", C, small.shift)
    f_i = phase.position(t, 2) + np.einsum("kij,kj->ki", C, push) - gravity_along(r)
    swing = rotation_quaternions(small.turn)
    back = frames.matrices(swing)
    rate = np.einsum("kji,kj->ki", back, w) + _vector_rate(small.turn, small.turn_rate)
    q = product(q, swing)
    f_b = np.einsum("kji,kj->ki", frames.matrices(q), f_i)
    return Motion(t, r, v + np.einsum("kij,kj->ki", C, speed), q, f_b, rate)


def _vector_rate(p: Floats, dp: Floats) -> Floats:
    """Return the body rate (n, 3) rad/s of a rotation vector p (n, 3), below half a turn, with derivative dp (n, 3)."""
    x2 = np.sum(p * p, axis=1, keepdims=True)
    small = x2 < 0.01
    x = np.sqrt(np.where(small, 1.0, x2))  # 1 where the series apply, to avoid 0 / 0
    a = np.where(small, 0.5 - x2 / 24.0 * (1.0 - x2 / 30.0 * (1.0 - x2 / 56.0)), (1.0 - np.cos(x)) / x**2)
    series = 1.0 / 6.0 - x2 / 120.0 * (1.0 - x2 / 42.0 * (1.0 - x2 / 72.0))
    b = np.where(small, series, (x - np.sin(x)) / x**3)
    once = np.cross(p, dp)
    return np.asarray(dp - a * once + b * np.cross(p, once))


def rotation_quaternions(p: Floats) -> Floats:
    """Return the quaternions (n, 4), scalar first, of rotation vectors p (n, 3) rad; continuous in p."""
    half = 0.5 * np.linalg.norm(p, axis=1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * p], axis=1)  # numpy: sinc(x) = sin(pi x)/(pi x)


def product(p: Floats, q: Floats) -> Floats:
    """Return the quaternion products p q (n, 4): rotation p (n, 4), then q (n, 4) about the rotated axes."""
    a, b, u, v = p[:, :1], q[:, :1], p[:, 1:], q[:, 1:]
    scalar = a * b - np.sum(u * v, axis=1, keepdims=True)
    return np.concatenate([scalar, a * v + b * u + np.cross(u, v)], axis=1)


def oscillating(trajectory: Trajectory, oscillations: tuple[Oscillation, ...]) -> Trajectory:
    """Return the trajectory with oscillations added, its phases cut at the ends of ramps so that each is smooth."""
    if not oscillations:
        return trajectory
    edges = ((shake.start, shake.start + shake.ramp, shake.end - shake.ramp, shake.end) for shake in oscillations)
    cuts = sorted(set(chain.from_iterable(edges)))
    phases: list[Phase] = []
    for phase in trajectory.phases:
        times = [phase.start, *(cut for cut in cuts if phase.start < cut < phase.end), phase.end]
        for start, end in pairwise(times):
            here = tuple(shake for shake in oscillations if shake.start < end and start < shake.end)
            phases.append(phase._replace(start=start, end=end, oscillations=here))
    return replace(trajectory, phases=tuple(phases))


def without_oscillations(trajectory: Trajectory) -> Trajectory:
    """Return the trajectory without its oscillations."""
    return replace(trajectory, phases=tuple(phase._replace(oscillations=()) for phase in trajectory.phases))


def reference(trajectory: Trajectory, rate: float) -> Reference:
    """Return the motion on ticks at `rate` (Hz) from the start, and the increments of an ideal IMU between them.

    Increments are Gauss-Legendre integrals of body rate (rad) and specific force (m/s) over each interval, split at the
    end of a phase. They have three nodes (exact to the sixth power of the interval), or more if the body spins or
    oscillates. The remainder of the trajectory after the last whole interval is omitted.
    """
    n_imu = math.floor((trajectory.end - trajectory.start) * rate + 1e-6)
    t = np.minimum(trajectory.start + np.arange(n_imu + 1) / rate, trajectory.end)
    at = motion(trajectory, t)
    dtheta, dvel = np.zeros((n_imu, 3)), np.zeros((n_imu, 3))
    for phase in trajectory.phases:
        begin, end = np.maximum(t[:-1], phase.start), np.minimum(t[1:], phase.end)
        (within,) = np.nonzero(end - begin > _SLIVER)  # intervals that overlap the phase, contiguous
        if within.size:
            ticks = slice(within[0], within[-1] + 1)
            _add_integrals(phase, begin[ticks], end[ticks], dtheta[ticks], dvel[ticks])
    return Reference(t, *at[1:], dtheta, dvel)


def _add_integrals(phase: Phase, begin: Floats, end: Floats, dtheta: Floats, dvel: Floats) -> None:
    """Add the integrals of body rate and specific force over the intervals begin to end (n,) to dtheta, dvel (n, 3)."""
    length = end - begin
    rule = list(zip(*_quadrature(_fastest(phase) * float(np.max(length))), strict=True))
    for piece in _stretches(length.size):
        turn, push = np.zeros_like(dtheta[piece]), np.zeros_like(dvel[piece])
        for node, weight in rule:
            at = _in_phase(phase, begin[piece] + node * length[piece])
            scale = (weight * length[piece])[:, None]
            turn += scale * at.w_ib_b
            push += scale * at.f_b
        dtheta[piece] += turn
        dvel[piece] += push


def _fastest(phase: Phase) -> float:
    """Return the highest angular frequency (rad/s) of force and rate in a phase, second harmonics included."""
    spin = 0.0
    if phase.spin is not None:
        inside = phase.spin.x[(phase.start < phase.spin.x) & (phase.spin.x < phase.end)]
        spin = float(np.max(np.abs(phase.spin(np.concatenate([[phase.start], inside, [phase.end]]), 1))))
    return spin + 2.0 * max((float(np.max(shake.omega)) for shake in phase.oscillations), default=0.0)


@lru_cache(maxsize=256)
def _quadrature(angle: float) -> tuple[Floats, Floats]:
    """Return Gauss-Legendre nodes and weights on (0, 1): three, or enough for `angle` rad of a sine wave to 1e-12."""
    n, exact = max(3, int(0.25 * angle)), np.sinc(0.5 * angle / np.pi)  # fewer nodes do not resolve the wave
    while True:
        nodes, weights = np.polynomial.legendre.leggauss(n)
        if abs(0.5 * weights @ np.cos(0.5 * angle * nodes) - exact) < 1e-12:
            return 0.5 * (1.0 + nodes), 0.5 * weights
        n += 1


def body_axes(x: Floats, right: Floats, roll: Floats) -> Floats:
    """Return the attitude C_b_i (n, 3, 3) of a body with x axis x (n, 3), frame i, and roll angle roll (n,) rad.

    right : (n, 3), frame i. Direction of the y axis at zero roll, before its component along x is removed.
    """
    level = frames.unit(right - np.sum(right * x, axis=1, keepdims=True) * x)
    below = frames.cross(x, level)
    c, s = np.cos(roll)[:, None], np.sin(roll)[:, None]
    return np.stack([x, c * level + s * below, c * below - s * level], axis=-1)
