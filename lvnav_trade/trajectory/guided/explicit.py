"""Unified powered-flight guidance of one burn: a linear-tangent direction that reaches radius, speed, climb and plane.

`steer` updates the law. `guided_dynamics.commanded_direction` returns its direction; `guided_dynamics.fly_last` ends
the burn. The effect of gravity over the rest of the burn is integrated, or follows in closed form from the Schuler
approximation.

McHenry, Brand, Long, Cockrell and Thibodeau, Space Shuttle ascent guidance, navigation, and control, Journal of the
Astronautical Sciences 27(1), 1979; Brand, Brown and Higgins, Unified powered flight guidance, NTRS 19740004402 (1973).
"""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.earth import gravity_j4
from lvnav_trade.kernels.jit import array_jit, jit
from lvnav_trade.quantities.records import Floats

_COAST_STEP = 20.0  # s, of the prediction of gravity; halving it moves the predicted end by centimetres
_CONVERGED = 0.1  # m/s, change of the velocity to go in one pass, below which the law has converged
_JUMP = 500.0  # m/s of the same from one pass to the next in flight, beyond which it diverges
_PASSES = 200  # at the start, where little is known
# Indices in the state of guidance, which is stored from pass to pass
VGO, RGRAV, RBIAS, RD, LAMBDA, TURN = 0, 3, 6, 9, 12, 15
TGO, BEFORE, REFERENCE, VELOCITY, TIME, STARTED, N_LAW_STATE = 18, 19, 20, 21, 24, 25, 26
"""Velocity to go (m/s), integral of gravity, bias and aim of the position (m), direction and its rate (1/s), time to go
(s), that of the pass before, time at which the direction is `LAMBDA` (s), velocity (m/s) and time (s) at the last
pass, and whether there was one.
"""

ThrustIntegrals = tuple[float, float, float, float, float, float]
"""The integrals L, J, H, S, Q, P, see `integrals`."""


class Target(NamedTuple):
    """Target state at the end of the burn.

    radius : m.
    speed : m/s.
    flight_path_angle : rad. Flight-path angle.
    normal : (3,). Normal of the orbit's plane, frame i.
    place : (3,) m. Position of the nominal cut-off, frame i, from which the first pass starts.
    """

    radius: float
    speed: float
    flight_path_angle: float
    normal: Floats
    place: Floats


@array_jit
def _integrate_free_fall(r: Floats, v: Floats, span: float) -> tuple[Floats, Floats]:
    """Return position and velocity (3,) after a span (s) of free fall, by the classical Runge-Kutta method."""
    n_step = max(1, math.ceil(span / _COAST_STEP))
    h = span / n_step
    half = 0.5 * h
    sixth = h / 6.0
    for _ in range(n_step):
        a1 = np.array(gravity_j4(r[0], r[1], r[2]))
        r2 = r + half * v
        v2 = v + half * a1
        a2 = np.array(gravity_j4(r2[0], r2[1], r2[2]))
        r3 = r + half * v2
        v3 = v + half * a2
        a3 = np.array(gravity_j4(r3[0], r3[1], r3[2]))
        r4 = r + h * v3
        v4 = v + h * a3
        a4 = np.array(gravity_j4(r4[0], r4[1], r4[2]))
        v_sum = v + 2.0 * (v2 + v3) + v4
        a_sum = a1 + 2.0 * (a2 + a3) + a4
        r = r + sixth * v_sum
        v = v + sixth * a_sum
    return r, v


@array_jit
def schuler_coast(r: Floats, v: Floats, span: float) -> tuple[Floats, Floats]:
    """Return position and velocity (3,) after a span (s) of free fall, by the Schuler approximation.

    Gravity points to the centre of the Earth, and is proportional to the distance from it: a'' = -w^2 a on each axis.
    The frequency w is that of a Schuler pendulum at r, the root of gravity over radius.
    """
    gravity = np.array(gravity_j4(r[0], r[1], r[2]))
    square_gravity = np.dot(gravity, gravity)
    square_radius = np.dot(r, r)
    w = (square_gravity / square_radius) ** 0.25
    phase = w * span
    cosine = math.cos(phase)
    sine = math.sin(phase)
    end_r = cosine * r + sine / w * v
    end_v = cosine * v - w * sine * r
    return end_r, end_v


@jit
def integrals(acceleration: float, exhaust: float, span: float) -> ThrustIntegrals:
    """Return the thrust integrals L, J, H, S, Q, P of a constant thrust and mass flow.

    L, J, H are the integrals of a, a t and a t^2 (m/s, m, m s). S, Q, P are the double integrals of the same (m, m s,
    m s^2).

    acceleration : m/s^2. Specific force at the start.
    exhaust : m/s. Exhaust speed.
    span : s. Duration.
    """
    tau = exhaust / acceleration
    half = 0.5 * exhaust * span * span
    burnt = span / tau  # share of the mass
    L = -exhaust * math.log(1.0 - burnt)
    J = L * tau - exhaust * span
    H = J * tau - half
    S = L * span - J
    Q = S * tau - half
    P = Q * tau - half * span / 3.0
    return L, J, H, S, Q, P


