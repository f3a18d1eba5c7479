"""The flight of a sounding rocket: along its rail, nose first through the air, over the apogee and down."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from lvnav_trade.errors import InputError
from lvnav_trade.frames import (
    earth_angle,
    earth_velocity,
    ecef_from_eci,
    eci_from_ecef,
    gmst,
    matrices,
    rotation_i_e,
    rotation_i_n,
    unit,
)
from lvnav_trade.kernels.earth import OMEGA, SEMI_MAJOR
from lvnav_trade.kernels.media.atmosphere import atmosphere
from lvnav_trade.world.ascent.launch import pad_knots, pad_track
from lvnav_trade.world.ascent.legs import pad_state, site_axes
from lvnav_trade.world.ascent.vehicle import STANDARD_GRAVITY
from lvnav_trade.world.flight import pointing
from lvnav_trade.world.flight.free_flight import (
    Aerodynamics,
    Law,
    Stretch,
    Thrust,
    climb,
    fly,
    greatest_load,
    height,
    knots,
    newton,
    phases,
)
from lvnav_trade.world.flight.pointing import Mode
from lvnav_trade.world.flight.sounding import SolidMotor, SoundingFlight, spin_angle
from lvnav_trade.world.truth import Phase, Trajectory, attitude_spline, body_axes, position_spline

Floats = NDArray[np.float64]

_STEP = 0.25  # s between knots
_LONGEST = 3600.0  # s of a coast; a rocket that is not down again by then has left for orbit


def launch(card: SoundingFlight) -> Trajectory:
    """Return the flight of a sounding rocket; InputError where it does not rise, or its apogee is out of reach."""
    flight = _fly(card, *_solve(card))
    before = pad_knots(card.pad_hold, _STEP)
    t, y = knots(flight.stretches)
    t, y = np.concatenate([before, t]), np.concatenate([np.zeros((before.size, 7)), y])
    attitude = attitude_spline(t, pointing.attitude(flight.modes, t, y))
    flight.events["max_q"], pressure = _max_q(flight)
    events = dict(sorted(flight.events.items(), key=lambda item: item[1]))
    spin = spin_angle(card.spin, events, float(t[0]), float(t[-1]))
    flown = phases(flight.stretches, attitude, spin)
    if card.pad_hold > 0.0:
        pad = pad_track(card.site, flight.theta0, card.pad_hold)
        flown.insert(0, Phase(pad.name, float(pad.t[0]), 0.0, position_spline(*pad[1:]), attitude, spin))
    return Trajectory(tuple(flown), events, flight.theta0, card.epoch, _facts(card, flight, pressure))


class _Flight:
    """Flies stretch after stretch, keeping state, modes of attitude and events."""

    def __init__(self, card: SoundingFlight, elevation: float) -> None:
        up, downrange, right = site_axes(card.site, card.rail.azimuth)
        self.card, self.t, self.theta0 = card, 0.0, gmst(card.epoch)
        self.elevation = elevation
        self.rail_e = math.cos(elevation) * downrange + math.sin(elevation) * up
        self.right_e = right
        mass = card.payload + sum(stage.propellant + stage.dry for stage in card.stages)
        self.y = np.concatenate([*pad_state(card.site, float(earth_angle(self.theta0, 0.0))), [mass]])
        self.modes = [Mode(-math.inf, 0.0, pointing.fixed_to_earth(self.rail_e, right, self.theta0))]
        self.air = Aerodynamics(card.reference_area, np.array(card.mach), np.array(card.drag_coefficient))
        self.stretches: list[Stretch] = []
        self.events = {"liftoff": 0.0}
        self.held = False

    def thrust(self, stage: SolidMotor) -> Thrust:
        """Return the motor of a stage at work."""
        flow = stage.propellant / stage.burn_time
        vacuum = flow * STANDARD_GRAVITY * stage.specific_impulse
        return Thrust(vacuum, flow, stage.exit_area, lambda t, y: pointing.nose(self.modes, t, y))

    def keep(self, stretch: Stretch) -> None:
        """Take a stretch that was flown."""
        self.stretches.append(stretch)
        self.t, self.y = float(stretch.t[-1]), stretch.y[-1].copy()

    def leave_rail(self, stage: SolidMotor) -> None:
        """Fly the metres on the rail, whose force lets only the motion along it be."""
        free = newton(self.air, self.thrust(stage), self.theta0)
        start_e = ecef_from_eci(self.y[:3], self.theta0)

        def gone(t: float, y: Floats) -> float:
            return (
                float(self.rail_e @ (ecef_from_eci(y[:3], earth_angle(self.theta0, t)) - start_e))
                - self.card.rail.length
            )

        law = self._along_rail(free)
        if (
            float(self.rail_e @ rotation_i_e(self.theta0) @ (law(0.0, self.y)[3:6] - _acceleration_at_rest(self.y)))
            < 0.5
        ):
            raise InputError(f"{self.card.name}: the thrust of {stage.name!r} does not lift the rocket off its rail")
        self.keep(fly("rail", 0.0, self.y, law, stage.burn_time, _STEP, gone))
        self.events["rail_exit"] = self.t
        self.modes.append(Mode(self.t, self.card.weathercock, pointing.along_airspeed(self.right_e, self.theta0)))

    def _along_rail(self, free: Law) -> Law:
        """Return the rate under the force of the rail, from that of free motion."""

        def rate(t: float, y: Floats) -> Floats:
            out = free(t, y)
            rail = eci_from_ecef(self.rail_e, earth_angle(self.theta0, t))
            at_rest = _acceleration_at_rest(y) + 2.0 * np.cross([0.0, 0.0, OMEGA], earth_velocity(y[:3], y[3:6]))
            out[3:6] = rail * (rail @ (out[3:6] - at_rest)) + at_rest
            return out

        return rate

    def leg(self, name: str, duration: float, thrust: Thrust | None = None) -> None:
        """Fly on for a duration; where the air lets go of the body the stretch is cut and the attitude kept."""
        end = self.t + duration
        law = newton(self.air, thrust, self.theta0)

        def above(t: float, y: Floats) -> float:
            return height(t, y, self.theta0) - self.card.held_above

        while end - self.t > 1e-9:
            cut = None if self.held or above(self.t, self.y) >= 0.0 else above
            self.keep(fly(name, self.t, self.y, law, end - self.t, _STEP, cut))
            if not self.held and above(self.t, self.y) >= -1e-6:
                self.hold(self.axes())

    def axes(self) -> Floats:
        """Return the attitude C_b_i (3, 3) of now."""
        return np.asarray(matrices(pointing.attitude(self.modes, np.array([self.t]), self.y[None]))[0])

    def hold(self, C_b_i: Floats, start: float | None = None) -> None:
        """Keep an attitude in inertial space from `start` or now on."""
        self.held = True
        self.modes.append(Mode(self.t if start is None else start, self.card.turn_time, pointing.fixed_to_stars(C_b_i)))

    def turn(self, elevation: float, coast: float) -> None:
        """Turn to an elevation (rad) over the horizontal of a place `coast` seconds ahead, to be there in time."""
        there = fly("", self.t, self.y, newton(self.air, None, self.theta0), coast, _STEP)
        C_i_n = rotation_i_n(there.y[-1:, :3], np.array(earth_angle(self.theta0, there.t[-1])))[0]
        along = C_i_n @ earth_velocity(there.y[-1, :3], there.y[-1, 3:6])
        level = along[:2] / np.hypot(*along[:2]) * math.cos(elevation)
        x = C_i_n.T @ np.array([*level, -math.sin(elevation)])
        right = eci_from_ecef(self.right_e, earth_angle(self.theta0, there.t[-1]))
        self.hold(body_axes(x[None], right[None], np.zeros(1))[0], float(there.t[-1]) - self.card.turn_time)

    def burn(self, number: int, stage: SolidMotor) -> None:
        """Burn a stage out and drop it."""
        thrust = self.thrust(stage)
        if number > 1:
            self.events[f"stage{number}_ignition"] = self.t
        left = stage.burn_time - (self.t if number == 1 else 0.0)
        self.leg(f"stage {number} burn", left, thrust)
        self.events[f"stage{number}_cutoff"] = self.t
        if stage.separation_delay is not None:
            self.leg(f"stage {number} coast", stage.separation_delay)
            self.events[f"stage{number}_separation"] = self.t
            self.y[6] -= stage.dry

    def rise(self) -> None:
        """Coast to the apogee."""
        if climb(self.y) <= 0.0:
            raise InputError(f"{self.card.name}: the rocket is past its apogee before its last stage is done")
        law = newton(self.air, None, self.theta0)
        if not self.held:
            self.hold(self.axes())
        self.keep(fly("coast", self.t, self.y, law, _LONGEST, _STEP, lambda t, y: climb(y)))
        if climb(self.y) > 1.0:
            raise InputError(f"{self.card.name}: no apogee within {_LONGEST:g} s of the last stage")
        self.events["apogee"] = self.t

    def fall(self) -> None:
        """Coast down to the end, nose first again where there is air."""
        law = newton(self.air, None, self.theta0)
        if self.height - self.card.end_altitude < 1.0:
            raise InputError(f"{self.card.name}: the apogee is not above end_altitude")
        marks = [self.card.held_above] if self.card.end_altitude < self.card.held_above < self.height else []
        for mark in [*marks, self.card.end_altitude]:
            last = mark == self.card.end_altitude

            def above(t: float, y: Floats, mark: float = mark) -> float:
                return height(t, y, self.theta0) - mark

            found = fly("descent", self.t, self.y, law, _LONGEST, _STEP, above)
            if last:  # a whole second is the end of a tick at every rate
                whole = max(math.floor(found.t[-1]), math.ceil(self.t + 1e-6))
                found = fly("descent", self.t, self.y, law, whole - self.t, _STEP)
            self.keep(found)
            if not last:
                self.modes.append(Mode(self.t, self.card.turn_time, pointing.along_airspeed(self.right_e, self.theta0)))
        self.events["end"] = self.t

    @property
    def height(self) -> float:
        """Height of now, m."""
        return height(self.t, self.y, self.theta0)


def _acceleration_at_rest(y: Floats) -> Floats:
    """Return the acceleration (3,) of a point that rests on the Earth at a state's position."""
    return np.array([-OMEGA * OMEGA * y[0], -OMEGA * OMEGA * y[1], 0.0])


