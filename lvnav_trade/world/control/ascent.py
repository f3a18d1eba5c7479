"""A controlled vehicle along its ascent: control effectiveness, aerodynamic moment, wind and rate on every tick."""

import re
from typing import NamedTuple

import numpy as np

from lvnav_trade import frames
from lvnav_trade.errors import InputError
from lvnav_trade.kernels.media.atmosphere import atmosphere
from lvnav_trade.records import Floats, Ints
from lvnav_trade.world.ascent.dispersion import flown
from lvnav_trade.world.ascent.dynamics import thrust_beside, thrust_of
from lvnav_trade.world.ascent.launch import build_ascent
from lvnav_trade.world.ascent.legs import Leg
from lvnav_trade.world.ascent.steering_law import smoothsteps
from lvnav_trade.world.ascent.vehicle import VehicleAscent
from lvnav_trade.world.control_cards import ControllerCard, RotationCard, WindCard, air
from lvnav_trade.world.events import resolve
from lvnav_trade.world.truth import Trajectory, motion

PITCH, YAW = 0, 1
_BURN = re.compile(r"stage (\d+) burn")
_STACK = re.compile(r"stage (\d+)")
_CHANGE = re.compile(r"stage\d+_(ignition|cutoff|separation)")


class Body(NamedTuple):
    """The vehicle under control and its surroundings at n ticks. The axes are pitch and yaw.

    Lateral is the direction in which the nose moves: up for pitch, right for yaw.

    t : (n,) s since lift-off.
    motor : (n,). Number of the burning stage, 0 in coasts.
    stack : (n,). Number of the lowest stage.
    effectiveness : (n,) 1/s^2. Angular acceleration per nozzle angle.
    thrust_load : (n,) m/s^2. Thrust over mass.
    moment : (n,) rad/(s m). Angular acceleration per lateral airspeed.
    force : (n,) 1/s. Lateral acceleration per lateral airspeed.
    airspeed : (n,) m/s.
    slip : (n, 2) m/s. Lateral airspeed on the nominal flight.
    wind : (n, 2, 2) m/s. Lateral wind by axis: of the profile along, and across, its direction.
    gust : (n,) m/s. Sigma of gusts.
    gust_rate : (n,) 1/s. Airspeed over the gust length.
    thruster : (n,) rad/s^2. Angular acceleration of a thruster pair.
    rate : (n, 2) rad/s. Body rate on the nominal flight.
    turn : (n, 2) rad. Additional commanded angle.
    turn_rate : (n, 2) rad/s. Additional commanded rate.
    """

    t: Floats
    motor: Ints
    stack: Ints
    effectiveness: Floats
    thrust_load: Floats
    moment: Floats
    force: Floats
    airspeed: Floats
    slip: Floats
    wind: Floats
    gust: Floats
    gust_rate: Floats
    thruster: Floats
    rate: Floats
    turn: Floats
    turn_rate: Floats


class Ascent(NamedTuple):
    """A solved ascent: its truth, and the legs with mass and thrust behind it."""

    card: VehicleAscent
    trajectory: Trajectory
    legs: list[Leg]


def ascend(card: VehicleAscent) -> Ascent:
    """Return the solved ascent of a vehicle card; InputError where the orbit is out of its reach."""
    vehicle, _, flight = flown(card)
    return Ascent(vehicle, build_ascent(card), flight.legs)


def changes(trajectory: Trajectory) -> Floats:
    """Return the times (k,) in s of lift-off and of every ignition, cut-off and separation of a stage, in order."""
    return np.array([t for name, t in trajectory.events.items() if name == "liftoff" or _CHANGE.match(name)])


