"""Cards of a launch vehicle and its ascent."""

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from lvnav_trade.kernels.earth import GM, J2, SEMI_MAJOR
from lvnav_trade.quantities import units
from lvnav_trade.quantities.conditions import Instant
from lvnav_trade.quantities.units import Card, parse, require_rising
from lvnav_trade.trajectory.ascent.dispersion_card import Dispersion, DispersionsCard
from lvnav_trade.trajectory.control_cards import SteeredCard
from lvnav_trade.trajectory.disturbances import OscillationCard

STANDARD_GRAVITY = 9.80665  # m/s^2, converts specific impulse in seconds to exhaust speed


def refuse_drag_table(mach: tuple[float, ...], coefficient: tuple[float, ...]) -> None:
    """Raise ValueError if Mach numbers and drag coefficients are not a table: lengths differ, or Mach does not rise."""
    if len(mach) != len(coefficient):
        raise ValueError(f"{len(mach)} Mach numbers but {len(coefficient)} drag coefficients")
    require_rising("mach", mach)


class ThrustProfile(Card):
    """Shape of the thrust of a solid motor over its burn, linear between points.

    Only the shape is used: the mean thrust follows from propellant, specific impulse and burn time.
    """

    part: tuple[units.Share, ...] = Field(
        min_length=2, description="fractions of the burn time, from 0 to 1, increasing"
    )
    thrust: tuple[Annotated[float, Field(gt=0.0)], ...] = Field(description="relative vacuum thrust at these times")

    def _faults(self) -> Iterator[str]:
        if len(self.part) != len(self.thrust):
            yield f"{len(self.part)} parts of the burn but {len(self.thrust)} thrusts"
        if self.part[0] != 0.0 or self.part[-1] != 1.0 or any(b <= a for a, b in pairwise(self.part)):
            yield "part must rise from 0 to 1"


class Motor(Card):
    """Masses and engine of a stage or booster. Either the thrust or the burn time is given, and the other follows.

    Thrust at altitude is the vacuum thrust minus ambient pressure times exit area. A motor given by its thrust can be
    throttled at constant specific impulse. A motor given by its burn time burns exactly that long, with a mean thrust.
    """

    name: str  # of the stage or booster
    propellant: Annotated[units.Mass, Field(gt=0.0)] = Field(description="usable propellant")
    dry: Annotated[units.Mass, Field(gt=0.0)] = Field(description="mass that is dropped at separation")
    thrust: units.Force | None = Field(None, description="vacuum thrust at full throttle")
    burn_time: units.TimeConstant | None = Field(None, description="time to burn all the propellant")
    specific_impulse: units.TimeConstant = Field(description="vacuum specific impulse")
    exit_area: units.Area = 0.0  # of the nozzle
    profile: ThrustProfile | None = Field(None, description="shape of the thrust over the burn; none: constant thrust")
    separation_delay: units.Pause = Field(0.0, description="coast between cut-off and separation")

    def _faults(self) -> Iterator[str]:
        if (self.thrust is None) == (self.burn_time is None):
            yield "give the thrust or the burn time, one of the two"
        if self.profile is not None and self.burn_time is None:
            yield "a thrust profile needs the burn time: a motor that is throttled has none"

    @property
    def full_thrust(self) -> float:
        """Vacuum thrust in N: at full throttle, or the mean over the burn."""
        if self.thrust is not None:
            return self.thrust
        assert self.burn_time is not None
        return self.propellant * STANDARD_GRAVITY * self.specific_impulse / self.burn_time

    @property
    def exhaust_speed(self) -> float:
        """Effective exhaust speed in vacuum, m/s."""
        return STANDARD_GRAVITY * self.specific_impulse

    @property
    def full_burn(self) -> float:
        """Burn time of all propellant without throttling, s."""
        return self.propellant * STANDARD_GRAVITY * self.specific_impulse / self.full_thrust


class Stage(Motor):
    """A stage, and the coast before its ignition."""

    ignition_delay: units.Pause = Field(0.0, description="coast between separation of the stage below and ignition")


class Boosters(Motor):
    """A group of equal strap-on motors that burn together with the first stage; masses and thrust are of one motor."""

    name: str = Field(
        pattern="^[a-z][a-z0-9_]*$", description="name of the group; the names of its events start with it"
    )
    number: int = Field(ge=1, description="number of boosters in the group")
    ignition: units.Pause = Field(0.0, description="time between lift-off and ignition")

    @property
    def separation_time(self) -> float:
        """Time of separation, s since lift-off."""
        return self.ignition + self.full_burn + self.separation_delay


