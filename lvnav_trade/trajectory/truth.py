"""True trajectory as splines of position and attitude by phase; velocity, rate and specific force are derivatives.

Rolls of many turns and oscillations are closed formulas added to the splines.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, PPoly, make_interp_spline

from lvnav_trade.kernels.earth import OMEGA, gravity_along
from lvnav_trade.kernels.media.atmosphere import atmosphere
from lvnav_trade.quantities import frames
from lvnav_trade.quantities.conditions import FlightProfile
from lvnav_trade.quantities.records import Floats, Motion, Reference
from lvnav_trade.trajectory.attitude_algebra import product, quaternion_rate, rotation_quaternions, rotation_vector_rate
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
    roll_angle : Roll angle (rad) over time, a rotation about the body x axis after the splined attitude.
    oscillations : Coning and vibration, a rotation and displacement after the roll.
    """

    name: str
    start: float
    end: float
    position: BSpline
    attitude: BSpline
    roll_angle: PPoly | None = None
    oscillations: tuple[Oscillation, ...] = ()


BEYOND, WARNING, NOTE = "beyond usual limits", "warning", "note"


class Remark(NamedTuple):
    """Remark on a trajectory for the user: category (`BEYOND`, `WARNING` or `NOTE`) and text without a full stop."""

    category: str
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

    def sample(self, t: Floats) -> tuple[Floats, Floats]:
        """Return rate and nozzle angle, (k, 2) each, of the last tick before times t (k,) s; zero before the first."""
        k = np.searchsorted(self.t, t + _SLIVER, side="right")
        rate = np.vstack([np.zeros(2), self.rate])
        nozzle = np.vstack([np.zeros(2), self.nozzle])
        return rate[k], nozzle[k]


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

    def add_remarks(self, category: str, texts: Iterable[str]) -> "Trajectory":
        """Return the trajectory with further remarks of a category."""
        return replace(self, remarks=(*self.remarks, *(Remark(category, text) for text in texts)))

    @cached_property
    def flight_profile(self) -> FlightProfile:
        """The flight as `Conditions` evaluate it: events, altitude, speed, dynamic pressure."""
        return FlightProfile(self.instants, self._profile_values)

    def _profile_values(self, t: Floats) -> Floats:
        """Return altitude (m), speed (m/s, relative to the Earth) and dynamic pressure (Pa) at t (n,) s, (3, n)."""
        true = motion(self, t)
        height = frames.geodetic_from_ecef(true.r_i)[2]  # the same in frame i: it turns about the ellipsoid's axis
        speed = np.linalg.norm(frames.earth_velocity(true.r_i, true.v_i), axis=1)
        density = np.array([atmosphere(h)[0] for h in height.tolist()])
        dynamic_pressure = 0.5 * density * speed**2
        return np.stack([height, speed, dynamic_pressure])


def spline_phase(
    name: str,
    t: Floats,
    r: Floats,
    v_ends: ArrayLike,
    a_ends: ArrayLike,
    attitude: BSpline,
    roll_angle: PPoly | None = None,
) -> Phase:
    """Return the phase through positions r (n, 3) m at t (n,) s; attitude and roll_angle as in `Phase`.

    v_ends, a_ends : (2, 3) m/s, m/s^2, frame i. Velocity and acceleration at both ends.
    """
    position = position_spline(t, r, v_ends, a_ends)
    return Phase(name, float(t[0]), float(t[-1]), position, attitude, roll_angle)


def pad_times(start: float, hold: float, step: float = PAD_STEP) -> Floats:
    """Return the knots (n,) s, at most `step` s apart, of `hold` seconds at rest on the pad that end at `start`."""
    n_interval = max(8, int(np.ceil(hold / step)))
    return start + np.linspace(-hold, 0.0, n_interval + 1)


def pad_phase(
    r_e: Floats,
    theta0: float,
    start: float,
    hold: float,
    attitude: BSpline,
    roll_angle: PPoly | None = None,
    v_end: Floats | None = None,
) -> tuple[Phase, ...]:
    """Return the phase at rest on the pad, in a tuple; an empty tuple without a hold.

    r_e : (3,) m, frame e. Position on the pad.
    theta0 : rad. Earth angle at lift-off.
    start, hold : s. End of the phase (since lift-off) and its length.
    attitude, roll_angle : As in `Phase`.
    v_end : (3,) m/s, frame i. Velocity at the end, that of the next phase; None: that of the rotating Earth.
    """
    if hold <= 0.0:
        return ()
    t = pad_times(start, hold)
    r = frames.eci_from_ecef(r_e, frames.earth_angle(theta0, t))
    v = np.cross([0.0, 0.0, OMEGA], r[[0, -1]])
    a = np.cross([0.0, 0.0, OMEGA], v)
    v[1] = v[1] if v_end is None else v_end
    return (spline_phase("pad", t, r, v, a, attitude, roll_angle),)