def body_along(ascent: Ascent, rotation: RotationCard, controller: ControllerCard, wind: WindCard, rate: float) -> Body:
    """Return the turning vehicle along its ascent, on ticks at `rate` (Hz) from lift-off to the end.

    InputError where a card has not as many stacks or gains as the vehicle has stages, or a turn starts at no event.
    """
    n_stage = len(ascent.card.vehicle.stages)
    for owner, name, held in ((rotation, "stacks", rotation.stacks), (controller, "gains", controller.gains)):
        if len(held) != n_stage:
            raise InputError(f"{owner.name}: {len(held)} {name}, {ascent.card.vehicle.name} has {n_stage} stages")
    n_tick = int(np.floor(ascent.trajectory.end * rate + 1e-6))
    t = np.minimum(np.arange(n_tick + 1) / rate, ascent.trajectory.end)
    motor, stack, mass, thrust = _propulsion(ascent, t)
    flown = motion(ascent.trajectory, t)
    theta = frames.earth_angle(ascent.trajectory.theta0, t)
    latitude, longitude, height = frames.geodetic_from_ecef(frames.ecef_from_eci(flown.r_i, theta))
    v_i = frames.earth_velocity(flown.r_i, flown.v_i)
    airspeed = np.linalg.norm(v_i, axis=1)
    density = np.array([atmosphere(h)[0] for h in height])
    steady_e, gust, length = air(wind, latitude, longitude, height)
    C_b_i = frames.matrices(flown.q_b_i)
    sides = np.stack([-C_b_i[:, :, 2], C_b_i[:, :, 1]], axis=1)  # the way of the nose, pitching up and yawing right
    steady_i = np.stack([frames.eci_from_ecef(steady_e[:, k], theta) for k in range(2)], axis=2)
    inertia, nozzle, normal, pressure = _of_stacks(rotation, stack, mass)
    per_speed = 0.5 * density * airspeed * ascent.card.vehicle.reference_area * normal
    turn, turn_rate = _turns(controller, ascent.trajectory, t)
    return Body(
        t=t,
        motor=motor,
        stack=stack,
        effectiveness=thrust * nozzle / inertia,
        thrust_load=thrust / mass,
        moment=per_speed * pressure / inertia,
        force=per_speed / mass,
        airspeed=airspeed,
        slip=np.einsum("kai,ki->ka", sides, v_i),
        wind=np.einsum("kai,kiw->kaw", sides, steady_i),
        gust=gust,
        gust_rate=airspeed / length,
        thruster=rotation.thrusters.force * rotation.thrusters.arm / inertia,
        rate=np.ascontiguousarray(flown.w_ib_b[:, 1:]),
        turn=turn,
        turn_rate=turn_rate,
    )


def _propulsion(ascent: Ascent, t: Floats) -> tuple[Ints, Ints, Floats, Floats]:
    """Return the stage that burns (0: none), the lowest stage, mass (kg) and thrust (N), each (n,), at times t (n,)."""
    motor, stack = np.zeros(t.size, dtype=np.int64), np.ones(t.size, dtype=np.int64)
    mass, thrust = np.empty(t.size), np.zeros(t.size)
    index = np.maximum(np.searchsorted([leg.t[0] for leg in ascent.legs], t, side="right") - 1, 0)
    number = 1
    for k, leg in enumerate(ascent.legs):
        here = index == k
        named = _STACK.search(leg.name)
        number = int(named[1]) if named else number
        mass[here], stack[here] = np.interp(t[here], leg.t, leg.y[:, 6]), number
        if _BURN.match(leg.name):
            motor[here] = number
            thrust[here] = np.interp(t[here], leg.t, _thrusts(leg, ascent.trajectory.theta0))
    return motor, stack, mass, thrust


def _thrusts(leg: Leg, theta0: float) -> Floats:
    height = frames.geodetic_from_ecef(frames.ecef_from_eci(leg.y[:, :3], frames.earth_angle(theta0, leg.t)))[2]
    out = np.empty(leg.t.size)
    for k, t in enumerate(leg.t):
        pressure = atmosphere(height[k])[1]
        beside, _ = thrust_beside(t, pressure, leg.engine.beside)
        out[k] = beside + thrust_of(leg.y[k, 6], pressure, leg.engine, beside)[0]
    return out


def _of_stacks(rotation: RotationCard, stack: Ints, mass: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return moment of inertia, nozzle's arm (m), slope of the normal force and arm of the pressure (m), each (n,)."""
    inertia, nozzle, normal, pressure = np.empty((4, mass.size))
    for number, card in enumerate(rotation.stacks, start=1):
        here = stack == number
        inertia[here] = rotation.inertia(number, mass[here])
        nozzle[here] = card.nozzle_arm * card.length
        normal[here], pressure[here] = card.normal_force, card.pressure_arm * card.length
    return inertia, nozzle, normal, pressure


def _turns(controller: ControllerCard, trajectory: Trajectory, t: Floats) -> tuple[Floats, Floats]:
    angle, rate = np.zeros((t.size, 2)), np.zeros((t.size, 2))
    for turn in controller.turns:
        axis = PITCH if turn.axis == "pitch" else YAW
        x = np.clip((t - resolve(turn.start, trajectory.events)) / turn.duration, 0.0, 1.0)
        angle[:, axis] += turn.angle * smoothsteps(x)
        rate[:, axis] += turn.angle / turn.duration * 30.0 * (x * (1.0 - x)) ** 2
    return angle, rate
