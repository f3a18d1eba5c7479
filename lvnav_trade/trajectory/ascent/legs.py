"""Staged ascent of a vehicle card with given steering: motors and legs from the pad to the final coast."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities.frames import earth_angle, ecef_from_geodetic, eci_from_ecef, gmst, rotation_e_n, unit
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.equations_of_motion import NOTHING, Drag, Propulsion, Unthrottled, fly, time_to_mass
from lvnav_trade.trajectory.ascent.steering_law import Steering
from lvnav_trade.trajectory.ascent.vehicle_cards import Boosters, Motor, Site, Stage, VehicleAscent, VehicleCard

_Burning = tuple[Motor, int, float]  # motor, number of motors, time of ignition
STEP = 0.25  # s; step of the integration and of the knots; halving it moves injection by 0.3 m
COASTING = Propulsion(0.0, 0.0, 0.0, 1.0)
_SLIVER = 1e-9  # s; a piece of a burn shorter than this is rounding


class BurnPoint(NamedTuple):
    """A point in the burn of a stage, `after` s from ignition: mass (kg) dropped there, and name of the event."""

    after: float
    drop: float = 0.0
    event: str = ""


def cuts(vehicle: VehicleCard, number: int) -> list[BurnPoint]:
    """Return, in order, the points of the first burn of a stage at which thrust jumps or bends, or mass is dropped."""
    stage, fairing = vehicle.stages[number - 1], vehicle.fairing
    points = [BurnPoint(after) for after in _bends(stage)]
    if fairing is not None and fairing.stage == number:
        points.append(BurnPoint(fairing.after_ignition, fairing.mass, "fairing_separation"))
    boosters = vehicle.boosters if number == 1 else ()
    for group in boosters:
        burn_end = group.ignition + group.full_burn
        points += [BurnPoint(group.ignition + after) for after in _bends(group)]
        if group.ignition > 0.0:
            points.append(BurnPoint(group.ignition, event=f"{group.name}_ignition"))
        points.append(BurnPoint(burn_end, event=f"{group.name}_cutoff"))
        points.append(BurnPoint(group.gone, group.number * group.dry, f"{group.name}_separation"))
    return sorted(points, key=lambda cut: cut.after)


def engine(vehicle: VehicleCard, number: int, ignition: float, begin: float, end: float) -> Propulsion:
    """Return the propulsion over an interval between two successive `cuts`, in which every thrust is linear in time.

    number : number of the burning stage, from 1
    ignition : s since lift-off. Ignition of the stage.
    begin, end : s since lift-off. The end is infinite for a stage without bends.
    """
    stage = vehicle.stages[number - 1]
    middle = 0.5 * (begin + end)
    burning: list[_Burning] = []
    for group in vehicle.boosters if number == 1 else ():
        if group.ignition < middle < group.ignition + group.full_burn:
            burning.append((group, group.number, group.ignition))
    if stage.profile is not None:
        motors = _total_thrust([(stage, 1, ignition), *burning], begin, end)
        return Propulsion(0.0, 0.0, 0.0, math.inf, motors)
    limit = math.inf if stage.thrust is None or vehicle.max_load is None else vehicle.max_load
    return Propulsion(
        thrust=stage.full_thrust,
        mass_flow=stage.full_thrust / stage.exhaust_speed,
        exit_area=stage.exit_area,
        max_load=limit,
        beside=_total_thrust(burning, begin, end) if burning else NOTHING,
    )


def impulse_speed(vehicle: VehicleCard, payload: float) -> float:
    """Return the ideal velocity gain (m/s) of the vehicle with a payload (kg), with all propellant burnt.

    Boosters burn together with the propellant that the first stage consumes in that time. The fairing is counted to the
    end of the burn in which it is released.
    """
    mass, gain = payload, 0.0
    for number in range(len(vehicle.stages), 0, -1):
        stage = vehicle.stages[number - 1]
        if vehicle.fairing is not None and vehicle.fairing.stage == number:
            mass += vehicle.fairing.mass
        boosters = vehicle.boosters if number == 1 else ()
        booster_time = max((group.gone for group in boosters), default=0.0)
        joint_propellant = stage.propellant * booster_time / stage.full_burn
        alone = stage.propellant - joint_propellant
        gain += stage.exhaust_speed * math.log1p(alone / (mass + stage.dry))
        if boosters:
            gain += _joint_gain(boosters, stage, stage.propellant - alone, mass + stage.dry + alone)
        mass += stage.dry + stage.propellant
    return gain


def _joint_gain(groups: tuple[Boosters, ...], stage: Stage, stage_propellant: float, mass: float) -> float:
    """Return the velocity gain (m/s) while boosters and stage burn together.

    stage_propellant : kg. Propellant of the stage burnt in that time.
    mass : kg. Mass at the end.
    """
    burnt = [(group.number * group.propellant, group.exhaust_speed) for group in groups]
    burnt.append((stage_propellant, stage.exhaust_speed))
    total = sum(propellant for propellant, _ in burnt)
    mean_exhaust = sum(propellant * speed for propellant, speed in burnt) / total
    dry = sum(group.number * group.dry for group in groups)
    return mean_exhaust * math.log1p(total / (mass + dry))


def _bends(motor: Motor) -> list[float]:
    """Return the points of a motor's thrust profile, s after ignition; with guidance it may burn beyond the last."""
    if motor.profile is None:
        return []
    return [share * motor.full_burn for share in motor.profile.part[1:]]