def position_spline(t: Floats, r: Floats, v_ends: ArrayLike, a_ends: ArrayLike) -> BSpline:
    """Return the quintic spline of position (frame i) in time.

    t, r : (n,) s, (n, 3) m. Knots and positions.
    v_ends, a_ends : (2, 3) m/s, m/s^2. Velocity and acceleration at both ends.
    """
    v, a = np.asarray(v_ends), np.asarray(a_ends)
    first = [(1, v[0]), (2, a[0])]
    last = [(1, v[1]), (2, a[1])]
    return make_interp_spline(t, r, k=5, bc_type=(first, last))


def join_samples(samples: Sequence[Floats]) -> Floats:
    """Return the samples of successive phases as one array, with the common sample of two phases only once."""
    leading_samples = [values[:-1] for values in samples[:-1]]
    return np.concatenate([*leading_samples, samples[-1]])


def attitude_spline(t: Floats, q: Floats) -> BSpline:
    """Return the quintic spline through quaternions q (n, 4) of continuous sign; `motion` normalises its values."""
    return make_interp_spline(t, q, k=5)


def motion(trajectory: Trajectory, t: ArrayLike) -> Motion:
    """Return the true motion at times t (n,), s since lift-off; at a jump of force, the motion just after the jump.

    ValueError if a time lies outside the trajectory, where the splines would extrapolate.
    """
    t = np.atleast_1d(np.asarray(t, dtype=float))
    if t.size and not (trajectory.start <= t.min() and t.max() <= trajectory.end):
        span = f"{trajectory.start:g} to {trajectory.end:g} s"
        raise ValueError(f"times {t.min():g} to {t.max():g} s, the trajectory has {span}")
    widths = (3, 3, 4, 3, 3)
    result = Motion(t, *(np.empty((t.size, width)) for width in widths))
    starts = np.array([phase.start for phase in trajectory.phases[1:]])
    phase_index = np.searchsorted(starts, t, side="right")
    for k in np.unique(phase_index):
        inside = np.flatnonzero(phase_index == k)
        for block in _blocks(inside.size):
            indices = inside[block]
            block_motion = _phase_motion(trajectory.phases[k], t[indices])
            for values, block_values in zip(result[1:], block_motion[1:], strict=True):
                values[indices] = block_values
    return result


def _blocks(n: int) -> Iterator[slice]:
    """Return slices of at most `_AT_ONCE` that together cover n indices."""
    return (slice(first, min(first + _AT_ONCE, n)) for first in range(0, n, _AT_ONCE))


def _to_body(C_b_i: Floats, vectors: Floats) -> Floats:
    """Return vectors (n, 3) of frame i in body axes, C_b_i^T v, row by row."""
    return np.einsum("kji,kj->ki", C_b_i, vectors)


def _phase_motion(phase: Phase, t: Floats) -> Motion:
    """Return the motion at times t (n,) within a phase."""
    if phase.oscillations:
        return _oscillating_motion(phase, t)
    r, v, a = (phase.position(t, order) for order in range(3))
    q, w_ib_b = _mean_rotation(phase, t)
    f_b = _to_body(frames.matrices(q), a - gravity_along(r))
    return Motion(t, r, v, q, f_b, w_ib_b)


def _mean_rotation(phase: Phase, t: Floats) -> tuple[Floats, Floats]:
    """Return quaternion (n, 4) and body rate (n, 3) at times t (n,) of the body without its oscillations."""
    quaternion, slope = (phase.attitude(t, order) for order in range(2))
    q, rate = _unit_quaternion_and_rate(quaternion, slope)
    if phase.roll_angle is None:
        return q, rate
    roll = _roll_quaternions(phase.roll_angle, t)
    rate = _to_body(frames.matrices(roll), rate)
    rate[:, 0] += phase.roll_angle(t, 1)
    return product(q, roll), rate


