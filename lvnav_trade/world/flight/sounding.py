"""A spinning sounding rocket: its card, and how fast it spins when."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator
from scipy.interpolate import PPoly

from lvnav_trade.errors import InputError
from lvnav_trade.units import Angle, Area, Card, Epoch, Length, Mass, Pause, TimeConstant, TurnRate
from lvnav_trade.world.ascent.vehicle import Site
from lvnav_trade.world.events import resolve
from lvnav_trade.world.oscillation import OscillationCard


def _turns(value: Any) -> Any:
    """Refuse an angle per time: as a frequency it would be taken for turns, 6 times too fast."""
    if isinstance(value, str) and ("rad" in value or "deg" in value):
        raise ValueError(f"{value!r}: turns per second are asked for, in Hz")
    return value


class SolidMotor(Card):
    """A stage of a sounding rocket: constant mass flow over its burn, and the pauses around it."""

    name: str
    propellant: Annotated[Mass, Field(gt=0.0)]
    dry: Annotated[Mass, Field(gt=0.0)] = Field(description="mass that falls away with it")
    burn_time: TimeConstant
    specific_impulse: TimeConstant = Field(description="vacuum specific impulse")
    exit_area: Area = 0.0
    ignition_delay: Pause = Field(0.0, description="coast between separation of the stage below and ignition")
    separation_delay: Pause | None = Field(None, description="coast between cut-off and separation; none: it stays")
    elevation: Angle | None = Field(
        None,
        description="the body is turned to this elevation before ignition, in its plane of flight; none: it is not",
    )


class Rail(Card):
    """The launcher that guides the rocket's first metres."""

    azimuth: Angle
    elevation: Annotated[Angle, Field(gt=0.3, lt=1.5707)] | None = Field(
        None, description="none: solved for the apogee"
    )
    length: Annotated[Length, Field(gt=0.0)]


class SpinStep(Card):
    """A change of the spin, such as canted fins or a yo-yo bring about: smooth, over a time."""

    at: str = Field(description="event of the flight, with a duration added or not, or a time since lift-off")
    frequency: Annotated[TurnRate, BeforeValidator(_turns)] = Field(
        description="turns per second about the x axis from then on"
    )
    over: TimeConstant


class SoundingFlight(Card):
    """A trajectory of an unguided rocket that leaves a rail, flies nose first and then keeps its attitude by spin.

    The apogee, an altitude over the ellipsoid, asks for the rail's elevation, or where that is stated for the elevation
    to which the body is turned before the last stage.
    """

    kind: Literal["sounding"] = "sounding"
    name: str
    source: str
    epoch: Epoch = Field(description="lift-off, ISO 8601 UTC")
    site: Site
    rail: Rail
    stages: tuple[SolidMotor, ...] = Field(min_length=1)
    payload: Annotated[Mass, Field(gt=0.0)]
    reference_area: Annotated[Area, Field(gt=0.0)] = Field(description="area that the drag coefficients refer to")
    mach: tuple[float, ...] = Field(min_length=2, description="Mach numbers of the drag table, rising")
    drag_coefficient: tuple[float, ...] = Field(min_length=2)
    apogee: Annotated[Length, Field(gt=0.0)] | None = None
    weathercock: TimeConstant = Field(
        10.0, description="time after the rail in which the air takes hold of the body and turns it into the wind"
    )
    held_above: Length = Field(60e3, description="height above which spin, not air, holds the attitude")
    turn_time: TimeConstant = Field(6.0, description="time to turn from one law of attitude to the next")
    spin: tuple[SpinStep, ...] = ()
    end_altitude: Length = Field(100e3, description="of the descent, where the flight ends, at a whole second before")
    pad_hold: Pause = 60.0
    oscillation: tuple[OscillationCard, ...] = Field((), description="coning and vibration, by parts of the flight")

    @property
    def coast_after_injection(self) -> float:
        """Time between the last event and the end of the flight: the last event is the end."""
        return 0.0

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if len(self.mach) != len(self.drag_coefficient):
            raise ValueError(f"{len(self.mach)} Mach numbers but {len(self.drag_coefficient)} drag coefficients")
        if any(later <= earlier for earlier, later in pairwise(self.mach)):
            raise ValueError("mach must rise from entry to entry")
        if self.rail.elevation is None and self.apogee is None:
            raise ValueError("give the rail's elevation or the apogee that it is to be solved for")
        solved = self.rail.elevation is not None and self.apogee is not None
        if solved and (len(self.stages) < 2 or self.stages[-1].elevation is not None):
            raise ValueError("the rail's elevation and the last stage's are stated: nothing is left for the apogee")
        if self.stages[0].elevation is not None:
            raise ValueError("the first stage starts from the rail: its elevation is that of the rail")
        for stage in self.stages[:-1]:
            if stage.separation_delay is None:
                raise ValueError(f"stage {stage.name!r} stays, but another burns above it: give its separation_delay")
        for k, stage in enumerate(self.stages[1:], start=2):
            turned = stage.elevation is not None or (solved and k == len(self.stages))
            if turned and stage.ignition_delay < self.turn_time:
                raise ValueError(f"stage {stage.name!r} is turned within turn_time, longer than its ignition_delay")
        return self


def spin_angle(steps: tuple[SpinStep, ...], events: dict[str, float], start: float, end: float) -> PPoly | None:
    """Return the roll angle (rad) over start to end (s) of a spin that begins with none; None where it stays so."""
    if not steps:
        return None
    times, rows, before = [start - 1.0], [], 0.0
    for step in steps:
        at = resolve(step.at, events)
        if at < times[-1] or at + step.over > end:
            raise InputError(f"spin: the step at {step.at!r} overlaps the one before, or lies outside the flight")
        change, d = step.frequency - before, step.over
        rows += [
            [0.0] * 5 + [before],
            [6.0 * change / d**5, -15.0 * change / d**4, 10.0 * change / d**3, 0.0, 0.0, before],
        ]
        times += [at, at + d]
        before = step.frequency
    rows.append([0.0] * 5 + [before])
    rate = PPoly(2.0 * math.pi * np.array(rows).T, np.array([*times, end + 1.0]))
    return rate.antiderivative()