def _thrust_at(motor: Motor, after: float) -> float:
    """Return the vacuum thrust (N) of a motor `after` s from ignition; constant after its burn time.

    The profile is linear between its points, and is scaled to the mean thrust of the motor.
    """
    if motor.profile is None:
        return motor.full_thrust
    share, level = motor.profile.part, motor.profile.thrust
    intervals = range(len(share) - 1)
    mean = sum(0.5 * (level[k] + level[k + 1]) * (share[k + 1] - share[k]) for k in intervals)
    x = min(max(after / motor.full_burn, 0.0), 1.0)
    k = next(k for k in intervals if x <= share[k + 1])
    rise = level[k + 1] - level[k]
    width = share[k + 1] - share[k]
    level_x = level[k] + rise * (x - share[k]) / width
    return motor.full_thrust * level_x / mean


def _total_thrust(burning: list[_Burning], begin: float, end: float) -> Unthrottled:
    """Return the total of motors over an interval in which the thrust of each is linear.

    burning : motors, each with its number and its ignition (s since lift-off)
    begin, end : s since lift-off
    """
    total = np.zeros(5)
    for motor, number, ignition in burning:
        first = _thrust_at(motor, begin - ignition)
        last = _thrust_at(motor, end - ignition)
        thrust = number * first
        slope = number * ((last - first) / (end - begin))
        exhaust = motor.exhaust_speed
        total += [thrust, slope, thrust / exhaust, slope / exhaust, number * motor.exit_area]
    return Unthrottled(begin, *total.tolist())


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
    r_i = eci_from_ecef(ecef_from_geodetic(site.latitude, site.longitude, site.height), theta)
    return r_i, np.cross([0.0, 0.0, OMEGA], r_i)


def site_axes(site: Site, azimuth: float) -> tuple[Floats, Floats, Floats]:
    """Return the unit vectors up, downrange and right of the downrange, each (3,) in frame e."""
    north, east, down = rotation_e_n(site.latitude, site.longitude)
    downrange = math.cos(azimuth) * north + math.sin(azimuth) * east
    return -down, downrange, np.cross(downrange, -down)


def lift_off_mass(card: VehicleAscent) -> float:
    """Return the mass in kg at ignition."""
    fairing = card.vehicle.fairing.mass if card.vehicle.fairing else 0.0
    boosters = sum(group.number * (group.propellant + group.dry) for group in card.vehicle.boosters)
    return mass_above(card, 0) + fairing + boosters