@array_jit
def _begin(law_state: Floats, r: Floats, v: Floats, target: Target) -> None:
    """Set the initial values of the first pass: the nominal position at cut-off, and the velocity there.

    law_state : (N_LAW_STATE,). Set.
    r, v : (3,) m, m/s. Navigated position and velocity, frame i.
    """
    law_state[:] = 0.0
    radius = np.linalg.norm(target.place)
    radial = target.place / radius
    downrange = np.cross(target.normal, radial)
    sine = math.sin(target.flight_path_angle)
    cosine = math.cos(target.flight_path_angle)
    direction = sine * radial + cosine * downrange
    target_velocity = target.speed * direction
    law_state[VGO : VGO + 3] = target_velocity - v
    law_state[RD : RD + 3] = target.place
    # The integral of gravity grows with the square of the time to go: that of one second is scaled in the first pass.
    gravity = np.array(gravity_j4(r[0], r[1], r[2]))
    law_state[RGRAV : RGRAV + 3] = 0.5 * gravity
    law_state[BEFORE] = 1.0


@array_jit
def _position_to_go(lambda_v: Floats, S: float, rgo: Floats, rd: Floats, normal: Floats) -> Floats:
    """Return the position to go (3,) m with the downrange component that the thrust produces.

    The range at cut-off is free: the downrange component of rgo follows from S = rgo . lambda_v.

    lambda_v : (3,). Unit vector along the velocity to go.
    S : m. Double integral of the specific force.
    rgo : (3,) m. Position to go, with any component downrange.
    rd : (3,) m. Desired position.
    normal : (3,). Normal of the orbital plane. All vectors are in frame i.
    """
    iy = -normal  # against the angular momentum
    ix = rd / np.linalg.norm(rd)
    iz = np.cross(ix, iy)
    downrange = np.dot(iz, rgo)
    rgo_xy = rgo - downrange * iz
    along_xy = np.dot(lambda_v, rgo_xy)
    along_z = np.dot(lambda_v, iz)
    rgo_z = (S - along_xy) / along_z
    return rgo_xy + rgo_z * iz


@array_jit
def _turning_thrust(lambda_v: Floats, lambda_dot: Floats, thrust: ThrustIntegrals) -> tuple[Floats, Floats]:
    """Return the velocity (m/s) and position (m), (3,) each, gained by a thrust that turns at a constant rate.

    They are of second order in the angle phi + phi_dot t between the thrust and lambda_v.

    lambda_v : (3,). Unit vector of the thrust at the reference time.
    lambda_dot : (3,) 1/s. Its rate.
    thrust : Thrust integrals over the burn.
    """
    L, J, H, S, Q, P = thrust
    start = lambda_v - lambda_dot * (J / L)
    start = start / np.linalg.norm(start)
    cosine = float(np.dot(start, lambda_v))
    phi = math.acos(min(1.0, max(-1.0, cosine)))
    phi_dot = -phi * L / J
    # Along lambda_v: integrals of the cosine, 1 - (phi + phi_dot t)^2 / 2
    vthrust_along = L - 0.5 * L * phi * phi - J * phi * phi_dot - 0.5 * H * phi_dot * phi_dot
    rthrust_along = S - 0.5 * S * phi * phi - Q * phi * phi_dot - 0.5 * P * phi_dot * phi_dot
    vthrust = vthrust_along * lambda_v
    rthrust = rthrust_along * lambda_v
    turn_norm = np.linalg.norm(lambda_dot)
    if turn_norm > 0.0:
        # Along the turn: integrals of the sine, phi + phi_dot t
        vthrust_turn = L * phi + J * phi_dot
        rthrust_turn = S * phi + Q * phi_dot
        turned_v = vthrust_turn * lambda_dot / turn_norm
        turned_r = rthrust_turn * lambda_dot / turn_norm
        vthrust = vthrust - turned_v
        rthrust = rthrust - turned_r
    return vthrust, rthrust


@array_jit
def _gravity_over_burn(
    r: Floats, v: Floats, tgo: float, vthrust: Floats, rthrust: Floats, schuler: bool
) -> tuple[Floats, Floats]:
    """Return the change of velocity (m/s) and position (m), (3,) each, by gravity over the burn.

    It is that of a free fall, whose initial state is shifted so that it stays close to the powered path.

    r, v : (3,) m, m/s. Present position and velocity, frame i.
    tgo : s. Time to go.
    vthrust, rthrust : (3,) m/s, m. Velocity and position gained by thrust.
    schuler : whether the free fall is that of `schuler_coast`; otherwise it is integrated
    """
    r1 = r - 0.1 * rthrust - tgo / 30.0 * vthrust
    v1 = v + 1.2 * rthrust / tgo - 0.1 * vthrust
    if schuler:
        r2, v2 = schuler_coast(r1, v1, tgo)
    else:
        r2, v2 = _integrate_free_fall(r1, v1, tgo)
    vgrav = v2 - v1
    rgrav = r2 - r1 - v1 * tgo
    return vgrav, rgrav


