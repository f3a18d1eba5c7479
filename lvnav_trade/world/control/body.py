"""A launch vehicle as a body that turns: inertia, nozzle, aerodynamic moment, thrusters of the coast; the cards."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from lvnav_trade.units import Angle, AngleSigma, AngularRate, Card, Force, Fraction, Length, TimeConstant

Floats = NDArray[np.float64]

_UNIFORM = 0.28867513459481287  # radius of gyration of a uniform rod, in its lengths: 1 / sqrt(12)


class Nozzle(Card):
    """A thrust nozzle on two axes and its actuators: a first-order lag within limits of rate and deflection."""

    time_constant: TimeConstant
    rate_limit: Annotated[AngularRate, Field(gt=0.0)]
    deflection_limit: Annotated[Angle, Field(gt=0.0, lt=1.0)]
    misalignment: AngleSigma = Field(0.0, description="of the thrust, constant over a burn, per axis")


class Thrusters(Card):
    """Pairs of lateral thrusters that hold the attitude while no motor burns: on or off, with a dead band.

    They open where attitude error plus `lead` times rate error leaves the dead band, and close within the part
    `release` of it.
    """

    force: Force = Field(description="of a pair that turns the vehicle about one axis")
    arm: Annotated[Length, Field(gt=0.0)] = Field(description="from the centre of mass, in every stack")
    dead_band: Annotated[Angle, Field(gt=0.0)]
    lead: TimeConstant
    release: float = Field(0.5, ge=0.0, lt=1.0)


class Stack(Card):
    """The vehicle while one stage is the lowest: a body of a length, whose mass is that of the ascent."""

    length: Annotated[Length, Field(gt=0.0)]
    gyration: Annotated[Fraction, Field(gt=0.0)] = Field(
        _UNIFORM, description="radius of gyration across the axis, in lengths; none: a uniform rod"
    )
    nozzle_arm: Annotated[Fraction, Field(gt=0.0, le=1.0)] = Field(
        0.5, description="nozzle's throat behind the centre of mass, in lengths"
    )
    normal_force: float = Field(0.0, ge=0.0, description="slope of the normal-force coefficient, per rad")
    pressure_arm: float = Field(
        0.0, ge=-1.0, le=1.0, description="centre of pressure ahead of the centre of mass, in lengths: unstable above 0"
    )


class RotationCard(Card):
    """How a launch vehicle turns in pitch and yaw, about the ascent of its vehicle card.

    Roll is held; the axes do not couple. Bending, sloshing, jet damping and the nozzle's own inertia are left out.
    """

    name: str
    source: str
    stacks: tuple[Stack, ...] = Field(min_length=1, description="one for each stage, from the first")
    nozzle: Nozzle
    thrusters: Thrusters

    @model_validator(mode="after")
    def _tight(self) -> Self:
        if self.nozzle.misalignment > self.nozzle.deflection_limit:
            raise ValueError("the misalignment of the thrust exceeds the limit of deflection")
        return self

    def inertia(self, number: int, mass: Floats) -> Floats:
        """Return moments of inertia (n,) in kg m^2 across the axis, of the stack of stage `number` (from 1), at masses
        (n,) in kg.
        """
        stack = self.stacks[number - 1]
        return np.asarray(mass * (stack.gyration * stack.length) ** 2)