def mass_above(card: VehicleAscent, number: int) -> float:
    """Return the mass (kg) above stage `number` in orbit: full stages and the payload."""
    above = card.vehicle.stages[number:]
    return float(sum(stage.propellant + stage.dry for stage in above) + card.vehicle.payload)


def law_span(card: VehicleAscent, aim: TargetingUnknowns) -> float:
    """Return the approximate time (s) from the start of the steering law to the (first) cut-off in orbit.

    It only scales the law.
    """
    stages = card.vehicle.stages[card.steered_from - 1 : card.inserting]
    span = sum((stage.full_burn + stage.separation_delay for stage in stages[:-1]), start=aim.burn)
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
        self.drag = Drag(vehicle.reference_area, np.array(vehicle.mach), np.array(vehicle.drag_coefficient))
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
        self.t, self.y = float(t[-1]), y[-1].copy()

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
        normal = unit(np.cross(self.y[:3], self.y[3:6]))
        along = np.cross(unit(self.y[:3]), normal)
        steering.normal_i[k] = math.cos(yaw) * normal - math.sin(yaw) * along

    def burn(self, number: int, duration: float | None, again: bool = False) -> None:
        """Burn a stage, from cut to cut.

        number : number of the stage, from 1
        duration : s. None: until the propellant is depleted.
        again : whether this is a second burn, which has no cuts
        """
        vehicle = self.card.vehicle
        stage, mark = vehicle.stages[number - 1], "_2" if again else ""
        ignition, elapsed = self.t, 0.0
        self.events[f"stage{number}_ignition{mark}"] = ignition
        empty_mass = self.y[6] - stage.propellant
        empty_mass -= sum(group.number * group.propellant for group in vehicle.boosters if number == 1)
        # the depletion time of a stage that can be throttled follows from the integration
        if duration is None and (stage.thrust is None or vehicle.max_load is None):
            duration = stage.full_burn
        name = f"stage {number} burn{mark.replace('_', ' ')}"
        end = math.inf if duration is None else ignition + duration
        for cut in [] if again else cuts(vehicle, number):
            if ignition + cut.after >= end:
                break
            piece = cut.after - elapsed
            if piece > _SLIVER:
                push = engine(vehicle, number, ignition, self.t, self.t + piece)
                self.leg(f"{name} with fairing" if self._has_fairing(number) else name, piece, push)
            if cut.event:
                self.events[cut.event] = self.t
            self.y[6] -= cut.drop
            empty_mass -= cut.drop
            elapsed = cut.after
        push = engine(vehicle, number, ignition, self.t, end)
        if duration is None:
            end = self.t + time_to_mass(self.t, empty_mass, STEP, self.y, self.steering, push, self.drag)
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
        self.leg(f"stage {number} coast", self.card.vehicle.stages[number - 1].separation_delay)
        self.events[f"stage{number}_separation"] = self.t

    def ignite_after(self, number: int) -> None:
        """Coast to the ignition of a stage; the first steered stage starts the linear-tangent law."""
        if number == self.card.steered_from:
            rate = (self.aim.tangent_end - self.aim.tangent) / self.span
            self.begin_law(0, self.aim.tangent, rate, self.aim.yaw)
        self.leg(f"coast before stage {number}", self.card.vehicle.stages[number - 1].ignition_delay)

    def into_orbit(self) -> None:
        """Simulate the stage that is cut off in orbit, and the last burn if that orbit is a parking orbit."""
        number, last = self.card.inserting, len(self.card.vehicle.stages)
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
        self.burn(last, self.aim.burn_2, again=number == last)


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
    for number in range(1, card.inserting):
        pilot.stage(number)
    pilot.into_orbit()
    pilot.events["injection"] = pilot.t
    pilot.events.pop("stage1_ignition")  # it is the lift-off
    if final_coast:
        pilot.leg("final coast", card.coast_after_injection)
    return SimulatedAscent(pilot.legs, pilot.steering, pilot.drag, pilot.events)
