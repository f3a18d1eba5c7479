"""A spinning sounding rocket: its card, and its flight along the rail, nose first through the air, and down."""

import math
from collections.abc import Callable, Iterator
from functools import cache
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field
from scipy.optimize import brentq

from lvnav_trade.kernels.earth import OMEGA, SEMI_MAJOR
from lvnav_trade.kernels.media.atmosphere import atmosphere
from lvnav_trade.quantities import frames
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import Angle, Area, Card, Length, Mass, Pause, TimeConstant
from lvnav_trade.trajectory.ascent.equations_of_motion import Drag
from lvnav_trade.trajectory.ascent.launch import pad_knots, site_phase
from lvnav_trade.trajectory.ascent.legs import pad_state, site_axes
from lvnav_trade.trajectory.ascent.vehicle_cards import STANDARD_GRAVITY, FlightCard, Site, refuse_drag_table
from lvnav_trade.trajectory.attitude_algebra import body_axes
from lvnav_trade.trajectory.disturbances import OscillationCard
from lvnav_trade.trajectory.flights.free_flight import (
    AttitudeLaw,
    FlightIntegration,
    Thrust,
    airspeed_direction,
    airspeed_law,
    attitude,
    climb,
    fly,
    greatest_load,
    height,
    inertial_law,
    knots,
    newton,
    phases,
)
from lvnav_trade.trajectory.flights.spin import SpinStep, spin_angle
from lvnav_trade.trajectory.truth import Trajectory, attitude_spline

_STEP = 0.25  # s between knots
_LONGEST = 3600.0  # s; longest coast: a rocket that has not come down by then is in orbit


class SolidMotor(Card):
    """A stage of a sounding rocket: constant mass flow over its burn, and the coasts before and after it."""

    name: str  # of the stage
    propellant: Annotated[Mass, Field(gt=0.0)]  # mass that burns
    dry: Annotated[Mass, Field(gt=0.0)] = Field(description="mass that is dropped with the stage")
    burn_time: TimeConstant  # of all the propellant
    specific_impulse: TimeConstant = Field(description="vacuum specific impulse")
    exit_area: Area = 0.0  # of the nozzle
    ignition_delay: Pause = Field(0.0, description="coast between separation of the stage below and ignition")
    separation_delay: Pause | None = Field(None, description="coast between cut-off and separation; none: it stays")
    elevation: Angle | None = Field(
        None,
        description="elevation to which the body is turned before ignition, in its plane of flight; none: no turn",
    )

    @property
    def flow(self) -> float:
        """Mass flow in kg/s."""
        return self.propellant / self.burn_time


class Rail(Card):
    """The rail that guides the rocket over its first metres."""

    azimuth: Angle
    elevation: Annotated[Angle, Field(gt=0.3, lt=1.5707)] | None = Field(
        None, description="elevation of the rail; none: solved for the apogee"
    )
    length: Annotated[Length, Field(gt=0.0)]


