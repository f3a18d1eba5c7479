"""Truth as splines: position and attitude per phase, and everything that follows from them by differentiation."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, make_interp_spline

from lvnav_trade.frames import matrices, unit
from lvnav_trade.kernels.earth import gravity_along
from lvnav_trade.records import Motion, Reference

Floats = NDArray[np.float64]

# Gauss-Legendre nodes and weights on (0, 1): three are exact to the sixth power of the tick, below rounding at 100 Hz.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
_NODES, _WEIGHTS = 0.5 * (1.0 + _NODES), 0.5 * _WEIGHTS
_SLIVER = 1e-9  # s; a piece of a tick shorter than this is rounding of the grid, not a piece


class Phase(NamedTuple):
    """A stretch without a jump of force: splines of position (m, frame i) and quaternion (q_b_i before normalising)."""

    name: str
    start: float
    end: float
    position: BSpline
    attitude: BSpline


@dataclass(frozen=True)
class Trajectory:
    """The true flight. Phases follow one another without a gap; events in order of time; facts for the report."""

    phases: tuple[Phase, ...]
    events: dict[str, float]
    theta0: float
    epoch: str
    facts: dict[str, float | str] = field(default_factory=dict)

    @property
    def start(self) -> float:
        """Start of the first phase, s since lift-off (negative: on the pad)."""
        return self.phases[0].start

    @property
    def end(self) -> float:
        """End of the last phase, s since lift-off."""
        return self.phases[-1].end


def position_spline(t: Floats, r: Floats, v_ends: ArrayLike, a_ends: ArrayLike) -> BSpline:
    """Return the quintic through r (n, 3) at t (n,), with given velocity and acceleration (2, 3) at both ends."""
    v, a = np.asarray(v_ends), np.asarray(a_ends)
    return make_interp_spline(t, r, k=5, bc_type=([(1, v[0]), (2, a[0])], [(1, v[1]), (2, a[1])]))


def attitude_spline(t: Floats, q: Floats) -> BSpline:
    """Return the quintic through quaternions q (n, 4), of continuous sign, at times t (n,)."""
    return make_interp_spline(t, q, k=5)


def motion(trajectory: Trajectory, t: ArrayLike) -> Motion:
    """Return the true motion at times t (n,), s since lift-off; at a jump the value just after it.

    Times outside the trajectory are a ValueError: a spline means nothing there.
    """
    t = np.atleast_1d(np.asarray(t, dtype=float))
    if t.size and not (trajectory.start <= t.min() and t.max() <= trajectory.end):
        raise ValueError(f"times {t.min():g} to {t.max():g} s, the trajectory has {trajectory.start:g} to "
                         f"{trajectory.end:g} s")  # fmt: skip
    parts = Motion(t, *(np.empty((t.size, width)) for width in (3, 3, 4, 3, 3)))
    starts = np.array([phase.start for phase in trajectory.phases[1:]])
    index = np.searchsorted(starts, t, side="right")
    for k in np.unique(index):
        here = index == k
        for whole, part in zip(parts[1:], _in_phase(trajectory.phases[k], t[here])[1:], strict=True):
            whole[here] = part
    return parts


def _in_phase(phase: Phase, t: Floats) -> Motion:
    """Return the motion at times t (n,) of one phase."""
    r = phase.position(t)
    q, f_b, w_ib_b = _sensed(phase, t, r)
    return Motion(t, r, phase.position(t, 1), q, f_b, w_ib_b)


def _sensed(phase: Phase, t: Floats, r: Floats) -> tuple[Floats, Floats, Floats]:
    """Return quaternion (n, 4), specific force (n, 3) and body rate (n, 3) at times t (n,), positions r (n, 3)."""
    raw = phase.attitude(t)
    length = np.linalg.norm(raw, axis=1, keepdims=True)
    q, slope = raw / length, phase.attitude(t, 1) / length
    f_i = phase.position(t, 2) - gravity_along(r)
    f_b = np.einsum("kji,kj->ki", matrices(q), f_i)
    # w = 2 vec(q* qdot); a change of length is along q and has no vector part, so qdot need not be freed of it.
    w, xyz, dw, dxyz = q[:, :1], q[:, 1:], slope[:, :1], slope[:, 1:]
    return q, f_b, 2.0 * (w * dxyz - dw * xyz - np.cross(xyz, dxyz))


def reference(trajectory: Trajectory, rate: float) -> Reference:
    """Return the motion on ticks at `rate` (Hz) from the start, and the increments of an ideal IMU between them.

    Increments are Gauss-Legendre integrals of body rate (rad) and specific force (m/s) over each tick, split where a
    phase ends within it. A last piece of flight shorter than a tick is left out.
    """
    n_imu = math.floor((trajectory.end - trajectory.start) * rate + 1e-6)
    t = np.minimum(trajectory.start + np.arange(n_imu + 1) / rate, trajectory.end)
    at = motion(trajectory, t)
    dtheta, dvel = np.zeros((n_imu, 3)), np.zeros((n_imu, 3))
    for phase in trajectory.phases:
        for ticks, begin, end in _pieces(t, phase):
            turn, push = _integrals(phase, begin, end)
            dtheta[ticks] += turn
            dvel[ticks] += push
    return Reference(t, *at[1:], dtheta, dvel)


def _pieces(t: Floats, phase: Phase) -> Iterator[tuple[slice, Floats, Floats]]:
    """Return the ticks (a slice) that a phase has a part in, and begin and end (n,) of those parts."""
    first = max(int(np.searchsorted(t, phase.start, side="right")) - 1, 0)
    last = min(int(np.searchsorted(t, phase.end, side="left")), len(t) - 1)
    if last <= first:
        return
    begin = np.maximum(t[first:last], phase.start)
    end = np.minimum(t[first + 1 : last + 1], phase.end)
    keep = end - begin > _SLIVER
    if np.any(keep):
        a, b = int(np.argmax(keep)), len(keep) - int(np.argmax(keep[::-1]))
        yield slice(first + a, first + b), begin[a:b], end[a:b]


def _integrals(phase: Phase, begin: Floats, end: Floats) -> tuple[Floats, Floats]:
    """Return the integrals of body rate and specific force, each (n, 3), over the intervals begin to end (n,)."""
    length = end - begin
    turn, push = np.zeros((length.size, 3)), np.zeros((length.size, 3))
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        t = begin + node * length
        _, f_b, w_ib_b = _sensed(phase, t, phase.position(t))
        scale = (weight * length)[:, None]
        turn += scale * w_ib_b
        push += scale * f_b
    return turn, push


def body_axes(x: Floats, right: Floats, roll: Floats) -> Floats:
    """Return C_b_i (n, 3, 3) of a body with x axis x (n, 3) and the given roll (n,) from the zero of the roll card.

    At zero roll the y axis is the part of `right` (n, 3) across x; both in frame i.
    """
    level = unit(right - np.sum(right * x, axis=1, keepdims=True) * x)
    below = np.cross(x, level)
    c, s = np.cos(roll)[:, None], np.sin(roll)[:, None]
    return np.stack([x, c * level + s * below, c * below - s * level], axis=-1)
