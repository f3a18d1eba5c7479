"""Staged ascent from a vehicle card: the legs flown for given steering, from the pad to the final coast."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.frames import earth_angle, ecef_from_geodetic, eci_from_ecef, gmst, rotation_e_n, unit
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.world.ascent.dynamics import Drag, Engine, fly, time_to_mass
from lvnav_trade.world.ascent.motors import cuts, engine, throttled
from lvnav_trade.world.ascent.steering_law import Steering
from lvnav_trade.world.ascent.vehicle import Site, Stage, VehicleAscent

Floats = NDArray[np.float64]

STEP = 0.25  # s, of integration and of the truth's knots; halving it moves injection by 0.3 m
COASTING = Engine(0.0, 0.0, 0.0, 1.0)
_SLIVER = 1e-9  # s; a piece of a burn shorter than this is rounding


class Aim(NamedTuple):
    """What is solved for: launch azimuth and kick (rad), law of the steered stages, burns and coasts (s).

    tangent and tangent_end are tan of the elevation at the start of the law and `burn` seconds after the ignition of
    the stage that is cut off in orbit; coast and burn_2 belong to the last burn, level, of an ascent by a parking
    orbit. yaw (rad, to the right) turns the plane of the law out of that of the velocity, for a prescribed azimuth.
    """

    azimuth: float
    kick: float
    tangent: float
    tangent_end: float
    burn: float
    coast: float = 0.0
    burn_2: float = 0.0
    yaw: float = 0.0


class Leg(NamedTuple):
    """A stretch of flight without a jump: times (n,), states (n, 7), engine; steering holds for the whole ascent."""

    name: str
    t: Floats
    y: Floats
    engine: Engine


class Flight(NamedTuple):
    """A whole ascent: legs in order, the final steering, drag, event times in order of time."""

    legs: list[Leg]
    steering: Steering
    drag: Drag
    events: dict[str, float]


def pad_state(site: Site, theta: float) -> tuple[Floats, Floats]:
    """Return r_i (m) and v_i (m/s), each (3,), of a point at rest on the launch site at Earth angle theta."""
    r_i = eci_from_ecef(ecef_from_geodetic(site.latitude, site.longitude, site.height), theta)
    return r_i, np.cross([0.0, 0.0, OMEGA], r_i)


def site_axes(site: Site, azimuth: float) -> tuple[Floats, Floats, Floats]:
    """Return the unit vectors up, downrange and right of the downrange, each (3,) in frame e."""
    north, east, down = rotation_e_n(site.latitude, site.longitude)
    downrange = math.cos(azimuth) * north + math.sin(azimuth) * east
    return -down, downrange, np.cross(downrange, -down)


def lift_off_mass(card: VehicleAscent) -> float:
    """Return the mass in kg at ignition."""
    vehicle = card.vehicle
    fairing = vehicle.fairing.mass if vehicle.fairing else 0.0
    boosters = sum(group.number * (group.propellant + group.dry) for group in vehicle.boosters)
    return float(sum(stage.propellant + stage.dry for stage in vehicle.stages) + vehicle.payload + fairing + boosters)


def mass_above(card: VehicleAscent, number: int) -> float:
    """Return the mass in kg that stage `number` carries in orbit: full stages above it and the payload."""
    above = card.vehicle.stages[number:]
    return float(sum(stage.propellant + stage.dry for stage in above) + card.vehicle.payload)


def turned(vector: Floats, axis: Floats, angle: float) -> Floats:
    """Return a vector (3,) turned by an angle in rad about a unit axis (3,) at right angles to it, right-handed."""
    return np.asarray(math.cos(angle) * vector + math.sin(angle) * np.cross(axis, vector))


class _Pilot:
    """Flies leg after leg, keeping state, steering and events; used by `fly_ascent` alone."""

    def __init__(self, card: VehicleAscent, aim: Aim) -> None:
        vehicle = card.vehicle
        up, downrange, _ = site_axes(card.site, aim.azimuth)
        self.card, self.aim, self.t = card, aim, 0.0
        theta0 = gmst(card.epoch)
        n_law = 1 if card.parking is None else 2
        kick_end = card.vertical_rise + card.kick_duration
        self.steering = Steering(
            up, downrange, theta0, card.vertical_rise, card.kick_duration, aim.kick, kick_end, card.slew,
            np.full(n_law, np.inf), np.zeros((n_law, 3)), np.zeros(n_law), np.zeros(n_law),
        )  # fmt: skip
        self.drag = Drag(vehicle.reference_area, np.array(vehicle.mach), np.array(vehicle.drag_coefficient))
        self.y = np.concatenate([*pad_state(card.site, float(earth_angle(theta0, 0.0))), [lift_off_mass(card)]])
        self.legs: list[Leg] = []
        self.events = {"liftoff": 0.0, "kick": card.vertical_rise}

    def leg(self, name: str, duration: float, engine: Engine = COASTING) -> None:
        """Fly one leg; a leg without duration is none."""
        if duration <= 0.0:
            return
        n_step = max(8, math.ceil(duration / STEP))
        t, y = fly(self.t, duration, n_step, self.y, self.steering, engine, self.drag)
        self.legs.append(Leg(name, t, y, engine))
        self.t, self.y = float(t[-1]), y[-1].copy()

    def begin_law(self, k: int, tangent: float, rate: float, yaw: float = 0.0) -> None:
        """Let steering law k start now, in the present orbital plane or turned from it to the right by yaw."""
        s = self.steering
        s.law_start[k], s.tangent[k], s.rate[k] = self.t, tangent, rate
        normal = unit(np.cross(self.y[:3], self.y[3:6]))
        s.normal_i[k] = normal if yaw == 0.0 else turned(normal, unit(self.y[:3]), -yaw)

    def burn(self, number: int, duration: float | None, again: bool = False) -> None:
        """Burn for a duration, or until the propellant is gone, from cut to cut; a second burn has no cuts."""
        vehicle = self.card.vehicle
        stage, mark = vehicle.stages[number - 1], "_2" if again else ""
        begin, elapsed = self.t, 0.0
        self.events[f"stage{number}_ignition{mark}"] = begin
        left = self.y[6] - stage.propellant
        if number == 1:
            left -= sum(group.number * group.propellant for group in vehicle.boosters)
        if duration is None and not throttled(vehicle, stage):
            duration = stage.full_burn
        name = f"stage {number} burn{mark.replace('_', ' ')}"
        ends = math.inf if duration is None else begin + duration
        for cut in [] if again else cuts(vehicle, number):
            if begin + cut.after >= ends:
                break
            piece = cut.after - elapsed
            if piece > _SLIVER:
                with_fairing = " with fairing" if self.carries_fairing(number) else ""
                self.leg(name + with_fairing, piece, engine(vehicle, number, begin, self.t, self.t + piece))
            if cut.event:
                self.events[cut.event] = self.t
            self.y[6] -= cut.drop
            left -= cut.drop
            elapsed = cut.after
        push = engine(vehicle, number, begin, self.t, ends)
        if duration is None:
            ends = self.t + time_to_mass(self.t, left, STEP, self.y, self.steering, push, self.drag)
        self.leg(name, ends - self.t, push)
        self.events[f"stage{number}_cutoff{mark}"] = self.t

    def carries_fairing(self, number: int) -> bool:
        """Whether the fairing is still there, and goes during the burn of stage `number`."""
        fairing = self.card.vehicle.fairing
        return fairing is not None and fairing.stage == number and "fairing_separation" not in self.events

    def stage(self, number: int) -> None:
        """Fly a stage that burns out and is dropped."""
        stage = self.card.vehicle.stages[number - 1]
        self.ignite_after(number, stage)
        self.burn(number, None)
        self.leg(f"stage {number} coast", stage.separation_delay)
        self.events[f"stage{number}_separation"] = self.t
        self.y[6] -= stage.dry

    def ignite_after(self, number: int, stage: Stage) -> None:
        """Coast to the ignition of a stage, beginning the linear-tangent law with the first steered one."""
        if number == self.card.steered_from:
            span = self.time_to_last_cutoff(number)
            rate = (self.aim.tangent_end - self.aim.tangent) / span
            self.begin_law(0, self.aim.tangent, rate, self.aim.yaw)
        self.leg(f"coast before stage {number}", stage.ignition_delay)

    def time_to_last_cutoff(self, number: int) -> float:
        """Return about how long it is from now to the (first) cut-off in orbit; only scales the law."""
        span, inserting = self.aim.burn, self.card.inserting
        for stage in self.card.vehicle.stages[number - 1 : inserting - 1]:
            span += stage.full_burn + stage.separation_delay
        span += sum(stage.ignition_delay for stage in self.card.vehicle.stages[number - 1 : inserting])
        return max(1.0, float(span))  # a solver on its way may ask for no burn at all

    def into_orbit(self) -> None:
        """Fly the stage that is cut off in orbit, and the last burn where that orbit is a parking orbit."""
        number, last = self.card.inserting, len(self.card.vehicle.stages)
        stage = self.card.vehicle.stages[number - 1]
        self.ignite_after(number, stage)
        self.burn(number, self.aim.burn)
        if self.card.parking is None or self.aim.burn_2 <= 0.0:
            return
        self.begin_law(1, 0.0, 0.0)
        coast = self.aim.coast
        if number < last:
            self.leg(f"stage {number} coast", stage.separation_delay)
            self.events[f"stage{number}_separation"] = self.t
            self.y[6] = mass_above(self.card, number)
            coast -= stage.separation_delay
        self.leg("parking coast", coast)
        self.burn(last, self.aim.burn_2, again=number == last)


def fly_ascent(card: VehicleAscent, aim: Aim, final_coast: bool = True) -> Flight:
    """Return the ascent that a vehicle card flies with the given aim, from lift-off to the end of the final coast.

    Without the final coast the last state is that of injection. The last stage may burn more than its propellant: the
    caller checks for a shortfall.
    """
    pilot = _Pilot(card, aim)
    for number in range(1, card.inserting):
        pilot.stage(number)
    pilot.into_orbit()
    pilot.events["injection"] = pilot.t
    pilot.events.pop("stage1_ignition")  # it is the lift-off
    if final_coast:
        pilot.leg("final coast", card.coast_after_injection)
    events = dict(sorted(pilot.events.items(), key=lambda item: item[1]))
    return Flight(pilot.legs, pilot.steering, pilot.drag, events)