class SoundingFlight(FlightCard):
    """A trajectory of an unguided rocket: along a rail, nose first in the air, then stabilised by spin.

    The elevation of the rail is solved for the apogee (altitude over the ellipsoid). If that elevation is given, the
    elevation to which the body turns before the last stage is solved instead.
    """

    kind: Literal["sounding"] = "sounding"
    site: Site  # launch site
    rail: Rail  # launcher that guides the first metres
    stages: tuple[SolidMotor, ...] = Field(min_length=1)  # in order of ignition
    payload: Annotated[Mass, Field(gt=0.0)]  # mass above the last stage
    reference_area: Annotated[Area, Field(gt=0.0)] = Field(description="area that the drag coefficients refer to")
    mach: tuple[float, ...] = Field(min_length=2, description="Mach numbers of the drag table, increasing")
    drag_coefficient: tuple[float, ...] = Field(min_length=2)  # at the Mach numbers
    apogee: Annotated[Length, Field(gt=0.0)] | None = None  # altitude above the ellipsoid; none: elevations given
    weathercock: TimeConstant = Field(
        10.0, description="time after the rail in which aerodynamics align the body with the airflow"
    )
    held_above: Length = Field(
        60e3, description="height above which spin stabilises the attitude instead of aerodynamics"
    )
    turn_time: TimeConstant = Field(6.0, description="time to turn from one law of attitude to the next")
    spin: tuple[SpinStep, ...] = ()  # changes of the spin, in order
    end_altitude: Length = Field(
        100e3, description="height in the descent at which the flight ends, at the last whole second before it"
    )
    pad_hold: Pause = 60.0  # rest on the rail before lift-off
    oscillation: tuple[OscillationCard, ...] = Field((), description="coning and vibration, by parts of the flight")

    coast_after_injection: ClassVar[float] = 0.0  # the last event is the end

    def _faults(self) -> Iterator[str]:
        refuse_drag_table(self.mach, self.drag_coefficient)
        if self.rail.elevation is None and self.apogee is None:
            yield "give the rail's elevation or the apogee that it is to be solved for"
        is_solved = self.rail.elevation is not None and self.apogee is not None
        if is_solved and (len(self.stages) < 2 or self.stages[-1].elevation is not None):
            yield "the rail's elevation and the last stage's are stated: nothing is left for the apogee"
        if self.stages[0].elevation is not None:
            yield "the first stage starts from the rail: its elevation is that of the rail"
        if self.stages[0].ignition_delay > 0.0:
            yield "ignition_delay of the first stage has no effect: it ignites at lift-off; leave it out"
        for stage in self.stages[:-1]:
            if stage.separation_delay is None:
                yield f"stage {stage.name!r} stays, but another burns above it: give its separation_delay"
        for k, stage in enumerate(self.stages[1:], start=2):
            is_turned = stage.elevation is not None or (is_solved and k == len(self.stages))
            if is_turned and stage.ignition_delay < self.turn_time:
                yield f"stage {stage.name!r} is turned within turn_time, longer than its ignition_delay"


def launch(card: SoundingFlight) -> Trajectory:
    """Return the true trajectory of a sounding rocket; InputError if it does not rise or cannot reach its apogee."""
    flight = _ascend(card)
    flight.fall()
    pad_t = pad_knots(card.pad_hold, _STEP)
    flight_t, states = knots(flight.stretches)
    t = np.concatenate([pad_t, flight_t])
    y = np.concatenate([np.zeros((pad_t.size, 7)), states])
    q_b_i = attitude_spline(t, attitude(flight.modes, t, y))
    flight.events["max_q"], max_q = _max_q(flight)
    events = dict(sorted(flight.events.items(), key=lambda item: item[1]))
    roll_angle = spin_angle(card.spin, events, float(t[0]), float(t[-1]))
    pad = site_phase(card.site, flight.theta0, card.pad_hold, q_b_i, roll_angle)
    return Trajectory(
        phases=(*pad, *phases(flight.stretches, q_b_i, roll_angle)),
        events=events,
        theta0=flight.theta0,
        epoch=card.epoch,
        facts=_facts(card, flight, max_q),
    )


