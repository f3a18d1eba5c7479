"""Staged ascent of a vehicle card with given steering: legs from the pad to the final coast."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities.frames import earth_angle, ecef_from_geodetic, eci_from_ecef, gmst, rotation_e_n, unit
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.equations_of_motion import Drag, Propulsion, fly, time_to_mass
from lvnav_trade.trajectory.ascent.motors import cuts, engine
from lvnav_trade.trajectory.ascent.steering_law import Steering
from lvnav_trade.trajectory.ascent.vehicle_cards import Site, VehicleAscent

STEP = 0.25  # s; step of the integration and of the knots; halving it moves injection by 0.3 m
COASTING = Propulsion(
    thrust=0.0,
    mass_flow=0.0,
    exit_area=0.0,
    max_load=1.0,
)
_SLIVER = 1e-9  # s; a piece of a burn shorter than this is rounding


class TargetingUnknowns(NamedTuple):
    """Unknowns of the targeting: launch azimuth and kick (rad), steering law, burns and coasts (s).

    tangent and tangent_end are the tangents of the elevation at the start of the law, and `burn` s after the ignition
    of the stage that is cut off in orbit. coast and burn_2 are those of the last, level burn of an ascent through a
    parking orbit. yaw (rad, to the right) rotates the plane of the law out of that of the velocity, if the azimuth is
    prescribed.
    """

    azimuth: float
    kick: float
    tangent: float
    tangent_end: float
    burn: float
    coast: float = 0.0
    burn_2: float = 0.0
    yaw: float = 0.0


class AscentLeg(NamedTuple):
    """A phase of flight without a jump: times (n,) s, states (n, 7), engine. The steering is that of the ascent."""

    name: str
    t: Floats
    y: Floats
    engine: Propulsion


class SimulatedAscent(NamedTuple):
    """A whole ascent: legs in order, the final steering, drag, times (s) of events."""

    legs: list[AscentLeg]
    steering: Steering
    drag: Drag
    events: dict[str, float]


def pad_state(site: Site, theta: float) -> tuple[Floats, Floats]:
    """Return r_i (m) and v_i (m/s), each (3,), of a point at rest on the launch site at Earth angle theta."""
    r_e = ecef_from_geodetic(site.latitude, site.longitude, site.height)
    r_i = eci_from_ecef(r_e, theta)
    v_i = np.cross([0.0, 0.0, OMEGA], r_i)
    return r_i, v_i


def site_axes(site: Site, azimuth: float) -> tuple[Floats, Floats, Floats]:
    """Return the unit vectors up, downrange and right of the downrange, each (3,) in frame e."""
    north, east, down = rotation_e_n(site.latitude, site.longitude)
    up = -down
    downrange = math.cos(azimuth) * north + math.sin(azimuth) * east
    right = np.cross(downrange, up)
    return up, downrange, right


def lift_off_mass(card: VehicleAscent) -> float:
    """Return the mass in kg at ignition."""
    vehicle = card.vehicle
    fairing = vehicle.fairing.mass if vehicle.fairing else 0.0
    boosters = sum(group.number * (group.propellant + group.dry) for group in vehicle.boosters)
    return mass_above(card, 0) + fairing + boosters


def mass_above(card: VehicleAscent, number: int) -> float:
    """Return the mass (kg) above stage `number` in orbit: full stages and the payload."""
    stages_above = card.vehicle.stages[number:]
    full_stages = sum(stage.propellant + stage.dry for stage in stages_above)
    return float(full_stages + card.vehicle.payload)


def law_span(card: VehicleAscent, aim: TargetingUnknowns) -> float:
    """Return the approximate time (s) from the start of the steering law to the (first) cut-off in orbit.

    It only scales the law.
    """
    stages = card.vehicle.stages[card.steered_from - 1 : card.insertion_stage]
    lower_stages = stages[:-1]
    span = sum((stage.full_burn + stage.separation_delay for stage in lower_stages), start=aim.burn)
    span += sum(stage.ignition_delay for stage in stages)
    return max(1.0, float(span))  # an iteration of the solver may have no burn at all


class Pilot:
    """Simulation of an ascent leg by leg, with its state, steering and events."""

    def __init__(self, card: VehicleAscent, aim: TargetingUnknowns, span: float | None) -> None:
        vehicle = card.vehicle
        self.span = law_span(card, aim) if span is None else span
        self.card, self.aim, self.t = card, aim, 0.0
        up, downrange, _ = site_axes(card.site, aim.azimuth)
        theta0 = gmst(card.epoch)
        n_law = 1 if card.parking is None else 2
        self.steering = Steering(
            up_e=up,
            downrange_e=downrange,
            theta0=theta0,
            kick_start=card.vertical_rise,
            kick_duration=card.kick_duration,
            kick_angle=aim.kick,
            follow_start=card.vertical_rise + card.kick_duration,
            slew=card.slew,
            law_start=np.full(n_law, np.inf),
            normal_i=np.zeros((n_law, 3)),
            tangent=np.zeros(n_law),
            rate=np.zeros(n_law),
        )
        self.drag = Drag(
            area=vehicle.reference_area,
            mach=np.array(vehicle.mach),
            coefficient=np.array(vehicle.drag_coefficient),
        )
        r_i, v_i = pad_state(card.site, float(earth_angle(theta0, 0.0)))
        self.y = np.concatenate([r_i, v_i, [lift_off_mass(card)]])
        self.legs: list[AscentLeg] = []
        self.events = {"liftoff": 0.0, "kick": card.vertical_rise}

    def leg(self, name: str, duration: float, engine: Propulsion = COASTING) -> None:
        """Integrate a leg without a jump for a duration (s)."""
        if duration <= 0.0:
            return
        n_step = max(8, math.ceil(duration / STEP))
        t, y = fly(self.t, duration, n_step, self.y, self.steering, engine, self.drag)
        self.legs.append(AscentLeg(name, t, y, engine))
        self.t = float(t[-1])
        self.y = y[-1].copy()

    def begin_law(self, k: int, tangent: float, rate: float, yaw: float = 0.0) -> None:
        """Start steering law k at the present time.

        k : index of the law
        tangent, rate : tangent of the elevation at the start, and its rate (1/s)
        yaw : rad. Rotation of the plane of the law from the present orbital plane, positive to the right.
        """
        steering = self.steering
        steering.law_start[k] = self.t
        steering.tangent[k] = tangent
        steering.rate[k] = rate
        r = self.y[:3]
        v = self.y[3:6]
        normal = unit(np.cross(r, v))
        along = np.cross(unit(r), normal)
        steering.normal_i[k] = math.cos(yaw) * normal - math.sin(yaw) * along

    def burn(self, number: int, duration: float | None, is_second: bool = False) -> None:
        """Burn a stage, from cut to cut.

        number : number of the stage, from 1
        duration : s. None: until the propellant is depleted.
        is_second : whether this is a second burn, which has no cuts
        """
        vehicle = self.card.vehicle
        stage = vehicle.stages[number - 1]
        mark = "_2" if is_second else ""
        ignition = self.t
        time_from_ignition = 0.0
        self.events[f"stage{number}_ignition{mark}"] = ignition
        empty_mass = self.y[6] - stage.propellant
        empty_mass -= sum(group.number * group.propellant for group in vehicle.boosters if number == 1)
        # the depletion time of a stage that can be throttled follows from the integration
        if duration is None and (stage.thrust is None or vehicle.max_load is None):
            duration = stage.full_burn
        name = f"stage {number} burn{mark.replace('_', ' ')}"
        end = math.inf if duration is None else ignition + duration
        burn_points = [] if is_second else cuts(vehicle, number)
        for cut in burn_points:
            if ignition + cut.time_from_ignition >= end:
                break
            duration_to_cut = cut.time_from_ignition - time_from_ignition
            if duration_to_cut > _SLIVER:
                leg_end = self.t + duration_to_cut
                push = engine(vehicle, number, ignition, self.t, leg_end)
                leg_name = f"{name} with fairing" if self._has_fairing(number) else name
                self.leg(leg_name, duration_to_cut, push)
            if cut.event:
                self.events[cut.event] = self.t
            self.y[6] -= cut.dropped_mass
            empty_mass -= cut.dropped_mass
            time_from_ignition = cut.time_from_ignition
        push = engine(vehicle, number, ignition, self.t, end)
        if duration is None:
            time_to_depletion = time_to_mass(self.t, empty_mass, STEP, self.y, self.steering, push, self.drag)
            end = self.t + time_to_depletion
        self.leg(name, end - self.t, push)
        self.events[f"stage{number}_cutoff{mark}"] = self.t

    def _has_fairing(self, number: int) -> bool:
        """Return whether the fairing is released in the burn of a stage, and is not released yet."""
        fairing = self.card.vehicle.fairing
        return fairing is not None and fairing.stage == number and "fairing_separation" not in self.events

    def stage(self, number: int) -> None:
        """Simulate a stage that is not cut off in orbit, from the coast before ignition to its separation."""
        self.ignite_after(number)
        self.burn(number, None)
        self.separate(number)
        self.y[6] -= self.card.vehicle.stages[number - 1].dry

    def separate(self, number: int) -> None:
        """Coast to the separation of a stage, whose mass the caller subtracts."""
        stage = self.card.vehicle.stages[number - 1]
        self.leg(f"stage {number} coast", stage.separation_delay)
        self.events[f"stage{number}_separation"] = self.t

    def ignite_after(self, number: int) -> None:
        """Coast to the ignition of a stage; the first steered stage starts the linear-tangent law."""
        if number == self.card.steered_from:
            aim = self.aim
            rate = (aim.tangent_end - aim.tangent) / self.span
            self.begin_law(0, aim.tangent, rate, aim.yaw)
        stage = self.card.vehicle.stages[number - 1]
        self.leg(f"coast before stage {number}", stage.ignition_delay)

    def simulate_insertion(self) -> None:
        """Simulate the stage that is cut off in orbit, and the last burn if that orbit is a parking orbit."""
        number, last = self.card.insertion_stage, len(self.card.vehicle.stages)
        self.ignite_after(number)
        self.burn(number, self.aim.burn)
        if self.card.parking is None or self.aim.burn_2 <= 0.0:
            return
        self.begin_law(1, 0.0, 0.0)
        coast = self.aim.coast
        if number < last:
            self.separate(number)
            self.y[6] = mass_above(self.card, number)
            coast -= self.card.vehicle.stages[number - 1].separation_delay
        self.leg("parking coast", coast)
        self.burn(last, self.aim.burn_2, is_second=number == last)


def fly_ascent(
    card: VehicleAscent, aim: TargetingUnknowns, final_coast: bool = True, span: float | None = None
) -> SimulatedAscent:
    """Return the ascent of a vehicle with given steering, from lift-off to the end of the final coast.

    The last stage may burn more than its propellant: the caller checks for a shortfall.

    Parameters
    ----------
    card : VehicleAscent
    aim : TargetingUnknowns
        Steering, burns and coasts.
    final_coast : bool
        Without it the last state is that of injection.
    span : float, optional
        Time scale of the steering law (s), if the law is that of another vehicle.
    """
    pilot = Pilot(card, aim, span)
    for number in range(1, card.insertion_stage):
        pilot.stage(number)
    pilot.simulate_insertion()
    pilot.events["injection"] = pilot.t
    pilot.events.pop("stage1_ignition")  # it is the lift-off
    if final_coast:
        pilot.leg("final coast", card.coast_after_injection)
    return SimulatedAscent(pilot.legs, pilot.steering, pilot.drag, pilot.events)
