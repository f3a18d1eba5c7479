"""Flight in orbit: coasts, burns, and the way down to an altitude, its braking and parachutes."""

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from lvnav_trade.kernels.earth import SEMI_MAJOR
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import (
    Elements,
    earth_angle,
    earth_velocity,
    ecef_from_eci,
    gmst,
    state_from_elements,
    unit,
)
from lvnav_trade.quantities.units import Angle, Area, Card, Epoch, Force, Length, Mass, TimeConstant
from lvnav_trade.trajectory.ascent.equations_of_motion import Drag
from lvnav_trade.trajectory.ascent.launch import achieved_orbit
from lvnav_trade.trajectory.ascent.vehicle_cards import STANDARD_GRAVITY, FlightCard, refuse_drag_table
from lvnav_trade.trajectory.disturbances import OscillationCard
from lvnav_trade.trajectory.flights.free_flight import (
    AttitudeLaw,
    Axes,
    FlightIntegration,
    Law,
    airspeed_direction,
    airspeed_law,
    attitude,
    backward_direction,
    forward_direction,
    greatest_load,
    inertial_law,
    knots,
    level_attitude,
    phases,
    rotate_law,
    velocity_law,
)
from lvnav_trade.trajectory.truth import Trajectory, attitude_spline

Pointing = Literal["prograde", "retrograde", "horizontal", "airspeed", "inertial"]

_NOSES: dict[Pointing, Law] = {
    "prograde": forward_direction,
    "retrograde": backward_direction,
    "airspeed": airspeed_direction,
}
_COAST, _POWERED, _CANOPY = 2.0, 0.25, 0.05  # s between knots: where forces are smooth, in burns and air, at openings
_AIR = 200e3  # m; knots below it are as close as in a burn
_WIDEST = 2.5  # rad; largest turn in a burn: near half a turn the direction, and thus the thrust, is ambiguous
_ENTRY = 100e3  # m; altitude of the event entry
_SLEW = 60.0  # s
_LONGEST = 20000.0  # s of a coast down: three orbits


class OrbitalStart(Card):
    """Osculating orbit at t = 0: altitudes above the equatorial radius, and the place at which the flight begins."""

    perigee: Length
    apogee: Length
    inclination: Angle
    node: Angle = Field(0.0, description="longitude of the ascending node in the Earth-fixed frame at t = 0")
    perigee_argument: Angle = 0.0
    latitude_argument: Angle = Field(0.0, description="angle from the ascending node to the start")

    def _faults(self) -> Iterator[str]:
        if self.apogee < self.perigee:
            yield "apogee lies below perigee"
        if self.perigee <= -SEMI_MAJOR:
            yield f"perigee: {self.perigee * 1e-3:.6g} km is below the Earth's centre; it counts from the surface"


class OrbitalLeg(Card):
    """A coast or a burn, with an attitude law to which the body turns at its start.

    prograde, retrograde: x axis along or against the inertial velocity; horizontal: x axis level in the orbital plane;
    airspeed: x axis along the velocity through the air; inertial: constant inertial attitude of the start of the leg.
    Pitch and yaw are rotations from the law about body axes.
    """

    name: str = Field(
        pattern="^[a-z][a-z0-9_]*$", description="name of the event; a burn has NAME_ignition and NAME_cutoff"
    )
    duration: TimeConstant
    thrust: Force | None = Field(None, description="vacuum thrust along the x axis; none: a coast")
    specific_impulse: TimeConstant | None = None
    attitude: Pointing = "inertial"
    pitch: Angle = 0.0
    yaw: Angle = 0.0
    slew: TimeConstant = Field(_SLEW, description="time to turn to the attitude law")

    @property
    def flow(self) -> float:
        """Mass flow in kg/s."""
        if self.thrust is None or self.specific_impulse is None:
            return 0.0
        return self.thrust / (STANDARD_GRAVITY * self.specific_impulse)

    def _faults(self) -> Iterator[str]:
        if (self.thrust is None) != (self.specific_impulse is None):
            yield "a burn needs thrust and specific_impulse, a coast neither"


class Canopy(Card):
    """A parachute that opens at an altitude and is replaced by the next parachute."""

    name: str = Field(pattern="^[a-z][a-z0-9_]*$")
    below: Length
    drag_area: Annotated[Area, Field(gt=0.0)] = Field(description="area times drag coefficient")


class Descent(Card):
    """The last coast, through the air down to an altitude."""

    altitude: Length = Field(description="height at which the flight ends, at the last whole second before it")
    attitude: Pointing = "airspeed"
    pitch: Angle = 0.0
    yaw: Angle = 0.0
    slew: TimeConstant = 60.0
    parachutes: tuple[Canopy, ...] = ()

    def _faults(self) -> Iterator[str]:
        marks = [canopy.below for canopy in self.parachutes] + [self.altitude]
        is_unordered = any(next_mark >= mark for mark, next_mark in pairwise(marks))
        if is_unordered:
            yield "parachutes open one below the other, above the altitude of the end"