class _SoundingIntegration(FlightIntegration):
    def __init__(self, card: SoundingFlight, elevation: float) -> None:
        up, downrange, right = site_axes(card.site, card.rail.azimuth)
        self.card = card
        self.elevation = elevation
        self.right_e = right
        self.rail_e = math.cos(elevation) * downrange + math.sin(elevation) * up
        self.is_held = False  # whether spin stabilises the attitude
        theta0 = frames.gmst(card.epoch)
        liftoff_theta = float(frames.earth_angle(theta0, 0.0))
        r_i, v_i = pad_state(card.site, liftoff_theta)
        mass = card.payload + sum(stage.propellant + stage.dry for stage in card.stages)
        y = np.concatenate([r_i, v_i, [mass]])
        drag = Drag(
            area=card.reference_area,
            mach=np.array(card.mach),
            coefficient=np.array(card.drag_coefficient),
        )
        super().__init__(theta0, y, drag)
        rail_law = airspeed_law(right, theta0, at_rest=self.rail_e)
        self.modes.append(AttitudeLaw(start=-math.inf, slew=0.0, axes=rail_law))
        self.events["liftoff"] = 0.0

    def motor(self, stage: SolidMotor) -> Thrust:
        """Return the burning motor of a stage."""
        vacuum_thrust = stage.flow * STANDARD_GRAVITY * stage.specific_impulse
        return self.thrust(vacuum_thrust, stage.flow, stage.exit_area)

    def leave_rail(self, stage: SolidMotor) -> None:
        """Integrate the motion along the rail, whose force cancels all acceleration across it."""
        free_motion = newton(self.air, self.motor(stage), self.theta0)
        start_e = frames.ecef_from_eci(self.y[:3], self.theta0)

        def rate(t: float, y: Floats) -> Floats:
            out = free_motion(t, y)
            theta = frames.earth_angle(self.theta0, t)
            rail = frames.eci_from_ecef(self.rail_e, theta)
            # Centripetal and Coriolis acceleration of a point on the rotating rail
            velocity = frames.earth_velocity(y[:3], y[3:6])
            coriolis = 2.0 * np.cross([0.0, 0.0, OMEGA], velocity)
            frame_acceleration = _centripetal_acceleration(y) + coriolis
            relative_acceleration = out[3:6] - frame_acceleration
            along_rail = rail @ relative_acceleration
            out[3:6] = rail * along_rail + frame_acceleration
            return out

        def distance_to_end(t: float, y: Floats) -> float:
            theta = frames.earth_angle(self.theta0, t)
            way = frames.ecef_from_eci(y[:3], theta) - start_e
            return float(self.rail_e @ way) - self.card.rail.length

        start_rate = rate(0.0, self.y)
        acceleration = start_rate[3:6] - _centripetal_acceleration(self.y)
        acceleration_e = frames.rotation_i_e(self.theta0) @ acceleration
        if float(self.rail_e @ acceleration_e) < 0.5:
            raise InputError(f"{self.card.name}: the thrust of {stage.name!r} does not lift the rocket off its rail")
        self.append_phase(fly("rail", 0.0, self.y, rate, stage.burn_time, _STEP, distance_to_end))
        self.events["rail_exit"] = self.t
        self.nose_first(self.card.weathercock)

    def nose_first(self, slew: float) -> None:
        """Turn the x axis along the airspeed, within `slew` seconds."""
        axes = airspeed_law(self.right_e, self.theta0)
        self.modes.append(AttitudeLaw(start=self.t, slew=slew, axes=axes, nose=airspeed_direction))

    def leg(self, name: str, duration: float, thrust: Thrust | None = None) -> None:
        """Integrate for a duration (s); at the end of the aerodynamic phase the leg is cut and the attitude fixed."""
        end = self.t + duration
        height_condition = self.height_condition(self.card.held_above)
        while end - self.t > 1e-9:
            has_crossing = not self.is_held and height_condition(self.t, self.y) < 0.0
            end_condition = height_condition if has_crossing else None
            stretch = self.integrate_phase(name, end - self.t, _STEP, thrust, end_condition)
            self.append_phase(stretch)
            if not self.is_held and height_condition(self.t, self.y) >= -1e-6:
                self.hold(self.axes())

    def hold(self, C_b_i: Floats, start: float | None = None) -> None:
        """Keep an inertial attitude from `start` (s) on; None: from the present time on."""
        self.is_held = True
        law_start = self.t if start is None else start
        axes = inertial_law(C_b_i)
        nose = C_b_i[:, 0].copy()
        self.modes.append(AttitudeLaw(law_start, self.card.turn_time, axes, nose=lambda t, y: nose))

    def turn(self, elevation: float, coast: float) -> None:
        """Turn to an elevation (rad) above the local horizontal after `coast` seconds, by that time."""
        coast_ahead = self.integrate_phase("", coast, _STEP)
        end = coast_ahead.t[-1]
        y = coast_ahead.y[-1]
        r_i, v_i = y[:3], y[3:6]
        theta = frames.earth_angle(self.theta0, end)
        C_i_n = frames.rotation_i_n(r_i[None], np.array(theta))[0]
        airspeed_i = frames.earth_velocity(r_i, v_i)
        v_n = C_i_n @ airspeed_i
        horizontal_v = v_n[:2]
        heading = horizontal_v / np.hypot(*horizontal_v)
        horizontal = heading * math.cos(elevation)
        x_n = np.array([*horizontal, -math.sin(elevation)])
        x = C_i_n.T @ x_n
        right = frames.eci_from_ecef(self.right_e, theta)
        C_b_i = body_axes(x[None], right[None], np.zeros(1))[0]
        self.hold(C_b_i, float(end) - self.card.turn_time)

    def burn(self, number: int, stage: SolidMotor) -> None:
        """Burn a stage, and coast to its separation."""
        thrust = self.motor(stage)
        if number > 1:
            self.events[f"stage{number}_ignition"] = self.t
        time_on_rail = self.t if number == 1 else 0.0
        self.leg(f"stage {number} burn", stage.burn_time - time_on_rail, thrust)
        self.events[f"stage{number}_cutoff"] = self.t
        if stage.separation_delay is not None:
            self.leg(f"stage {number} coast", stage.separation_delay)
            self.events[f"stage{number}_separation"] = self.t
            self.y[6] -= stage.dry

    def fly_stage(self, number: int, stage: SolidMotor, elevation: float | None) -> None:
        """Coast to the ignition of a stage, burn it, and coast to its separation.

        elevation : rad. Elevation to which the body is turned before ignition; None: no turn.
        """
        if number > 1:
            if elevation is not None:
                self.turn(elevation, stage.ignition_delay)
            self.leg(f"coast before stage {number}", stage.ignition_delay)
        self.burn(number, stage)

    def rise(self) -> None:
        """Coast to the apogee."""
        if climb(self.y) <= 0.0:
            raise InputError(f"{self.card.name}: the rocket is past its apogee before its last stage is done")
        if not self.is_held:
            self.hold(self.axes())
        self.append_phase(self.integrate_phase("coast", _LONGEST, _STEP, end_condition=lambda t, y: climb(y)))
        if climb(self.y) > 1.0:
            raise InputError(f"{self.card.name}: no apogee within {_LONGEST:g} s of the last stage")
        self.events["apogee"] = self.t

    def fall(self) -> None:
        """Coast down to the end, nose first again in the air."""
        card = self.card
        if self.height - card.end_altitude < 1.0:
            raise InputError(f"{card.name}: the apogee is not above end_altitude")
        if card.end_altitude < card.held_above < self.height:
            air_condition = self.height_condition(card.held_above)
            self.append_phase(self.integrate_phase("descent", _LONGEST, _STEP, end_condition=air_condition))
            self.nose_first(card.turn_time)
        end_condition = self.height_condition(card.end_altitude)
        stretch = self.integrate_phase("descent", _LONGEST, _STEP, end_condition=end_condition)
        # a whole second is the end of a tick at every rate
        end = max(math.floor(stretch.t[-1]), math.ceil(self.t + 1e-6))
        self.append_phase(self.integrate_phase("descent", end - self.t, _STEP))
        self.events["end"] = self.t


