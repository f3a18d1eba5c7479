"""A launch vehicle and the ascent asked of it: the cards."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from lvnav_trade.units import Acceleration, Angle, AngularRate, Area, Card, Duration, Force, Length, Mass, Pause
from lvnav_trade.world.oscillation import OscillationCard

STANDARD_GRAVITY = 9.80665  # m/s^2, converts specific impulse in seconds to exhaust speed


class Stage(Card):
    """One stage: masses, engine and the pauses around its burn.

    Thrust at altitude is the vacuum thrust less ambient pressure times exit area, at a constant mass flow per throttle.
    """

    name: str
    propellant: Annotated[Mass, Field(gt=0.0)] = Field(description="usable propellant")
    dry: Annotated[Mass, Field(gt=0.0)] = Field(description="mass that stays behind when the stage is dropped")
    thrust: Force = Field(description="vacuum thrust at full throttle")
    specific_impulse: Annotated[Duration, Field(gt=0.0)] = Field(description="vacuum specific impulse")
    exit_area: Area = 0.0
    ignition_delay: Pause = Field(0.0, description="coast between separation of the stage below and ignition")
    separation_delay: Pause = Field(0.0, description="coast between cut-off and separation")


class Fairing(Card):
    """Payload fairing, released a while after a stage has lit."""

    mass: Mass
    stage: int = Field(2, ge=1, description="number of the stage that burns when it is released")
    after_ignition: Pause = Field(description="time between that ignition and the release")


class VehicleCard(Card):
    """A launch vehicle as a point mass with stages, drag and a load limit."""

    name: str
    source: str
    stages: tuple[Stage, ...] = Field(min_length=1)
    payload: Mass
    fairing: Fairing | None = None
    reference_area: Annotated[Area, Field(gt=0.0)] = Field(description="area that the drag coefficients refer to")
    mach: tuple[float, ...] = Field(min_length=2, description="Mach numbers of the drag table, rising")
    drag_coefficient: tuple[float, ...] = Field(min_length=2)
    max_load: Annotated[Acceleration, Field(gt=0.0)] = Field(
        description="thrust is throttled to stay below this specific force"
    )

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if len(self.mach) != len(self.drag_coefficient):
            raise ValueError(f"{len(self.mach)} Mach numbers but {len(self.drag_coefficient)} drag coefficients")
        if any(later <= earlier for earlier, later in zip(self.mach, self.mach[1:], strict=False)):
            raise ValueError("mach must rise from entry to entry")
        if self.fairing is not None and self.fairing.stage > len(self.stages):
            raise ValueError(f"the fairing is released in stage {self.fairing.stage} of {len(self.stages)}")
        return self


class Site(Card):
    """Launch site: geodetic latitude, longitude and height of the IMU on the pad, WGS-84."""

    latitude: Annotated[Angle, Field(ge=-1.5707963267948966, le=1.5707963267948966)]
    longitude: Angle
    height: Length = 0.0


class Orbit(Card):
    """Osculating orbit: altitudes above the equatorial radius, and inclination to the true equator."""

    perigee: Length
    apogee: Length
    inclination: Angle
    direction: Literal["ascending", "descending"] = Field("ascending", description="sense of the pass over the site")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.apogee < self.perigee:
            raise ValueError("apogee lies below perigee")
        return self


class Parking(Card):
    """Transfer orbit: the last stage cuts off at its perigee, coasts to the target's apogee and lights again."""

    perigee: Length


class Roll(Card):
    """Roll programme: angle on the pad, and the rate-limited manoeuvre to the roll angle of flight.

    Zero roll: y axis to the right of the flight plane, hence z downrange on the pad and down in level flight.
    """

    pad: Angle = 0.0
    flight: Angle = 0.0
    start: Duration = 5.0
    rate: AngularRate = Field(0.05235987755982988, gt=0.0, description="greatest roll rate")  # 3 deg/s


class VehicleAscent(Card):
    """A trajectory flown by a vehicle card: from the pad to a target orbit, its steering solved for."""

    kind: Literal["vehicle"] = "vehicle"
    name: str
    source: str
    epoch: str = Field(description="lift-off, ISO 8601 UTC")
    vehicle: VehicleCard
    site: Site
    target: Orbit
    parking: Parking | None = Field(None, description="none: one burn of the last stage straight into the target")
    pad_hold: Pause = 60.0
    vertical_rise: Annotated[Duration, Field(gt=0.0)] = 8.0
    kick_duration: Annotated[Duration, Field(gt=0.0)] = 8.0
    kick_angle: Annotated[Angle, Field(gt=0.0)] | None = Field(
        None, description="none: chosen for the least propellant"
    )
    steered_from: int = Field(2, ge=2, description="number of the first stage that follows the linear-tangent law")
    slew: Annotated[Duration, Field(gt=0.0)] = Field(12.0, description="time to turn from one steering law to the next")
    roll: Roll = Roll()
    coast_after_injection: Annotated[Duration, Field(gt=0.0)] = 20.0
    oscillation: tuple[OscillationCard, ...] = Field((), description="coning and vibration, by parts of the flight")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if len(self.vehicle.stages) < 2:
            raise ValueError("an ascent to orbit is built for two stages or more")
        if self.steered_from > len(self.vehicle.stages):
            raise ValueError(f"steered_from is {self.steered_from}, the vehicle has {len(self.vehicle.stages)} stages")
        if self.parking is not None and self.parking.perigee > self.target.perigee:
            raise ValueError("the perigee of the parking orbit lies above that of the target")
        return self
