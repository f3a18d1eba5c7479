"""Unified powered-flight guidance of one burn: a linear-tangent direction that reaches radius, speed, climb and plane.

`steer` updates the law. `guided_dynamics.commanded` returns its direction; `guided_dynamics.fly_last` ends the burn.
The effect of gravity over the rest of the burn is integrated, or follows in closed form from the Schuler approximation.

McHenry, Brand, Long, Cockrell and Thibodeau, Space Shuttle ascent guidance, navigation, and control, Journal of the
Astronautical Sciences 27(1), 1979; Brand, Brown and Higgins, Unified powered flight guidance, NTRS 19740004402 (1973).
"""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.earth import gravity_j4
from lvnav_trade.kernels.jit import jit, making_arrays
from lvnav_trade.quantities.records import Floats

_COAST_STEP = 20.0  # s, of the prediction of gravity; halving it moves the predicted end by centimetres
_CONVERGED = 0.1  # m/s, change of the velocity to go in one pass, below which the law has converged
_JUMP = 500.0  # m/s of the same from one pass to the next in flight, beyond which it diverges
_PASSES = 200  # at the start, where little is known
# Places in the vector that guidance keeps from pass to pass
VGO, RGRAV, RBIAS, RD, LAMBDA, TURN = 0, 3, 6, 9, 12, 15
TGO, BEFORE, REFERENCE, VELOCITY, TIME, STARTED, N_KEPT = 18, 19, 20, 21, 24, 25, 26
"""Velocity to go (m/s), integral of gravity, bias and aim of the position (m), direction and its rate (1/s), time to go
(s), that of the pass before, time at which the direction is `LAMBDA` (s), velocity (m/s) and time (s) at the last
pass, and whether there was one.
"""


class Target(NamedTuple):
    """Where the burn ends.

    radius : m.
    speed : m/s.
    climb : rad. Flight-path angle.
    normal : (3,). Normal of the orbit's plane, frame i.
    place : (3,) m. Position of the nominal cut-off, frame i, from which the first pass starts.
    """

    radius: float
    speed: float
    climb: float
    normal: Floats
    place: Floats


@making_arrays
def _coasted(r: Floats, v: Floats, span: float) -> tuple[Floats, Floats]:
    """Return position and velocity (3,) after a span (s) of free fall, by the classical Runge-Kutta method."""
    n = max(1, math.ceil(span / _COAST_STEP))
    h = span / n
    for _ in range(n):
        a1 = np.array(gravity_j4(r[0], r[1], r[2]))
        r2, v2 = r + 0.5 * h * v, v + 0.5 * h * a1
        a2 = np.array(gravity_j4(r2[0], r2[1], r2[2]))
        r3, v3 = r + 0.5 * h * v2, v + 0.5 * h * a2
        a3 = np.array(gravity_j4(r3[0], r3[1], r3[2]))
        r4, v4 = r + h * v3, v + h * a3
        a4 = np.array(gravity_j4(r4[0], r4[1], r4[2]))
        r, v = r + h / 6.0 * (v + 2.0 * (v2 + v3) + v4), v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
    return r, v


@making_arrays
def schuler_coast(r: Floats, v: Floats, span: float) -> tuple[Floats, Floats]:
    """Return position and velocity (3,) after a span (s) of free fall, by the Schuler approximation.

    Gravity points to the centre of the Earth, and is proportional to the distance from it: a'' = -w^2 a on each axis.
    The frequency w is that of a Schuler pendulum at r, the root of gravity over radius.
    """
    gravity = np.array(gravity_j4(r[0], r[1], r[2]))
    w = (np.dot(gravity, gravity) / np.dot(r, r)) ** 0.25
    c, s = math.cos(w * span), math.sin(w * span)
    return c * r + s / w * v, c * v - w * s * r


@jit
def integrals(acceleration: float, exhaust: float, span: float) -> tuple[float, float, float, float, float, float]:
    """Return the integrals L, J, H, S, Q, P over a span (s) of constant thrust that begins with an acceleration.

    L, J, H are those of a, a t, a t^2; S, Q, P the double integrals of the same; exhaust speed in m/s.
    """
    tau = exhaust / acceleration
    half = 0.5 * exhaust * span * span
    L = -exhaust * math.log(1.0 - span / tau)
    J = L * tau - exhaust * span
    H = J * tau - half
    S = L * span - J
    Q = S * tau - half
    P = Q * tau - half * span / 3.0
    return L, J, H, S, Q, P


@making_arrays
def _begin(kept: Floats, r: Floats, v: Floats, target: Target) -> None:
    """Set what the first pass starts from: the nominal place of cut-off, and the velocity there."""
    kept[:] = 0.0
    out = target.place / np.linalg.norm(target.place)
    along = np.cross(target.normal, out)
    wanted = target.speed * (math.sin(target.climb) * out + math.cos(target.climb) * along)
    kept[VGO : VGO + 3] = wanted - v
    kept[RD : RD + 3] = target.place
    kept[RGRAV : RGRAV + 3] = 0.5 * np.array(gravity_j4(r[0], r[1], r[2]))  # of a second; scaled below
    kept[BEFORE] = 1.0