def _fly(card: SoundingFlight, elevation: float, turn: float | None, whole: bool = True) -> _Flight:
    """Fly with the rail at `elevation` and the last stage turned to `turn` (rad); to the apogee alone if not whole."""
    flight = _Flight(card, elevation)
    flight.leave_rail(card.stages[0])
    for number, stage in enumerate(card.stages, start=1):
        goal = stage.elevation if number < len(card.stages) or turn is None else turn
        if number > 1:
            if goal is not None:
                flight.turn(goal, stage.ignition_delay)
            flight.leg(f"coast before stage {number}", stage.ignition_delay)
        flight.burn(number, stage)
    flight.rise()
    if whole:
        flight.fall()
    return flight


def _solve(card: SoundingFlight) -> tuple[float, float | None]:
    """Return the rail's elevation and that of the last stage (rad; None: as it flies), solved for the apogee."""
    rail, wanted = card.rail.elevation, card.apogee
    if wanted is None:
        assert rail is not None
        return rail, None
    _Flight(card, rail or math.radians(80.0)).leave_rail(card.stages[0])  # refuses what does not, before the search

    def excess(elevation: float) -> float:
        start, turn = (elevation, None) if rail is None else (rail, elevation)
        try:
            return _fly(card, start, turn, whole=False).height - wanted
        except InputError:  # so low that it comes down before its last stage is done
            return -wanted

    low, high = (math.radians(60.0), math.radians(89.5)) if rail is None else (math.radians(-10.0), math.radians(80.0))
    try:
        found = float(brentq(excess, low, high, xtol=1e-7))
    except ValueError:
        raise InputError(
            f"{card.name}: an apogee of {wanted / 1e3:g} km is out of reach with elevations of "
            f"{math.degrees(low):g} to {math.degrees(high):g} deg"
        ) from None
    return (found, None) if rail is None else (rail, found)