def _mean_rotation_and_acceleration(phase: Phase, t: Floats) -> tuple[Floats, Floats, Floats]:
    """Return quaternion and body rate as `_mean_rotation` does, and angular acceleration (n, 3) rad/s^2, body axes."""
    quaternion, first, second = (phase.attitude(t, order) for order in range(3))
    q, rate = _unit_quaternion_and_rate(quaternion, first)
    acceleration = _angular_acceleration(quaternion, first, second)
    if phase.roll_angle is None:
        return q, rate, acceleration
    roll = _roll_quaternions(phase.roll_angle, t)
    C_roll = frames.matrices(roll)
    roll_rate = np.outer(phase.roll_angle(t, 1), [1.0, 0.0, 0.0])
    rate = _to_body(C_roll, rate)
    rate[:, 0] += roll_rate[:, 0]
    acceleration = _to_body(C_roll, acceleration) - frames.cross(roll_rate, rate)
    acceleration[:, 0] += phase.roll_angle(t, 2)
    return product(q, roll), rate, acceleration


def _unit_quaternion_and_rate(quaternion: Floats, slope: Floats) -> tuple[Floats, Floats]:
    """Return unit quaternion (n, 4) and body rate (n, 3) rad/s of quaternions of any length with derivative slope."""
    length = np.linalg.norm(quaternion, axis=1, keepdims=True)
    q = quaternion / length
    return q, quaternion_rate(q, slope / length)


def _angular_acceleration(quaternion: Floats, first: Floats, second: Floats) -> Floats:
    """Return the angular acceleration (n, 3) rad/s^2 of quaternions (n, 4) of any length with two derivatives."""
    square = np.sum(quaternion * quaternion, axis=1, keepdims=True)
    # d/dt 2 vec(q* qdot) / |q|^2. qdot* qdot is a scalar and drops out of the vector part; the second term corrects for
    # the change of length.
    acceleration = quaternion_rate(quaternion, second) / square
    rate = quaternion_rate(quaternion, first) / square
    square_slope = 2.0 * np.sum(quaternion * first, axis=1, keepdims=True)
    return np.asarray(acceleration - rate * (square_slope / square))


def _roll_quaternions(roll_angle: PPoly, t: Floats) -> Floats:
    """Return the quaternions (n, 4) of a roll about the body x axis at times t (n,)."""
    return rotation_quaternions(np.outer(roll_angle(t), [1.0, 0.0, 0.0]))


def _oscillating_motion(phase: Phase, t: Floats) -> Motion:
    """Return the motion at times t (n,) of an oscillating body.

    The displacement d, in the axes of the body without oscillations, adds the acceleration
    d'' + 2 w x d' + w' x d + w x (w x d). The rotation vector p turns the body by exp(p) at the rate J(p) p', with
    J = 1 - (1 - cos |p|) / |p|^2 [p x] + (|p| - sin |p|) / |p|^3 [p x]^2.
    """
    r, v, a = (phase.position(t, order) for order in range(3))
    q, w, dw = _mean_rotation_and_acceleration(phase, t)
    small = small_motion(phase.oscillations, t)
    C_b_i = frames.matrices(q)
    # d' + w x d, and its derivative: 2 w x d' + w x (w x d) = w x (d' + velocity)
    velocity = small.shift_rate + frames.cross(w, small.shift)
    rotation_acceleration = frames.cross(w, small.shift_rate + velocity)
    acceleration = small.shift_acceleration + rotation_acceleration + frames.cross(dw, small.shift)
    r = r + np.einsum("kij,kj->ki", C_b_i, small.shift)
    v = v + np.einsum("kij,kj->ki", C_b_i, velocity)
    shift_acceleration_i = np.einsum("kij,kj->ki", C_b_i, acceleration)
    f_i = a + shift_acceleration_i - gravity_along(r)
    swing = rotation_quaternions(small.turn)
    swing_rate = rotation_vector_rate(small.turn, small.turn_rate)
    w_ib_b = _to_body(frames.matrices(swing), w) + swing_rate
    q = product(q, swing)
    f_b = _to_body(frames.matrices(q), f_i)
    return Motion(t, r, v, q, f_b, w_ib_b)


