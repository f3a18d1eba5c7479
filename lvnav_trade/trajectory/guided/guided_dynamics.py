"""Flight of a piece of a guided ascent: a dispersed point mass that holds a commanded attitude by its navigation."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.earth import GM, OMEGA, gravity_j4
from lvnav_trade.kernels.jit import jit, making_arrays
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.equations_of_motion import (
    Drag,
    Propulsion,
    drag_factor,
    height_above,
    thrust_beside,
    thrust_of,
)
from lvnav_trade.trajectory.ascent.steering_law import smoothstep
from lvnav_trade.trajectory.guided.explicit import LAMBDA, REFERENCE, STARTED, TGO, TURN, Target, steer

Vector = tuple[float, float, float]
WHOLE, CUT_OFF, EMPTY, DIVERGED = 0, 1, 2, 3
"""How a piece ends: as planned, by the cut-off, out of propellant, or because guidance diverges."""
_REFINED = 4  # secant steps to the cut-off within a step


class AttitudeProgramme(NamedTuple):
    """The attitude programme that is stored before lift-off.

    step : s. Interval of its entries, the first of which is at lift-off.
    u : (n, 3). Direction of the thrust, frame i.
    """

    step: float
    u: Floats


class NavigationErrors(NamedTuple):
    """Navigation errors over a flight. From each of the times to the next one the error stays, and that of the position
    grows by that of the velocity: between two updates a strapdown only integrates.

    t : (n,) s since lift-off.
    error : (n, 9). Truth less estimate of attitude (rad), velocity (m/s) and position (m), frame i.
    """

    t: Floats
    error: Floats


PERFECT = NavigationErrors(np.array([0.0, 1.0]), np.zeros((2, 9)))


class Wind(NamedTuple):
    """Wind over height, linear between the entries; none above the last one.

    step : m. Interval of height, from the ellipsoid on.
    speed : (n, 2) m/s. Towards east and north.
    """

    step: float
    speed: Floats


class Cutoff(NamedTuple):
    """What ends the last burn: the cut-off, or an empty stage.

    by_energy : Whether the cut-off is at an energy; else it is at a time.
    energy : J/kg. Specific two-body energy of the navigated state at the cut-off.
    time : s since lift-off. Time of the cut-off.
    empty : kg. Mass of the vehicle with an empty stage.
    """

    by_energy: bool
    energy: float
    time: float
    empty: float


class GuidanceLaw(NamedTuple):
    """Explicit guidance of the last stage.

    start : s since lift-off. From then on it steers; infinite: never.
    slew : s. Time in which the command changes from the programme to its law.
    cycle : s. Interval of its passes.
    freeze : s. Time to go below which its law is no longer updated.
    exhaust : m/s. Exhaust speed as it is known before lift-off.
    target : Where it ends the burn.
    kept : (N_KEPT,). What it keeps from pass to pass, see `steer`; updated.
    schuler : Whether it predicts gravity by the Schuler approximation.
    """

    start: float
    slew: float
    cycle: float
    freeze: float
    exhaust: float
    target: Target
    kept: Floats
    schuler: bool = False


class AscentInputs(NamedTuple):
    """What a piece of the ascent is flown with.

    programme : Attitude programme.
    navigation : Navigation errors.
    drag : Air and drag of the vehicle.
    wind : Wind over height.
    misalignment : (2,) rad. Of the thrust, down and to the right.
    law : Explicit guidance.
    lag : s. Time constant with which the body follows its command; 0: at once. With a lag a state has ten numbers, the
        last three the direction of the body.
    """

    programme: AttitudeProgramme
    navigation: NavigationErrors
    drag: Drag
    wind: Wind
    misalignment: Floats
    law: GuidanceLaw
    lag: float = 0.0


@jit
def _entry_at(t: float, navigation: NavigationErrors) -> int:
    """Return the number of the entry whose errors hold at a time (s)."""
    return max(0, int(np.searchsorted(navigation.t, t, side="right")) - 1)


@jit
def attitude_error_at(t: float, navigation: NavigationErrors) -> Vector:
    """Return the attitude error (rad, frame i) at a time (s)."""
    error = navigation.error[_entry_at(t, navigation)]
    return error[0], error[1], error[2]


@making_arrays
def error_at(t: float, navigation: NavigationErrors) -> Floats:
    """Return the navigation errors (9,) at a time (s)."""
    k = _entry_at(t, navigation)
    out = navigation.error[k].copy()
    for i in range(3):
        out[6 + i] += max(0.0, t - navigation.t[k]) * out[3 + i]
    return out


@jit
def _unit(x: float, y: float, z: float) -> Vector:
    n = math.sqrt(x * x + y * y + z * z)
    return x / n, y / n, z / n


@jit
def commanded(t: float, around: AscentInputs) -> Vector:
    """Return the direction (frame i) in which guidance wants the thrust at a time (s)."""
    programme, law = around.programme, around.law
    last = programme.u.shape[0] - 1
    x = min(max(t / programme.step, 0.0), last - 1e-9)
    k = int(x)
    w, a, b = x - k, programme.u[k], programme.u[k + 1]
    p = _unit(a[0] + w * (b[0] - a[0]), a[1] + w * (b[1] - a[1]), a[2] + w * (b[2] - a[2]))
    if law.kept[STARTED] == 0.0:
        return p
    s, kept = t - law.kept[REFERENCE], law.kept
    q = _unit(
        kept[LAMBDA] + s * kept[TURN], kept[LAMBDA + 1] + s * kept[TURN + 1], kept[LAMBDA + 2] + s * kept[TURN + 2]
    )
    weight = smoothstep((t - law.start) / law.slew)
    return _unit(p[0] + weight * (q[0] - p[0]), p[1] + weight * (q[1] - p[1]), p[2] + weight * (q[2] - p[2]))


@jit
def held_direction(t: float, around: AscentInputs) -> Vector:
    """Return the true direction of a body that has the commanded attitude by its navigation.

    C_true = (1 + [error x]) C_estimated.
    """
    u, e = commanded(t, around), attitude_error_at(t, around.navigation)
    return _unit(
        u[0] + e[1] * u[2] - e[2] * u[1],
        u[1] + e[2] * u[0] - e[0] * u[2],
        u[2] + e[0] * u[1] - e[1] * u[0],
    )


@jit
def misaligned(u: Vector, r: Vector, misalignment: Floats) -> Vector:
    """Return the direction of the thrust of a body that points along u: turned down and to the right by (2,) rad."""
    down, right = misalignment[0], misalignment[1]
    if down == 0.0 and right == 0.0:
        return u
    # right = u x up, upright = right x u
    a = _unit(u[1] * r[2] - u[2] * r[1], u[2] * r[0] - u[0] * r[2], u[0] * r[1] - u[1] * r[0])
    b = (a[1] * u[2] - a[2] * u[1], a[2] * u[0] - a[0] * u[2], a[0] * u[1] - a[1] * u[0])
    x, y, z = u
    return _unit(x + right * a[0] - down * b[0], y + right * a[1] - down * b[1], z + right * a[2] - down * b[2])


@jit
def thrust_direction(t: float, r: Vector, around: AscentInputs) -> Vector:
    """Return the true direction of the thrust of a body that holds its command, with its misalignment."""
    return misaligned(held_direction(t, around), r, around.misalignment)


@jit
def velocity_of_air(r: Vector, wind: Wind) -> Vector:
    """Return the velocity of the air over the ground, frame i."""
    x = height_above(r[0], r[1], r[2]) / wind.step
    last = wind.speed.shape[0] - 1
    if last < 1 or x >= last:
        return 0.0, 0.0, 0.0
    x = max(x, 0.0)
    k = int(x)
    east = wind.speed[k, 0] + (x - k) * (wind.speed[k + 1, 0] - wind.speed[k, 0])
    north = wind.speed[k, 1] + (x - k) * (wind.speed[k + 1, 1] - wind.speed[k, 1])
    p = math.sqrt(r[0] * r[0] + r[1] * r[1])
    n = math.sqrt(p * p + r[2] * r[2])
    ex, ey = -r[1] / p, r[0] / p
    return east * ex - north * r[2] / n * r[0] / p, east * ey - north * r[2] / n * r[1] / p, north * p / n


@making_arrays
def rates(t: float, y: Floats, engine: Propulsion, around: AscentInputs) -> Floats:
    """Return the time derivative of y (7 or 10,): inertial position (m), velocity (m/s), mass (kg), and with a lag the
    direction of the body.
    """
    r = (y[0], y[1], y[2])
    air = velocity_of_air(r, around.wind)
    w = (y[3] + OMEGA * r[1] - air[0], y[4] - OMEGA * r[0] - air[1], y[5] - air[2])
    push, pressure = drag_factor(r, w, around.drag)
    other, flow = thrust_beside(t, pressure, engine.beside)
    thrust, throttle = thrust_of(y[6], pressure, engine, other)
    thrust += other
    g = gravity_j4(r[0], r[1], r[2])
    out = np.empty(y.size)
    u = (0.0, 0.0, 0.0)
    if around.lag > 0.0:
        wanted, body = held_direction(t, around), (y[7], y[8], y[9])
        for i in range(3):
            out[7 + i] = (wanted[i] - body[i]) / around.lag
        u = misaligned(_unit(body[0], body[1], body[2]), r, around.misalignment)
    elif thrust > 0.0:
        u = thrust_direction(t, r, around)
    for i in range(3):
        out[i] = y[3 + i]
        out[3 + i] = g[i] + (thrust * u[i] - push * w[i]) / y[6]
    out[6] = -engine.mass_flow * throttle - flow
    return out


@making_arrays
def step(t: float, h: float, y: Floats, engine: Propulsion, around: AscentInputs) -> Floats:
    """Return y (7 or 10,) advanced by h with the classical Runge-Kutta step of fourth order."""
    k1 = rates(t, y, engine, around)
    k2 = rates(t + 0.5 * h, y + 0.5 * h * k1, engine, around)
    k3 = rates(t + 0.5 * h, y + 0.5 * h * k2, engine, around)
    k4 = rates(t + h, y + h * k3, engine, around)
    return y + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)


@making_arrays
def navigated_energy(t: float, y: Floats, navigation: NavigationErrors) -> float:
    """Return the specific energy (J/kg) of the navigated state, two-body."""
    e = error_at(t, navigation)
    v, r = y[3:6] - e[3:6], y[:3] - e[6:9]
    return 0.5 * np.dot(v, v) - GM / math.sqrt(np.dot(r, r))


@making_arrays
def fly_piece(t: float, end: float, most: float, y: Floats, engine: Propulsion, around: AscentInputs) -> Floats:
    """Return the state (7,) after a piece of flight without cut-off; most: s, the longest step."""
    n = max(8, math.ceil((end - t) / most))
    h = (end - t) / n
    for k in range(n):
        y = step(t + k * h, h, y, engine, around)
    return y


@making_arrays
def guide(t: float, y: Floats, engine: Propulsion, around: AscentInputs) -> bool:
    """Update explicit guidance at a true state y (7,); return whether it converges."""
    e, law = error_at(t, around.navigation), around.law
    if t < law.start or (law.kept[STARTED] > 0.0 and law.kept[TGO] < law.freeze):
        return True
    slope = rates(t, y, engine, around)
    g = gravity_j4(y[0], y[1], y[2])
    felt = math.sqrt((slope[3] - g[0]) ** 2 + (slope[4] - g[1]) ** 2 + (slope[5] - g[2]) ** 2)
    return steer(law.kept, t, y[:3] - e[6:9], y[3:6] - e[3:6], felt, law.exhaust, law.target, law.schuler)


@making_arrays
def _stopped(
    t: float, h: float, y: Floats, engine: Propulsion, around: AscentInputs, cutoff: Cutoff
) -> tuple[float, Floats, int]:
    """Return how far a step of h (s) from y goes, the state there, and how it ends: the first of cut-off and depletion.

    Within the step both are found by secants on integrations of a part of it.
    """
    best, state, why = h, step(t, h, y, engine, around), WHOLE
    for kind in (CUT_OFF, EMPTY):
        if kind == EMPTY:
            before, after = y[6] - cutoff.empty, state[6] - cutoff.empty
        elif cutoff.by_energy:
            before = cutoff.energy - navigated_energy(t, y, around.navigation)
            after = cutoff.energy - navigated_energy(t + best, state, around.navigation)
        else:
            before, after = cutoff.time - t, cutoff.time - t - best
        if after > 0.0:
            continue
        part, found = best * before / (before - after), state
        for _ in range(_REFINED):
            found = step(t, part, y, engine, around)
            if kind == EMPTY:
                there = found[6] - cutoff.empty
            elif cutoff.by_energy:
                there = cutoff.energy - navigated_energy(t + part, found, around.navigation)
            else:
                there = cutoff.time - t - part
            if before == there:
                break
            part = min(best, max(0.0, part * before / (before - there)))
        best, state, why = part, step(t, part, y, engine, around), kind
    return best, state, why


@making_arrays
def fly_last(
    t: float, end: float, most: float, y: Floats, engine: Propulsion, around: AscentInputs, cutoff: Cutoff
) -> tuple[float, Floats, int]:
    """Return time (s), state (7,) and how it ends, of a piece of the last burn that ends at `end` at the latest.

    most : s. The longest step.
    """
    law = around.law
    due = t
    while t < end - 1e-9:
        if law.start < math.inf and t >= due - 1e-9:
            if not guide(t, y, engine, around):
                return t, y, DIVERGED
            due = t + law.cycle
        h, y, why = _stopped(t, min(most, end - t), y, engine, around, cutoff)
        t += h
        if why != WHOLE:
            return t, y, why
    return t, y, WHOLE