@making_arrays
def _pass(
    kept: Floats, t: float, r: Floats, v: Floats, acceleration: float, exhaust: float, target: Target, schuler: bool
) -> float:
    """Refine velocity to go and direction once; return by how much the former has changed (m/s)."""
    vgo = kept[VGO : VGO + 3].copy()
    size = np.linalg.norm(vgo)
    tgo = exhaust / acceleration * -math.expm1(-size / exhaust)
    L, J, H, S, Q, P = integrals(acceleration, exhaust, tgo)
    ahead = vgo / size
    rgrav = kept[RGRAV : RGRAV + 3] * (tgo / kept[BEFORE]) ** 2
    left = -target.normal  # iy of the literature: against the angular momentum
    rd = kept[RD : RD + 3]
    out = rd / np.linalg.norm(rd)
    along = np.cross(out, left)
    go = rd - (r + v * tgo + rgrav)
    across = go - np.dot(along, go) * along
    go = across + (S - np.dot(ahead, across)) / np.dot(ahead, along) * along + kept[RBIAS : RBIAS + 3]
    turn = (go - S * ahead) / (Q - S * J / L)
    start = ahead - turn * (J / L)
    start = start / np.linalg.norm(start)
    phi = math.acos(min(1.0, max(-1.0, float(np.dot(start, ahead)))))
    rate = -phi * L / J
    gained = (L - 0.5 * L * phi * phi - J * phi * rate - 0.5 * H * rate * rate) * ahead
    moved = (S - 0.5 * S * phi * phi - Q * phi * rate - 0.5 * P * rate * rate) * ahead
    pace = np.linalg.norm(turn)
    if pace > 0.0:
        gained = gained - (L * phi + J * rate) * turn / pace
        moved = moved - (S * phi + Q * rate) * turn / pace
    lost = vgo - gained
    r1, v1 = r - 0.1 * moved - tgo / 30.0 * gained, v + 1.2 * moved / tgo - 0.1 * gained
    r2, v2 = schuler_coast(r1, v1, tgo) if schuler else _coasted(r1, v1, tgo)
    vgrav, rgrav = v2 - v1, r2 - r1 - v1 * tgo
    place = r + v * tgo + rgrav + moved
    place = place - np.dot(place, left) * left
    out = place / np.linalg.norm(place)
    along = np.cross(out, left)
    wanted = target.speed * (math.sin(target.climb) * out + math.cos(target.climb) * along)
    new = wanted - v - vgrav + lost
    kept[VGO : VGO + 3], kept[RGRAV : RGRAV + 3], kept[RBIAS : RBIAS + 3] = new, rgrav, go - moved
    kept[RD : RD + 3] = target.radius * out
    kept[LAMBDA : LAMBDA + 3], kept[TURN : TURN + 3] = ahead, turn
    kept[TGO], kept[BEFORE], kept[REFERENCE] = tgo, tgo, t + J / L
    return float(np.linalg.norm(new - vgo))


@making_arrays
def steer(
    kept: Floats,
    t: float,
    r: Floats,
    v: Floats,
    acceleration: float,
    exhaust: float,
    target: Target,
    schuler: bool = False,
) -> bool:
    """Bring guidance up to date at a navigated state; return whether it has converged.

    Parameters
    ----------
    kept : (N_KEPT,). What guidance keeps from pass to pass; zero before the first one.
    t : s since lift-off.
    r, v : (3,) m, m/s. Navigated position and velocity, frame i.
    acceleration : m/s^2. Specific force along the thrust, as sensed.
    exhaust : m/s. Exhaust speed as it is known before lift-off.
    target : Target
    schuler : Whether gravity over the rest of the burn is that of the Schuler approximation; else it is integrated.
    """
    if kept[STARTED] == 0.0:
        _begin(kept, r, v, target)
        change = 1e9
        for _ in range(_PASSES):
            change = _pass(kept, t, r, v, acceleration, exhaust, target, schuler)
            if not change > _CONVERGED:
                break
        kept[STARTED], limit = 1.0, _CONVERGED
    else:
        # the thrust since the last pass is what is no gravity
        g = np.array(gravity_j4(r[0], r[1], r[2]))
        kept[VGO : VGO + 3] -= v - kept[VELOCITY : VELOCITY + 3] - (t - kept[TIME]) * g
        change, limit = _pass(kept, t, r, v, acceleration, exhaust, target, schuler), _JUMP
    kept[VELOCITY : VELOCITY + 3], kept[TIME] = v, t
    return bool(change <= limit)