class OrbitalFlight(FlightCard):
    """A trajectory that begins in orbit at t = 0: legs, and optionally a descent to an altitude.

    Drag acts throughout, with the present mass; there is none without a reference area.
    """

    kind: Literal["orbital"] = "orbital"
    epoch: Epoch = Field(description="t = 0, ISO 8601 UTC")
    orbit: OrbitalStart  # at t = 0
    mass: Annotated[Mass, Field(gt=0.0)]  # at t = 0
    reference_area: Area = 0.0  # area that the drag coefficients refer to
    mach: tuple[float, ...] = Field((0.0, 1.0), min_length=2, description="Mach numbers of the drag table, increasing")
    drag_coefficient: tuple[float, ...] = Field((2.2, 2.2), min_length=2)  # at the Mach numbers
    legs: tuple[OrbitalLeg, ...] = Field(min_length=1)  # coasts and burns in order
    descent: Descent | None = None  # to the end altitude; none: the flight ends with its last leg
    oscillation: tuple[OscillationCard, ...] = Field((), description="coning and vibration, by parts of the flight")

    pad_hold: ClassVar[float] = 0.0  # the flight begins with its first event
    coast_after_injection: ClassVar[float] = 0.0  # and ends with the last one

    def _faults(self) -> list[str]:
        refuse_drag_table(self.mach, self.drag_coefficient)
        burnt = sum(leg.flow * leg.duration for leg in self.legs)
        names = {leg.name for leg in self.legs}
        rules = {
            "two legs have the same name": len(names) < len(self.legs),
            "slew of the first leg has no effect: no leg comes before it; leave it out": self.legs[0].slew != _SLEW,
            f"the burns use {burnt:g} kg, the mass is {self.mass:g} kg": burnt >= self.mass,
        }
        return [fault for fault, applies in rules.items() if applies]


def orbit(card: OrbitalFlight) -> Trajectory:
    """Return the true trajectory of an orbital card; InputError if it does not come down, or comes down too early."""
    flight = _OrbitalIntegration(card)
    for leg in card.legs:
        flight.leg(leg)
    if card.descent is not None:
        flight.descend(card.descent)
    flight.events["end"] = flight.t
    t, y = knots(flight.stretches)
    q_b_i = attitude_spline(t, attitude(flight.modes, t, y))
    return Trajectory(
        phases=tuple(phases(flight.stretches, q_b_i)),
        events=flight.events,
        theta0=flight.theta0,
        epoch=card.epoch,
        facts=_facts(flight),
    )


def _initial_elements(orbit: OrbitalStart, theta0: float) -> Elements:
    """Return the orbital elements of a start; theta0 : rad, Earth angle at t = 0."""
    a = SEMI_MAJOR + 0.5 * (orbit.apogee + orbit.perigee)
    linear_eccentricity = 0.5 * (orbit.apogee - orbit.perigee)
    return Elements(
        semi_major_axis=np.array(a),
        eccentricity=np.array(linear_eccentricity / a),
        inclination=np.array(orbit.inclination),
        node=np.array(orbit.node + theta0),
        perigee_argument=np.array(orbit.perigee_argument),
        true_anomaly=np.array(orbit.latitude_argument - orbit.perigee_argument),
    )