class Fairing(Card):
    """Payload fairing, released at a time after the ignition of a stage."""

    mass: units.Mass
    stage: int = Field(2, ge=1, description="number of the stage that burns when the fairing is released")
    after_ignition: units.Pause = Field(description="time between the ignition of that stage and the release")


class VehicleCard(units.NamedCard):
    """A launch vehicle as a point mass with stages, strap-on boosters, drag and a load limit."""

    stages: tuple[Stage, ...] = Field(min_length=1)  # from the first
    boosters: tuple[Boosters, ...] = Field((), description="groups of strap-on boosters of the first stage")
    payload: units.Mass  # above the last stage
    fairing: Fairing | None = None  # none: nothing is released
    reference_area: Annotated[units.Area, Field(gt=0.0)] = Field(description="area that the drag coefficients refer to")
    mach: tuple[float, ...] = Field(min_length=2, description="Mach numbers of the drag table, increasing")
    drag_coefficient: tuple[float, ...] = Field(min_length=2)  # at the Mach numbers
    max_load: units.AccelerationLimit | None = Field(
        None,
        description="largest specific force; engines that can be throttled are throttled to stay below it; none: no "
        "throttling",
    )
    dispersions: DispersionsCard | None = Field(
        None,
        description="one-sigma dispersions from vehicle to vehicle",
    )

    def _faults(self) -> Iterator[str]:
        refuse_drag_table(self.mach, self.drag_coefficient)
        if self.stages[0].ignition_delay > 0.0:
            yield "ignition_delay of the first stage has no effect: it ignites at lift-off; leave it out"
        if self.fairing is not None and self.fairing.stage > len(self.stages):
            yield f"the fairing is released in stage {self.fairing.stage} of {len(self.stages)}"
        if self.fairing is not None and self.fairing.stage < len(self.stages):
            fairing_stage = self.stages[self.fairing.stage - 1]
            if self.fairing.after_ignition >= fairing_stage.full_burn:
                burn_time = fairing_stage.full_burn
                yield f"stage {fairing_stage.name!r} burns out after {burn_time:.1f} s, before the fairing goes"
        names = [group.name for group in self.boosters]
        if len(set(names)) < len(names):
            yield f"two groups of boosters share a name: {', '.join(names)}"
        for group in self.boosters:
            if group.separation_time >= self.stages[0].full_burn:
                yield (
                    f"boosters {group.name!r} are dropped {group.separation_time:.1f} s after lift-off, the first "
                    f"stage burns out after {self.stages[0].full_burn:.1f} s"
                )


class Site(Card):
    """Launch site: geodetic latitude, longitude and height of the IMU on the pad, WGS-84."""

    latitude: Annotated[units.Angle, Field(ge=-1.5707963267948966, le=1.5707963267948966)]
    longitude: units.Angle
    height: units.Length = 0.0


class Orbit(Card):
    """Osculating orbit: altitudes above the equatorial radius, and inclination to the true equator."""

    perigee: units.Length
    apogee: units.Length
    inclination: units.Angle = Field(description="inclination, or the word sun-synchronous")
    direction: Literal["ascending", "descending"] = Field(
        "ascending", description="direction of the pass over the site"
    )
    anomaly: Annotated[units.Angle, Field(ge=0.0, lt=1.5707963267948966)] = Field(
        0.0,
        description="true anomaly of injection; zero: perigee. A last stage of low thrust needs less propellant if it"
        " is injected past the perigee",
    )

    @model_validator(mode="before")
    @classmethod
    def _sun_synchronous(cls, data: Any) -> Any:
        if not isinstance(data, dict) or data.get("inclination") != "sun-synchronous":
            return data
        try:
            low, high = (parse(str(data[key]), "m") for key in ("perigee", "apogee"))
        except (KeyError, ValueError):
            return data  # the error is reported for that field
        return {**data, "inclination": f"{sun_synchronous(low, high)!r} rad"}

    def _faults(self) -> Iterator[str]:
        if self.apogee < self.perigee:
            yield "apogee lies below perigee"