def _max_q(flight: _Flight) -> tuple[float, float]:
    """Return time (s) and value (Pa) of the greatest dynamic pressure before the apogee."""
    best = (0.0, 0.0)
    for stretch in flight.stretches:
        if stretch.name in ("rail", "descent"):
            continue
        for t, y in zip(stretch.t.tolist(), stretch.y, strict=True):
            density = atmosphere(height(t, y, flight.theta0))[0]
            q = 0.5 * density * float(np.sum(earth_velocity(y[:3], y[3:6]) ** 2))
            best = max(best, (q, t))
    return best[1], best[0]


def _facts(card: SoundingFlight, flight: _Flight, max_q: float) -> dict[str, float | str]:
    """Return what the report says of the flight, SI."""
    apogee = next(s for s in flight.stretches if s.t[-1] == flight.events["apogee"])
    ends = [ecef_from_eci(y[:3], earth_angle(flight.theta0, t)) for t, y in ((0.0, flight.stretches[0].y[0]),
            (flight.t, flight.y))]  # fmt: skip
    return {
        "apogee_m": height(float(apogee.t[-1]), apogee.y[-1], flight.theta0),
        "rail_elevation_rad": flight.elevation,
        "azimuth_rad": card.rail.azimuth,
        "downrange_m": SEMI_MAJOR * math.acos(float(unit(ends[0]) @ unit(ends[1]))),
        "max_load_g": greatest_load(flight.stretches) / STANDARD_GRAVITY,
        "max_dynamic_pressure_pa": max_q,
    }