def _centripetal_acceleration(y: Floats) -> Floats:
    """Return the acceleration (3,) of a point at rest on the rotating Earth, at the position of a state."""
    factor = -OMEGA * OMEGA
    return np.array([factor * y[0], factor * y[1], 0.0])


def _fly_lower_stages(card: SoundingFlight, elevation: float) -> _SoundingIntegration:
    """Return the flight up to the separation below the last stage, with the rail at `elevation` (rad)."""
    flight = _SoundingIntegration(card, elevation)
    flight.leave_rail(card.stages[0])
    for number, stage in enumerate(card.stages[:-1], start=1):
        flight.fly_stage(number, stage, stage.elevation)
    return flight


def _fly_last_stage(lower_flight: _SoundingIntegration, turn: float | None) -> _SoundingIntegration:
    """Return the flight up to its apogee, with the last stage turned to `turn` (rad; None: no turn)."""
    flight = lower_flight.branch()
    stages = flight.card.stages
    flight.fly_stage(len(stages), stages[-1], turn)
    flight.rise()
    return flight


def _ascend(card: SoundingFlight) -> _SoundingIntegration:
    """Return the flight up to its apogee, with the elevation of rail or last stage that reaches a stated apogee."""
    rail, apogee, turn = card.rail.elevation, card.apogee, card.stages[-1].elevation
    if apogee is None:
        assert rail is not None
        return _fly_last_stage(_fly_lower_stages(card, rail), turn)
    if rail is None:
        # A rocket that does not leave its rail is refused before the search.
        _SoundingIntegration(card, math.radians(80.0)).leave_rail(card.stages[0])
        bounds = (math.radians(60.0), math.radians(89.5))

        def fly_from_rail(elevation: float) -> _SoundingIntegration:
            return _fly_last_stage(_fly_lower_stages(card, elevation), turn)

        return _search(card, apogee, bounds, fly_from_rail)
    lower_flight = _fly_lower_stages(card, rail)
    bounds = (math.radians(-10.0), math.radians(80.0))
    return _search(card, apogee, bounds, lambda elevation: _fly_last_stage(lower_flight, elevation))