def sun_synchronous(perigee: float, apogee: float) -> float:
    """Return the inclination in rad at which the node of an orbit (altitudes in m) follows the mean Sun.

    The mean precession of the node due to J2, -3/2 J2 n (a_e / p)^2 cos i (Kaula 1966), is one turn in a tropical year.
    ValueError if there is no such inclination.
    """
    a = SEMI_MAJOR + 0.5 * (perigee + apogee)
    eccentricity = 0.5 * (apogee - perigee) / a
    p = a * (1.0 - eccentricity**2)
    year = 365.24219 * 86400.0
    mean_motion = math.sqrt(GM / a**3)
    polar_drift = 1.5 * J2 * mean_motion * (SEMI_MAJOR / p) ** 2
    cosine = -2.0 * math.pi / year / polar_drift
    if cosine < -1.0:
        raise ValueError(f"no orbit of {perigee / 1e3:.0f} x {apogee / 1e3:.0f} km is sun-synchronous")
    return math.acos(cosine)


class Parking(Card):
    """Parking orbit: a stage cuts off at its perigee and coasts to the target's apogee, where the last stage burns.

    The stage that cuts off is the last stage, which is then ignited a second time, or the stage below it, which is
    separated before the coast.
    """

    perigee: units.Length
    stage: int | None = Field(
        None, ge=2, description="number of the stage that reaches the parking orbit; none: the last"
    )


class FlightRecords(Card):
    """Records of such a flight, with which the facts of the trajectory compare it."""

    source: str
    file: str | None = Field(
        None, description="CSV of time, Earth-relative speed and altitude", json_schema_extra={"path": True}
    )
    events: dict[str, units.Duration] = Field(default={}, description="times of the trajectory's events, from lift-off")


class Roll(Card):
    """Roll programme: angle on the pad, and the rate-limited manoeuvre to the roll angle of flight.

    Zero roll: y axis to the right of the flight plane, hence z downrange on the pad and down in level flight.
    """

    pad: units.Angle = 0.0
    flight: units.Angle = 0.0
    start: units.Duration = 5.0
    rate: units.AngularRate = Field(0.05235987755982988, gt=0.0, description="largest roll rate")  # 3 deg/s

    def _faults(self) -> Iterator[str]:
        idle_fields = [
            name for name in ("start", "rate") if getattr(self, name) != type(self).model_fields[name].default
        ]
        if self.pad == self.flight and idle_fields:
            yield f"{' and '.join(idle_fields)}: no effect: pad and flight have the same roll angle; change or omit one"


class FlightCard(units.NamedCard):
    """Base of the cards of all trajectories."""

    kind: str
    epoch: units.Epoch = Field(description="lift-off, ISO 8601 UTC")
    named_times: dict[str, Instant] = Field(
        {},
        description="further events by names of your choice: '60 s', or 'stage1_cutoff + 20 s'; faults and statements"
        " can name them, and runs are stored at these times",
    )