class _OrbitalIntegration(FlightIntegration):
    def __init__(self, card: OrbitalFlight) -> None:
        self.card = card
        theta0 = gmst(card.epoch)
        elements = _initial_elements(card.orbit, theta0)
        r_i, v_i = state_from_elements(elements)
        y = np.concatenate([r_i, v_i, [card.mass]])
        air = None
        if card.reference_area > 0.0:
            air = Drag(
                area=card.reference_area,
                mach=np.array(card.mach),
                coefficient=np.array(card.drag_coefficient),
            )
        super().__init__(theta0, y, air)

    def point(self, leg: OrbitalLeg | Descent) -> None:
        """Turn to the attitude law of a leg at the present time; the first law applies from the start."""
        start = self.t if self.modes else -math.inf
        slew = leg.slew if self.modes else 0.0
        axes = rotate_law(self._law(leg.attitude), leg.pitch, leg.yaw)
        is_rotated = leg.pitch != 0.0 or leg.yaw != 0.0
        nose = None if is_rotated else _NOSES.get(leg.attitude)
        self.modes.append(AttitudeLaw(start, slew, axes, nose))

    def _law(self, law: Pointing) -> Axes:
        """Return an attitude law that begins at the present state."""
        if law == "inertial":
            if self.modes:
                return inertial_law(self.axes())
            return inertial_law(velocity_law()(np.array([self.t]), self.y[None])[0])
        if law == "airspeed":
            across = unit(np.cross(self.y[3:6], self.y[:3]))
            across_e = ecef_from_eci(across, earth_angle(self.theta0, self.t))
            return airspeed_law(across_e, self.theta0)
        if law == "horizontal":
            return level_attitude
        return velocity_law(1.0 if law == "prograde" else -1.0)

    def leg(self, leg: OrbitalLeg) -> None:
        """Integrate a coast or a burn."""
        self.point(leg)
        has_thrust = leg.thrust is not None
        if has_thrust and self._turn() > _WIDEST:
            raise InputError(
                f"{self.card.name}: the body would turn by {math.degrees(self._turn()):.0f} deg while {leg.name!r} "
                "burns; turn it in a coast before"
            )
        self.events[f"{leg.name}_ignition" if has_thrust else leg.name] = self.t
        is_smooth = not has_thrust and leg.slew >= 20.0 * _COAST and self.height >= _AIR
        step = _COAST if is_smooth else _POWERED
        thrust = self.thrust(leg.thrust, leg.flow) if leg.thrust is not None else None
        self.append_phase(self.integrate_phase(leg.name, leg.duration, step, thrust, self.height_condition(0.0)))
        if self.height < 1.0:
            raise InputError(f"{self.card.name}: the leg {leg.name!r} ends on the ground")
        if has_thrust:
            self.events[f"{leg.name}_cutoff"] = self.t

    def _turn(self) -> float:
        """Return the angle (rad) from the present attitude to that of the latest law."""
        present_axes = self.axes()
        latest_axes = self.axes(self.modes[-1:])
        rotation = present_axes.T @ latest_axes
        trace = float(np.trace(rotation))
        cosine = 0.5 * (trace - 1.0)
        return math.acos(min(1.0, max(-1.0, cosine)))

    def _marks(self, card: Descent) -> list[tuple[float, Canopy | None]]:
        """Return the heights (m) at which the descent is cut, downwards, with the parachute that opens there."""
        marks: list[tuple[float, Canopy | None]] = []
        opens_below_entry = all(canopy.below < _ENTRY for canopy in card.parachutes)
        for height in (_AIR, _ENTRY):
            is_crossed = card.altitude < height < self.height
            if is_crossed and (height == _AIR or opens_below_entry):
                marks.append((height, None))
        marks += [(canopy.below, canopy) for canopy in card.parachutes]
        return [*marks, (card.altitude, None)]

    def descend(self, card: Descent) -> None:
        """Integrate the descent to its end, with its parachutes."""
        self.point(card)
        self.events["descent"] = self.t
        is_smooth = self.height > _AIR and card.slew >= 20.0 * _COAST
        step = _COAST if is_smooth else _POWERED
        for mark, canopy in self._marks(card):
            height_condition = self.height_condition(mark)
            if height_condition(self.t, self.y) <= 0.0:
                raise InputError(f"{self.card.name}: the descent begins below {mark / 1e3:g} km")
            stretch = self.integrate_phase("descent", _LONGEST, step, end_condition=height_condition)
            end = stretch.t[-1]
            if height_condition(float(end), stretch.y[-1]) > 1.0:
                raise InputError(f"{self.card.name}: does not come down to {card.altitude / 1e3:g} km")
            if mark == card.altitude:  # a whole second is the end of a tick at every rate
                duration = math.floor(end) - self.t
                stretch = self.integrate_phase("descent", duration, step)
            self.append_phase(stretch)
            step = _POWERED
            if mark == _ENTRY:
                self.events["entry"] = self.t
            if canopy is not None:
                self.events[canopy.name] = self.t
                self.air = Drag(
                    area=canopy.drag_area,
                    mach=np.array([0.0, 1.0]),
                    coefficient=np.ones(2),
                )
                self.append_phase(self.integrate_phase("opening", 4.0, _CANOPY))


def _facts(flight: _OrbitalIntegration) -> dict[str, float | str]:
    first = achieved_orbit(flight.stretches[0].y[0])
    return {
        "perigee_at_start_m": first["perigee_m"],
        "apogee_at_start_m": first["apogee_m"],
        "inclination_rad": first["inclination_rad"],
        "mass_at_end_kg": float(flight.y[6]),
        "max_load_g": greatest_load(flight.stretches) / STANDARD_GRAVITY,
        "altitude_at_end_m": flight.height,
        "ground_speed_at_end_m_per_s": float(np.linalg.norm(earth_velocity(flight.y[:3], flight.y[3:6]))),
    }