def _search(
    card: SoundingFlight,
    apogee: float,
    bounds: tuple[float, float],
    fly_to_apogee: Callable[[float], _SoundingIntegration],
) -> _SoundingIntegration:
    """Return the flight that reaches the apogee.

    Parameters
    ----------
    card : SoundingFlight
    apogee : float
        Height of the apogee (m).
    bounds : (2,)
        Lowest and highest elevation (rad).
    fly_to_apogee : function of an elevation (rad)
        Returns the flight up to its apogee.
    """
    fly_once = cache(fly_to_apogee)  # the solution is an elevation that the search has tried

    def excess_height(elevation: float) -> float:
        try:
            return fly_once(elevation).height - apogee
        except InputError:  # so low that it comes down before its last stage is done
            return -apogee

    low, high = bounds
    try:
        elevation = float(brentq(excess_height, low, high, xtol=1e-7))
    except ValueError:
        raise InputError(
            f"{card.name}: an apogee of {apogee / 1e3:g} km is out of reach with elevations of "
            f"{math.degrees(low):g} to {math.degrees(high):g} deg"
        ) from None
    return fly_once(elevation)


def _max_q(flight: _SoundingIntegration) -> tuple[float, float]:
    """Return time (s) and value (Pa) of the greatest dynamic pressure before the apogee."""
    max_q, max_q_time = 0.0, 0.0
    for stretch in flight.stretches:
        if stretch.name in ("rail", "descent"):
            continue
        for t, y in zip(stretch.t.tolist(), stretch.y, strict=True):
            density = atmosphere(height(t, y, flight.theta0))[0]
            airspeed = frames.earth_velocity(y[:3], y[3:6])
            square_speed = float(np.sum(airspeed**2))
            q = 0.5 * density * square_speed
            if (q, t) > (max_q, max_q_time):
                max_q, max_q_time = q, t
    return max_q_time, max_q


def _facts(card: SoundingFlight, flight: _SoundingIntegration, max_q: float) -> dict[str, float | str]:
    """Return the facts of a flight for the report, SI."""
    apogee_time = flight.events["apogee"]
    apogee = next(stretch for stretch in flight.stretches if stretch.t[-1] == apogee_time)
    apogee_height = height(float(apogee.t[-1]), apogee.y[-1], flight.theta0)
    begin_y = flight.stretches[0].y[0]
    begin_theta = frames.earth_angle(flight.theta0, 0.0)
    end_theta = frames.earth_angle(flight.theta0, flight.t)
    begin_e = frames.ecef_from_eci(begin_y[:3], begin_theta)
    end_e = frames.ecef_from_eci(flight.y[:3], end_theta)
    cosine = float(frames.unit(begin_e) @ frames.unit(end_e))
    central_angle = math.acos(cosine)
    return {
        "apogee_m": apogee_height,
        "rail_elevation_rad": flight.elevation,
        "azimuth_rad": card.rail.azimuth,
        "downrange_m": SEMI_MAJOR * central_angle,
        "max_load_g": greatest_load(flight.stretches) / STANDARD_GRAVITY,
        "max_dynamic_pressure_pa": max_q,
    }