class VehicleAscent(FlightCard):
    """An ascent of a vehicle from the pad to a target orbit, for which the steering is solved."""

    kind: Literal["vehicle"] = "vehicle"
    vehicle: VehicleCard  # stages, boosters, fairing and payload
    site: Site  # launch site
    target: Orbit  # orbit at injection
    parking: Parking | None = Field(
        None, description="parking orbit; none: one burn of the last stage directly into the target orbit"
    )
    azimuth: units.Angle | None = Field(
        None, description="prescribed launch azimuth; the steered stages then turn the orbit plane"
    )
    dispersion: Dispersion | None = Field(
        None, description="off-nominal vehicle, with the steering that is solved for the vehicle of the card"
    )
    guidance: Literal["nominal", "open_loop", "explicit", "schuler"] = Field(
        "nominal",
        description="nominal: every run has the nominal ascent; open_loop: the nominal attitude programme, followed "
        "by the navigated attitude; explicit: the last stage is steered by the navigated state; schuler: the same, "
        "with the gravity over the rest of the burn in closed form, proportional to the radius",
        json_schema_extra={"digest_if_set": True},
    )
    cutoff: Literal["energy", "time"] = Field(
        "energy",
        description="cut-off of the last stage with guidance: at the energy of the target orbit by the navigated "
        "state, or at the nominal time",
        json_schema_extra={"digest_if_set": True},
    )
    recorded: FlightRecords | None = Field(None, description="recorded flight to compare with")
    pad_hold: units.Pause = 60.0  # rest on the pad before lift-off
    vertical_rise: units.TimeConstant = 8.0  # time from lift-off to the kick
    kick_duration: units.TimeConstant = 8.0  # time of the tilt from vertical
    kick_angle: units.AngleLimit | None = Field(
        None, description="angle of the kick; none: the angle that needs least propellant"
    )
    steered_from: int = Field(2, ge=2, description="number of the first stage that follows the linear-tangent law")
    slew: units.TimeConstant = Field(12.0, description="time to turn from one steering law to the next")
    roll: Roll = Roll()  # roll angle on the pad and in flight
    coast_after_injection: units.TimeConstant = 20.0  # time from injection to the end of the flight
    oscillation: tuple[OscillationCard, ...] = Field((), description="coning and vibration, by parts of the flight")
    control: SteeredCard | None = Field(
        None,
        description="wind and attitude control of the ascent, with guidance of every run; none: ideal attitude",
    )
    attitude_lag: Annotated[units.TimeConstant, Field(ge=0.01)] | None = Field(
        None,
        description="time constant with which the attitude follows a command, with guidance; none: immediately",
        json_schema_extra={"digest_if_set": True},
    )

    def _faults(self) -> Iterator[str]:
        if len(self.vehicle.stages) < 2:
            yield "an ascent to orbit is built for two stages or more"
        if self.steered_from > len(self.vehicle.stages):
            yield f"steered_from is {self.steered_from}, the vehicle has {len(self.vehicle.stages)} stages"
        if self.parking is not None and self.parking.perigee > self.target.perigee:
            yield "the perigee of the parking orbit lies above that of the target"
        if self.parking is not None and self.target.anomaly != 0.0:
            yield "by a parking orbit the target is reached at its apogee: its anomaly cannot be chosen"
        n_stage = len(self.vehicle.stages)
        if self.insertion_stage not in (n_stage - 1, n_stage) or self.insertion_stage < self.steered_from:
            yield (
                f"the parking orbit is reached by stage {self.insertion_stage}; of {n_stage} stages it must be one of "
                f"the last two, and steered (from {self.steered_from})"
            )
        last = self.vehicle.stages[-1]
        if self.control is not None:
            yield from self.control.misfits(n_stage)
        if last.separation_delay != 0.0:
            yield f"separation_delay of stage {last.name!r} has no effect: the last stage does not separate; omit it"
        if self.target.anomaly != 0.0 and self.target.perigee == self.target.apogee:
            yield "anomaly has no effect: a circular target has no perigee to count it from; leave it out"
        if self.parking is not None and last.profile is not None:
            yield f"stage {last.name!r} burns as long as guidance requires, so it cannot have a thrust profile"
        yield from self._unguided_faults() if self.guidance == "nominal" else self._guided_faults()

    def _unguided_faults(self) -> Iterator[str]:
        if self.dispersion is not None and (self.dispersion.sigmas or self.dispersion.drawn_sources):
            yield "dispersion: sigmas and draw need guidance: open_loop, explicit or schuler"
        if self.cutoff != "energy":
            yield "cutoff: has no effect without guidance: give guidance: open_loop, explicit or schuler"
        if self.attitude_lag is not None:
            yield "attitude_lag: has no effect without guidance: give guidance: open_loop, explicit or schuler"

    def _guided_faults(self) -> Iterator[str]:
        if self.parking is not None:
            yield (
                f"guidance: {self.guidance} steers one burn into the target; with a parking orbit give guidance: "
                "nominal, or leave parking out"
            )
        if self.oscillation:
            yield f"oscillation: with guidance: {self.guidance} the body does not oscillate; leave it out"
        if self.control is not None:
            yield from self.control.guidance_faults(self.guidance)
            if self.attitude_lag is not None:
                yield "attitude_lag: control also states the response of the attitude; omit one of them"
        if self.dispersion is not None:
            yield from self.dispersion.misfits(self.vehicle.dispersions)
            if self.dispersion.pitch_program != 0.0:
                yield "dispersion.pitch_program: has no effect with guidance; leave it out"

    @property
    def insertion_stage(self) -> int:
        """Number of the stage that is cut off in orbit: the target orbit, or the parking orbit."""
        return len(self.vehicle.stages) if self.parking is None or self.parking.stage is None else self.parking.stage