@array_jit
def _refine(
    law_state: Floats,
    t: float,
    r: Floats,
    v: Floats,
    acceleration: float,
    exhaust: float,
    target: Target,
    schuler: bool,
) -> float:
    """Refine velocity to go and direction by one pass; return the change (m/s) of the velocity to go.

    Symbols are those of McHenry et al.: velocity, time and position to go (vgo, tgo, rgo), effect of gravity (vgrav,
    rgrav), bias and aim of the position (rbias, rd), predicted position (rp), desired velocity (vd).
    """
    vgo = law_state[VGO : VGO + 3].copy()
    vgo_norm = np.linalg.norm(vgo)
    # Rocket equation with constant mass flow: tgo = (exhaust / acceleration) (1 - exp(-vgo / exhaust))
    burnt = -math.expm1(-vgo_norm / exhaust)
    tgo = exhaust / acceleration * burnt
    thrust = integrals(acceleration, exhaust, tgo)
    L, J, _, S, Q, _ = thrust
    lambda_v = vgo / vgo_norm
    time_ratio = tgo / law_state[BEFORE]
    rgrav = law_state[RGRAV : RGRAV + 3] * time_ratio**2
    rd = law_state[RD : RD + 3]
    coast_position = r + v * tgo + rgrav
    rgo = rd - coast_position
    rbias = law_state[RBIAS : RBIAS + 3]
    rgo = _position_to_go(lambda_v, S, rgo, rd, target.normal) + rbias
    # Direction of the thrust: lambda_v + lambda_dot (time - reference), with the reference time t + J / L
    turning_distance = rgo - S * lambda_v
    lambda_dot = turning_distance / (Q - S * J / L)
    vthrust, rthrust = _turning_thrust(lambda_v, lambda_dot, thrust)
    vbias = vgo - vthrust
    vgrav, rgrav = _gravity_over_burn(r, v, tgo, vthrust, rthrust, schuler)
    # Velocity at the predicted cut-off, in the plane of the target
    iy = -target.normal
    rp = r + v * tgo + rgrav + rthrust
    normal_component = np.dot(rp, iy)
    rp = rp - normal_component * iy
    ix = rp / np.linalg.norm(rp)
    iz = np.cross(ix, iy)
    sine = math.sin(target.flight_path_angle)
    cosine = math.cos(target.flight_path_angle)
    vd_direction = sine * ix + cosine * iz
    vd = target.speed * vd_direction
    new_vgo = vd - v - vgrav + vbias
    vgo_change = new_vgo - vgo

    law_state[VGO : VGO + 3] = new_vgo
    law_state[RGRAV : RGRAV + 3] = rgrav
    law_state[RBIAS : RBIAS + 3] = rgo - rthrust
    law_state[RD : RD + 3] = target.radius * ix
    law_state[LAMBDA : LAMBDA + 3] = lambda_v
    law_state[TURN : TURN + 3] = lambda_dot
    law_state[TGO] = tgo
    law_state[BEFORE] = tgo
    law_state[REFERENCE] = t + J / L
    return float(np.linalg.norm(vgo_change))


@array_jit
def steer(
    law_state: Floats,
    t: float,
    r: Floats,
    v: Floats,
    acceleration: float,
    exhaust: float,
    target: Target,
    schuler: bool = False,
) -> bool:
    """Update guidance at a navigated state; return whether it has converged.

    Parameters
    ----------
    law_state : (N_LAW_STATE,). State of guidance from pass to pass; zero before the first pass; updated.
    t : s since lift-off.
    r, v : (3,) m, m/s. Navigated position and velocity, frame i.
    acceleration : m/s^2. Specific force along the thrust, as sensed.
    exhaust : m/s. Exhaust speed as it is known before lift-off.
    target : Target
    schuler : Whether gravity over the rest of the burn is that of the Schuler approximation; else it is integrated.
    """
    if law_state[STARTED] == 0.0:
        _begin(law_state, r, v, target)
        change = 1e9
        for _ in range(_PASSES):
            change = _refine(law_state, t, r, v, acceleration, exhaust, target, schuler)
            if not change > _CONVERGED:
                break
        law_state[STARTED] = 1.0
        limit = _CONVERGED
    else:
        # The velocity gained by thrust since the last pass is the change of velocity without that by gravity.
        gravity = np.array(gravity_j4(r[0], r[1], r[2]))
        span = t - law_state[TIME]
        last_velocity = law_state[VELOCITY : VELOCITY + 3]
        velocity_gain = v - last_velocity - span * gravity
        law_state[VGO : VGO + 3] -= velocity_gain
        change = _refine(law_state, t, r, v, acceleration, exhaust, target, schuler)
        limit = _JUMP
    law_state[VELOCITY : VELOCITY + 3] = v
    law_state[TIME] = t
    return bool(change <= limit)