def add_oscillations(trajectory: Trajectory, oscillations: tuple[Oscillation, ...]) -> Trajectory:
    """Return the trajectory with oscillations added, its phases cut at the ends of ramps so that each is smooth."""
    if not oscillations:
        return trajectory
    ramp_ends = set()
    for shake in oscillations:
        ramp_ends |= {shake.start, shake.start + shake.ramp, shake.end - shake.ramp, shake.end}
    phases: list[Phase] = []
    for phase in trajectory.phases:
        cuts = [time for time in sorted(ramp_ends) if phase.start < time < phase.end]
        for start, end in pairwise([phase.start, *cuts, phase.end]):
            active_oscillations = tuple(shake for shake in oscillations if shake.start < end and start < shake.end)
            phases.append(phase._replace(start=start, end=end, oscillations=active_oscillations))
    return replace(trajectory, phases=tuple(phases))


def remove_oscillations(trajectory: Trajectory) -> Trajectory:
    """Return the trajectory without its oscillations."""
    return replace(trajectory, phases=tuple(phase._replace(oscillations=()) for phase in trajectory.phases))


def reference(trajectory: Trajectory, rate: float) -> Reference:
    """Return the motion on ticks at `rate` (Hz) from the start, and the increments of an ideal IMU between them.

    Increments are Gauss-Legendre integrals of body rate (rad) and specific force (m/s) over each interval, split at the
    end of a phase. They have three nodes (exact to the sixth power of the interval), or more if the body spins or
    oscillates. The remainder of the trajectory after the last whole interval is omitted.
    """
    start, end = trajectory.start, trajectory.end
    n_tick = math.floor((end - start) * rate + 1e-6)
    t = np.minimum(start + np.arange(n_tick + 1) / rate, end)
    dtheta, dvel = np.zeros((n_tick, 3)), np.zeros((n_tick, 3))
    for phase in trajectory.phases:
        piece_begin = np.maximum(t[:-1], phase.start)
        piece_end = np.minimum(t[1:], phase.end)
        (overlap,) = np.nonzero(piece_end - piece_begin > _SLIVER)  # intervals that overlap the phase, contiguous
        if overlap.size:
            ticks = slice(overlap[0], overlap[-1] + 1)
            _add_integrals(phase, piece_begin[ticks], piece_end[ticks], dtheta[ticks], dvel[ticks])
    return Reference(t, *motion(trajectory, t)[1:], dtheta, dvel)


def _add_integrals(phase: Phase, begin: Floats, end: Floats, dtheta: Floats, dvel: Floats) -> None:
    """Add the integrals of body rate and specific force over intervals to dtheta (n, 3) rad and dvel (n, 3) m/s.

    begin, end : (n,) s. Ends of the intervals, within the phase.
    """
    length = end - begin
    length_by_axis = np.repeat(length[:, None], 3, axis=1)  # products of arrays of one shape take half of the time
    largest_angle = _highest_frequency(phase) * float(np.max(length))
    nodes, weights = _quadrature(largest_angle)
    for block in _blocks(length.size):
        turn, velocity = np.zeros_like(dtheta[block]), np.zeros_like(dvel[block])
        for node, weight in zip(nodes, weights, strict=True):
            node_motion = _phase_motion(phase, begin[block] + node * length[block])
            scale = weight * length_by_axis[block]
            turn += scale * node_motion.w_ib_b
            velocity += scale * node_motion.f_b
        dtheta[block] += turn
        dvel[block] += velocity


def _highest_frequency(phase: Phase) -> float:
    """Return the highest angular frequency (rad/s) of force and rate in a phase, second harmonics included."""
    spin = 0.0
    if phase.roll_angle is not None:
        is_inside = (phase.start < phase.roll_angle.x) & (phase.roll_angle.x < phase.end)
        times = np.concatenate([[phase.start], phase.roll_angle.x[is_inside], [phase.end]])
        rates = phase.roll_angle(times, 1)
        spin = float(np.max(np.abs(rates)))
    oscillation = max((float(np.max(shake.omega)) for shake in phase.oscillations), default=0.0)
    return spin + 2.0 * oscillation


@lru_cache(maxsize=256)
def _quadrature(angle: float) -> tuple[Floats, Floats]:
    """Return Gauss-Legendre nodes and weights on (0, 1): three, or enough for `angle` rad of a sine wave to 1e-12."""
    n_node = max(3, int(0.25 * angle))  # fewer nodes do not resolve the wave
    exact = np.sinc(0.5 * angle / np.pi)
    while True:
        nodes, weights = np.polynomial.legendre.leggauss(n_node)
        integral = 0.5 * weights @ np.cos(0.5 * angle * nodes)
        if abs(integral - exact) < 1e-12:
            return 0.5 * (1.0 + nodes), 0.5 * weights
        n_node += 1
